"""`station restore`: the sharp picture and the depth map from two or more photographs blurred by depth."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.cli.log import log, log_json_option

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from procedures.raw import RawFrame
    from procedures.restoration.alternate import Round
    from procedures.restoration.forward import Array, MaskStack
    from procedures.restoration.many_depths import MotionShapes

_LEVELS = {"pass": "info", "doubtful": "warning"}


class _Shapes(click.Command):
    """Lets `--shape` take one value, or two and more as `--shape FILE1 FILE2` before the next option."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Repeat `--shape` before each further file that follows it."""
        spelled: list[str] = []
        files = 0
        photographs = sum(1 for _ in self._leading(args))
        for arg in args:
            if arg == "--shape":
                files = 1
            elif arg.startswith("-"):
                files = 0
            elif files and (files == 1 or files <= max(photographs, 2)):
                if files > 1:
                    spelled.append("--shape")
                files += 1
            spelled.append(arg)
        return super().parse_args(ctx, spelled)

    @staticmethod
    def _leading(args: list[str]) -> list[str]:
        """The arguments before the first option: the photographs, as the contract writes them."""
        for n, arg in enumerate(args):
            if arg.startswith("-"):
                return args[:n]
        return args


@click.command("restore", cls=_Shapes)
@click.argument("images", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--blur", "blur", type=click.Choice(["defocus", "motion"]), required=True, help="What blurred them.")
@click.option("--shape", "shapes", multiple=True, help="pillbox, gaussian, or text arrays: one, or one for each image.")
@click.option(
    "--ratio", "ratios", type=float, multiple=True, help="w of photograph 2 (3, ...) over w of 1.  [default: 1]"
)
@click.option(
    "--max-w", type=float, default=8.0, show_default=True, help="Largest half-width of blur, pixels of image 1."
)
@click.option("--image-weight", type=float, help="lambda_u.  [default: from the noise]")
@click.option("--depth-weight", type=float, help="lambda_w.  [default: from the noise]")
@click.option(
    "--scheme", default="20x(8+10)+5x20", show_default=True, help="Rounds of picture and depth, then picture."
)
@click.option(
    "--depth-start", type=click.Choice(["matched", "symmetric", "blur"]), default="matched", show_default=True
)
@click.option("--total-variation", is_flag=True, help="Picture prior by total variation instead of Tikhonov.")
@click.option("--depth-total-variation", is_flag=True, help="Prior of w by total variation.")
@click.option("--prototype-region", metavar="X,Y,W,H", help="Flat part from which unknown motion shapes are estimated.")
@click.option(
    "--recorded-path",
    "paths",
    multiple=True,
    metavar="FILE",
    help="Path of the rig during each exposure, two columns x y at equal times: begins the search of its shape.",
)
@click.option("--fix-path", is_flag=True, help="Take the recorded paths as they are; find their size and place only.")
@click.option("--plane", help="R, G1, G2, B, Y or all.  [default: G1 of a RAW file, Y of a grey image]")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder for the results.")
@click.option("--json", "as_json", is_flag=True, help="Write result.json to stdout too.")
@log_json_option
def restore(
    images: tuple[Path, ...],
    blur: str,
    shapes: tuple[str, ...],
    ratios: tuple[float, ...],
    max_w: float,
    prototype_region: str | None,
    paths: tuple[str, ...],
    fix_path: bool,
    plane: str | None,
    out: Path,
    as_json: bool,
    **options: Any,
) -> None:
    """Restore the sharp picture and the depth map from IMAGES, two or more photographs of one scene."""
    start = time.perf_counter()
    if len(images) < 2:
        raise click.UsageError(f"restoration needs two photographs or more, got {len(images)}")
    if (paths or fix_path) and (prototype_region is None or len(paths) != 2):
        raise click.UsageError("--recorded-path needs --prototype-region, and one path for each of two photographs")
    from procedures.restoration.checks import check_max_w
    from procedures.restoration.estimate import restore as restored
    from station.restoration_page import restoration_page
    from station.restoration_results import write_restoration
    from station.results import ResultFolder

    check_max_w(max_w)
    parameters = _parameters(options)
    with ResultFolder(out) as folder:
        frames, photographs = _photographs(images, plane)
        known = None
        if prototype_region is not None:
            known = _prototypes(photographs, prototype_region, max_w, paths, fix_path)
        stacks, described = _stacks(blur, shapes, ratios, max_w, photographs, list(known.shapes) if known else None)
        described |= {"prototype_region": prototype_region, "recorded_path": list(paths), "fix_path": fix_path}
        outcome = restored(photographs, stacks, parameters, _tell)
        if known is not None:
            described["motion"] = _motion(known)
            outcome = known.judged(outcome)
        about = {
            "procedure": "restore",
            "input": [{"path": str(i), "sha256": f.sha256} for i, f in zip(images, frames, strict=True)],
            "parameters": {"blur": blur, **described, "max_w": max_w, "planes": list(frames[0].planes), **options},
            "duration_s": round(time.perf_counter() - start, 3),
        }
        text = write_restoration(folder, outcome, about, restoration_page(outcome, photographs, about))
    level = _LEVELS.get(str(outcome.verdict), "error")
    log("restored", f"{outcome.verdict}: {outcome.reason or 'picture and depth restored'}", level=level)
    log("written", f"wrote {out / 'result.json'}", path=str(out / "result.json"))
    if as_json:
        click.echo(text, nl=False)


def _parameters(options: dict[str, Any]) -> Any:
    from procedures.restoration.estimate import RestorationParameters
    from procedures.restoration.scheme import Scheme

    return RestorationParameters(**{**options, "scheme": Scheme.parse(options["scheme"])})


def _photographs(images: tuple[Path, ...], plane: str | None) -> tuple[list[RawFrame], list[Array]]:
    """Frames, and their planes stacked as channels (C, H, W)."""
    import numpy as np

    from procedures.raw import default_plane, read_frame

    chosen = plane or default_plane(images[0])
    frames = [read_frame(image, None if chosen == "all" else [chosen]) for image in images]
    for image, frame in zip(images, frames, strict=True):
        log("read", f"read {image}: {', '.join(frame.planes)}", path=str(image), sha256=frame.sha256)
    return frames, [np.stack([p.samples.astype(np.float64) for p in f.planes.values()]) for f in frames]


def _stacks(
    blur: str,
    shapes: tuple[str, ...],
    ratios: tuple[float, ...],
    max_w: float,
    photographs: list[Array],
    known: list[NDArray[np.float64]] | None,
) -> tuple[list[MaskStack], dict[str, Any]]:
    """Masks of every photograph, and what the record says of them. known : shapes found in the photographs."""
    import numpy as np

    from procedures.restoration.blur_models import mask_stack
    from procedures.restoration.checks import check_extent

    count = len(photographs)
    each = (1.0, *ratios, *([ratios[-1] if ratios else 1.0] * count))[:count]
    if known is None and len(shapes) not in (1, count):
        raise click.UsageError(f"--shape takes one shape, or one for each of {count} images; got {len(shapes)}")
    arrays = known or [_shape(name, blur) for name in (shapes if len(shapes) == count else shapes * count)]
    R = int(np.ceil(max_w * max(each) + 0.5))
    check_extent(R, (photographs[0].shape[1], photographs[0].shape[2]))
    stacks = [mask_stack(shape, max_w, ratio=ratio, R=R) for shape, ratio in zip(arrays, each, strict=True)]
    return stacks, {"shape": list(shapes), "ratio": list(each[1:])}


def _shape(name: str, blur: str) -> NDArray[np.float64]:
    from procedures.restoration import blur_models

    if blur == "defocus" and name == "pillbox":
        return blur_models.pillbox()
    if blur == "defocus" and name == "gaussian":
        return blur_models.gaussian()
    return blur_models.read_shape(Path(name))


def _prototypes(
    photographs: list[Array], region: str, max_w: float, paths: tuple[str, ...], fixed: bool
) -> MotionShapes:
    """Shapes of unknown motion from a flat part of the scene, begun from or fixed by recorded paths of the rig."""
    import numpy as np

    from procedures.restoration.blind import prototype_shapes
    from procedures.restoration.many_depths import MotionShapes, motion_of_scene
    from procedures.restoration.paths import recorded
    from procedures.restoration.recorded import read_path, recorded_masks, recorded_shapes

    try:
        x, y, width, height = (int(part) for part in region.split(","))
    except ValueError as error:
        raise click.UsageError(f"--prototype-region is X,Y,W,H in pixels, got {region!r}") from error
    parts = np.stack([p[:, y : y + height, x : x + width].mean(axis=0) for p in photographs])
    largest = int(np.ceil(max_w))
    # the scene is drawn along minus the rig's path
    drawn = [-read_path(Path(name)) for name in paths]
    if fixed:
        motion = MotionShapes(*recorded_shapes(parts, drawn, largest))
    else:
        found = prototype_shapes(parts, largest, first=recorded_masks(parts, drawn, largest) if drawn else None)
        log("prototypes", f"motion of half-width {found.half_width:.1f} pixels in the flat part")
        begun = [recorded(path, mask, found.half_width) for path, mask in zip(drawn, found.masks, strict=False)]
        motion = motion_of_scene(
            photographs,
            (x, y, *parts.shape[:0:-1]),
            found,
            max_w,
            np.random.default_rng(0),
            np.stack(begun) if begun else None,
        )
    sentence = motion.doubt or f"paths of half-width {motion.half_width:.2f} pixels in the flat part"
    log("motion", sentence, level="warning" if motion.doubt else "info", half_width=motion.half_width)
    return motion


def _motion(known: MotionShapes) -> dict[str, Any]:
    """What the record says of motion found: half-width and paths in the flat part, pixels."""
    paths = None if known.path is None else known.path[:, ::8].round(3).tolist()
    return {"half_width_px": known.half_width, "paths_px": paths, "doubt": known.doubt}


def _tell(done: Round) -> None:
    sentence = f"round {done.n}: {done.what}, cost {done.cost:.4g}, residual {done.residual * 255:.3f}/255"
    log("round", sentence, n=done.n, what=done.what, cost=done.cost, seconds=round(done.seconds, 3))
