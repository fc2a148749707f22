"""The command line: parses and delegates, nothing else. Commands are loaded when they are called."""

from __future__ import annotations

import click

from station.cli.lazy import LazyGroup

# name -> (module under station.cli, function, help line)
COMMANDS = {
    "pattern": ("pattern", "pattern", "Write the printable noise chart."),
    "psf": ("psf", "psf", "Estimate a point spread function."),
    "restore": ("restore", "restore", "Restore a sharp picture and depth from blurred photographs."),
    "demo": ("demo", "demo", "Calibrate a simulated camera, start to end."),
}


@click.group(cls=LazyGroup, table=COMMANDS)
@click.version_option(package_name="calibration-station")
def main() -> None:
    """Camera calibration station: subpixel point spread functions with error bars."""


if __name__ == "__main__":
    main(prog_name="station")
