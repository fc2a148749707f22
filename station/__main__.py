"""The command line: parses and delegates, nothing else. Commands are loaded when they are called."""

from __future__ import annotations

import os

import click

from station.cli.lazy import LazyGroup

# name -> (module under station.cli, function, help line)
COMMANDS = {
    "pattern": ("pattern", "pattern", "Write the printable noise chart."),
    "psf": ("psf", "psf", "Estimate a point spread function."),
    "mtf": ("mtf", "mtf", "Measure a modulation transfer function."),
    "restore": ("restore", "restore", "Restore a sharp picture and depth from blurred photographs."),
    "rays": ("rays", "rays", "Remove the noise of a Monte Carlo render."),
    "devices": ("devices", "devices", "Show what is configured and what answers."),
    "simulate": ("simulate", "simulate", "Open the simulated bench for other programs."),
    "demo": ("demo", "demo", "Calibrate a simulated camera, start to end."),
}


@click.group(cls=LazyGroup, table=COMMANDS)
@click.version_option(package_name="calibration-station")
def main() -> None:
    """Camera calibration station: subpixel point spread functions with error bars."""
    # Work runs side by side by planes and frames. BLAS threads beside that wait in turns for each other's cores: four
    # planes took over four times the processor time. Read when numpy is loaded, which no command does before this.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


if __name__ == "__main__":
    main(prog_name="station")
