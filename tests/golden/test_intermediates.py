"""Results of single modules that no record of a procedure holds whole: `--freeze` writes them anew."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from procedures.corruption.directions import filters, mask_gain, mirrored, variations
from procedures.corruption.noise import Variogram, combined_scores, mask_scores, noise_checks, texture_correlation
from procedures.corruption.paper import flat_noise, measure_noise
from procedures.corruption.ring import missing_light
from procedures.field.estimate import HEADLINE, MeasuredChart, mean_budgets
from procedures.field.focus import best_focus as best_of_places
from procedures.field.focus import focus_surface, sharpest
from procedures.field.interpolate import interpolate
from procedures.field.maps import derive, lateral_colour, over_height
from procedures.field.photosite import Photosite, WithoutPhotosite
from procedures.field.plan import location_of
from procedures.field.samplings import as_polynomial
from procedures.geometry.bundle import first_bundle
from procedures.geometry.cameras import FORMULAS, CameraModel, distortion
from procedures.geometry.chart_bins.photographs import view_of
from procedures.geometry.conversion import as_kalibr, as_model, as_opencv, as_radial
from procedures.geometry.estimate import GeometryParameters, calibrate_geometry
from procedures.geometry.facts import GeometryFacts
from procedures.geometry.next_view import NextView, next_views
from procedures.geometry.plan import pose_advice
from procedures.geometry.rig import estimate_rig
from procedures.geometry.views import ChartView, chart_nodes
from procedures.outcome import Check, verdict_of
from procedures.pattern import Chart
from procedures.pattern_psf.chart_finding.corner_layouts import find_layouts
from procedures.pattern_psf.chart_finding.detection import find_charts
from procedures.pattern_psf.chart_finding.marks import Saddles
from procedures.pattern_psf.checks import shown
from procedures.pattern_psf.combine import combine
from procedures.pattern_psf.corruptions import print_prior
from procedures.pattern_psf.drift import chart_series, slope_of
from procedures.pattern_psf.estimate import PatternParameters, estimate_psf
from procedures.pattern_psf.focus.sharpness import measure_sharpness
from procedures.pattern_psf.focus.sweep import advise_turn, best_focus
from procedures.pattern_psf.gamma import gamma_diagram
from procedures.pattern_psf.pose import ImagingGeometry, chart_pose
from procedures.pattern_psf.stability import stability_of
from procedures.plan import facts_as
from procedures.psf import Psf
from procedures.quality import Diffraction
from procedures.raw import Plane
from procedures.two_photo.estimate import TwoPhotoParameters, estimate_psf_of_pair
from procedures.two_photo.pair_consistency import beyond_light, light_turned
from procedures.two_photo.several import estimate_psf_of_wall
from tests.benchmarks.fisheye_views import photograph as fisheye_photograph
from tests.benchmarks.fisheye_views import polynomial, poses
from tests.procedures.field.lens import SHAPE, FieldCamera, K, grid, nodes
from tests.procedures.geometry.chart_bins.test_photographs import photographed, tilted, wide_camera
from tests.procedures.geometry.simulated_views import CELL_MM, Shoot, TrueCamera, take
from tests.procedures.geometry.test_rig import HERE, THIRD, TRUE, rig
from tests.procedures.pattern_psf.conftest import photograph
from tests.procedures.pattern_psf.damage import CHANGES, damaged
from tests.procedures.slanted_edge.test_corruptions import PROCESSED, measured, picture
from tests.procedures.two_photo.damage import damaged as damaged_pair
from tests.procedures.two_photo.damage import names
from tests.procedures.two_photo.wall import gaussian, photographs

from .frozen import check_frozen
from .test_plans import of_field

CHART = Chart.from_seed()
SMALL = PatternParameters(2, 9)


def charts() -> Any:
    """Sightings in a photograph, and in its negative, mirrored, enlarged, hidden and cut variants."""
    seen = photograph(pixels=70, size=(160, 160)).clean.astype(np.float32)
    hidden = seen.copy()
    hidden[30:60, 20:60] = 0.4
    pictures = [seen, 1 - seen, seen[:, ::-1], np.kron(seen, np.ones((3, 3), np.float32)), hidden, seen[:, 40:],
                np.hstack([seen, seen.T])]  # fmt: skip
    every = [find_charts(one) for one in pictures]
    more = [[one.reduced(3), one.moved(2.5, -1), one.widths(), one.cut_marks((120, 115), 4.0)] for one in every[0]]
    return every, more


def shots() -> Any:
    """Three photographs of a chart together."""
    bench, rng = photograph(pixels=70, size=(150, 150)), np.random.default_rng(5)
    outcomes = [
        estimate_psf(bench.plane(0.004, rng), CHART, replace(SMALL, solver=one)) for one in ("ls", "ls", "nnls")
    ]
    both, values = combine(outcomes), [one.value for one in outcomes if one.value]
    assert both.value
    series = chart_series([*values, *values[:2]], 2)
    slopes = {name: slope_of(np.array([20.0, 21, 23, 22, 25]), one) for name, one in series.items()}
    mean, plane = both.value, bench.plane(0.01, rng)
    whole = [mean.quality, mean.diagnostics, mean.values, mean.psf, mean.places]
    stability = stability_of([(one.psf.h, one.psf.s) for one in values])
    return both.verdict, both.reason, whole, series, slopes, stability, measure_sharpness(plane, CHART)


def spoilt() -> Any:
    """A chart with marks hidden, strays, and a curved response."""
    bench, rng = photograph(pixels=80, size=(160, 160)), np.random.default_rng(6)
    samples = bench.plane(0.004, rng).samples.copy()
    samples = samples + 0.05 * samples * (samples - 0.8)
    samples[70:74, 60:70] = 0.9
    samples[rng.random(samples.shape) < 0.001] = 1.0
    limit = Diffraction(5.6, 7.52, 540.0)
    found = [estimate_psf(Plane("G1", np.float32(samples), 1e-4, pitch=2), CHART, one, limit) for one in (SMALL, None)]
    return [(one.verdict, one.reason, one.value and (one.value.diagnostics, one.value.quality)) for one in found]


def sweeps() -> Any:
    """The best of a focus's sweep, and advice on the next turn."""
    x, u, scores = np.arange(7.0), np.full(7, 0.004), np.array([0.2, 0.31, 0.42, 0.44, 0.4, 0.28, 0.2])
    kinds = [scores, scores[::-1], np.sort(scores), np.where(x == 3, np.nan, scores), np.where(x > 4, scores, np.nan)]
    whole = [(best_focus(x, one, u), best_focus(x[:4], one[:4], 9 * u[:4])) for one in kinds]
    places = ((), [-2.0 * i for i in range(7)])
    return whole, [advise_turn(one[:n], u[:n], at) for one in kinds for n in range(1, 8) for at in places]


