"""The program in the tests' own process, as somebody types it."""

from click.testing import CliRunner, Result

from station.__main__ import main


def run(*words: object, code: int | None = 0, says: str = "", typed: str | None = None) -> Result:
    """What the program did with these words: it must end with this exit code (None: any) and say this."""
    done = CliRunner().invoke(main, [str(word) for word in words], prog_name="station", input=typed)
    assert code is None or done.exit_code == code, done.output
    assert says in done.output
    return done
