"""The command line: parses and delegates, nothing else. Commands are loaded when they are called."""

import atexit
import gc
import os
import sys
from pathlib import Path
from typing import Any

import click

from station.cli.terminal.command import SEED, UNITS, FiniteNumber, completed, plan_names
from station.common.namesakes import check_namesakes

check_namesakes()  # before the imports that would fail in a foreign package

from station.cli.terminal.bench_options import existing_file
from station.cli.terminal.lazy import LazyGroup, json_before

# name -> (module under station.cli, function, help line)
COMMANDS = {
    "pattern": ("pattern", "pattern", "Write the printable noise chart."),
    "psf": ("groups", "psf", "Estimate a point spread function."),
    "sensor": ("procedure_command", "sensor", "Measure gain, noise and non-uniformity of a sensor (EMVA 1288)."),
    "geometry": ("procedure_command", "geometry", "Calibrate a camera's geometry: intrinsics, distortion, poses."),
    "rig": ("procedure_command", "rig", "Measure the pose of one camera on a rig by the other."),
    "vignetting": ("procedure_command", "vignetting", "Measure the light lost towards the corners, from flats."),
    "tilt": ("procedure_command", "tilt", "Find the sensor's tilt, and the turns of its screws that correct it."),
    "export": ("export", "export", "Write a result as a file of another program."),
    "profile": ("profile", "profile", "Keep measured fields by lens and settings; export filters for other programs."),
    "focus": ("focus", "focus", "Report the sharpness of every new photograph, and which way to turn."),
    "mtf": ("groups", "mtf", "Measure a modulation transfer function."),
    "sharpen": ("procedure_command", "sharpen", "Sharpen photographs: the way is chosen, stated and taken."),
    "restore": ("procedure_command", "restore", "Restore a sharp picture and depth from blurred photographs."),
    "refocus": ("procedure_command", "refocus", "Change aperture and focus of a restored picture afterwards."),
    "correct": ("procedure_command", "correct", "Sharpen a photograph by the measured PSF field of its lens."),
    "rays": ("procedure_command", "rays", "Remove the noise of a Monte Carlo render."),
    "batch": ("batch", "batch", "Measure folders of photographs by any procedure."),
    "explain": ("results", "explain", "Explain a result: cause, largest uncertainty, best remedy."),
    "verify": ("results", "verify", "Compare a certificate with its record and its originals."),
    "session": ("session.group", "session", "List, resume, recompute and compare sessions."),
    "devices": ("bench.devices", "devices", "Show the configured devices and their answers."),
    "conform": ("bench.devices", "conform", "Test the driver of a stage: promises, stops, faults, a soak."),
    "serve": ("bench.serve", "serve", "Serve the bench to other programs: HTTP and JSON, Alpaca, a page for a phone."),
    "simulate": ("bench.serve", "simulate", "Open the simulated bench for other programs."),
    "completion": ("templates", "completion", "Write the script by which a shell completes commands."),
    "demo": ("demo", "demo", "Calibrate a simulated camera, start to end."),
    "init": ("templates", "init", "Write commented template files."),
    "manual": ("manual", "manual", "Show the manual, or write it as pages for a browser."),
    "reproduce": ("reproduce", "reproduce", "Compute the papers' tables and figures again."),
}

LARGE_HEAP = 50_000
"""Allocations between two garbage collections instead of Python's 700: here arrays are large, and few."""


@click.group(
    cls=LazyGroup,
    table=COMMANDS,
    extensible=True,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.version_option(package_name="calibration-station")
@click.option(
    "--simulate", is_flag=True, help="Work with the simulated bench.  [also for: focus, session resume, devices, serve]"
)
@click.option("--shaker", is_flag=True, help="With --simulate: the bench has a shaker.  [also for: devices, serve]")
@click.option(
    "--speed", type=FiniteNumber(min=0.1, max=1000.0), default=1.0,
    help="With --simulate: how many times as fast as real ones its moves are.  [also for: serve]",
)  # fmt: skip
@click.option(
    "--config", type=click.Path(path_type=Path), callback=existing_file,
    help="The bench's devices, and the unit of frequencies.  [default: station.toml where there is one]"
    "  [also for: psf pattern, psf witnessed, psf two-photo, psf series, psf field, focus, mtf, session resume,"
    " devices, conform, serve]",
)  # fmt: skip
@click.option(
    "--sessions", type=click.Path(path_type=Path), default=Path("sessions"), show_default=True,
    help="Folder of the sessions.  [also for: session, serve]",
)  # fmt: skip
@click.option(
    "--seed", type=SEED, default=0,
    help="Of the simulated bench.  [also for: focus, devices, conform, serve, simulate, demo]",
)  # fmt: skip
@click.option("--plain", is_flag=True, help="Guide by plain lines on stdin and stdout.")
@click.option("--plan", shell_complete=completed(plan_names), help="The guided procedure.  [default: pattern]")
@click.option(
    "--specification", type=click.Path(path_type=Path),
    help="Limits for the results, in TOML.  [also for: psf, sensor, geometry, rig, vignetting, tilt, mtf, sharpen,"
    " restore, refocus, correct, rays, serve]",
)  # fmt: skip
@click.option(
    "--unit", type=UNITS,
    help="Of frequencies.  [default: from --config, else cycles/pixel]"
    "  [also for: psf pattern, psf witnessed, psf two-photo, psf series, psf field, mtf, serve]",
)  # fmt: skip
@click.pass_context
def main(ctx: click.Context, /, plain: bool, plan: str | None, **lab: Any) -> None:
    """Camera calibration station: subpixel point spread functions with error bars.

    Without a command it opens the operator's application. An option before a command applies to it where the
    option's help names the command ("also for"), and is an error otherwise; --quiet and --json apply to every
    command that has them.
    """
    open_closed_streams()
    # Planes and frames are processed in parallel; BLAS threads in addition would compete for the cores: four planes
    # took over four times the processor time. Read when numpy is loaded, which no command does before this.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Imported objects are permanent: collecting garbage among them takes a tenth of the time of a command.
    gc.set_threshold(LARGE_HEAP)
    atexit.register(gc.freeze)
    if ctx.invoked_subcommand is not None:  # it inherits the options that apply to it: see `inherited`
        return
    if json_before.given(ctx):
        raise click.UsageError("--json is for a command, and none is given.")
    if plain:
        from station.cli.guide import run_plain as run
    else:
        from station.cli.app import run_app as run
    run(plan, **lab)


def open_closed_streams() -> None:
    """Open a standard stream that the caller has closed on nothing: its input has ended, and its output is dropped."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115  until the program ends


if __name__ == "__main__":
    main(prog_name="station")