def gammas() -> Any:
    """gamma for lenses sharper and softer than the band."""
    return [gamma_diagram(ImagingGeometry(50, 6.0, 0.4), s, 4 * s + 1, 1.2, Diffraction(f, 6.0, 540.0))
            for s in (2, 4) for f in (2.0, 5.6, 22.0)]  # fmt: skip


def calibrations() -> Any:
    """Cameras of a formula and of a spline, in photographs and in a video, and their conversions."""
    small = Shoot(TrueCamera(radial=(-0.12, 0.06, 0.0)), count=7, every=4, print_mm=0.03, bend_mm=0.3)
    taken = take(small, np.random.default_rng(3))
    asked = GeometryParameters(CELL_MM, distances_mm=(500.0, np.inf), advise_px=(600.0, 500.0), scale_uncertainty=1e-3)
    views = [replace(one, time_s=float(i)) for i, one in enumerate(taken.views)]
    found = []
    for parameters in (asked, replace(asked, model="OPENCV", is_video=True, advise_px=None)):
        outcome = calibrate_geometry(views, small.camera.size, parameters, nodes=taken.nodes)
        one = outcome.value
        assert one
        converted = [
            as_opencv(one.camera, one.region, 4),
            *(as_radial(one.camera, one.region, name, 3000.0) for name in ("poly3", "poly5", "ptlens", "even")),
        ]
        kinds = [as_kalibr(one.camera, one.region), as_model(one.camera, one.region, "OPENCV_FISHEYE")]
        fitted = [(fit.camera.model, fit.difference, fit.share) for fit in one.formulas]
        found += [outcome.verdict, outcome.reason, one.covariance, one.camera, one.numbers, one.budgets, one.shape]
        found += [one.trials, fitted, one.misfit, one.maps, one.next_view, one.shutter, one.views, converted, kinds]
        found += [next_views(one.adjustment, pixel)[:5] for pixel in (None, (5000.0, 300.0))]
    return found


