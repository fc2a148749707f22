"""The command line: parses and delegates, nothing else. Commands are loaded when they are called."""

from __future__ import annotations

import atexit
import gc
import os
from pathlib import Path

import click

from station.common.namesakes import check_namesakes

check_namesakes()  # before the imports that would fail in a foreign package

from station.cli.terminal.bench_options import check_shaker, existing_file
from station.cli.terminal.lazy import LazyGroup
from station.cli.terminal.numbers import SEED, UNITS
from station.common.log import quiet_option

# name -> (module under station.cli, function, help line)
COMMANDS = {
    "pattern": ("pattern", "pattern", "Write the printable noise chart."),
    "psf": ("psf.group", "psf", "Estimate a point spread function."),
    "sensor": ("procedure_command", "sensor", "Measure gain, noise and non-uniformity of a sensor (EMVA 1288)."),
    "geometry": ("procedure_command", "geometry", "Calibrate a camera's geometry: intrinsics, distortion, poses."),
    "rig": ("procedure_command", "rig", "Measure the pose of one camera on a rig by the other."),
    "vignetting": ("procedure_command", "vignetting", "Measure the light lost towards the corners, from flats."),
    "tilt": ("procedure_command", "tilt", "Find the sensor's tilt, and the turns of its screws that mend it."),
    "export": ("export", "export", "Write a result as a file of another program."),
    "focus": ("focus", "focus", "Tell how sharp every photograph is as it comes, and which way to turn."),
    "mtf": ("mtf.group", "mtf", "Measure a modulation transfer function."),
    "restore": ("procedure_command", "restore", "Restore a sharp picture and depth from blurred photographs."),
    "correct": ("procedure_command", "correct", "Sharpen a photograph by the measured PSF field of its lens."),
    "rays": ("procedure_command", "rays", "Remove the noise of a Monte Carlo render."),
    "batch": ("batch", "batch", "Measure folders of photographs by any procedure."),
    "session": ("session.group", "session", "List, resume, recompute and compare sessions."),
    "devices": ("bench.devices", "devices", "Show what is configured and what answers."),
    "conform": ("bench.conform", "conform", "Try the driver of a stage: promises, stops, faults, a soak."),
    "serve": ("bench.serve", "serve", "Serve the bench to other programs: HTTP and JSON, Alpaca, a page for a phone."),
    "simulate": ("bench.simulate", "simulate", "Open the simulated bench for other programs."),
    "demo": ("demo", "demo", "Calibrate a simulated camera, start to end."),
    "init": ("init", "init", "Write commented files to begin with."),
    "manual": ("manual", "manual", "Show the manual, or write it as pages for a browser."),
    "reproduce": ("reproduce", "reproduce", "Compute the papers' tables and figures again."),
}

LARGE_HEAP = 50_000
"""Containers made between two searches for garbage, Python's own habit being 700: here arrays are large, and few."""


@click.group(
    cls=LazyGroup,
    table=COMMANDS,
    extensible=True,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.version_option(package_name="calibration-station")
@click.option(
    "--simulate", is_flag=True,
    help="Work with the simulated bench.  [also for: focus, session resume, devices, serve]",
)  # fmt: skip
@click.option("--shaker", is_flag=True, help="With --simulate: the bench has a shaker.  [also for: devices, serve]")
@click.option(
    "--config", type=click.Path(path_type=Path), callback=existing_file,
    help="The bench's devices, and the unit of frequencies.  [default: station.toml where there is one]"
    "  [also for: psf, focus, mtf, session resume, devices, conform, serve]",
)  # fmt: skip
@click.option(
    "--sessions", type=click.Path(path_type=Path), default=Path("sessions"), show_default=True,
    help="Folder of the sessions.  [also for: session, serve]",
)  # fmt: skip
@click.option(
    "--seed", type=SEED, default=0,
    help="Of the simulated bench.  [also for: focus, devices, conform, serve, simulate, demo]",
)  # fmt: skip
@quiet_option
@click.option("--plain", is_flag=True, help="Guide by plain lines on stdin and stdout.")
@click.option("--plan", help="What to be guided through.  [default: pattern]")
@click.option(
    "--specification", type=click.Path(path_type=Path),
    help="Limits to hold results to, in TOML.  [also for: psf, sensor, geometry, rig, vignetting, tilt, mtf, restore,"
    " correct, rays, serve]",
)  # fmt: skip
@click.option(
    "--unit", type=UNITS,
    help="Of frequencies.  [default: as --config says, else cycles/pixel]  [also for: psf, mtf, serve]",
)  # fmt: skip
@click.pass_context
def main(
    ctx: click.Context,
    simulate: bool,
    shaker: bool,
    config: Path | None,
    sessions: Path,
    seed: int,
    plain: bool,
    plan: str | None,
    specification: Path | None,
    unit: str | None,
) -> None:
    """Camera calibration station: subpixel point spread functions with error bars.

    Without a command it opens the operator's application. An option before a command is handed to it where the
    option's help names the command ("also for"), and is an error where not; --quiet holds for every command.
    """
    # Work runs side by side by planes and frames. BLAS threads beside that wait in turns for each other's cores: four
    # planes took over four times the processor time. Read when numpy is loaded, which no command does before this.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # What is imported stays: looking through it for garbage, now and then and at the end, takes a tenth of a command.
    gc.set_threshold(LARGE_HEAP)
    atexit.register(gc.freeze)
    if ctx.invoked_subcommand is not None:  # options that apply to it are handed to it: see `inherited`
        return
    check_shaker(simulate=simulate, shaker=shaker)
    if plain:
        from station.cli.guide import run_plain

        run_plain(
            simulate=simulate, shaker=shaker, config=config, sessions=sessions, seed=seed, plan=plan,
            specification=specification, unit=unit,
        )  # fmt: skip
    else:
        from station.cli.app import run_app

        run_app(
            simulate=simulate, shaker=shaker, config=config, sessions=sessions, seed=seed, plan=plan,
            specification=specification, unit=unit,
        )  # fmt: skip


if __name__ == "__main__":
    main(prog_name="station")
