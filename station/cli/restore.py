"""`station restore`: the sharp picture and the depth map from two or more photographs blurred by depth."""

from __future__ import annotations

import time
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.psf.planes import raw_option, tell_judged, told_layout
from station.cli.psf.terms import plane_option
from station.cli.terminal.force import force_option, forced
from station.cli.terminal.numbers import Number
from station.common.errors import REFUSED
from station.common.log import log, log_json_option
from station.results.record_head import InputFile, RecordHead

if TYPE_CHECKING:
    from procedures.reading.sensor_dump import DumpLayout
    from procedures.restoration.joint.joint_descent import JointRound
    from procedures.restoration.joint.result import GroundTruth
    from station.calibration.restoration.blur_options import BlurOptions
    from station.calibration.restoration.metres_options import MetresOptions


_ONE_EACH = ("--shape", "--imu", "--poses", "--defocus-shape")


class _OneEach(click.Command):
    """Lets `--shape` and similar options take one value, or several as `--shape FILE1 FILE2` before the next option."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Repeat the option before each further file that follows it."""
        spelled: list[str] = []
        files, option = 0, ""
        photographs = sum(1 for _ in self._leading(args))
        for arg in args:
            if arg in _ONE_EACH:
                files, option = 1, arg
            elif arg.startswith("-"):
                files = 0
            elif files and (files == 1 or files <= max(photographs, 2)):
                if files > 1:
                    spelled.append(option)
                files += 1
            spelled.append(arg)
        return super().parse_args(ctx, spelled)

    @staticmethod
    def _leading(args: list[str]) -> list[str]:
        for n, arg in enumerate(args):
            if arg.startswith("-"):
                return args[:n]
        return args


