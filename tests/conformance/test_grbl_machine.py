"""What happens to a GRBL at a bench: its power fails, its door is opened, its homing takes long.

At the twins always; at GRBL in simavr with `--grbl-firmware` and `--grbl-box`, at grblHAL's simulator with `--grblhal`.
"""

import pytest

from drivers.errors import DeviceError, Held, LineLost, NoAnswer, NotHomed, WasReset

from .test_stage import middle, near

DOOR = b"\x84"
PULL_OFF_MM = 6.0


@pytest.fixture
def homed(grbl_rig):
    grbl_rig.device.connect()
    grbl_rig.device.home()
    return grbl_rig.device


def stands(rig, for_s):
    """Whether nothing moves for so long."""
    before = rig.machine.standing() if rig.machine else ()
    rig.clock.sleep(for_s)
    return not before or rig.machine.standing() == before


def while_it_moves(rig, happens):
    """From one end to the other, and what happens a second later; what the move ended in."""
    rig.device.move_to(**middle(rig.device, 0.0))
    return rig.together(
        lambda: rig.device.move_to(**middle(rig.device, 1.0)), lambda: (rig.clock.sleep(1.0), happens())
    )[0]


@pytest.mark.parametrize(
    ("off_s", "with_line", "error", "reported"),
    [
        (0.5, False, WasReset, "restarted; home the stage"),
        (40.0, False, NoAnswer, "did not answer .* check power and cable, then connect again"),
        (2.0, True, LineLost, "went away: .* connect again"),
    ],
)
def test_power_that_fails_in_mid_move_leaves_no_trust(homed, grbl_rig, off_s, with_line, error, reported):
    machine = grbl_rig.machine
    if machine is None:
        pytest.skip("nobody switches a real device off here")
    if not (with_line or machine.line_stays):
        pytest.skip("its line goes with it")
    moved = while_it_moves(grbl_rig, lambda: machine.cut_power(off_s, with_line))
    assert isinstance(moved, error), repr(moved)
    with pytest.raises(error, match=reported):
        raise moved
    assert not homed.condition().usable
    assert stands(grbl_rig, off_s + 3.0)
    with pytest.raises(DeviceError, match=r"home the stage|connect again|connect first"):
        homed.move_to(**middle(homed))
    if error is not WasReset:
        homed.connect()
        with pytest.raises(NotHomed, match="home the stage"):
            homed.move_to(**middle(homed))
    assert stands(grbl_rig, 1.0)
    homed.home()
    homed.move_to(**middle(homed))
    assert near(homed.position(), middle(homed))


def test_a_door_that_opens_in_mid_move_is_named(homed, grbl_rig):
    moved = while_it_moves(grbl_rig, lambda: homed.link.write(DOOR))
    assert isinstance(moved, Held), repr(moved)
    assert "at the door" in moved.reason
    assert stands(grbl_rig, 2.0)
    if homed.condition().usable:
        homed.resume()
    else:  # the reports do not show the door
        assert homed.condition().remedy == "close it, then home the stage"
        homed.home()
    homed.move_to(**middle(homed))
    assert near(homed.position(), middle(homed))


def test_homing_has_the_time_of_its_slow_search(grbl_rig):
    # which lasts longer than twice all that is searched quickly; GRBL goes no slower than 7.3 mm a minute at 250 steps
    if grbl_rig.machine is None:
        pytest.skip("a real device keeps its settings")
    stage = grbl_rig.device
    if stage.connect().model == "FluidNC":
        pytest.skip("it has its settings in a file")
    lengths = [one.high - one.low for one in stage.envelopes.values()]
    slow_s = 10 + 1.5 * sum(2 * 2.5 * length / stage.link.setting(25, None) * 60 for length in lengths)
    stage.close()
    grbl_rig.machine.set(f"$27={PULL_OFF_MM}", f"$24={60 * PULL_OFF_MM / slow_s:.3f}")
    stage.connect()
    begin_s = grbl_rig.clock.now_s()
    stage.home()
    assert grbl_rig.clock.now_s() - begin_s > 0.9 * slow_s
    stage.move_to(**middle(stage))
    assert near(stage.position(), middle(stage))
