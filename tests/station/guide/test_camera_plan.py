"""Use of the sensor model for the PSFs of a whole-camera session, plane by plane."""

from types import SimpleNamespace

import pytest

from procedures.outcome import Outcome, Verdict, causes_of
from station.calibration.sensor import SensorFiles, SensorPlane
from station.guide.plans import camera

FEW = "the ladder has 12 levels; the standard requires 50"
UNEVEN = Outcome(SimpleNamespace(caveat=""), Verdict.DOUBTFUL, "light differs by 14 % over the sensor")
SHORT = Outcome(SimpleNamespace(caveat=FEW), Verdict.DOUBTFUL, FEW)
REFUSED = Outcome(None, Verdict.REFUSED, "light must not change between pictures; it does by 5 %")


@pytest.fixture
def used(monkeypatch):
    """used(planes, iso): the sensor of these planes' outcomes, for charts of that sensitivity."""
    monkeypatch.setattr(camera, "sensor_model", lambda model, step: step)

    def use(planes, iso=100.0):
        models = [SensorPlane(name, one, (4, 4), 4.0, None) for name, one in planes.items()]
        files = SensorFiles([], None, 100.0, models)
        outcomes = {name: Outcome(files, one.verdict, one.reason) for name, one in planes.items()}
        return camera.sensor_used(outcomes, iso)

    return use


def test_doubtful_refused_and_other_sensors_are_not_used(used):
    answer, models, words = used({"R": UNEVEN, "B": UNEVEN})
    assert answer.verdict is Verdict.DOUBTFUL
    assert models == {"R": 4.0, "B": 4.0}
    assert words == f"R, B: {camera.USED}"
    answer, models, words = used({"R": UNEVEN, "G1": SHORT, "B": REFUSED})
    assert answer.verdict is Verdict.REFUSED
    assert set(models) == {"R"}
    assert f"G1: {camera.NOT_USED}: {FEW}" in words
    assert f"B: {camera.NOT_USED}: {REFUSED.reason}" in words
    answer, models, words = used({"R": UNEVEN}, iso=400.0)
    assert not models
    assert words == f"{camera.NOT_USED}: the sensor was measured at ISO 100, the charts were taken at ISO 400"
    assert answer.verdict is Verdict.DOUBTFUL
    assert any("ISO 400" in one.reason for one in causes_of(answer))
    _, models, words = camera.sensor_used({"R": REFUSED}, 100.0)
    assert not models
    assert words == f"{camera.NOT_USED}: it was refused"
