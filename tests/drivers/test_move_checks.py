"""What all stages keep to: one mover, targets and arrivals, and when a position is trusted."""

import pytest

from drivers.errors import Alarm, BadConfiguration, EmergencyStopped, MoveFailed, NotHomed, OutsideTravel, Rejected
from drivers.interfaces import Condition, Travel
from drivers.move_checks import STOP_BY_HAND, UNHOMED, OneMover, Trust, check_arrival, check_target, in_turn, left_still

ALARM, STOP = Alarm("it stalled", "clear it", "1"), EmergencyStopped("stopped", "home it")
TRAVEL = {"z_mm": Travel(0.0, 10.0)}


def test_a_stage_has_one_mover_whose_orders_end_with_a_stop():
    mover, asked = OneMover(), []
    with mover as stops:
        with pytest.raises(Rejected, match="already moving"), mover:
            pytest.fail("it was entered")
        check = mover.unless_stopped(stops, lambda: asked.append(1), lambda: asked.append(2))
        check()
        assert (asked, mover.stopped(stops)) == ([1, 2], False)
        mover.stop()
        assert mover.stopped(stops)
        with pytest.raises(MoveFailed, match="stopped before all axes had started"):
            check()
    with mover as now:
        assert not mover.stopped(now)


@pytest.mark.parametrize(
    ("ends", "halts", "asked"),
    [(None, None, []), (ALARM, None, ["halt"]), (ALARM, STOP, ["halt", STOP]), (KeyboardInterrupt(), None, ["all"])],
)
def test_nothing_moves_on_where_a_move_ends_early(ends, halts, asked):
    seen, trust = [], Trust()
    trust.why = None

    def halt():
        seen.append("halt")
        if halts:
            raise halts

    def run():
        with left_still(halt, lambda: seen.append("all"), trust):
            if ends:
                raise ends

    if ends:
        with pytest.raises(type(ends)) as ended:
            run()
        if halts:
            assert ended.value.reason == ends.reason
            assert ended.value.remedy == f"{STOP_BY_HAND}; then {ends.remedy}"
    else:
        run()
    assert [*seen, *([trust.why] if trust.why else [])] == asked


def test_targets_and_arrivals_are_checked_at_their_bounds():
    for inside in (0.0, 10.0):
        check_target({"z_mm": inside}, TRAVEL)
    for outside in (-0.01, 10.01):
        with pytest.raises(OutsideTravel, match=r"z_mm = .* lies outside 0 \.\. 10.* choose a target inside"):
            check_target({"z_mm": outside}, TRAVEL)
    with pytest.raises(BadConfiguration, match="there is no axis x_mm; axes are"):
        check_target({"x_mm": 1.0}, TRAVEL)
    check_arrival("z_mm", 5.0, 5.25, 0.25, stopped=False)
    for there, stopped, how in ((5.26, False, "stopped"), (4.74, True, "was stopped")):
        with pytest.raises(MoveFailed, match=f"^z_mm {how} at {there:.4f} on its way to 5.0000"):
            check_arrival("z_mm", 5.0, there, 0.25, stopped)


def test_trust_begins_with_homing_and_ends_with_the_first_event():
    trust = Trust()
    assert trust.refusal(False) == Condition("not connected", False, "connect it")
    assert trust.refusal(True) == Condition(UNHOMED.reason, False, UNHOMED.remedy)
    with pytest.raises(NotHomed):
        trust.require()
    epoch = trust.begin(trust.preemptions)
    trust.undisturbed(epoch)
    trust.give(epoch)
    trust.require()
    assert trust.refusal(True) is None
    trust.lose(ALARM)
    trust.lose(STOP)  # the first reason is kept
    assert trust.refusal(True) == Condition("it stalled", False, "clear it")
    for late in (trust.undisturbed, trust.give):
        with pytest.raises(Alarm):
            late(epoch)
    trust.preempt(STOP)  # an emergency stop replaces it
    with pytest.raises(EmergencyStopped):
        trust.require()
    before = trust.preemptions
    trust.preempt(STOP)
    with pytest.raises(EmergencyStopped):
        trust.begin(before)
    assert trust.why is STOP
    epoch = trust.begin(trust.preemptions)
    assert trust.why is UNHOMED
    trust.lose(ALARM)  # in mid-homing
    with pytest.raises(Alarm):
        trust.give(epoch)
    assert trust.why is ALARM


def test_checks_are_made_in_their_order():
    seen = []
    in_turn(*(lambda n=n: seen.append(n) for n in range(3)))()
    assert seen == [0, 1, 2]
