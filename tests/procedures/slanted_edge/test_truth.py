"""Edges of analytic OTFs, clipped edges, and the verdict of each edge of a frame."""

from dataclasses import replace

import numpy as np
import pytest

from procedures import Diffraction, Plane, Roi, Verdict
from procedures.slanted_edge.estimate import EdgeOutcome, estimate_edge, estimate_edges
from procedures.slanted_edge.tail import Tail
from simulators.camera.optics import CircularPupil, Optics, PixelAperture
from simulators.camera.pupil import Wavefront

from .analytic import BLACK, WHITE, Camera, edge, photograph

CAMERAS = {
    "f_c 3.25": Camera(3.25),
    "f_c 1.62": Camera(1.62, fill=0.9),
    "f_c 1.14": Camera(1.14, blur_px=0.3),
    "f_c 0.57": Camera(0.57),
    "wide": Camera.of_mtf50(0.1),
    "f_c 4": Camera(4.0, fill=0.6),
}


def whole(plane: Plane, diffraction: Diffraction | None = None) -> EdgeOutcome:
    return estimate_edge(plane, Roi.whole(plane.samples), diffraction)


def noiseless(light: np.ndarray) -> Plane:
    return Plane("Y", light.astype(np.float32), 1e-5)


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("angle", [3.3, 7.7])
def test_mtf50_is_of_the_whole_psf(name: str, angle: float) -> None:
    # aliases of four bins per pixel: half a per cent at 0.79 cycles/pixel, negligible below 0.6
    camera = CAMERAS[name]
    found = whole(noiseless(edge(camera, angle_deg=angle, shift_px=0.3, columns=100 if name == "wide" else 60))).value
    assert found is not None
    tolerance = 0.006 if camera.mtf50(angle) > 0.6 else 0.001
    assert found.numbers["mtf50"].value == pytest.approx(camera.mtf50(angle), rel=tolerance)
    assert found.diagnostics["tail_px"] == pytest.approx(2 / np.pi**3 / camera.cutoff, abs=0.002)


@pytest.mark.slow
@pytest.mark.parametrize("known", [False, True])
def test_uncertainties_cover_the_whole_psf(rng: np.random.Generator, known: bool) -> None:
    z = []
    for name in ("f_c 3.25", "f_c 1.14", "f_c 0.57"):
        camera = CAMERAS[name]
        stated = Diffraction(1.0, camera.cutoff, 1000.0) if known else None
        for _ in range(8):
            angle = rng.uniform(3, 10)
            light = edge(camera, angle_deg=angle, shift_px=rng.uniform(-0.5, 0.5))
            # beside the frame's centre, where no ghost of it hides
            plane = photograph(np.pad(light, ((0, 0), (0, light.shape[1])), mode="edge"), rng)
            outcome = estimate_edge(plane, Roi(0, 0, light.shape[1], light.shape[0]), stated)
            assert outcome.verdict is Verdict.PASS
            assert outcome.value is not None
            q = outcome.value.numbers["mtf50"]
            z.append((q.value - camera.mtf50(angle)) / q.uncertainty)
    # of 24 the mean scatters by 0.2, the root mean square by 0.14: three of each
    assert abs(np.mean(z)) < 0.6
    assert 0.57 < np.sqrt(np.mean(np.square(z))) < 1.43


def test_a_known_aperture_reduces_the_uncertainty(rng: np.random.Generator) -> None:
    camera = Camera(0.57)
    plane = photograph(edge(camera, columns=36, rows=60), rng, noise=0.01)
    stated = Diffraction(1.0, camera.cutoff, 1000.0)
    alone, known = (whole(plane, limit).value for limit in (None, stated))
    assert alone is not None
    assert known is not None
    assert known.numbers["mtf50"].uncertainty < 0.9 * alone.numbers["mtf50"].uncertainty
    assert Tail.of_pupil(stated).px == pytest.approx(2 / np.pi**3 / 0.57)


def test_a_wrong_aperture_is_doubtful(rng: np.random.Generator) -> None:
    plane = photograph(edge(Camera(3.25)), rng)
    for cutoff, verdict in ((3.25, Verdict.PASS), (1.62, Verdict.DOUBTFUL)):
        outcome = whole(plane, Diffraction(1.0, cutoff, 1000.0))
        assert outcome.verdict is verdict
        assert ("by the aperture" in outcome.reason) == (verdict is Verdict.DOUBTFUL)


def test_sharpening_is_measured_and_doubtful(rng: np.random.Generator) -> None:
    # a halo of three pixels, in noise for which the window of a lens's edge is four pixels wide
    camera = Camera.of_mtf50(0.55, sharpening=0.5, halo_px=3.0)
    outcome = whole(photograph(edge(camera), rng, noise=0.01))
    assert outcome.verdict is Verdict.DOUBTFUL
    assert "sharpened" in outcome.reason
    assert outcome.value is not None
    q = outcome.value.numbers["mtf50"]
    assert abs(q.value - camera.mtf50(5.0)) < 3 * q.uncertainty


