"""What the commands share that turn photographs into PSFs: their options, reading, telling."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.psf.terms import plane_option, tell_specification, terms_options
from station.cli.terminal.numbers import SEED, Number
from station.common.errors import REFUSED
from station.common.log import Fact, log, log_json_option

if TYPE_CHECKING:
    from procedures.outcome import Judged, Miss
    from procedures.pattern_print.source import Source
    from procedures.raw import RawFrame
    from procedures.reading.sensor_dump import DumpLayout
    from station.results.overlay import Overlay
    from station.results.plane_result import PlaneResult

LEVELS = {"pass": "info", "doubtful": "warning", "refused": "error"}
"""Of a log line, by verdict."""
OPTICS = ("pixel_pitch_um", "f_number", "wavelength_nm")
"""Options that describe the diffraction limit."""

INSIST = "add --trust-typed"
FAILED = 1
"""Exit code: measured, and not good enough."""

Command = Callable[..., Any]


class AutoInt(click.ParamType):  # type: ignore[type-arg]  # generic in some releases only
    """A whole number, or "auto": None, for what the program chooses from the photograph."""

    name = "auto|N"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> int | None:
        """The number, None for "auto"."""
        if isinstance(value, int) or value is None:
            return value
        if value == "auto":
            return None
        try:
            return int(str(value))
        except ValueError:
            self.fail(f"give a whole number, or auto; got {value!r}", param, ctx)


AUTO = AutoInt()


def _layout(context: click.Context, option: click.Parameter, text: str | None) -> DumpLayout | None:
    if text is None:
        return None
    from procedures.reading.sensor_dump import DumpLayout

    return DumpLayout.parse(text)


raw_option = click.option(
    "--raw",
    "layout",
    callback=_layout,
    metavar="WxH,RGGB,u16le,BLACK,WHITE",
    help="The photographs are a sensor's samples without a header: size, colours, kind of sample, levels.",
)


def told_layout(layout: DumpLayout | None) -> dict[str, str]:
    """What a record says of the layout that was given."""
    return {"raw": str(layout)} if layout else {}


def told_trust(trusted: bool) -> dict[str, bool]:
    """What a record says where what was typed counted against what the camera noted."""
    return {"trust_typed": True} if trusted else {}


def psf_options(s: int | str, k: int | str, solver: str, *, report: bool = False) -> Callable[[Command], Command]:
    """The options of every PSF command, with a procedure's own defaults; those of a page and its certificate.

    A page takes as long to draw as its planes to be estimated, so it is written where it is asked for.
    """
    options: list[Callable[[Command], Command]] = [
        click.option("-s", "s", type=AUTO, default=s, show_default=True, help="PSF samples per pixel of the plane."),
        click.option("-k", "k", type=AUTO, default=k, show_default=True, help="PSF samples along one side, odd."),
        click.option("--solver", type=click.Choice(["ls", "clip", "nnls"]), default=solver, show_default=True),
        click.option("--pixel-pitch-um", type=Number(min=0.1), help="The sensor's pitch, for the Strehl ratio."),
        click.option("--f-number", type=Number(min=0.1), help="The aperture.  [default: as the camera noted it]"),
        click.option("--wavelength-nm", type=Number(min=100), help="[default: R 600, G 530, B 460, Y 550]"),
        click.option(
            "--trust-typed", is_flag=True, help="Take --f-number and --pixel-pitch-um against what the camera noted."
        ),
        plane_option,
        raw_option,
        terms_options,
        click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder for the results."),
        click.option(
            "--report/--no-report", default=report, show_default=True, help="Write report.html too, for people."
        ),
        click.option("--json", "as_json", is_flag=True, help="Write result.json to stdout too."),
        log_json_option,
    ]

    def add(command: Command) -> Command:
        for option in reversed(options):
            command = option(command)
        return command

    return add


certificate_option = click.option(
    "--certificate", is_flag=True, help="Write certificate.html and certificate.pdf too: one printed page."
)


overlay_option = click.option(
    "--overlay", "overlays", multiple=True, type=click.Path(path_type=Path), metavar="RESULT",
    help="Draw the MTF of this result or session over the page's too; as often as wanted.",
)  # fmt: skip


def read_overlays(paths: Sequence[Path]) -> list[Overlay]:
    """The results to draw over this one's. Raises BadParameter where one is none."""
    from station.results.overlay import read_overlay

    return [read_overlay(path) for path in paths]


