"""`station psf pattern`: the PSF of each plane from one photograph of the noise chart."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.errors import REFUSED
from station.cli.log import log, log_json_option

if TYPE_CHECKING:
    from procedures.pattern_print.source import Source
    from procedures.raw import RawFrame
    from station.results import PlaneRecord

_LEVELS = {"pass": "info", "doubtful": "warning", "refused": "error"}


@click.command("pattern")
@click.argument("image", type=click.Path(path_type=Path))
@click.option("--bits", type=click.Path(path_type=Path), help="The chart's 256 x 256 cells as a grey image.")
@click.option(
    "--seed", type=click.IntRange(0, 2**63 - 1), help="The chart's seed; 1 if neither this nor --bits is given."
)
@click.option("-s", "s", type=int, default=4, show_default=True, help="PSF samples per pixel of the plane.")
@click.option("-k", "k", type=int, default=17, show_default=True, help="PSF samples along one side, odd.")
@click.option("--solver", type=click.Choice(["ls", "clip", "nnls"]), default="ls", show_default=True)
@click.option("--pixel-pitch-um", type=click.FloatRange(min=0.1), help="The sensor's pitch, for the Strehl ratio.")
@click.option("--f-number", type=click.FloatRange(min=0.1), help="The aperture.  [default: as the camera noted it]")
@click.option("--wavelength-nm", type=click.FloatRange(min=100), help="[default: R 600, G 530, B 460, Y 550]")
@click.option("--plane", help="R, G1, G2, B, Y or all.  [default: G1 of a RAW file, Y of a grey image]")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder for the results.")
@click.option("--json", "as_json", is_flag=True, help="Write result.json to stdout too.")
@log_json_option
def psf_pattern(
    image: Path,
    bits: Path | None,
    seed: int | None,
    plane: str | None,
    out: Path,
    as_json: bool,
    **options: Any,
) -> None:
    """Estimate the PSF from IMAGE, a photograph of the noise chart."""
    start = time.perf_counter()
    if bits is not None and seed is not None:
        raise click.UsageError("the chart comes from --bits or from --seed; give one of them")
    from procedures.pattern_psf.estimate import PatternParameters
    from station.calibrate import calibrate, diffraction_limit
    from station.results import ResultFolder, write_psf_result

    optics = {name: options.pop(name) for name in ("pixel_pitch_um", "f_number", "wavelength_nm")}
    parameters = PatternParameters(**options)
    with ResultFolder(out) as folder:
        source = _chart(bits, seed)
        frame = _frame(image, plane)
        limit = partial(diffraction_limit, frame.exposure, **optics)
        planes = []
        for plane_found in calibrate(frame, source.chart, parameters, limit):
            _tell(plane_found.record, plane_found.duration_s)
            planes.append(plane_found.record)
        about = {
            "procedure": "pattern",
            "input": [{"path": str(image), "sha256": frame.sha256}],
            "parameters": {**options, "chart": source.origin, **{k: v for k, v in optics.items() if v is not None}},
            "duration_s": round(time.perf_counter() - start, 3),
        }
        text = write_psf_result(folder, planes, about)
    log("written", f"wrote {out / 'result.json'}", path=str(out / "result.json"))
    if as_json:
        click.echo(text, nl=False)
    if any(record.verdict == "refused" for record in planes):
        raise click.exceptions.Exit(REFUSED)


def _chart(bits: Path | None, seed: int | None) -> Source:
    from procedures.pattern import DEFAULT_SEED
    from procedures.pattern_print.source import Source

    return Source.from_file(bits) if bits else Source.from_seed(DEFAULT_SEED if seed is None else seed)


def _frame(image: Path, plane: str | None) -> RawFrame:
    from procedures.raw import default_plane, read_frame

    chosen = plane or default_plane(image)
    frame = read_frame(image, None if chosen == "all" else [chosen])
    rows, columns = next(iter(frame.planes.values())).samples.shape
    sentence = f"read {image}: {', '.join(frame.planes)}, {columns} x {rows} pixels a plane"
    log("read", sentence, path=str(image), sha256=frame.sha256, planes=",".join(frame.planes))
    return frame


def _tell(record: PlaneRecord, duration_s: float) -> None:
    verdict = str(record.verdict)
    log(
        "plane",
        _sentence(record),
        level=_LEVELS[verdict],
        remedy=record.remedy,
        plane=record.name,
        verdict=verdict,
        dur_ms=round(1000 * duration_s),
    )


def _sentence(record: PlaneRecord) -> str:
    """What a person wants to know of a plane in one line."""
    parts = [f"{record.name}: {record.verdict}"]
    parts += [record.reason] if record.reason else []
    numbers = record.quality.numbers if record.quality else {}
    for name in ("mtf50_horizontal", "mtf50_vertical"):
        if name in numbers:
            number = numbers[name]
            parts.append(f"{name} {number.value:.4f} ± {number.uncertainty:.4f} {number.unit}")
    return "; ".join(parts)
