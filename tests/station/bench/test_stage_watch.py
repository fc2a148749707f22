"""What a front end is shown of a stage before, in and after a motion; the stage's motion is a list of places."""

from types import SimpleNamespace

import pytest

from drivers.errors import MoveFailed, NoAnswer
from drivers.interfaces import Condition
from station.bench.motions import Motions
from station.bench.stage_watch import HOMING, DeviceState, StageWatch

IDLE, LOST = Condition("idle"), Condition("unhomed", False, "home it")


class Stage:
    """A stage that is looked at after each second of its way; a place that is an error is raised by the line."""

    def __init__(self):
        self.place, self.asked, self.state, self.seconds = 0.0, 0, IDLE, []

    def condition(self):
        return self.state

    def position(self):
        self.asked += 1
        if isinstance(self.place, Exception):
            raise self.place
        return {"z_mm": self.place}

    def pass_by(self, places):
        for place in places:
            self.place = place
            self.each_second()

    def move_to(self, **target):
        self.pass_by(self.way)

    def home(self, allowed):
        allowed()
        self.pass_by(self.way)


@pytest.fixture
def stage():
    return Stage()


@pytest.fixture
def bench(stage):
    clock = SimpleNamespace(seconds=0.0)
    clock.now_s = lambda: clock.seconds
    return SimpleNamespace(devices={"stage": stage}, clock=clock, motions=Motions({"stage": stage}, clock))


@pytest.fixture
def watch(bench, stage):
    watch = StageWatch(bench)
    stage.seen = []

    def look():
        stage.seen.extend(watch.look())
        bench.clock.seconds += 1

    stage.each_second = look
    return watch


def test_a_stage_that_stands_is_not_asked_where(watch, stage):
    assert watch.look() == [DeviceState("stage", IDLE)]
    assert stage.asked == 0


def test_a_move_is_shown_with_its_place_and_the_time_left(watch, bench, stage):
    stage.way = (0.0, 1.0, 25.0, 75.0)
    bench.motions.move("stage", {"z_mm": 100.0})
    assert [state.places for state in stage.seen] == [{"z_mm": place} for place in stage.way]
    assert all(state.moving for state in stage.seen)
    assert [state.condition.word for state in stage.seen] == [
        "moving z 0.0 to 100.0 mm",
        "moving z 1.0 to 100.0 mm",  # too little for a speed
        "moving z 25.0 to 100.0 mm, 6 s left",  # at the mean speed since it began: 25 mm in 2 s
        "moving z 75.0 to 100.0 mm, 1 s left",
    ]


def test_the_longest_of_several_moves_is_waited_for(watch, bench, stage):
    stage.position = lambda: {"x_mm": 2 * bench.clock.seconds, "z_mm": bench.clock.seconds, "y_mm": 7.0}
    stage.way = (0.0, 0.0, 0.0)
    bench.motions.move("stage", {"x_mm": 10.0, "z_mm": 10.0, "y_mm": 7.0, "lost_mm": 3.0})
    assert stage.seen[-1].condition.word.endswith("8 s left")
    assert "lost_mm" not in stage.seen[-1].condition.word


def test_the_next_move_begins_where_the_last_one_ended(watch, bench, stage):
    for way, goal in (((0.0, 50.0, 100.0), 100.0), ((100.0, 90.0), 0.0)):
        stage.way = way
        bench.motions.move("stage", {"z_mm": goal})
        watch.look()
    assert stage.seen[-1].condition.word.endswith("9 s left")


def test_a_move_that_ended_is_asked_once_where_it_stands(watch, bench, stage):
    stage.way = (MoveFailed("it stalled", "look"),)
    stage.each_second = lambda: (_ for _ in ()).throw(stage.place)
    with pytest.raises(MoveFailed):
        bench.motions.move("stage", {"z_mm": 100.0})
    stage.place, stage.state = 42.0, LOST
    for _ in range(2):
        assert watch.look() == [DeviceState("stage", LOST, places={"z_mm": 42.0})]
    assert stage.asked == 1
    assert not bench.motions.under_way


def test_a_line_that_does_not_answer_leaves_the_last_place(watch, bench, stage):
    stage.way = (3.0, NoAnswer("silent", "look"))
    bench.motions.move("stage", {"z_mm": 100.0})
    assert stage.seen[-1].places == {"z_mm": 3.0}


@pytest.mark.parametrize(("after", "places"), [(IDLE, {"z_mm": 0.0}), (LOST, {})])
def test_a_place_is_known_only_after_a_homing_that_succeeded(watch, bench, stage, after, places):
    stage.way = (7.0,)
    bench.motions.move("stage", {"z_mm": 7.0})
    watch.look()
    asked, stage.way = stage.asked, (5.0, 0.0)
    bench.motions.home("stage", lambda: setattr(stage, "state", LOST))
    assert stage.seen[-2:] == [DeviceState("stage", Condition(HOMING, False, "home it"), moving=True)] * 2
    assert stage.asked == asked  # a controller does not answer while homing
    stage.state = after
    assert watch.look() == [DeviceState("stage", after, places=places)]


def test_a_motion_is_under_way_until_it_ends_and_ends_once(bench, stage):
    seen = []
    stage.way, stage.each_second = (
        (1.0,),
        lambda: seen.append((bench.motions.motion_of("stage"), bench.motions.under_way)),
    )
    bench.clock.seconds = 5.0
    bench.motions.move("stage", {"z_mm": 1.0})
    ((motion, under_way),) = seen
    assert (motion.began_s, motion.target, under_way) == (5.0, {"z_mm": 1.0}, True)
    assert bench.motions.motion_of("stage") is None
    assert bench.motions.take_ended("stage") is motion
    assert bench.motions.take_ended("stage") is None