def chart_options(command: Command) -> Command:
    """The options that tell which chart was printed."""
    bits = click.option("--bits", type=click.Path(path_type=Path), help="The chart's 256 x 256 cells as a grey image.")
    seed = click.option("--seed", type=SEED, help="The chart's seed; 1 if neither this nor --bits is given.")
    return bits(seed(command))


def chart_source(bits: Path | None, seed: int | None) -> Source:
    """The chart that the options tell."""
    if bits is not None and seed is not None:
        raise click.UsageError("the chart comes from --bits or from --seed; give one of them")
    from procedures.pattern import DEFAULT_SEED
    from procedures.pattern_print.source import Source

    return Source.from_file(bits) if bits else Source.from_seed(DEFAULT_SEED if seed is None else seed)


def read_planes(
    image: Path,
    plane: str | None,
    layout: DumpLayout | None = None,
    *,
    typed: Mapping[str, float | None] | None = None,
) -> RawFrame:
    """The planes asked for, of one photograph; the default one where none is named.

    `typed` are settings that must not contradict what the camera noted. Raises BadParameter where they do.
    """
    from procedures.raw import default_plane, read_frame
    from procedures.reading.exposure import check_typed

    chosen = plane or default_plane(image, layout)
    frame = read_frame(image, None if chosen == "all" else [chosen], layout)
    check_typed(frame.exposure, typed or {}, str(image), INSIST)
    rows, columns = next(iter(frame.planes.values())).samples.shape
    sentence = f"read {image}: {', '.join(frame.planes)}, {columns} x {rows} pixels a plane"
    log("read", sentence, path=str(image), sha256=frame.sha256, planes=",".join(frame.planes))
    return frame


def tell_each(calibrated: Iterable[PlaneResult]) -> list[PlaneResult]:
    """The planes, each told as it comes."""
    found = []
    for one in calibrated:
        tell_result(one)
        found.append(one)
    return found


def finish(records: Sequence[PlaneResult], text: str, *, as_json: bool) -> None:
    """Tell how the planes stand to their specification, and write the record to stdout where it is wanted.

    Leaves with the code of a refusal if a plane was refused, else with that of a failure if one does not meet its
    specification.
    """
    tell_specification(records)
    if as_json:
        click.echo(text, nl=False)
    if any(record.verdict == "refused" for record in records):
        raise click.exceptions.Exit(REFUSED)
    if any(record.specification and record.specification.judged == "does not meet" for record in records):
        raise click.exceptions.Exit(FAILED)


def tell_result(record: PlaneResult) -> None:
    """One line on stderr about a plane."""
    took = {"dur_ms": round(1000 * record.duration_s)} if record.duration_s else {}
    tell_judged("plane", _sentence(record), record, plane=record.name, **took)
    tell_untold(record)


def tell_judged(event: str, sentence: str, judged: Judged, **facts: Fact) -> None:
    """One line on stderr about a result, with the causes of its verdict."""
    log(
        event,
        sentence,
        level=LEVELS[str(judged.verdict)],
        remedy=judged.remedy,
        other_causes=judged.other_causes,
        verdict=str(judged.verdict),
        **facts,
    )


def tell_untold(record: PlaneResult) -> None:
    """A line on stderr for every frequency asked for at which a plane has no MTF."""
    for sentence in record.untold:
        log("untold", f"{record.name}: {sentence}", level="warning", plane=record.name)


def tell_misses(misses: Iterable[Miss]) -> None:
    """Which places of which photographs gave nothing, each with its reason."""
    for miss in misses:
        log("missed", str(miss), level="warning", remedy=miss.remedy)


def _sentence(record: PlaneResult) -> str:
    """What a person wants to know of a plane in one line."""
    from procedures.numbers import RADIAL, Group, frequency_of, in_group, label
    from station.common.uncertainty_text import stated
    from station.results.verdict_words import measurement_words

    parts = [f"{record.name}: {measurement_words(record.verdict)}"]
    parts += [record.reason] if record.reason else []
    asked = [name for name in record.numbers if (at := frequency_of(name)) and at[1] != RADIAL]
    for name in (*in_group(Group.LINE, record.numbers), *asked):
        number = record.numbers[name]
        words = f"{label(name, record.unit)} {stated(number.value, number.uncertainty)}"
        parts.append(f"{words} {number.unit}" if number.unit != "1" else words)
    if record.unit == "cycles/pixel" and record.pitch > 1 and any("pixel" in part for part in parts):
        parts.append(f"pixels of the plane, each {record.pitch} of the sensor")
    return "; ".join(parts)
