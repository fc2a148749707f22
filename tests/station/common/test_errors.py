import json

import click
import pytest
from click.testing import CliRunner

from procedures.outcome import BadInput, BadParameter, Refused
from station.common.errors import log, log_json_option, reporting_errors


class StageLost(Exception):
    """Shaped like the drivers' errors, which procedures and command line do not know."""

    exit_code = 3

    def __init__(self):
        super().__init__("lost")
        self.reason = "the stage does not answer"
        self.remedy = "check its cable"


def failing(error, *words):
    @click.command()
    @log_json_option
    def command():
        with reporting_errors():
            raise error

    return CliRunner().invoke(command, words)


@pytest.mark.parametrize(
    ("error", "code"), [(BadParameter("r", "m"), 2), (StageLost(), 3), (BadInput("r", "m"), 4), (Refused("r", "m"), 5)]
)
def test_our_errors_keep_their_exit_code(error, code):
    done = failing(error)
    assert done.exit_code == code
    assert done.stderr == f"error: {error.reason}\n  what to do: {error.remedy}\n"
    assert done.stdout == ""


@pytest.mark.parametrize("error", [KeyboardInterrupt(), click.Abort()])
def test_interruption_is_130(error):
    assert failing(error).exit_code == 130


def test_usage_errors_stay_clicks_own_and_others_are_objects_where_logs_are_json():
    assert failing(click.UsageError("no such thing")).exit_code == 2
    entry = json.loads(failing(BadInput("it is empty", "copy it again"), "--log-json").stderr)
    reported = {
        "level": "error",
        "event": "failed",
        "message": "it is empty",
        "remedy": "copy it again",
        "exit_code": 4,
    }
    assert entry.items() >= reported.items()

    @click.command()
    @log_json_option
    def command():
        log("step", "one step", share=float("nan"), n=3)

    entry = json.loads(CliRunner().invoke(command, ["--log-json"]).stderr, parse_constant=pytest.fail)
    assert (entry["share"], entry["n"]) == (None, 3)
    assert CliRunner().invoke(command).stderr == "one step\n"


@pytest.mark.parametrize(
    ("error", "code", "says"),
    [
        (PermissionError(13, "Permission denied", "/locked/out"), 2, "/locked/out: Permission denied"),
        (OSError(28, "No space left on device"), 2, "a file: No space left on device"),
        (MemoryError(), 5, "more memory than there is"),
        (OSError("a sentence of some library"), 70, "failed unexpectedly"),
    ],
)
def test_what_the_system_does_not_allow_is_no_fault_of_the_program(error, code, says):
    done = failing(error)
    assert (done.exit_code, done.stdout) == (code, "")
    assert says in done.stderr
