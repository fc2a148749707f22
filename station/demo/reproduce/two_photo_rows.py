"""Chapter 3 of the thesis: the PSF from two photographs of a wall at different distances."""

from dataclasses import replace
from functools import cache

import numpy as np

from procedures.numerics.arrays import Array
from procedures.pattern import Chart
from procedures.raw import Plane, read_frame
from procedures.two_photo.estimate import TwoPhotoParameters, TwoPhotoPsf, estimate_psf_of_pair
from simulators.camera.camera import SimulatedCamera, true_psf
from simulators.camera.optics import GaussianBlur, Optics
from station.demo.reproduce import cameras, patterns, rival_rows
from station.demo.reproduce.figures import Curve, curves, pictures
from station.demo.reproduce.rival_rows import LEVELS, edge_mtf, view
from station.demo.reproduce.row import Order, RowValues, Setting, ordered
from station.demo.truth_comparison import align

F = cameras.FREQUENCIES
RATIO = 4.3
"""Ratio of the distances; after refocusing the far photograph is 4.5 times smaller."""
SUPPORT = {1: 5, 2: 9, 3: 13, 4: 17}
COMMON = {1: 0.45, 2: 0.9, 3: 0.9}
"""Frequency up to which the MTF at a zoom is compared with that at 4×."""
PAIR = ("two_photos/IMG_0608_v1.pgm", "two_photos/IMG_0602_v1_CUT.pgm")
REFERENCES = ("reference/real_two_psf_s3_k13.txt", "reference/real_two_inter_s3_k13.txt")
CYCLES = "cycles per pixel"


def estimated(pair: tuple[Plane, Plane], s: int) -> TwoPhotoPsf:
    """The PSF of a pair. Raises Refused if there is none."""
    return estimate_psf_of_pair(*pair, TwoPhotoParameters(s=s, k=SUPPORT[s])).result()


@cache
def wall_pair() -> tuple[Plane, Plane]:
    """The thesis's camera at f/5.6 before a wall, from two distances."""
    return cameras.wall_pair(lambda side: cameras.green_camera(5.6, side), RATIO)


def _published(setting: Setting) -> tuple[Plane, Plane]:
    near, far = (read_frame(setting.path(name)).planes["Y"] for name in PAIR)
    return near, far


def _gaussian_camera(side: int) -> SimulatedCamera:
    """The thesis's simulation mentions no noise: a hundred times the light."""
    camera = cameras.green_camera(5.6, side)
    sensor = replace(
        camera.sensor, full_well_e=100 * camera.sensor.full_well_e, gain_e_per_dn=100 * camera.sensor.gain_e_per_dn
    )
    optics = Optics((GaussianBlur(0.4),), camera.pitch_um)
    return replace(camera, sensor=sensor, optics=optics, white_e_per_s=100 * camera.white_e_per_s)


def two_photo_simulated(setting: Setting) -> RowValues:
    """A known Gaussian PSF from a simulated pair at a ratio of about 4, s = 4, registered automatically."""
    pair = cameras.wall_pair(_gaussian_camera, RATIO)
    estimate = estimated(pair, 4)
    truth = true_psf(_gaussian_camera(64).sharp_optics(), 4, SUPPORT[4]).h
    h, k = estimate.psf.h, estimate.inter_image
    near_truth, _ = align(truth, h)
    error = float(np.linalg.norm(h - near_truth) / np.linalg.norm(truth))
    mtf = {"estimated PSF": cameras.mtf_down(h), "inter-image kernel": cameras.mtf_down(k)}
    apart = float(np.abs(mtf["estimated PSF"] - mtf["inter-image kernel"])[F <= 1].max())
    figures = (
        pictures("two-photo-pair", [("near", pair[0].samples), ("far", pair[1].samples)], columns=2),
        pictures("two-photo-psf", [("true", truth), ("estimated PSF", h), ("inter-image kernel", k)], cmap="viridis"),
        cameras.mtf_curves("two-photo-mtf", "vertical", mtf, cameras.mtf_down(truth)),
    )
    return RowValues((error, apart), figures)


def _zoom_of(pair: tuple[Plane, Plane], name: str) -> RowValues:
    estimates = {s: estimated(pair, s) for s in SUPPORT}
    mtf = {s: cameras.mtf_down(estimate.psf.h, s) for s, estimate in estimates.items()}
    apart = [float(np.abs(mtf[s] - mtf[4])[end >= F].max()) for s, end in COMMON.items()]
    figures = (
        pictures(f"{name}-psf", [(f"{s}×", one.psf.h) for s, one in estimates.items()], columns=4, cmap="viridis"),
        curves(
            f"{name}-mtf",
            [Curve(f"{s}×", F[s / 2 >= F], one[s / 2 >= F]) for s, one in mtf.items()],
            x=CYCLES,
            y="MTF, vertical",
        ),
    )
    return RowValues(tuple(apart), figures)


def two_photo_zoom(setting: Setting) -> RowValues:
    """The PSF at 1× to 4× from one simulated pair: the MTFs overlap in their common range."""
    return _zoom_of(wall_pair(), "zoom")