@click.command("restore", cls=_OneEach)
@click.argument("images", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--blur", "blur", type=click.Choice(["defocus", "motion", "both"]), required=True, help="Cause of the blur."
)
@click.option(
    "--shape",
    "shapes",
    multiple=True,
    help="pillbox, gaussian, polygon:BLADES[:DEGREES], text arrays, psf_P.npy, kernel_N.npy or field.h5 of a result, "
    "or radial:FILE,FILE,... for a lens symmetric about its axis, centre to corner: one, or one for each image. With "
    "--prototype-region whole, kernels from an earlier result.",
)
@click.option(
    "--samples-per-pixel", type=click.IntRange(1, 1000), help="Sampling if the shapes are PSFs, not on [-1, 1]."
)
@click.option(
    "--ratio",
    "ratios",
    type=Number(),
    multiple=True,
    help="w of photograph 2 (3, ...) over w of 1.  [default: 1, or the ratio of measured kernels' sizes]",
)
@click.option(
    "--offset",
    "offsets",
    type=Number(),
    multiple=True,
    help="Offset of w of photograph 2 (3, ...) in pixels, from another focus.  [default: 0]",
)
@click.option(
    "--defocus-shape",
    "defocus_shapes",
    multiple=True,
    help="With --blur both, where --shape is that of motion: the aperture's shape, one or one for each image.",
)
@click.option(
    "--defocus-ratio",
    "defocus_ratios",
    type=Number(),
    multiple=True,
    help="Half-width of that defocus in pixels per unit of w, one or one for each image.",
)
@click.option(
    "--defocus-offset",
    "defocus_offsets",
    type=Number(),
    multiple=True,
    help="Half-width of that defocus at w = 0, pixels; negative for a plane of focus within the scene.  [default: 0]",
)
@click.option(
    "--max-w",
    type=Number(),
    help="Largest half-width of blur, pixels of image 1.  [default: 8, or a measured kernel's plus one]",
)
@click.option("--image-weight", type=Number(), help="lambda_u.  [default: from the noise]")
@click.option("--depth-weight", type=Number(), help="lambda_w, of the bending of w.  [default: from the noise]")
@click.option(
    "--scheme", default="20x(20+20)+5x20", show_default=True, help="Rounds of picture and depth, then picture."
)
@click.option(
    "--depth-start", type=click.Choice(["matched", "symmetric", "blur"]), default="matched", show_default=True
)
@click.option(
    "--symmetric-axis",
    type=click.Choice(["both", "x", "y"]),
    default="both",
    show_default=True,
    help="Axis of symmetry for --depth-start symmetric: both, or that of a uniform motion.",
)
@click.option("--total-variation", is_flag=True, help="Picture prior by total variation instead of Tikhonov.")
@click.option("--depth-total-variation", is_flag=True, help="Prior of w by total variation.")
@click.option(
    "--prototype-region",
    metavar="X,Y,W,H",
    help="Flat part for the estimation of unknown motion; auto searches for one; whole is a flat scene, whose motions "
    "may be of any form, in two images or more.",
)
@click.option(
    "--recorded-path",
    "paths",
    multiple=True,
    metavar="FILE",
    help="Path of the rig during each exposure, two columns x y at equal times: starts the search of its shape.",
)
@click.option(
    "--imu",
    "imu",
    multiple=True,
    metavar="FILE",
    help="Record of each exposure, CSV: t_s,ax,ay,az,wx,wy,wz; s since the shutter opened, m/s², rad/s; x right, y up.",
)
@click.option(
    "--poses",
    "poses",
    multiple=True,
    metavar="FILE",
    help="Poses of the camera during each exposure, CSV: t_s,x,y,z,rx,ry,rz; m, rotation vector in rad, axes as --imu.",
)
@click.option("--focal-px", type=Number(), help="Focal length in pixels of the plane, for --imu and --poses.")
@click.option("--max-inverse-depth", type=Number(), help="1 / the smallest distance in the scene, 1/m, for these.")
@click.option("--exposure-s", type=Number(), multiple=True, help="Exposure time, for --imu.  [default: as recorded]")
@click.option(
    "--metres",
    type=click.Choice(["front", "behind"]),
    help="Give depth in metres: the scene is in front of the plane of focus, or behind it. --ratio and --offset come "
    "from the camera's data.",
)
@click.option(
    "--f-number",
    "f_numbers",
    type=Number(0.5, 100),
    multiple=True,
    help="For --metres, one or one for each image.  [default: as recorded]",
)
@click.option(
    "--focus-m",
    type=Number(0.01),
    multiple=True,
    help="For --metres: distance of the plane of focus from the lens, one or one each.  [default: as recorded]",
)
@click.option("--focal-length-mm", type=Number(0.1), help="For --metres.  [default: as recorded]")
@click.option("--pixel-pitch-um", type=Number(0.1), help="For --metres: of the sensor's pixels.")
@plane_option
@click.option(
    "--encoding",
    type=click.Choice(["linear", "srgb"]),
    help="Encoding of photographs that are colour TIFF or PNG files of 16 bits.",
)
@click.option(
    "--reference",
    type=click.Path(path_type=Path),
    help="A sharp photograph of the same scene from the same place, with which the result is compared.",
)
@raw_option
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder for the results.")
@click.option("--json", "as_json", is_flag=True, help="Write result.json to stdout too.")
@force_option
@log_json_option
def restore(
    images: tuple[Path, ...],
    plane: str | None,
    encoding: str | None,
    reference: Path | None,
    layout: DumpLayout | None,
    out: Path,
    as_json: bool,
    **options: Any,
) -> None:
    """Restore the sharp picture and the depth map from IMAGES, two or more photographs of one scene.

    --plane all restores RAW photographs in colour, on the sensor's grid.
    """
    start = time.perf_counter()
    if len(images) < 2:
        raise click.UsageError(f"restoration needs two photographs or more, got {len(images)}")
    from station.calibration.restoration.blur_options import BlurOptions
    from station.calibration.restoration.metres_options import MetresOptions
    from station.calibration.restoration.restorations import (
        DescentOptions,
        RestorationOptions,
        read_ground_truth,
        read_photographs,
        restored,
    )
    from station.reports.restoration_files import write_outcome
    from station.results.result_files import ResultFolder

    blur, metres = BlurOptions(**_taken(BlurOptions, options)), MetresOptions(**_taken(MetresOptions, options))
    truth_file = None if reference is None else str(reference)
    chosen = RestorationOptions(blur, DescentOptions(**options), encoding, metres, truth_file).checked(len(images))
    with ResultFolder(out, force=forced()) as folder:
        frames, photographs = read_photographs(images, plane, layout, encoding)
        for image, frame in zip(images, frames, strict=True):
            log("read", f"read {image}: {', '.join(frame.planes)}", path=str(image), sha256=frame.sha256)
        truth = None if reference is None else read_ground_truth(reference, frames, layout, encoding)
        result = restored(chosen, frames, photographs, log, _report_round, truth)
        files = tuple(InputFile(str(image), frame.sha256) for image, frame in zip(images, frames, strict=True))
        duration_s = round(time.perf_counter() - start, 3)
        head = RecordHead("restore", files, {**result.parameters, **told_layout(layout)}, duration_s=duration_s)
        outcome, text = result.outcome, write_outcome(folder, result, head, photographs)
    words = outcome.reason or "picture and depth restored"
    tell_judged("restored", f"{outcome.verdict}: {words}", outcome)
    if outcome.value is not None and outcome.value.ground_truth is not None:
        _report_ground_truth(outcome.value.ground_truth)
    log("written", f"wrote {out / 'result.json'}", path=str(out / "result.json"))
    if as_json:
        click.echo(text, nl=False)
    if outcome.value is None:
        raise click.exceptions.Exit(REFUSED)


def _report_round(done: JointRound) -> None:
    sentence = f"round {done.n}: {done.what}, cost {done.cost:.4g}, residual {done.residual * 255:.3f}/255"
    log("round", sentence, n=done.n, what=done.what, cost=done.cost, seconds=round(done.seconds, 3))


def _report_ground_truth(truth: GroundTruth) -> None:
    before = ", ".join(f"{db:.1f}" for db in truth.before_db)
    sentence = (
        f"compared with the ground truth {truth.psnr_db:.1f} dB, the photographs {before} dB; error {truth.error:.2%} "
        f"of white, estimated {truth.stated_error:.2%}"
    )
    log("ground truth", sentence, psnr_db=truth.psnr_db, error=truth.error, told=truth.stated_error)


def _taken(kind: type[BlurOptions | MetresOptions], options: dict[str, Any]) -> dict[str, Any]:
    return {option.name: options.pop(option.name) for option in fields(kind)}
