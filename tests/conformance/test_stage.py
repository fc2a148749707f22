"""What every stage promises."""

from contextlib import contextmanager

import pytest

from drivers.errors import BadConfiguration, EmergencyStopped, MoveFailed, NotHomed, OutsideTravel, Rejected


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


def test_it_says_who_it_is(stage_rig):
    identity = stage_rig.device.connect()
    assert identity.model
    assert identity.firmware
    assert identity.address == stage_rig.device.address


def reported(stage):
    """Its position, or that it reports none before homing."""
    try:
        return stage.position()
    except Rejected as refused:
        return refused.reason


def test_it_does_not_move_before_homing(stage):
    before = reported(stage)
    with pytest.raises(NotHomed, match="not homed"):
        stage.move_to(**middle(stage))
    assert not stage.moving()
    assert reported(stage) == before
    assert not stage.condition().usable


def test_it_homes_inside_its_travel(homed):
    assert all(homed.travel()[name].holds(value) for name, value in homed.position().items())
    assert homed.condition().usable
    assert not homed.moving()


def test_it_goes_where_it_is_sent_and_the_world_agrees(homed, stage_rig):
    for fraction in stage_rig.places:
        goal = middle(homed, fraction)
        homed.move_to(**goal)
        assert near(homed.position(), goal)
        if stage_rig.bench is not None:
            now_s = stage_rig.clock.now_s()
            assert near({name: stage_rig.bench.world.axes[name].position(now_s) for name in goal}, goal)


def test_one_axis_moves_alone(homed):
    homed.move_to(**middle(homed))
    name, travel = next(iter(homed.travel().items()))
    homed.move_to(**{name: travel.low + 0.3 * (travel.high - travel.low)})
    expected = {**middle(homed), name: travel.low + 0.3 * (travel.high - travel.low)}
    assert near(homed.position(), expected)


@pytest.mark.parametrize("beyond", [1e-3, 50.0, float("inf"), float("nan")])
def test_it_refuses_to_leave_its_travel(homed, beyond):
    before = homed.position()
    name, travel = next(iter(homed.travel().items()))
    for value in (travel.high + beyond, travel.low - beyond):
        with pytest.raises(OutsideTravel, match=r"lies outside .* choose a target inside"):
            homed.move_to(**{name: value})
    assert homed.position() == before


def test_it_refuses_an_axis_it_has_not(homed):
    with pytest.raises(BadConfiguration, match="there is no axis nowhere_mm; axes are"):
        homed.move_to(nowhere_mm=1.0)


def test_stop_ends_a_move_and_keeps_the_position(homed, stage_rig):
    homed.move_to(**middle(homed, 0.0))
    clock, ended_s = stage_rig.clock, {}

    def move():
        try:
            homed.move_to(**middle(homed, 1.0))
        finally:
            ended_s["move"] = clock.now_s()

    def stop():
        clock.sleep(1.0)
        assert homed.moving()
        homed.stop()
        ended_s["stop"] = clock.now_s()

    moved, stopped = stage_rig.together(move, stop)
    assert isinstance(moved, MoveFailed), moved
    assert stopped is None
    # slowing down and some polls, whatever time the move would have taken
    assert ended_s["move"] - ended_s["stop"] < 3.0
    assert "was stopped" in moved.reason
    assert not homed.moving()
    homed.move_to(**middle(homed))
    assert near(homed.position(), middle(homed))


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


def test_a_second_mover_is_refused(homed, stage_rig):
    homed.move_to(**middle(homed, 0.0))
    clock = stage_rig.clock

    def second():
        clock.sleep(0.5)
        homed.move_to(**middle(homed, 0.2))

    first, second_outcome = stage_rig.together(lambda: homed.move_to(**middle(homed, 0.6)), second)
    assert first is None
    assert isinstance(second_outcome, Rejected)
    assert "already moving" in second_outcome.reason


def test_an_emergency_stop_ends_a_move_and_holds_until_homed(homed, stage_rig):
    homed.move_to(**middle(homed, 0.0))
    clock = stage_rig.clock

    def emergency():
        clock.sleep(1.0)
        homed.emergency_stop()
        homed.emergency_stop()

    moved, _ = stage_rig.together(lambda: homed.move_to(**middle(homed, 1.0)), emergency)
    assert isinstance(moved, EmergencyStopped)
    clock.sleep(0.5)
    assert not homed.moving()
    with pytest.raises(EmergencyStopped, match="then home"):
        homed.move_to(**middle(homed))
    assert not homed.condition().usable
    homed.home()
    homed.move_to(**middle(homed))
    assert near(homed.position(), middle(homed))


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


def test_after_connecting_again_it_must_be_homed_again(homed):
    homed.connect()
    with pytest.raises(NotHomed):
        homed.move_to(**middle(homed))


def test_nothing_ever_left_the_travel(homed, stage_rig):
    if stage_rig.bench is None:
        pytest.skip("the truth about a real stage is not known")
    homed.move_to(**middle(homed, 0.0))
    homed.move_to(**middle(homed, 1.0))
    for axis in stage_rig.bench.world.axes.values():
        low, high = axis.extremes()
        assert axis.low - 1e-6 <= low
        assert high <= axis.high + 1e-6
