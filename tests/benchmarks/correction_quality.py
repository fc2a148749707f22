"""A mosaic of public photographs through a simulated lens: corrected through the measured field, and by other programs.

    python -m tests.benchmarks.correction_quality PICTURE PICTURE PICTURE PICTURE [--peers]
    python -m tests.benchmarks.correction_quality --chart [--peers]

Four pictures of 750 x 500 pixels or more, such as Kodak's, are one scene of 1500 x 1000 pixels. Each colour has its own
PSF over the frame and its lateral colour. Peers: RawTherapee (AMaZE, capture sharpening, lateral colour corrected), and
Richardson-Lucy from AMaZE's picture with the lens's own PSFs and the best number of iterations. PSNR of linear light,
balanced, in nine tiles. `--chart` takes a black-and-white chart of rings and bars: colour errors and
undershoot, with LibRaw's AHD.
"""

import subprocess
import tempfile
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import rawpy

from drivers.dng import Shot, write_dng
from procedures.correction.estimate import correct
from procedures.field.interpolate import interpolate
from procedures.raw import Exposure, Plane, RawFrame
from simulators.camera.camera import Lens
from tests.benchmarks import options
from tests.procedures.correction.lens_photographs import RGGB, Sensor, blurred, kernels_over, sampled
from tests.procedures.field.lens import SHAPE, FieldCamera, K, S, grid, nodes

Array = np.ndarray
LENS = Lens(
    f_number=2.8, coma_um=0.15, astigmatism_um=0.18, field_curvature_um=0.17, axis=(0.05, -0.03), lateral_colour=0.006
)
CAMERA = FieldCamera(LENS)
ROWS, COLUMNS = 2 * SHAPE[0], 2 * SHAPE[1]
NEUTRAL = np.array([0.6, 1.0, 0.7])[:, None, None]
"""Camera's response to white, as the DNG states it."""
RIM, EDGE, BLACK, WHITE = 40, 16, 512, 16383
SAMPLE_STD = 1.4e-4
PLACES = (5, 7)
SQUARES, DARKEST = (slice(20, 290), slice(1040, 1480)), 0.0205
"""The chart's black-and-white squares, and the light of their black ones."""


def scene(pictures: Sequence[Path]) -> Array:
    """Light (3, ROWS, COLUMNS) of four pictures."""
    parts = [cv2.imread(str(path))[: SHAPE[0], : SHAPE[1], ::-1] for path in pictures]
    levels = np.vstack([np.hstack(parts[:2]), np.hstack(parts[2:])]) / 255
    light = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
    return 0.9 * np.moveaxis(light, -1, 0)