def two_photo_zoom_published(setting: Setting) -> RowValues:
    """The PSF at 1× to 4× from the published pair of a wall: the MTFs overlap in their common range."""
    return _zoom_of(_published(setting), "zoom-published")


@cache
def _by_chart() -> Array:
    chart = Chart.from_seed()
    shot = cameras.photograph_chart(cameras.green_camera(5.6), chart, 1, roll_deg=1.5)
    return cameras.estimated(cameras.plane_of(shot), chart).psf.h


def wall_chart(setting: Setting) -> RowValues:
    """The PSF of one simulated camera from two photographs of a wall and from the noise chart, s = 4."""
    by_chart, estimate = _by_chart(), estimated(wall_pair(), 4).psf
    by_wall = estimate.h
    chart, wall = (cameras.mtf_down(h) for h in (by_chart, by_wall))
    figures = (
        pictures("wall-psf", [("two photographs", by_wall), ("noise chart", by_chart)], columns=2, cmap="viridis"),
        cameras.mtf_curves("wall-mtf", "vertical", {"two photographs": wall, "noise chart": chart}),
    )
    apart = np.abs(chart - wall)
    noise = cameras.mtf_down_uncertainty(estimate.h, estimate.covariance)
    width = [float(np.interp(0.5, one[::-1][-60:], F[::-1][-60:])) for one in (wall, chart)]
    lobe = (F > 1) & (F < 1.6)
    zero = [float(F[lobe][one[lobe].argmin()]) for one in (wall, chart)]
    in_noise = float(np.sqrt(np.mean((apart[1:] / noise[1:]) ** 2)))
    remark = (
        f"Up to 1.6 cycles per pixel the curves differ by {apart[F <= 1.6].max():.3f} at most. Beyond 1.8 the near"
        f" photograph does not determine the PSF: the difference is {apart.max():.2f} at {F[apart.argmax()]:.2f}, the"
        f" stated uncertainty {noise[apart.argmax()]:.2f}."
    )
    return RowValues((float(apart[F <= 0.5].max()), in_noise, width[0] / width[1], zero[0] / zero[1]), figures, remark)


@ordered(Order("the differences grow from low to high frequencies", lambda v: v[0] < v[1]))
def comparison(setting: Setting) -> RowValues:
    """MTFs by five methods agree at low frequencies; Joshi's varies with its level, the wall's is nearest the chart."""
    truth = true_psf(cameras.optics(5.6), 4, 17).h
    rng = np.random.default_rng(10)
    window = (90, 90)
    samples = patterns.side(window, 4, 17)
    arcs = view(patterns.of_drawing(patterns.disc(20.0), samples, 4), window)
    v = arcs.photograph(truth, rng)
    edge = view(patterns.of_drawing(patterns.slanted_edge, samples, 4), window)
    across = edge_mtf(edge.photograph(truth, rng).reshape(window))
    mtf = {
        "noise chart": cameras.mtf_across(_by_chart()),
        "two photographs": cameras.mtf_across(estimated(wall_pair(), 4).psf.h),
        **{f"Joshi, {name}": cameras.mtf_across(rival_rows.joshi(arcs.A, v, 17, w)) for name, w in LEVELS.items()},
        "slanted edge": np.interp(F, across.frequencies, across.mtf, right=np.nan),
    }
    chart = mtf["noise chart"]
    low, high = (F <= 0.15), (F >= 0.4) & (F <= 1.2)
    apart = {name: float(np.nanmax(np.abs(one - chart)[low])) for name, one in mtf.items()}
    levels = np.array([one for name, one in mtf.items() if name.startswith("Joshi")])
    spread = float(np.ptp(levels, axis=0)[high].max())
    common = across.frequencies.max() >= F
    rms = {name: float(np.sqrt(np.nanmean((one - chart)[common] ** 2))) for name, one in mtf.items()}
    others = min(value for name, value in rms.items() if name not in ("noise chart", "two photographs"))
    figure = cameras.mtf_curves("comparison", "horizontal", mtf, cameras.mtf_across(truth))
    return RowValues((max(apart.values()), spread, rms["two photographs"] / others), (figure,))


def published_pair(setting: Setting) -> RowValues:
    """PSF and inter-image kernel of the published pair, s = 3, compared with the published program's."""
    estimate = estimated(_published(setting), 3)
    psf, inter = (np.loadtxt(setting.path(name)) for name in REFERENCES)
    inter = inter / inter.sum()
    correlations = [
        float(np.corrcoef(a.ravel(), b.ravel())[0, 1])
        for a, b in ((estimate.psf.h, psf), (estimate.inter_image, inter))
    ]
    figures = (
        pictures(
            "pair-psf",
            [
                ("published PSF", psf),
                ("ours", estimate.psf.h),
                ("published kernel", inter),
                ("ours", estimate.inter_image),
            ],
            cmap="viridis",
        ),
    )
    return RowValues(tuple(correlations), figures, f"λ = {estimate.scale[0]:.3f}, {estimate.scale[1]:.3f}.")
