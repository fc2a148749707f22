"""Chapter 2 of the thesis, experiments: the PSF of a camera by the noise chart. Of the thesis's photographs one is
published (`photograph_rows`). The others are replaced by those of its camera, simulated."""

from dataclasses import replace
from functools import cache

import numpy as np

from procedures.clipping import SensorModel
from procedures.numbers import ENCIRCLED_ENERGY_80, SENSITIVITY_AT_5
from procedures.pattern import Chart
from procedures.pattern_psf.estimate import PatternPsf
from procedures.pattern_psf.stability import HALF, THRESHOLDS, stability_of
from procedures.quality import Diffraction
from simulators.camera.camera import SimulatedCamera
from simulators.camera.optics import WAVELENGTHS_UM, GaussianBlur
from simulators.world.scene import Illumination
from station.demo.reproduce import cameras
from station.demo.reproduce.figures import Curve, curves, pictures
from station.demo.reproduce.row import RowValues, Setting
from station.demo.truth_comparison import align

F = cameras.FREQUENCIES
NYQUIST = int(np.argmin(abs(F - 0.5)))
CYCLES = "cycles per pixel of the plane"


@cache
def _chart() -> Chart:
    return Chart.from_seed()


APERTURES = (3.2, 5.6, 12.9, 16.0, 32.0)


def _support(f_number: float) -> int:
    """Side of the support, samples: it contains the disc of diffraction."""
    return 17 if f_number < 8 else 25


def _at_aperture(f_number: float, seed: int = 1) -> tuple[PatternPsf, float]:
    """The estimated PSF at an aperture, and its relative error after the best subpixel shift."""
    shot = cameras.photograph_chart(cameras.green_camera(f_number), _chart(), seed, roll_deg=1.5)
    estimate = cameras.estimated(cameras.plane_of(shot), _chart(), k=_support(f_number))
    truth = shot.true_psf("Y", cameras.S, _support(f_number)).h
    aligned, _ = align(truth, estimate.psf.h)
    return estimate, float(np.linalg.norm(estimate.psf.h - aligned) / np.linalg.norm(truth))


def apertures(setting: Setting) -> RowValues:
    """The PSF at five apertures: f/16 and f/32 cut high frequencies, the camera aliases at all but f/32."""
    estimates = {N: _at_aperture(N)[0] for N in APERTURES}
    mtf = {N: cameras.mtf_down(estimate.psf.h) for N, estimate in estimates.items()}
    at_nyquist = {N: float(one[NYQUIST]) for N, one in mtf.items()}
    sharp = min(at_nyquist[N] for N in APERTURES[:3])
    figures = (
        pictures("apertures-psf", [(f"f/{N:g}", one.psf.h) for N, one in estimates.items()], columns=5, cmap="viridis"),
        cameras.mtf_curves("apertures-mtf", "vertical", {f"f/{N:g}": one for N, one in mtf.items()}),
    )
    others = [at_nyquist[N] for N in APERTURES[:4]]
    return RowValues(
        (min(others), at_nyquist[32.0] / min(others), at_nyquist[16.0] / sharp, at_nyquist[32.0] / sharp), figures
    )


def diffraction(setting: Setting) -> RowValues:
    """At f/5.6 the MTF is below that of diffraction alone, because of photosites and low-pass filter."""
    estimate, _ = _at_aperture(5.6)
    limit = Diffraction(5.6, 2 * cameras.PITCH_UM, 1000 * WAVELENGTHS_UM["Y"])
    quality = estimate.quality
    ideal = limit.otf(quality.frequencies)
    excess = np.maximum(quality.mtf_horizontal, quality.mtf_vertical) - ideal
    shown = [
        Curve("diffraction, f/5.6", quality.frequencies, ideal, "--"),
        Curve("estimate, along rows", quality.frequencies, quality.mtf_horizontal),
        Curve("estimate, along columns", quality.frequencies, quality.mtf_vertical),
    ]
    figure = curves("diffraction", shown, x=CYCLES, y="MTF")
    under = quality.frequencies > 0.25
    return RowValues((float(excess.max()), float(excess[under & (quality.frequencies < 1)].max())), (figure,))


