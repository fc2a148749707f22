"""The plan of the two photographs without a bench: the operator photographs, and the files arrive in a folder."""

import json

import cv2
import numpy as np
import pytest

from drivers.errors import SystemClock
from station.guide.catalogue import plan_named
from station.guide.frontend import FrameEvent, Result
from station.guide.run import Run
from station.guide.scripted import ScriptedOperator
from station.guide.vibration import SettlingTimeouts
from station.sessions.session import Session

RATIO = 3.6


def blotches(size, rng):
    """A wall of discs of all sizes."""
    wall = np.full((size, size), 0.45, np.float32)
    for _ in range(size * size // 300):
        radius = float((2.0**-2 - rng.random() * (2.0**-2 - 200.0**-2)) ** -0.5)
        x, y = rng.random(2) * size
        cv2.circle(wall, (int(16 * x), int(16 * y)), int(16 * radius), float(rng.uniform(0.1, 0.9)), -1, shift=4)
    return wall


def photographed(wall, px, texels_per_px, rng):
    """The middle of the wall through a soft lens, as 16 bit grey."""
    soft = cv2.GaussianBlur(wall, (0, 0), 0.5 * texels_per_px)
    corner = len(wall) / 2 - texels_per_px * (px - 1) / 2
    H = np.array([[texels_per_px, 0, corner], [0, texels_per_px, corner]])
    image = cv2.warpAffine(soft, H, (px, px), flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP)
    return np.clip((0.85 * image + rng.normal(0, 0.002, image.shape)) * 65535, 0, 65535).astype(np.uint16)


@pytest.mark.slow
def test_the_photographs_of_a_folder_become_a_result(tmp_path, rng):
    card = tmp_path / "card"
    card.mkdir()
    wall = blotches(1600, rng)
    taken = []

    def photograph(ask):
        far = sum(one.key == "focused_far" for one in operator.asked)
        image = photographed(wall, 140 if far else 420, 3.0 * RATIO if far else 3.0, rng)
        taken.append(cv2.imwrite(str(card / f"{len(taken):03d}.png"), image))
        return True

    answers = {"frames_folder": str(card), "photographed": photograph, "near_mm": 1000.0, "ratio": RATIO}
    operator = ScriptedOperator({**answers, "focus_by": "skip"})
    plan, clock = plan_named("two-photo"), SystemClock()
    with Session.create(tmp_path, plan=plan.name, camera="C", lens="L", config={}, clock=clock) as session:
        ended = Run(plan, None, session, operator, SettlingTimeouts(quiet=1.0)).go()
        assert ended.how == "finished"
        assert all(event.advice.good for event in operator.heard if isinstance(event, FrameEvent))
        assert [shot.purpose for shot in session.state.counting()] == ["near", "near", "far", "far"]
        assert "3.60 m from the wall" in " ".join(ask.question for ask in operator.asked)
        (result,) = (event for event in operator.heard if isinstance(event, Result))
        record = json.loads((result.folder / "result.json").read_text())
    assert record["procedure"] == "two-photo"
    assert record["planes"]["Y"]["verdict"] in ("pass", "doubtful")
    np.testing.assert_allclose(record["planes"]["Y"]["scale"], RATIO, rtol=5e-3)
    assert (result.folder / "inter_image_Y.npy").is_file()
    assert ended.report is not None