def chart_views() -> Any:
    """Nodes of charts: a small one, one that needs reduced pixels, and one near the corner of a fisheye."""
    camera = wide_camera(200, 240)
    planes = [photographed(camera, tilted(camera, i, pixels), i) for i, pixels in ((1, 80.0), (0, 150.0))]
    fisheye = polynomial((337, 225), 136.8, (169.65, 111.6), (-0.012, 0.004, -0.0015, 0.0002))
    corner = Plane("Y", fisheye_photograph(fisheye, poses(fisheye, 5, 86.0, 26.0)[4], CHART, 0.004, 1), 1 / 65535)
    return [view_of(one, CHART, "view") for one in (*planes, corner)]


def wide_bundle() -> Any:
    """A first camera of 170 degrees."""
    lens = polynomial((1500, 1000), 608.0, (754.0, 496.0), (-0.012, 0.004, -0.0015, 0.0002))
    nodes, index = chart_nodes(CELL_MM)[::16], np.arange(36)
    seen = [lens.project(nodes @ pose.R.T + pose.t) for pose in poses(lens, 6, 380.0, 26.0)]
    views = [ChartView("view", index, one, np.tile(np.eye(2) * 1e-4, (36, 1, 1))) for one in seen]
    return first_bundle(nodes, views, lens.size)


def cameras() -> Any:
    """One lens by every formula, its projection and derivatives, and a rig of three."""
    lens = CameraModel("OPENCV", np.array([900.0, 910, 500, 330, -0.1, 0.03, 1e-3, -2e-3]), 1000, 660)
    region = np.array([[0.0, 0], [999, 0], [999, 659], [0, 659]])
    points = np.random.default_rng(4).uniform((-0.4, -0.3, 0.9), (0.4, 0.3, 1.1), (40, 3))
    found: list[Any] = []
    for name in FORMULAS:
        one, difference = as_model(lens, region, name)
        pixels = one.project(points)
        found += [name, difference, pixels, one.rays(pixels), one.by_points(points), one.by_params(points)]
        found += [one.focal_px, one.centre, distortion(one, pixels), one.prior, one.units]
    return found, estimate_rig(rig(np.random.default_rng(1), (HERE, TRUE, THIRD)), 2000.0)


def views_checked() -> Any:
    """Advice on a chart in, near and off its pose, with light that is right, too little and too much."""
    with TemporaryDirectory() as folder:
        (known, *_), frames = of_field(Path(folder))
    (frame, _), facts, found = frames.values(), facts_as(GeometryFacts, known), []
    for light in (1.0, 0.15, 1.6):
        planes = {name: replace(one, samples=np.minimum(light * one.samples, 1)) for name, one in frame.planes.items()}
        lit = replace(frame, planes=planes)
        (sighting,) = find_charts(shown(lit).samples)
        at, pose = location_of(sighting, shown(lit)), chart_pose(sighting.H_sensor_pattern, (300, 300), facts.optics(2))
        for off, yaw, pitch in ((0, 0, 0), (0.04, 6.5, 0), (0.06, 0, 0), (0, 7.5, 0), (0, -30, 7.5), (0, 0, -7.5)):
            wanted = NextView((at.x + off, at.y), pose.yaw_deg + yaw, pose.pitch_deg + pitch, 7600.0, 0.4, 0.3)
            found.append(pose_advice(4, wanted, sighting, lit, facts))
    return found


