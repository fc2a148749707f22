"""`station session resume`: continue a session, as plain lines on stdin and stdout."""

import sys
from pathlib import Path

import click

from station.cli.session.group import find_session, newest_unfinished, sessions_option
from station.cli.terminal.bench_options import config_option, usual_config
from station.cli.terminal.command import StationCommand, strict_option
from station.cli.terminal.inherited import inherited
from station.common.errors import log_json_option


@click.command("resume", cls=StationCommand)
@click.argument("name", metavar="[SESSION]", required=False)
@sessions_option
@config_option
@inherited("--simulate", is_flag=True, help="Use the simulated bench; the default for a session that began on it.")
@click.option("--without", type=click.IntRange(min=1), multiple=True, help="Discard a shot whose photograph is lost.")
@click.option("--back-to", metavar="STEP", help="Repeat this step and the following ones.")
@strict_option
@log_json_option
def session_resume(
    name: str | None,
    root: Path,
    config: Path | None,
    simulate: bool,
    without: tuple[int, ...],
    back_to: str | None,
    strict: bool,
) -> None:
    """Continue SESSION, or the newest unfinished one, at the first incomplete step; stages home first."""
    from station.cli.guide import Watched, conduct
    from station.guide.workspace import StationLab
    from station.sessions.reader import read_session

    record = read_session(folder := find_session(name, root) if name else newest_unfinished(root))
    if back_to is not None:
        _check_step(record.state.plan, back_to)
    settings = record.config.get("config", {})
    lab = StationLab(
        sessions=folder.parent,
        config=config or usual_config(),
        simulate=simulate or settings.get("simulate") is True,
        seed=record.state.seed,
    )
    lab.virtual_time = True  # simulated time need not be real: nobody watches the bench
    operator = Watched(sys.stdin, sys.stdout)
    code = conduct(lab, operator, lambda: lab.resume(folder, operator, back_to=back_to, without=without), strict=strict)
    raise click.exceptions.Exit(code)


def _check_step(plan: str, name: str) -> None:
    """Raises BadParameter where the plan has no such step."""
    from procedures.outcome import BadParameter
    from station.guide.catalogue import plan_named

    names = [step.name for step in plan_named(plan).steps]
    if name not in names:
        raise BadParameter(f"the plan {plan} has no step {name!r}", f"choose one of {', '.join(names)}")