def chart() -> Array:
    """Rings up to 0.4 cycles a pixel, oblique bars, and edges between 0.02 and 0.8; grey."""
    y, x = np.mgrid[:ROWS, :COLUMNS].astype(float)
    r2 = (x - 500) ** 2 + (y - 500) ** 2
    light = np.where(r2 < 480**2, 0.41 + 0.39 * np.cos(np.pi * 0.4 * r2 / 480), 0.8)
    bars = np.sign(np.sin(2 * np.pi * (x * np.cos(0.3) + y * np.sin(0.3)) / (4 + (y // 100))))
    light = np.where((x > 1020) & (y > 300), 0.41 + 0.39 * bars, light)
    patch = (x > 1020) & (y < 300)
    squares = ((x * 0.995 + y * 0.0998) // 60 + (y * 0.995 - x * 0.0998) // 60) % 2
    light = np.where(patch, 0.02 + 0.78 * squares, light)
    return np.repeat(cv2.GaussianBlur(light, (0, 0), 0.5)[None], 3, axis=0)


def lateral(name: str, x: float, y: float) -> Array:
    """Displacement (2,) of a plane relative to green at a point of the plane, in pixels of the sensor."""
    return 2 * (CAMERA.position(x, y, name) - np.array([x, y]))


def kernel(name: str, x: float, y: float) -> Array:
    """The PSF on the sensor's grid at a point of the sensor, with lateral colour."""
    whole, d = CAMERA.whole(x / 2, y / 2, name), lateral(name, x / 2, y / 2) * S / 2
    f = np.fft.fftfreq(len(whole))
    phase = np.exp(-2j * np.pi * (f * d[0] + f[:, None] * d[1]))
    return sampled(np.fft.ifft2(np.fft.fft2(whole) * phase).real, S, 2)


def shift_of(name: str) -> object:
    """The lateral colour as the field's file gives it: quadratic in the position."""
    places = grid(5, 5, 0.0)
    moved = np.array([lateral(name, *place) for place in places])

    def design(points: Array) -> Array:
        x, y = (points / np.array(SHAPE[::-1]) - 0.5).T
        return np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y, x**3, x * x * y, x * y * y, y**3])

    fit = np.linalg.lstsq(design(places), moved, rcond=None)[0]
    return lambda points: design(points) @ fit


def through(light: Array, kernels: Sequence[Sequence[Sequence[Array]]]) -> Array:
    """Light through the lens, reflected beyond the frame."""
    wide = np.pad(light, ((0, 0), (RIM, RIM), (RIM, RIM)), mode="reflect")
    return np.stack([blurred(one, of, RIM) for one, of in zip(wide, kernels, strict=True)])


def frame_of(image: Array, seed: int) -> tuple[RawFrame, Array]:
    """The RAW photograph of light (3, H, W) on the sensor, and its mosaic in digital numbers."""
    rng, sensor, planes = np.random.default_rng(seed), Sensor(), {}
    mosaic = np.zeros((ROWS, COLUMNS), np.uint16)
    for name, (x0, y0) in RGGB.items():
        samples = sensor.read((NEUTRAL * image)["RGB".index(name[0])][y0::2, x0::2], rng)
        planes[name] = Plane(name, samples, 1 / sensor.steps, 2, (x0, y0))
        mosaic[y0::2, x0::2] = np.rint(np.maximum(samples * (WHITE - BLACK) + BLACK, 0))
    return RawFrame(Path("simulated"), "", planes, Exposure()), mosaic


PROFILE = """[Version]
AppVersion=5.9
Version=349
[White Balance]
Enabled=true
Setting=Camera
[Color Management]
InputProfile=(none)
WorkingProfile=sRGB
OutputProfile=RTv4_sRGB
[RAW]
CA=true
[RAW Bayer]
Method=amaze
[PDSharpening]
Enabled={sharpened}
AutoContrast=true
AutoRadius=true
DeconvIterCheck=true
DeconvIterations=20
[HLRecovery]
Enabled=false
"""


def rawtherapee(mosaic: Array, *, sharpened: bool) -> Array:
    """Linear picture (3, H, W) of RawTherapee."""
    with tempfile.TemporaryDirectory() as folder:
        dng, profile, out = (Path(folder) / name for name in ("a.dng", "a.pp3", "a.tif"))
        write_dng(dng, mosaic, Shot(), cfa="RGGB", black=[BLACK] * 4, white=WHITE)
        profile.write_text(PROFILE.format(sharpened=str(sharpened).lower()))
        command = ["rawtherapee-cli", "-p", str(profile), "-o", str(out), "-t", "-b16", "-Y", "-c", str(dng)]
        subprocess.run(command, check=True, capture_output=True)
        levels = cv2.imread(str(out), cv2.IMREAD_UNCHANGED)[..., ::-1] / 65535
    light = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
    missing = ((ROWS - light.shape[0]) // 2, (COLUMNS - light.shape[1]) // 2)  # it crops the border
    return np.pad(np.moveaxis(light, -1, 0), ((0, 0), *((n, n) for n in missing)), mode="edge")


def ahd(mosaic: Array) -> Array:
    """Linear picture (3, H, W) of LibRaw's AHD."""
    with tempfile.TemporaryDirectory() as folder:
        dng = Path(folder) / "a.dng"
        write_dng(dng, mosaic, Shot(), cfa="RGGB", black=[BLACK] * 4, white=WHITE)
        with rawpy.imread(str(dng)) as raw:
            picture = raw.postprocess(
                demosaic_algorithm=rawpy.DemosaicAlgorithm.AHD, output_color=rawpy.ColorSpace.raw, gamma=(1, 1),
                use_camera_wb=True, no_auto_bright=True, output_bps=16, user_flip=0,
            )  # fmt: skip
    return np.moveaxis(picture / 65535, -1, 0)


def matched(picture: Array, truth: Array) -> Array:
    """The picture at the level of the truth: the best gain and offset of each colour."""
    inner = (slice(EDGE, -EDGE), slice(EDGE, -EDGE))
    fits = [
        np.polyfit(one[inner].ravel(), wanted[inner].ravel(), 1) for one, wanted in zip(picture, truth, strict=True)
    ]
    return np.stack([np.polyval(fit, one) for fit, one in zip(fits, picture, strict=True)])


def richardson_lucy(first: Array, kernels: Sequence[Sequence[Sequence[Array]]], truth: Array) -> tuple[Array, int]:
    """The iterate with the least error, and its number."""
    observed = np.pad(np.maximum(first, 1e-4), ((0, 0), (RIM, RIM), (RIM, RIM)), mode="reflect")
    flipped = [[[one[::-1, ::-1] for one in row] for row in of] for of in kernels]
    blur = lambda u, of: np.stack([blurred(one, k, RIM) for one, k in zip(u, of, strict=True)])  # noqa: E731
    pad = partial(np.pad, pad_width=((0, 0), (RIM, RIM), (RIM, RIM)), mode="reflect")
    u, best, inner = observed.copy(), (np.inf, first, 0), (slice(None), slice(RIM, -RIM), slice(RIM, -RIM))
    for k in range(1, 31):
        ratio = observed[inner] / np.maximum(blur(u, kernels), 1e-4)
        u = pad(u[inner] * blur(pad(ratio), flipped))
        error = float(np.mean((u[inner] - truth) ** 2))
        if error > best[0]:
            break
        best = error, u[inner], k
    return best[1], best[2]


def psnr(picture: Array, truth: Array) -> Array:
    """PSNR of nine tiles and of the frame, without the rim."""
    square = np.mean((picture - truth) ** 2, axis=0)[EDGE:-EDGE, EDGE:-EDGE]
    tiles = [part.mean() for band in np.array_split(square, 3) for part in np.array_split(band, 3, axis=1)]
    return -10 * np.log10([*tiles, square.mean()])


def colour_error(picture: Array) -> float:
    """Root mean square of red and blue less green, in levels of 255."""
    inner = picture[:, EDGE:-EDGE, EDGE:-EDGE]
    return float(255 * np.sqrt(np.mean((inner[[0, 2]] - inner[1]) ** 2)))


def main() -> None:
    """Print the figures of every program."""
    given = options(__doc__, "pictures", pictures=[], chart=False, peers=False)
    truth = chart() if given.chart else scene([*map(Path, given.pictures)])
    kernels = [kernels_over(partial(kernel, name), (ROWS, COLUMNS), PLACES) for name in ("R", "G1", "B")]
    image = through(truth, kernels)
    frame, mosaic = frame_of(image, 5)
    covariance, rng = np.eye(K * K + 6) * SAMPLE_STD**2, np.random.default_rng(1)
    fields = {
        name: interpolate(name, SHAPE, nodes(CAMERA, grid(7, 5, 0.03), covariance, rng, name)).field for name in RGGB
    }
    shifts = {name: shift_of(name) for name in ("R", "B")}

    def line(words: str, picture: Array) -> None:
        figures = " ".join(f"{one:6.2f}" for one in psnr(picture, truth))
        black = truth[0][SQUARES] < DARKEST
        under = np.quantile((truth - picture)[:, *SQUARES][:, black], 0.999) if given.chart else 0.0
        print(f"{words:34} {figures}  colour {colour_error(picture):5.2f} undershoot {under:.4f}", flush=True)

    line("through the lens, all colours", image)
    began = time.process_time()
    outcome = correct(frame, fields, shifts)
    assert outcome.value is not None
    line(f"corrected, {outcome.verdict}, {time.process_time() - began:.1f} s", outcome.value.picture / NEUTRAL)
    if given.peers:
        line("LibRaw, AHD", matched(ahd(mosaic), image))
        amaze = matched(rawtherapee(mosaic, sharpened=False), image)
        line("RawTherapee, AMaZE", amaze)
        line("RawTherapee, capture sharpening", matched(rawtherapee(mosaic, sharpened=True), truth))
        deblurred, count = richardson_lucy(amaze, kernels, truth)
        line(f"AMaZE, Richardson-Lucy of {count}", deblurred)


if __name__ == "__main__":
    main()
