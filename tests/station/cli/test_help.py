"""Help of every command: options in groups and an example whose options exist; completion; options of all commands."""

import os
import pty
import select
import shutil
import subprocess
from collections.abc import Iterator

import click
import pytest

from station.__main__ import main
from station.cli.result_log import check_strict
from station.cli.terminal.examples import EXAMPLES
from station.cli.terminal.progress import awaited, step_lines
from tests.golden.cases import vignetting
from tests.program import run


def commands(group: click.Group = main, context: click.Context | None = None) -> Iterator[click.Context]:
    context = context or click.Context(main, info_name="station")
    for name in group.list_commands(context):
        one = group.get_command(context, name)
        assert one is not None
        below = click.Context(one, info_name=name, parent=context)
        yield from commands(one, below) if isinstance(one, click.Group) else [below]


CONTEXTS = {one.command_path.removeprefix("station "): one for one in commands()}


@pytest.mark.parametrize("path", CONTEXTS)
def test_example_is_in_the_help_and_could_be_typed(path):
    context = CONTEXTS[path]
    words = EXAMPLES[path].split()
    assert " ".join(context.get_help().partition("Example: ")[2].split()) == " ".join(["station", path, *words])
    context.command.make_context(context.info_name, list(words), parent=context.parent)  # raises a usage error


STRICT = "demo", "verify", "session list", "session show", "session recompute", "session resume", "psf pattern"


@pytest.mark.parametrize("path", CONTEXTS)
def test_every_command_is_quiet_those_with_verdicts_are_strict_and_json_means_one_thing(path):
    options = {one.opts[-1]: one for one in CONTEXTS[path].command.params}
    assert "--quiet" in options
    assert "--strict" in options or path not in STRICT
    streams = {"focus", "serve", "simulate"}  # they write one object per photograph, or before they begin
    if "--json" in options and path not in streams:
        assert "as JSON to stdout, and nothing else there" in options["--json"].help


def test_options_are_in_groups():
    text = CONTEXTS["psf pattern"].get_help()
    headings = ["Options:", "Input:", "Numbers and limits:", "Results:", "Output and help:"]
    assert [line for line in text.splitlines() if line in headings] == headings


@pytest.mark.parametrize(
    ("before", "after", "quiet"), [(["-q"], [], True), ([], ["--quiet"], True), (["-q"], ["-q"], True), ([], [], False)]
)
def test_quiet_is_understood_before_and_after_a_command(before, after, quiet, tmp_path):
    done = run(*before, *vignetting(tmp_path), "--out", tmp_path / "out", *after)
    assert (done.stderr == "") == quiet


@pytest.mark.parametrize(("strict", "code"), [([], 0), (["--strict"], 1)])
def test_strict_counts_what_is_doubtful_as_failed(strict, code, tmp_path):
    one_flat = vignetting(tmp_path)[:2]  # which does not separate lens and light
    done = run(*one_flat, "--out", tmp_path / "out", *strict, code=None)
    assert "doubtful" in done.stderr
    assert done.exit_code == code


COMPLETED = {
    "station psf pa": "pattern",
    "station batch --pro": "--procedure",
    "station --plan two": "two-photo",
    "station manual which": "which-procedure",
}
IN_SHELL = {
    "bash": ["-c", 'eval "$(station completion bash)"; COMP_WORDS=({0}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1));'
             ' _station_completion station; echo "${{COMPREPLY[@]}}"'],
    "fish": ["-c", "station completion fish | source; complete -C'{0}'"],
    "zsh": ["-fi"],
}  # fmt: skip
TYPED = 'autoload -U compinit; compinit -uD; eval "$(station completion zsh)"\n'


@pytest.mark.nightly
@pytest.mark.parametrize("shell", IN_SHELL)
@pytest.mark.parametrize("words", COMPLETED)
def test_shell_completes_what_is_begun(words, shell):
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    ours, its = pty.openpty()  # zsh completes in a terminal only
    begun = [shell, *(one.format(words) for one in IN_SHELL[shell])]
    with subprocess.Popen(begun, stdin=its, stdout=its, stderr=its, start_new_session=True) as process:
        if shell == "zsh":
            os.write(ours, f"{TYPED}{words}\t".encode())
        text = ""
        while COMPLETED[words] not in text.replace("\r", "") and select.select([ours], [], [], 20)[0]:
            text += os.read(ours, 4096).decode()
        process.kill()
    assert COMPLETED[words] in text


def test_work_within_a_step_is_reported_at_intervals(capsys):
    now = [0.0]
    report = step_lines(lambda: now[0])
    for second in range(12):
        now[0] = second
        report(f"{second} models fitted", 0)
    report("done")
    assert capsys.readouterr().err.split("\n") == ["6 models fitted", "done", ""]


def test_strict_counts_all_but_a_pass_and_items_are_awaited_in_order():
    check_strict(["pass", "doubtful"], strict=False)
    check_strict(["pass", "pass"], strict=True)
    with pytest.raises(click.exceptions.Exit) as ended:
        check_strict(["pass", "doubtful"], strict=True)
    assert ended.value.exit_code == 1
    assert list(awaited("working", iter([1, 2, 3]))) == [1, 2, 3]
