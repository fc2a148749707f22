"""`station session resume`: a session goes on where it stopped, as plain lines on stdin and stdout."""

from __future__ import annotations

import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

from station.cli.log import log_json_option
from station.cli.session import find_session, session_argument

if TYPE_CHECKING:
    from procedures.plan import Plan
    from station.bench import Bench
    from station.session import Session

CONFIG = Path("station.toml")


@click.command("resume")
@session_argument
@click.option(
    "--config", type=click.Path(path_type=Path), help="The bench.  [default: station.toml where there is one]"
)
@click.option("--simulate", is_flag=True, help="Use the simulated bench, as a session that began on it does.")
@click.option("--without", type=click.IntRange(min=1), multiple=True, help="Give up a shot whose photograph is lost.")
@click.option("--back-to", metavar="STEP", help="Do this step and those after it again.")
@log_json_option
def session_resume(
    name: str, root: Path, config: Path | None, simulate: bool, without: tuple[int, ...], back_to: str | None
) -> None:
    """Go on with SESSION at the first step that is not done; stages home again first."""
    from drivers.clock import SystemClock
    from station.acquisition import Run
    from station.cli.guide import Watched, conduct
    from station.plans import plan_named
    from station.session import Session
    from station.session_reading import read_session

    record = read_session(folder := find_session(name, root))
    plan = plan_named(record.state.plan)
    with ExitStack() as stack:
        simulated = simulate or record.config.get("config", {}).get("simulate") is True
        bench = _bench(stack, config, simulated, record.state.seed)
        clock = bench.clock if bench is not None else SystemClock()
        session = stack.enter_context(Session.open(folder, clock, without=without))
        if back_to is not None:
            _reopen(session, plan, back_to)
        operator = Watched(sys.stdin, sys.stdout)
        code = conduct(Run(plan, bench, session, operator), operator)
    raise click.exceptions.Exit(code)


def _reopen(session: Session, plan: Plan, name: str) -> None:
    """Go back to a step. Raises BadParameter where the plan has none of that name."""
    from procedures.outcome import BadParameter

    names = [step.name for step in plan.steps]
    if name not in names:
        raise BadParameter(f"the plan {plan.name} has no step {name!r}", f"choose one of {', '.join(names)}")
    session.reopen(name)


def _bench(stack: ExitStack, config: Path | None, simulate: bool, seed: int) -> Bench | None:
    """The bench that is configured, the simulated one, or none: then the operator does everything by hand."""
    from station.bench import make_bench, read_config, simulated_bench

    if simulate:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="station-", ignore_cleanup_errors=True))
        bench = simulated_bench(Path(folder), seed=seed)
    elif config is not None or CONFIG.is_file():
        config = config or CONFIG
        bench = make_bench(read_config(config), folder=config.resolve().parent)
    else:
        return None
    stack.callback(bench.close)
    bench.rows()
    return bench
