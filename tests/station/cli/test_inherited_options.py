"""Options before a command: each command takes them, or says in a usage error that they do not apply to it."""

import json
import os
import select
import subprocess
import sys

import click
import pytest

from station.__main__ import main
from station.cli.terminal.inherited import INSTEAD, InheritedOption, inherited
from station.cli.terminal.lazy import LazyGroup
from tests.program import run

from ..sessions.test_index import make
from .test_help import CONTEXTS

COMMANDS = {path: one.command for path, one in CONTEXTS.items()}
OPTIONS = {option.opts[-1]: option for option in main.params if option.expose_value}
OPEN_A_BENCH = ["focus", "session resume", "devices", "serve"]
OF_A_CHART = ["pattern", "psf pattern", "psf witnessed", "psf series", "psf field", "geometry", "tilt", "focus"]
HAVE_ANOTHER = [
    *(f"{words} --seed" for words in OF_A_CHART),
    *(f"{words} --plan" for words in ("session list", "session trend")),
]
"""Commands with an option of the same name and another meaning."""


def taken_by(flag):
    """The command's parameter that takes the option, by command."""
    names = {}
    for words, command in COMMANDS.items():
        for option in command.params:
            if isinstance(option, InheritedOption) and option.inherits == flag:
                names[words] = option.name
    return names


def words_for(option, folder):
    """The option with a value that is not its default."""
    if option.is_flag:
        return [option.opts[-1]]
    if isinstance(option.type, click.Path):
        path = folder / "named"
        path.mkdir() if "--sessions" in option.opts else path.touch()
        return [option.opts[-1], str(path)]
    return [option.opts[-1], option.type.choices[-1] if isinstance(option.type, click.Choice) else "7"]


@pytest.fixture
def called(monkeypatch):
    """called(command): its parameters once it is called, in place of what it does; nothing is required of it."""

    def watch(command):
        received = []
        monkeypatch.setattr(command, "callback", lambda **parameters: received.append(parameters))
        for one in command.params:
            monkeypatch.setattr(one, "required", False)
        return received

    return watch


@pytest.mark.parametrize("flag", OPTIONS)
@pytest.mark.parametrize("words", COMMANDS)
def test_a_command_takes_an_option_before_it_or_refuses_it(called, tmp_path, words, flag):
    given = words_for(OPTIONS[flag], tmp_path)
    received = called(COMMANDS[words])
    done = run(*given, *words.split(), code=None)
    if name := taken_by(flag).get(words):
        assert done.exit_code == 0, done.stderr
        context = main.make_context("station", list(given), resilient_parsing=True)
        assert received[0][name] == context.params[OPTIONS[flag].name]
    else:
        assert (done.exit_code, received) == (2, [])
        assert f"{flag} does not apply to `station {words}`: " in done.stderr
        assert "leave " in done.stderr or "write " in done.stderr


def test_every_command_that_opens_a_bench_inherits_the_options_of_benches():
    assert list(taken_by("--simulate")) == OPEN_A_BENCH
    assert set(taken_by("--config")) >= set(OPEN_A_BENCH)
    taken = {flag: taken_by(flag) for flag in OPTIONS}
    other = [
        f"{words} {flag}"
        for words, command in COMMANDS.items()
        for option in command.params
        for flag in option.opts
        if flag in OPTIONS and taken[flag].get(words) != option.name
    ]
    assert sorted(other) == sorted(HAVE_ANOTHER)
    for words, flag in INSTEAD:
        assert words in COMMANDS
        assert flag in OPTIONS
        assert words not in taken[flag]


@pytest.mark.parametrize("flag", OPTIONS)
def test_the_help_names_the_commands_that_take_an_option(flag):
    named = []
    for name in main.list_commands(None):
        below = [words for words in COMMANDS if words.split()[0] == name]
        taking = [words for words in below if words in taken_by(flag)]
        named += [name] if taking == below else taking
    suffix = f"[also for: {', '.join(named)}]"
    assert OPTIONS[flag].help.endswith(suffix) if named else "also for" not in OPTIONS[flag].help


def test_quiet_before_a_command_holds_for_it(tmp_path):
    assert "no session" in run("session", "list", "--sessions", tmp_path).stderr
    done = run("--quiet", "session", "list", "--sessions", tmp_path)
    assert (done.exit_code, done.stderr) == (0, "")


