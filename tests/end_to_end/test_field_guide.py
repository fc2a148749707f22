"""A field from one chart that the head brings to six places of the frame, interrupted on the way."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from procedures import read_camera_numbers
from procedures.facts import facts_as
from procedures.field.field_file import read_field
from procedures.field.plan import BEFORE, FEWEST, NEAR, locations
from procedures.pattern_psf.facts import PatternFacts
from simulators.bench.simulated_operator import Person
from simulators.camera.sensor import Sensor
from station.bench.opening import simulated_bench
from station.calibration.field_photographs import photographs
from station.guide.catalogue import plan_named
from station.guide.frontend import Doing, Result, Seen
from station.guide.recompute import recompute
from station.guide.run import Run
from station.guide.scripted import Scripted
from station.guide.session_report import session_page
from station.sessions.session import Session

pytestmark = pytest.mark.slow


def as_left(bench) -> dict:
    """What is known when the chart hangs straight, in focus, at its distance: the steps that other tests go through."""
    hands, hung = bench.simulated.hands, Person().mount
    keys = ("chart_width_mm", "ruler_mm", "focal_length_mm", "pixel_pitch_um", "sensor_kind")
    facts = {key: hands.knows(key) for key in keys}
    facts |= {"printed": True, "mounted": True, "focused": True, "light_level": 1.0, "f_number": 5.6}
    facts |= {f"hand_chart_{name}_deg": -getattr(hung, f"{name}_deg") for name in ("yaw", "pitch", "roll")}
    facts |= {"hand_aim": 1.0, "hand_even_light": 1.0, "hand_exposure_ev": math.log2(160 / 50)}
    room = bench.simulated.world.room
    places = {name: (low + high) / 2 for name, (low, high) in room.travel.items()}
    places["z_mm"] = facts_as(PatternFacts, facts).wanted_distance_mm() - room.near_mm
    return facts | {f"at_{name}": place for name, place in places.items()}


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    root = tmp_path_factory.mktemp("field")
    plan, folder = plan_named("field"), None
    told = SimpleNamespace(heard=[], ends=[], shots=[])
    for stop_at in ("place 4 of 6", None):
        incoming = Path(root, f"incoming-{stop_at}")
        incoming.mkdir()
        bench = simulated_bench(incoming, seed=3, virtual_time=True)
        view = bench.simulated.view
        # what is done to a mosaic's four planes is done here to one of their size; the error stays far below the noise
        view.camera = replace(view.camera, oversampling=8, sensor=Sensor(240, 320, cfa=None), pitch_um=11.88)
        if folder is None:
            session = Session.create(root, plan="field", camera="C", lens="L", config={}, clock=bench.clock, seed=3)
            session.learn(as_left(bench))
            for name in BEFORE:
                session.begin_step(name)
                session.finish_step(name)
            folder = session.folder
        else:
            session = Session.open(folder, bench.clock)
        operator = Scripted({"places": float(FEWEST)})
        run = Run(plan, bench, session, operator)

        def listen(event, run=run, stop_at=stop_at):
            if isinstance(event, Doing) and event.say == stop_at:
                run.ask_to_stop()

        operator.listen = listen
        told.ends.append(run.go())
        told.heard.append(operator.heard)
        told.shots.append(session.state.counting())
        told.view, told.state = bench.simulated.view, session.state
        told.taken = (*getattr(told, "taken", ()), *bench.simulated.view.taken)
        session.close()
        bench.close()
    told.folder = folder
    return told


def test_each_place_is_photographed_once_though_it_was_interrupted(done):
    assert [end.how for end in done.ends] == ["stopped", "finished"]
    assert [len(shots) for shots in done.shots] == [3, FEWEST]
    assert [shot.purpose for shot in done.shots[1]] == [f"place {i} of {FEWEST}" for i in range(1, FEWEST + 1)]


def test_what_counts_was_seen_where_it_was_wanted(done):
    # the truth is the simulator's own projection; the check allows NEAR, detection errs by far less than 1 % of that
    facts = done.state.facts
    wanted = np.array([(one.x, one.y) for one in locations(facts)])
    seen = [event.advice for heard in done.heard for event in heard if isinstance(event, Seen)]
    off = [
        advice.readings[0].value for advice in seen if advice.readings and advice.readings[0].name == "off its place"
    ]
    assert len(off) == FEWEST
    assert max(off) <= 100 * NEAR
    assert np.ptp(wanted, axis=0).min() > 0.4


def test_the_field_s_nodes_are_the_lens_s(done):
    (result,) = (event for event in done.heard[1] if isinstance(event, Result))
    field = read_field(result.folder / "field.h5")["Y"]
    assert len(field.nodes) == FEWEST
    for node, shot in zip(field.nodes, done.shots[1], strict=True):
        true = done.taken[shot.number - 1].true_psf("Y", node.psf.s, node.psf.k)
        # the norm of 289 correlated values scatters by a third
        expected = np.hypot(np.sqrt(np.trace(node.psf.covariance)), true.floor)
        assert np.linalg.norm(node.psf.h - true.h) < 1.6 * expected


def test_what_the_photographs_tell_of_the_camera_has_one_covariance(done):
    (result,) = (event for event in done.heard[1] if isinstance(event, Result))
    found = read_camera_numbers(result.folder / "camera.h5")
    assert {name.partition(".")[0] for name in found.names} == {"psf"}  # one plane: no colours
    spread = np.sqrt(np.diag(found.covariance))
    assert np.linalg.eigvalsh(found.covariance / np.outer(spread, spread)).min() > -1e-9
    page = done.ends[1].report.read_text()
    assert "The whole camera" in page
    # six places of a frame of nine degrees, the chart square to the lens: no geometry, and the reason why
    assert found.model == ""
    assert "Add views of the chart, tilted differently and spread over the frame" in page


def test_it_ends_with_a_report_of_the_field(done):
    page = done.ends[1].report.read_text()
    assert page.startswith("<!doctype html>")
    assert session_page(done.folder) == page


def test_it_can_be_computed_again_to_the_last_bit(done):
    (again,) = recompute(done.folder)
    assert again.identical, again


def test_its_photographs_are_what_the_command_line_takes_of_a_session(done):
    assert photographs(done.folder) == [done.folder / shot.path for shot in done.shots[1]]
