"""Options of commands with results: unit, frequencies and specification, overlays, certificate, processes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from station.cli.terminal.bench_options import existing_file
from station.cli.terminal.command import PATH, UNITS, force_option, options
from station.cli.terminal.inherited import inherited

if TYPE_CHECKING:
    from station.reports.certificate_details import CertificateDetails
    from station.results.terms import Terms

DETAILS = click.option(
    "--certificate-details", type=PATH, metavar="FILE",
    help="Laboratory, customer, serial numbers and dates of the certificate, in TOML; includes --certificate."
    "  [default: certificate.toml where there is one]",
)  # fmt: skip


certificate_options = options(
    click.option("--certificate", is_flag=True, help="Write certificate.html and certificate.pdf too."), DETAILS
)


def details_of(options: dict[str, Any]) -> CertificateDetails | None:
    """Details of the requested certificate; None without one. Raises BadParameter."""
    path = options.get("certificate_details")
    if not (options.get("certificate") or path):
        return None
    from station.reports.certificate_details import CertificateDetails

    return CertificateDetails.read(path)


overlay_option = click.option(
    "--overlay", "overlays", multiple=True, type=PATH, metavar="RESULT",
    help="Draw the MTF of this result or session over the page's too; as often as wanted.",
)  # fmt: skip
jobs_option = click.option(
    "--jobs", type=click.IntRange(1, 1024), help="Processes at a time.  [default: as many as cores]"
)


def plane_name(context: click.Context, option: click.Parameter, name: str | None) -> str | None:
    """Normalise the name of a plane: R for r, all for ALL."""
    return name if name is None else "all" if name.lower() == "all" else name.upper()


def _frequencies(context: click.Context, option: click.Parameter, words: str | None) -> tuple[float, ...]:
    try:
        frequencies = tuple(float(word) for word in (words or "").split(",") if word.strip())
    except ValueError:
        frequencies = (-1.0,)
    if not all(0 <= frequency < float("inf") for frequency in frequencies):
        raise click.BadParameter(f"{words!r} is no list of frequencies, such as 0.1,0.25", context, option)
    return frequencies


unit_option = inherited(
    "--unit", type=UNITS,
    help="Of every frequency: cycles/pixel of the plane, lp/mm on the sensor, lw/ph of the frame's short side."
    "  [default: as --config says, else cycles/pixel]",
)  # fmt: skip
config_option = inherited(
    "--config", type=PATH, callback=existing_file,
    help="File that names the unit where --unit does not.  [default: station.toml where there is one]",
)  # fmt: skip


specification_option = inherited(
    "--specification", type=PATH, help="Limits that the numbers are compared with, in TOML."
)


at_option = click.option(
    "--at", callback=_frequencies, metavar="F,F...", help="Report the MTF at these frequencies too."
)
terms_options = options(unit_option, config_option, at_option, specification_option, force_option)


def terms_of(options: dict[str, Any]) -> Terms:
    """The terms of the options, which are removed from them. Raises BadParameter for an invalid specification."""
    from station.results.limits import Specification
    from station.results.specification_file import preferred_unit, read_specification
    from station.results.terms import Terms
    from station.results.units import Frequency, Unit

    name, config, file = options.pop("unit", None), options.pop("config", None), options.pop("specification")
    unit = preferred_unit(config) if name is None else Unit(name.lower())
    at = tuple(Frequency(value, unit) for value in options.pop("at", ()))
    return Terms(unit, at, read_specification(file) if file else Specification())