def test_json_before_a_command_or_its_group_holds_for_it(tmp_path):
    for words in (("--json", "session", "list"), ("session", "--json", "list")):
        assert json.loads(run(*words, "--sessions", tmp_path).stdout)["sessions"] == []


@pytest.mark.parametrize(
    ("given", "words", "remedy"),
    [
        (("--seed", 3), ("pattern", "x.pdf"), "write it after the command, where it means: Cells from this seed"),
        (("--unit", "lp/mm"), ("batch", "x"), 'write `unit = "..."` in the procedure file'),
        (("--plan", "tilt"), ("devices",), "leave the command out"),
        (("--simulate",), ("psf", "pattern", "x"), "`station --help` lists the commands to which it applies"),
    ],
)
def test_a_refusal_names_the_correct_command(given, words, remedy):
    run(*given, *words, code=2, says=remedy)


def test_the_options_of_groups_below_the_program_are_inherited_too():
    received = []

    @click.command("leaf")
    @inherited("--near", "mine")
    @inherited("--far")
    @click.pass_context
    def leaf(context, mine, far):
        received.append((mine, far))

    def group(name, below, *flags):
        class Above(LazyGroup):
            def get_command(self, ctx, cmd_name):
                return below

        return Above(name, table={}, params=[click.Option([flag]) for flag in flags])

    program = group("station", group("group", leaf, "--near", "--own"), "--near", "--far")
    program.main(["--near", "1", "--far", "2", "group", "--near", "3", "leaf"], "station", standalone_mode=False)
    assert received == [("3", "2")]
    with pytest.raises(click.UsageError, match="--own does not apply to `station group leaf`"):
        program.main(["group", "--own", "1", "leaf"], "station", standalone_mode=False)


def test_the_commands_own_value_has_precedence(called):
    received = called(COMMANDS["devices"])
    run("--seed", 1, "devices", "--seed", 2)
    assert received[0]["seed"] == 2


def test_sessions_before_the_command_names_the_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    make(tmp_path / "sessions", camera="usual")
    make(tmp_path / "other", camera="wanted")
    done = run("--sessions", "other", "session", "list", says="wanted")
    assert "usual" not in done.stdout


@pytest.fixture
def wire(tmp_path, monkeypatch):
    """wire(): the bytes that came over the line of the stage that station.toml of this folder configures."""
    if sys.platform == "win32":
        pytest.skip("no pseudo-terminals here")
    here, line = os.openpty()
    os.set_blocking(here, False)
    monkeypatch.chdir(tmp_path)
    axes = '[{ name = "z_mm", letter = "X", feed_per_min = 3000 }]'
    table = f'[devices.stage]\ndriver = "grbl"\nport = "{os.ttyname(line)}"\naxes = {axes}\n'
    for name in ("station.toml", "bench.toml"):
        (tmp_path / name).write_text(table)

    def came():
        try:
            return os.read(here, 4096)
        except BlockingIOError:
            return b""

    came.line = here
    yield came
    os.close(here)
    os.close(line)


@pytest.mark.parametrize(
    "words",
    [
        ("--simulate", "devices"),
        ("--simulate", "devices", "--config", "bench.toml"),
        ("--config", "bench.toml", "devices", "--simulate"),
        ("--config", "bench.toml", "--simulate", "devices"),
    ],
)
def test_no_byte_is_sent_to_the_real_bench_with_simulate(wire, words):
    run(*words, says="1.1h.20190830")  # the simulated stage
    assert wire() == b""


def test_the_real_bench_is_opened_without_simulate(wire):
    command = [sys.executable, "-m", "station", "--config", "bench.toml", "devices"]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as program:
        assert select.select([wire.line], [], [], 60.0)[0]
        program.kill()
    assert wire() != b""


MISSING = "--config missing.toml"
COMMAND = OPEN_A_BENCH[0], *OPEN_A_BENCH[2:], "session resume x", "psf pattern x --out out"
GUIDE = "", "--plain", "--plain --simulate --unit lp/mm"


@pytest.mark.parametrize(
    "words", [*(f"{one} {MISSING}" for one in COMMAND), *(f"{MISSING} {one}" for one in (*COMMAND, *GUIDE))]
)
def test_a_config_that_does_not_exist_is_refused_and_no_other_read(wire, words):
    run(*words.split(), code=2, says="there is no missing.toml")
    assert wire() == b""