def fields() -> Any:
    """A lens over the frame, with its focus and colours."""
    camera, rng, places = FieldCamera(), np.random.default_rng(2), grid(4, 4)
    side = K * K + camera.parameters(0, 0).size - K * K
    covariance = 1e-8 * np.eye(side)
    of = {plane: nodes(camera, places, covariance, rng, plane) for plane in ("G1", "R")}
    whole = interpolate("G1", SHAPE, of["G1"])
    bracket = {z: nodes(camera, places, covariance, rng, defocus_um=z) for z in (-0.2, -0.05, 0.1, 0.25)}
    surface, colour = focus_surface(bracket, SHAPE), lateral_colour("R", of["R"], "G1", of["G1"], SHAPE, 2)
    without = WithoutPhotosite(Photosite(0.9, 0.05), 2)
    budgets = [dict.fromkeys(HEADLINE, terms) for terms in ({"noise": 3.0}, {"noise": 1.0, "print": 4.0}, {})]
    mean = mean_budgets([cast(MeasuredChart, SimpleNamespace(budgets=one)) for one in budgets])
    return (mean, whole.recipe, whole.candidates, whole.axis, derive(whole.field, 4), derive(whole.field, 3, without),
            over_height(whole.field, (0.2, 0.4)), as_polynomial(whole.field, allowed=0.05), surface, surface.maps(4),
            best_of_places(bracket, SHAPE), sharpest(bracket), colour, colour.maps(3))  # fmt: skip


def walls() -> Any:
    """A wall from three distances, and as a pair in either order."""
    pair = photographs(gaussian(0.45, 0.4), tilt=0.03)
    near, far = (Plane("G1", np.float32(one), 1 / 16383, pitch=2) for one in (pair.near, pair.far))
    third = replace(far, samples=np.float32(photographs(gaussian(0.45, 0.4), tilt=0.0).far))
    asked = TwoPhotoParameters(2, 9)
    found = [estimate_psf_of_pair(far, near, replace(asked, solver="nnls")), estimate_psf_of_pair(near, far),
             estimate_psf_of_wall([near, far, third], asked, Diffraction(8.0, 6.0, 540.0))]  # fmt: skip
    v, u = np.indices((13, 13)) - 6.0
    turned = [
        np.exp(-(a * u * u + b * u * v + v * v) / 9) - c for a, b, c in ((1, 0, 0), (2, 0.8, 0), (0.6, -0.5, 0.01))
    ]
    psfs = [Psf(one / one.sum(), 3, np.eye(169) * 1e-9) for one in turned]
    light = [(light_turned(one), beyond_light(one), missing_light(one)) for one in psfs]
    return light, [(one.verdict, one.reason, one.value) for one in found]