def phase(setting: Setting) -> RowValues:
    """At f/5.6 in the middle of the frame the OTF is real: modulus and real part coincide, the phase is 0 or π."""
    estimate, _ = _at_aperture(5.6)
    otf = cameras.spectrum(estimate.psf.h, cameras.S, F, np.zeros_like(F))
    figure = curves(
        "phase",
        [Curve("modulus", F, np.abs(otf)), Curve("real part", F, otf.real, "--"), Curve("imaginary part", F, otf.imag)],
        x=CYCLES,
        y="OTF",
    )
    transmitted = np.abs(otf) > 0.05
    phase = np.abs(np.angle(otf[transmitted]))
    return RowValues((float(np.abs(otf.imag).max()), float(np.minimum(phase, np.pi - phase).max())), (figure,))


def accuracy(setting: Setting) -> RowValues:
    """The relative error of the PSF is of the order of 2 to 5 %."""
    shots = [(N, seed) for N in (2.8, 4.0, 5.6, 8.0) for seed in range(5 if setting.full else 2)]
    errors = np.array([_at_aperture(N, seed)[1] for N, seed in shots])
    figure = curves("accuracy", [Curve("error", [N for N, _ in shots], errors, "o")], x="f-number", y="relative error")
    return RowValues((float(errors.mean()), float(errors.max())), (figure,))


CURVATURE = 0.05
"""Curvature of the simulated sensor: a departure from a straight line by 0.8 % of the chart's contrast."""
GREYS = np.linspace(0.05, 1.2, 24)
"""Uniform light of the photographs that measure the response, white = 1."""


def response(setting: Setting) -> RowValues:
    """The response refined with the PSF, measured by uniform light, or ignored: curves and MTFs are alike."""
    camera = cameras.green_camera(5.6)
    camera = replace(camera, sensor=replace(camera.sensor, curvature=CURVATURE))
    shot = cameras.photograph_chart(camera, _chart(), 4, roll_deg=1.5)
    plane = cameras.plane_of(shot)
    measured, signal = _by_uniform_light(camera)
    ignored = replace(measured, bend=())
    estimates = {
        "refined": cameras.estimated(plane, _chart()),
        "ignored": cameras.estimated(plane, _chart(), sensor=ignored),
        "measured": cameras.estimated(plane, _chart(), sensor=measured),
    }
    m = np.linspace(0, 1, 101)
    beta = estimates["refined"].diagnostics["response_curvature"]
    bent = measured.bent(m * signal) / measured.bent(np.array([signal]))
    refined = m + beta * (m**2 - m)
    mtf = {name: cameras.mtf_down(estimate.psf.h) for name, estimate in estimates.items()}
    figures = (
        curves(
            "response", [Curve("with the PSF", m, refined), Curve("uniform light", m, bent, "--")], x="light", y="g"
        ),
        cameras.mtf_curves("response-mtf", "vertical", mtf),
    )
    departure = max(float(np.abs(g - m).max()) for g in (refined, bent))
    apart = max(float(np.ptp([one[i] for one in mtf.values()])) for i in range(len(F)))
    return RowValues((departure, float(np.abs(refined - bent).max()), apart), figures)


def _by_uniform_light(camera: SimulatedCamera) -> tuple[SensorModel, float]:
    """The sensor's response by photographs of uniform light, and the linearised signal of white, digital numbers."""
    rng, sensor = np.random.default_rng(14), camera.sensor
    numbers = [sensor.expose(np.full((64, 64), grey), cameras.WHITE_E, rng).mean() - sensor.black[0] for grey in GREYS]
    slope, quadratic = np.linalg.lstsq(np.stack([GREYS, GREYS**2], axis=1), numbers, rcond=None)[0]
    return SensorModel(
        1 / sensor.gain_e_per_dn, 0.0, 0.0, sensor.read_noise_e**2 / sensor.gain_e_per_dn**2,
        sensor.white - sensor.black[0], slope, (quadratic / slope,),
    ), slope  # fmt: skip


DIAGONAL_AT = np.linspace(0.6, 1.2, 13)
"""Frequencies at which photosites without a corner differ along the two diagonals."""


