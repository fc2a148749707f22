"""No numeric option takes NaN, infinity or a number out of all measure: each ends in exit code 2, which names it."""

import click
import pytest

from station.__main__ import COMMANDS, main
from station.cli.terminal.command import FiniteNumber
from station.cli.terminal.lazy import LazyGroup
from tests.program import run

from .test_help import CONTEXTS

ALL = [((), main), *((tuple(path.split()), one.command) for path, one in CONTEXTS.items())]
FLOATS = [
    (words, option.opts[0])
    for words, command in ALL
    for option in command.params
    if isinstance(option, click.Option) and isinstance(option.type, click.types.FloatParamType | click.FloatRange)
]


def test_options_of_real_numbers_are_looked_at_and_shown_without_bounds_they_have_not():
    assert isinstance(main, LazyGroup)
    assert {words[0] for words, _ in ALL if words} == set(COMMANDS)
    assert {option for _, option in FLOATS} >= {"--f-number", "--ratio", "--for-s", "--kappa", "--width-mm"}
    for words, command in ALL:
        for option in command.params:
            assert option.type is not click.FLOAT, (words, option.name)
            assert not isinstance(option.type, click.FloatRange) or isinstance(option.type, FiniteNumber)
    option = click.Option(["--ratio"], type=FiniteNumber(), help="A number.")
    assert option.get_help_record(click.Context(click.Command("any"))) == ("--ratio NUMBER", "A number.")


@pytest.mark.parametrize(("words", "option"), FLOATS, ids=lambda one: "-".join(one) if isinstance(one, tuple) else one)
def test_no_real_option_takes_what_is_no_finite_number(words, option):
    for value in ("nan", "inf", "-inf", "1e999"):
        done = run(*words, f"{option}={value}", code=2)
        assert "finite" in done.stderr or "range" in done.stderr


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["psf", "pattern", "x.dng", "--out", "out", "-s", "1000000"], "s must be at most 16"),
        (["psf", "pattern", "x.dng", "--out", "out", "-k", "99999"], "k at most 101"),
        (["psf", "pattern", "x.dng", "--out", "out", "-s", "9" * 5000], "auto"),
        (["simulate", "--for-s", "1e300"], "range"),
        (["simulate", "--seed", "-1"], "range"),
        (["rays", "x.npz", "--out", "out", "--search", "1000000"], "range"),
    ],
)
def test_numbers_out_of_all_measure_are_refused(tmp_path, monkeypatch, words, says):
    monkeypatch.chdir(tmp_path)
    done = run(*words, code=None)
    assert (done.exit_code, list(tmp_path.iterdir())) == (2, [])
    assert says in done.stderr