def noises() -> Any:
    """Noise of flat and textured pictures, raw and masked, and the directions of processing."""
    rng = np.random.default_rng(8)
    noise, ramp = 0.01 * rng.standard_normal((2, 90, 100)), np.linspace(0.2, 0.8, 100)[None]
    picture = np.float32(ramp + noise[0] * np.sqrt(ramp) + 0.2 * (np.indices((90, 100)).sum(axis=0) // 9 % 2))
    known = rng.random(noise[0].shape) < 0.9
    variograms = [Variogram.of(one, known) for one in (noise[0], mirrored(picture, (3, 4), (90, 100)))]
    f = np.linspace(0, 0.7, 15)
    correlation = [texture_correlation(f, np.exp(-((f / 0.3) ** 2)), exponent) for exponent in (0.0, 1.0)]
    masks, smooth = (mask_scores(variograms, radii, correlation) for radii in ((0.7, 1.2), (0.5, 0.9)))
    y, x = np.indices((90, 100)) / 90 - 0.5
    psf = Psf(np.exp(-((np.indices((9, 9)) - 4) ** 2).sum(axis=0) / 5), 3, np.eye(81) * 1e-6)
    checks = [noise_checks(masks, smooth, raw=raw) for raw in (False, True)]
    measured = measure_noise(picture, (0.2, 0.9), lambda level: 1e-4 * level, noise[1]), flat_noise(picture)
    directions = filters(picture), variations(picture, x, y), mask_gain(f, 1.1)
    return variograms, masks, smooth, combined_scores(masks, smooth), checks, measured, directions, missing_light(psf)


def lattices() -> Any:
    """Layouts in a lattice whose inner points are partly missing."""
    z = np.add.outer(24j * np.arange(4), 24.0 * np.arange(4)).ravel() * np.exp(0.1j) + 30 + 20j
    saddles = Saddles(z, np.full(16, np.exp(0.2j)), np.linspace(1, 1.5, 16))
    kept = [[i for i in range(16) if i not in gone] for n in range(5) for gone in combinations((5, 6, 9, 10), n)]
    return [find_layouts(saddles.take(np.array(one))).hits.sum(axis=1) for one in kept]


def damaged_charts() -> Any:
    """Charts that a program, a sheet or a light spoilt."""
    clean = photograph(pixels=90, size=(170, 170)).plane(0.003, np.random.default_rng(9)).samples
    pictures = [np.float32(damaged(clean, name)) for name in list(CHANGES)[1::9]]
    found = [estimate_psf(Plane("Y", one, 1e-4), CHART, SMALL) for one in pictures]
    return [(one.verdict, one.reason, one.remedy, one.other_causes) for one in found]


def damaged_walls() -> Any:
    """Walls of which one or both photographs were spoilt."""
    pair = photographs(gaussian(0.45, 0.4), tilt=0.03)
    pairs = [[Plane("Y", one, 1e-4) for one in damaged_pair(pair, name)] for name in names()[::9]]
    found = [estimate_psf_of_pair(*one, TwoPhotoParameters(2, 9)) for one in pairs]
    return [(one.verdict, one.reason, one.remedy, one.other_causes) for one in found]


def damaged_edges() -> Any:
    """Edges that a program changed, rendered and as RAW; priors of a print's blur."""
    rng = np.random.default_rng(3)
    found = [measured(change(picture(rng)), raw=raw) for raw in (False, True) for change, _ in PROCESSED.values()]
    offsets = rng.uniform(-0.5, 0.5, 514)
    return [(one.verdict, one.reason, one.value) for one in found], [print_prior(d * offsets) for d in (0.1, 0.4, 1, 2)]


def judged(made: Callable[[], Any]) -> Any:
    """A result, and all checks that gave its verdicts; their statistics may be differences of large numbers."""
    checks: list[Any] = []

    def noted(found: Sequence[Check], *given: Any) -> Any:
        checks.append([(one.name, one.threshold, one.severity, one.fails, one.given, one.prior) for one in found])
        return verdict_of(found, *given)

    with pytest.MonkeyPatch.context() as patch:
        for module in JUDGES:
            patch.setattr(f"procedures.{module}.verdict_of", noted)
        return made(), checks


JUDGES = ("pattern_psf.estimate", "pattern_psf.combine", "pattern_psf.trust", "two_photo.estimate", "geometry.estimate",
          "slanted_edge.estimate")  # fmt: skip
MADE: tuple[Callable[[], Any], ...] = (
    charts, lattices, shots, spoilt, sweeps, gammas, wide_bundle, cameras, views_checked, walls, noises, damaged_walls,
    damaged_edges,
)  # fmt: skip
LONG: tuple[Callable[[], Any], ...] = (calibrations, chart_views, fields, damaged_charts)


@pytest.mark.slow
@pytest.mark.parametrize("made", [*MADE, *(pytest.param(one, marks=pytest.mark.nightly) for one in LONG)])
def test_modules_give_what_they_gave(made, request):
    check_frozen(request, made.__name__, judged(made))