def planes(setting: Setting) -> RowValues:
    """PSFs of the four Bayer planes: red is larger, the MTFs of red and blue are rotated from green's."""
    shot = cameras.photograph_chart(cameras.mosaic_camera(), _chart(), 3, roll_deg=1.0)
    estimates = {name: cameras.estimated(cameras.plane_of(shot, name), _chart()) for name in ("R", "G1", "G2", "B")}
    radius = {name: estimate.quality.numbers[ENCIRCLED_ENERGY_80].value for name, estimate in estimates.items()}
    f, lean = DIAGONAL_AT / np.sqrt(2), dict[str, float]()
    for name, estimate in estimates.items():  # the MTF along one diagonal minus that along the other
        there, across = (np.abs(cameras.spectrum(estimate.psf.h, cameras.S, f, sign * f)) for sign in (1, -1))
        lean[name] = float(np.mean(there - across))
    figures = (
        pictures("planes-psf", [(name, estimate.psf.h) for name, estimate in estimates.items()], cmap="viridis"),
        cameras.mtf_curves(
            "planes-mtf", "horizontal", {name: cameras.mtf_across(one.psf.h) for name, one in estimates.items()}
        ),
    )
    green = lean["G1"] + lean["G2"]
    measured = (
        radius["R"] / max(radius["G1"], radius["G2"]),
        radius["R"] / radius["B"],
        radius["G1"] / radius["G2"],
        -lean["R"] / green * 2,
        -lean["B"] / green * 2,
    )
    return RowValues(measured, figures)


def places(setting: Setting) -> RowValues:
    """PSFs far from the middle of the frame are larger and more asymmetrical."""
    lens = {"coma_um": 0.10, "astigmatism_um": 0.10, "field_curvature_um": 0.06, "spherical_um": 0.02}
    camera = cameras.green_camera(5.6, 600, **lens)
    places = {"centre": (0.5, 0.5), "edge": (0.86, 0.5), "corner": (0.86, 0.86)}
    psf = {}
    for i, (name, at) in enumerate(places.items()):
        shot = cameras.photograph_chart(camera, _chart(), i, at=at)  # type: ignore[arg-type]
        psf[name] = cameras.estimated(cameras.plane_of(shot), _chart())
    radius = {name: one.quality.numbers[ENCIRCLED_ENERGY_80].value for name, one in psf.items()}
    odd = {  # the difference between the PSF and itself rotated by half a turn
        name: float(np.linalg.norm(one.psf.h - one.psf.h[::-1, ::-1]) / np.linalg.norm(one.psf.h))
        for name, one in psf.items()
    }
    figure = pictures("places", [(name, one.psf.h) for name, one in psf.items()], columns=3, cmap="viridis")
    measured = (
        *(radius[name] / radius["centre"] for name in ("edge", "corner")),
        *(odd[name] / odd["centre"] for name in ("edge", "corner")),
    )
    return RowValues(measured, (figure,))


SLOPE, SHAKE_PX = 0.1, 0.1
"""Greatest slope of the light over the frame, and greatest sigma of a photograph's vibration, in pixels."""


def stability(setting: Setting) -> RowValues:
    """Thirteen photographs from similar viewpoints: mean of the MTF's standard deviation over mean of the MTF."""
    rng, psfs = np.random.default_rng(13), []
    camera = cameras.green_camera(5.6)
    camera = replace(camera, focus_mm=camera.place(_chart(), pixels=100.0).pose.centre_mm[2])
    middle = camera.sensor.columns / 2
    for seed in range(13):
        placed = {"pixels": rng.uniform(96, 104), "roll_deg": rng.uniform(-2, 2), "yaw_deg": rng.uniform(-2, 2)}
        x, y = rng.uniform(-SLOPE, SLOPE, 2)
        light = Illumination(slope=(x, y), centre_px=(middle, middle), radius_px=middle)
        shaken = replace(camera, optics=camera.sharp_optics().also(GaussianBlur(rng.uniform(0, SHAKE_PX))))
        shot = cameras.photograph_chart(shaken, _chart(), seed, light=light, **placed)
        psfs.append(cameras.estimated(cameras.plane_of(shot), _chart()).psf.h)
    estimate = stability_of([(h, cameras.S) for h in psfs])
    mean, spread = estimate.mean[HALF:, HALF], estimate.std[HALF:, HALF]
    figures = (
        curves(
            "stability-mtf",
            [Curve("mean of 13", estimate.frequencies[HALF:], mean, band=spread)],
            x=CYCLES,
            y="MTF, vertical",
        ),
        curves(
            "stability",
            [Curve("13 photographs", THRESHOLDS, estimate.sensitivity)],
            x="least MTF of the region",
            y="sensitivity",
        ),
    )
    return RowValues((float(np.nanmax(estimate.sensitivity)), estimate.numbers[SENSITIVITY_AT_5].value), figures)
