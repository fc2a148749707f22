"""What every stage promises."""

from collections.abc import Callable
from contextlib import contextmanager
from functools import partial

import numpy as np
import pytest

from drivers.errors import EmergencyStopped, NotHomed
from station.bench.conform import (
    StageRig,
    arrives,
    homes_first,
    identifies,
    keeps_its_travel,
    refuses_a_second_mover,
    stops,
    stops_in_an_emergency,
)

ONCE = {"rng": np.random.default_rng(1), "tries": 1}
TRIALS: dict[str, Callable[[StageRig], object]] = {
    "identifies": identifies, "keeps its travel": keeps_its_travel, "refuses": refuses_a_second_mover,
    "stops": partial(stops, **ONCE), "stops in an emergency": partial(stops_in_an_emergency, **ONCE),
}  # fmt: skip
"""Of `station conform`, those that need a homed stage."""


@pytest.fixture
def stage(stage_rig):
    stage_rig.device.connect()
    return stage_rig.device


@pytest.fixture
def homed(stage):
    stage.home()
    return stage


def middle(stage, fraction=0.5):
    return {name: t.low + fraction * (t.high - t.low) for name, t in stage.travel().items()}


def near(there, goal):
    # a hundredth of a millimetre or degree: coarser than any resolution configured here, finer than any use
    return there == pytest.approx(goal, abs=0.01)


@pytest.fixture
def trial(stage_rig):
    """The same as the trials of `station conform` have it."""
    axes = stage_rig.bench and stage_rig.bench.world.axes
    return StageRig(stage_rig.device, stage_rig.clock, axes)


def test_it_does_not_move_before_homing(trial):
    homes_first(trial)


def test_it_goes_where_it_is_sent(trial, homed, stage_rig):
    arrives(trial, stage_rig.places)


@pytest.mark.parametrize("name", TRIALS)
def test_it_keeps_the_promises_of_the_trials(trial, homed, name):
    TRIALS[name](trial)
    if not homed.condition().usable:
        homed.home()
    homed.move_to(**middle(homed))
    assert near(homed.position(), middle(homed))


def test_one_axis_moves_alone(homed):
    homed.move_to(**middle(homed))
    name, travel = next(iter(homed.travel().items()))
    homed.move_to(**{name: travel.low + 0.3 * (travel.high - travel.low)})
    expected = {**middle(homed), name: travel.low + 0.3 * (travel.high - travel.low)}
    assert near(homed.position(), expected)


@pytest.fixture
def far(stage, stage_rig):
    """Away from its switches, and not homed: its way there lasts longer than half a second."""
    stage.home()
    stage.move_to(**middle(stage))
    stage.connect()
    if stage_rig.bench is None:
        begin_s = stage_rig.clock.now_s()
        stage.home()
        if stage_rig.clock.now_s() - begin_s < 0.6:
            pytest.skip("its homing is over before it could be stopped")
        stage.move_to(**middle(stage))
        stage.connect()
    return stage


def test_stop_ends_a_homing_and_leaves_it_unhomed(far, stage_rig):
    stage, clock = far, stage_rig.clock
    homed, _ = stage_rig.together(stage.home, lambda: (clock.sleep(0.5), stage.stop()))
    assert isinstance(homed, Exception)
    assert not stage.condition().usable
    stage.home()
    stage.move_to(**middle(stage))


@pytest.fixture
def powered(homed):
    """A stage whose motors a watchdog may release."""
    if not hasattr(homed, "power"):
        pytest.skip("no watchdog enables its motors")
    return homed


def test_motors_that_lost_their_current_end_a_move_and_hold_until_homed(powered, stage_rig):
    powered.move_to(**middle(powered, 0.0))
    clock, error = stage_rig.clock, NotHomed("the motors were released", "home the stage")
    moved, _ = stage_rig.together(
        lambda: powered.move_to(**middle(powered, 1.0)), lambda: (clock.sleep(1.0), powered.lose_position(error))
    )
    assert moved is error
    clock.sleep(0.5)
    assert not powered.moving()
    with pytest.raises(NotHomed, match="the motors were released"):
        powered.move_to(**middle(powered))
    powered.home()
    powered.move_to(**middle(powered))
    assert near(powered.position(), middle(powered))


def test_motors_are_powered_for_homing_and_for_each_move(powered):
    entered = []

    @contextmanager
    def power():
        entered.append(True)
        yield
        assert not powered.moving()

    powered.power = power
    powered.home()
    powered.move_to(**middle(powered))
    assert len(entered) == 2


def test_an_emergency_stop_while_homing_is_not_forgotten(far, stage_rig):
    stage, clock = far, stage_rig.clock
    homed, _ = stage_rig.together(stage.home, lambda: (clock.sleep(0.5), stage.emergency_stop()))
    assert isinstance(homed, EmergencyStopped)
    with pytest.raises(EmergencyStopped):
        stage.move_to(**middle(stage))


def test_nothing_ever_left_the_travel(homed, stage_rig):
    if stage_rig.bench is None:
        pytest.skip("the truth about a real stage is not known")
    homed.move_to(**middle(homed, 0.0))
    homed.move_to(**middle(homed, 1.0))
    for axis in stage_rig.bench.world.axes.values():
        low, high = axis.extremes()
        assert axis.low - 1e-6 <= low
        assert high <= axis.high + 1e-6