@pytest.mark.parametrize("noise", [0.001, 0.004, 0.01, 0.02])
@pytest.mark.parametrize("mtf50", [0.15, 0.25, 0.5])
def test_clipped_edges_are_refused(rng: np.random.Generator, noise: float, mtf50: float) -> None:
    # as a camera clips: after the noise, at 0.99 of white or at any other level
    plane = photograph(edge(Camera.of_mtf50(mtf50), angle_deg=rng.uniform(3, 10)), rng, noise)
    for level, top in ((0.95, 0.6), (0.9, 0.99), (0.8, 0.99)):
        cut = np.minimum(plane.samples, level * WHITE)
        outcome = whole(replace(plane, samples=np.asarray(cut * (top / cut.max()), np.float32)))
        assert outcome.verdict is Verdict.REFUSED
        assert "bright side must not be clipped" in outcome.reason
    crushed = whole(replace(plane, samples=np.maximum(plane.samples, BLACK + np.float32(0.1 * (WHITE - BLACK)))))
    assert crushed.verdict is Verdict.REFUSED
    assert "dark side must not be cut off" in crushed.reason
    assert whole(plane).verdict is not Verdict.REFUSED


@pytest.mark.parametrize("mtf50", [0.1, 0.15, 0.25])
@pytest.mark.parametrize("bits", [8, 12, 16])
def test_clipping_without_noise_differs_from_plains(mtf50: float, bits: int) -> None:
    most = 2**bits - 1
    light = edge(Camera.of_mtf50(mtf50), columns=100)
    for level, verdict in ((1.0, Verdict.PASS), (0.9, Verdict.REFUSED)):
        counts = np.rint(np.minimum(light, level * WHITE) * most)
        assert whole(Plane("Y", (counts / most).astype(np.float32), 1 / most)).verdict is verdict


def several(rng: np.random.Generator) -> Plane:
    """A frame with a good edge, a sharpened one and a clipped one, on a dark ground."""
    camera, frame = Camera.of_mtf50(0.25), np.full((420, 260), BLACK)
    good = edge(camera, rows=120, columns=90)
    frame[20:140, 60:150] = good
    sharpened = Camera.of_mtf50(0.25, sharpening=0.5)
    frame[160:280, 60:150] = edge(sharpened, rows=120, columns=90, angle_deg=7.0)
    frame[300:420, 60:150] = np.minimum(edge(camera, rows=120, columns=90, angle_deg=4.0), 0.6)
    noisy = frame + 0.006 * rng.standard_normal(frame.shape)
    noisy[300:420, 60:150] = np.minimum(noisy[300:420, 60:150], 0.6)
    return Plane("Y", noisy.astype(np.float32), 1 / 4095)


@pytest.mark.slow
def test_each_edge_has_its_verdict_and_its_region_gives_the_same(rng: np.random.Generator) -> None:
    plane = several(rng)
    outcomes = estimate_edges(plane)
    verdicts = [one.verdict for one in outcomes]
    assert verdicts == [Verdict.PASS, Verdict.DOUBTFUL, Verdict.REFUSED]
    for one in outcomes:
        assert one.roi is not None
        again = estimate_edge(plane, one.roi)
        assert (again.verdict, again.reason) == (one.verdict, one.reason)
        if one.value is not None:
            assert again.value is not None
            assert again.value.numbers == one.value.numbers


class Comatic(Camera):
    """A lens at f/11 with coma along the edge's normal, pixels of 11.88 um, given by its wavefront."""

    def otf(self, f: np.ndarray, angle_deg: float) -> np.ndarray:
        """OTF along the normal of an edge at an angle from the columns; the normal points up from the rows."""
        lens = CircularPupil(11.0, Wavefront(coma_x_um=0.08)), PixelAperture(0.95, 0.95)
        angle = np.radians(-angle_deg)
        return np.asarray(Optics(lens, 11.88).otf(f * np.cos(angle), f * np.sin(angle)))

    def mtf50(self, angle_deg: float) -> float:
        """Frequency at which |OTF| first falls to one half."""
        f = np.linspace(0, 1, 10001)
        mtf = np.abs(self.otf(f, angle_deg))
        i = int(np.flatnonzero(mtf < 0.5)[0])
        return float(np.interp(0.5, mtf[[i, i - 1]], f[[i, i - 1]]))


@pytest.mark.slow
def test_asymmetric_tail_of_coma_does_not_bias_the_mtf() -> None:
    # with a symmetric tail the bias is 0.17 %; the aliases of four bins are 0.1 % below 0.6 cycles/pixel
    camera = Comatic()
    found = whole(noiseless(edge(camera, angle_deg=5.3, shift_px=0.3))).value
    assert found is not None
    assert found.numbers["mtf50"].value == pytest.approx(camera.mtf50(5.3), rel=0.001)
