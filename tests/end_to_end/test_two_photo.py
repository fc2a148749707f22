"""Two photographs of the simulated bench's wall, from homing to the report, compared with the true optics."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from station.demo.truth_comparison import align
from station.guide.catalogue import plan_named
from station.guide.session_result import compute
from station.sessions.reader import read_session
from tests.end_to_end.enter_only import walk

pytestmark = pytest.mark.nightly


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    walked = walk("two-photo", 3, "plain", tmp_path_factory.mktemp("two-photo"))
    state = read_session(walked.folder).state
    found = compute(walked.folder, state, plan_named("two-photo")).planes["G1"].estimate
    return SimpleNamespace(walked=walked, view=walked.view, state=state, found=found)


def test_enter_alone_leads_to_the_psf_of_the_camera_at_the_scale_of_the_distances(done):
    assert done.walked.passed, f"{done.walked.summary}\n{done.walked.transcript}"
    assert (done.walked.folder / "report.html").read_text().startswith("<!doctype html>")
    # three times the near distance, which is read off a tape to 5 mm
    assert done.state.facts["at_z_mm"] == pytest.approx(3 * done.view.world.room.near_mm, abs=15)
    assert (done.state.facts["at_pan_deg"], done.state.facts["at_tilt_deg"]) == pytest.approx((0, 0), abs=0.01)
    found = done.found
    taken = [done.view.taken[i] for i in (-1, -4)]  # from afar, from nearby
    true = [one.true_psf("G1", found.psf.s, found.psf.k) for one in taken]
    aligned, _ = align(true[0].h, found.psf.h)
    error = np.linalg.norm(found.psf.h - aligned) / np.linalg.norm(aligned)
    # focus by eye differs slightly between the distances, which the estimate cannot know
    focus = np.linalg.norm(true[1].h - true[0].h) / np.linalg.norm(aligned)
    # 1 where the error bars are true; the norm of 169 correlated values scatters by a third
    assert error / math.hypot(found.diagnostics["relative_uncertainty"], true[0].floor, focus) < 1.6
    number = found.quality.numbers["mtf_nyquist_horizontal"]
    true_nyquist = float(abs(taken[0].true_otf("G1", np.array([0.5]), np.zeros(1))[0]))
    assert abs(number.value - true_nyquist) < 3 * number.uncertainty < 0.15
    distances = [done.view.world.room.near_mm + shot.snapshot["axes"]["z_mm"] for shot in done.state.counting()]
    f_mm = done.view.camera.lens.focal_length_mm
    # a thin lens in focus at d magnifies f / (d - f); hands and rangefinder have no part in it
    assert np.mean(done.found.scale) == pytest.approx((distances[-1] - f_mm) / (distances[0] - f_mm), rel=2e-3)
