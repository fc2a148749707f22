"""The whole camera in one guided session: the panel, the chart at six places and turned, interrupted on the way."""

import json
import math
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from procedures import estimate_psf, read_camera_numbers, read_field
from procedures.field import conclusion
from procedures.field import estimate as field_estimate
from procedures.field.maps import derive
from procedures.field.plan import BEFORE, FEWEST, NEAR, locations
from procedures.geometry.chart_bins import photographs as geometry_photographs
from procedures.geometry.plan import TURN_DEG
from procedures.pattern_psf.facts import PatternFacts
from procedures.plan import Advice, Shoot, Step, facts_as
from procedures.sensor.plan import estimate_none
from procedures.whole_camera.plan import QUARTERS, WholeCameraFacts, plan
from simulators.bench.bench import Setup, SimulatedBench
from simulators.bench.simulated_operator import Person
from simulators.camera.sensor import Sensor
from station.bench.opening import make_bench, simulated_bench, simulated_tables
from station.calibration.field_photographs import photographs
from station.guide.catalogue import plan_named
from station.guide.frontend import DiagramEvent, FrameEvent, ProgressEvent, Result, StepBegan
from station.guide.plans.camera import SHOT_FACTS, USED, estimate
from station.guide.recompute import recompute
from station.guide.run import Run
from station.guide.scripted import ScriptedOperator
from station.guide.session_report import certificate_files, session_page
from station.sessions.session import Session

pytestmark = pytest.mark.nightly

ROOMS = (field_estimate, geometry_photographs)
LEVELS, PICTURES, VIEWS = 20, 3, 4
VIGNETTING = (-0.12, -0.02, 0.0)


def as_left(bench) -> dict:
    """Facts after the steps that other tests cover: the chart hangs straight, in focus, at its distance."""
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


def counted(monkeypatch) -> SimpleNamespace:
    """Of all PSFs estimated from now on: sensor, calling module, and results by samples."""
    collected = SimpleNamespace(sensors=[], answers={})
    for room in ROOMS:

        def estimated(plane, *words, room=room, **more):
            collected.sensors.append((room, more.get("sensor")))
            return collected.answers.setdefault((room, plane.samples.tobytes()), estimate_psf(plane, *words, **more))

        monkeypatch.setattr(room, "estimate_psf", estimated)
    return collected


@pytest.fixture(scope="module")
def monkeypatch_module():
    with pytest.MonkeyPatch.context() as patched:
        yield patched


@pytest.fixture(scope="module")
def done(tmp_path_factory, monkeypatch_module):
    root = tmp_path_factory.mktemp("camera")
    monkeypatch_module.setattr(conclusion, "derive", partial(derive, columns=7))  # maps of a ninth of their places
    whole, folder = plan(estimate, LEVELS, PICTURES), None
    collected = SimpleNamespace(heard=[], asked=[], ends=[], shots=[], taken=(), minutes=0.0)
    estimates = counted(monkeypatch_module)
    at_print_place_and_end = (
        lambda event: isinstance(event, StepBegan) and event.step.name == BEFORE[0],
        lambda event: isinstance(event, ProgressEvent) and event.say == "place 4 of 6",
        lambda event: False,
    )
    for part, stops in enumerate(at_print_place_and_end):
        incoming = Path(root, f"incoming-{part}")
        incoming.mkdir()
        bench = simulated_bench(incoming, seed=3, virtual_time=True)
        bench.simulated.show(whole.subject)
        view = bench.simulated.view
        # what is done to a mosaic's four planes is done here to one of their size; the error stays far below the noise
        lens = replace(view.camera.lens, k1=-0.02, vignetting=VIGNETTING)
        view.camera = replace(view.camera, lens=lens, oversampling=5, sensor=Sensor(300, 400, cfa=None))
        if folder is None:
            session = Session.create(root, plan="camera", camera="C", lens="L", config={}, clock=bench.clock, seed=3)
            folder = session.folder
        else:
            session = Session.open(folder, bench.clock)
        if part == 1:
            session.learn(as_left(bench))
            for name in BEFORE:
                session.begin_step(name)
                session.finish_step(name)
        operator = ScriptedOperator({"places": float(FEWEST), "views": float(VIEWS)})
        run = Run(whole, bench, session, operator)

        def listen(event, run=run, stops=stops):
            if stops(event):
                run.ask_to_stop()

        operator.listen = listen
        collected.ends.append(run.go())
        collected.heard.append(operator.heard)
        collected.asked += operator.asked
        collected.shots.append(session.state.counting())
        collected.view, collected.state = bench.simulated.view, session.state
        collected.taken = (*collected.taken, *bench.simulated.view.taken)
        collected.minutes += bench.clock.now_s() / 60
        session.close()
        bench.close()
    collected.estimates, collected.answers, collected.folder = list(estimates.sensors), dict(estimates.answers), folder
    (collected.result,) = (event for event in operator.heard if isinstance(event, Result))
    return collected


def places_of(shots) -> list:
    return [shot for shot in shots if shot.step == "tour"]


def test_every_place_is_photographed_once_and_every_check_passes_in_ten_minutes(done):
    assert [end.how for end in done.ends] == ["stopped", "stopped", "finished"]
    assert [len(places_of(shots)) for shots in done.shots] == [0, 3, FEWEST]
    assert [shot.purpose for shot in places_of(done.shots[2])] == [
        f"place {i} of {FEWEST}" for i in range(1, FEWEST + 1)
    ]
    assert {"look", "place"}.isdisjoint(ask.key for ask in done.asked)
    assert done.minutes < 10
    facts = facts_as(WholeCameraFacts, done.state.facts)
    assert len(facts.lit) == 2 * LEVELS + 2 * PICTURES
    assert sorted(facts.flats.values()) == list(range(QUARTERS))
    poses = [one.pose for one in facts.poses if one.number > FEWEST]
    assert len(facts.turned) == len(poses) == VIEWS
    assert len({(round(one.yaw_deg / 35), round(one.pitch_deg / 35)) for one in poses}) >= 3
    assert all(max(abs(one.yaw_deg), abs(one.pitch_deg)) < 35 + TURN_DEG for one in poses)
    (diagram,) = (e.diagram for e in done.heard[2] if isinstance(e, DiagramEvent) and "turned" in e.diagram.label)
    assert diagram.x[0] == 0
    assert list(diagram.y) == sorted(diagram.y, reverse=True)
    assert diagram.y[-1] < diagram.y[0] / 2


def test_charts_nodes_and_covariance_are_those_of_the_lens(done):
    # the truth is the simulator's own projection; the check allows NEAR, detection errs by far less than 1 % of that
    facts = done.state.facts
    wanted = np.array([(one.x, one.y) for one in locations(facts)])
    seen = [event.advice for heard in done.heard for event in heard if isinstance(event, FrameEvent)]
    off = [
        advice.readings[0].value for advice in seen if advice.readings and advice.readings[0].name == "off its place"
    ]
    assert len(off) > FEWEST  # the turned views, which may be farther off, after them
    assert max(off[:FEWEST]) <= 100 * NEAR
    assert np.ptp(wanted, axis=0).min() > 0.4
    field = read_field(done.result.folder / "field.h5")["Y"]
    assert len(field.nodes) == FEWEST
    for node, shot in zip(field.nodes, places_of(done.shots[2]), strict=True):
        true = done.taken[shot.number - 1].true_psf("Y", node.psf.s, node.psf.k)
        # the norm of 289 correlated values scatters by a third
        expected = np.hypot(np.sqrt(np.trace(node.psf.covariance)), true.floor)
        assert np.linalg.norm(node.psf.h - true.h) < 1.6 * expected
    found = read_camera_numbers(done.result.folder / "camera.h5")
    parts = {name.partition(".")[0] for name in found.names}
    assert parts == {"geometry", "psf", "vignetting", "sensor"}  # one plane: no colours
    spread = np.sqrt(np.diag(found.covariance))
    assert spread.min() > 0
    assert np.linalg.eigvalsh(found.covariance / np.outer(spread, spread)).min() > -1e-9


def test_the_numbers_are_the_simulated_camera_s(done):
    found = read_camera_numbers(done.result.folder / "camera.h5").numbers()
    camera = done.view.camera
    truths = {
        "geometry.fx": np.mean([one.truths[0].projection.principal_px for one in done.taken if one.truths][-VIEWS:]),
        "sensor.Y.system_gain": 1 / camera.sensor.gain_e_per_dn,
        "sensor.Y.temporal_dark_noise": camera.sensor.read_noise_e,
    }
    for name, true in truths.items():
        value, uncertainty = found[name]
        assert value == pytest.approx(true, abs=4 * uncertainty + 0.003 * true), name
    # the coefficients are correlated, the light is not
    assert sum(found[f"vignetting.Y.k{i}"][0] for i in (1, 2, 3)) == pytest.approx(sum(VIGNETTING), abs=0.002)


def test_the_measured_sensor_is_used_and_that_is_stated(done):
    by_room = {room: [sensor for of, sensor in done.estimates if of is room] for room, _ in done.estimates}
    assert len(by_room[field_estimate]) == FEWEST
    assert len(by_room[geometry_photographs]) == VIEWS
    (model,) = set(by_room[field_estimate])
    sensor = done.view.camera.sensor
    assert model.gain == pytest.approx(1 / sensor.gain_e_per_dn, abs=4 * model.gain_uncertainty)
    # the response is a line; through the lens light falls off by an eighth, of which PRNU must not hold anything
    assert abs(model.bent(np.float64(model.saturation / 2)) / (model.saturation / 2) - 1) < 4 * model.bend_uncertainty
    assert model.prnu < 2e-4
    page = certificate_files(done.folder)["certificate.html"].decode()
    assert all(words in page for words in ("Y, sensor", "Y, vignetting", "Y, geometry", "System gain K", "EMVA"))
    folder, page = done.result.folder, done.ends[2].report.read_text()
    record = json.loads((folder / "result.json").read_text())["field"]
    assert record["parts"]["sensor"]["used"] == f"Y: {USED}"
    assert f"Y: {USED}." in page
    budget = record["planes"]["Y"]["budgets"]["mtf50_horizontal"]
    assert 0 < budget["sensor"] < budget["noise"]
    why = {one.why for one in read_camera_numbers(folder / "camera.h5").blocks if "sensor" in (one.first, one.second)}
    assert any("response and noise were used" in one for one in why)


def test_the_report_leads_to_all_parts_and_is_recomputed_bitwise(done):
    folder, page = done.result.folder, done.ends[2].report.read_text()
    collected = json.loads((folder / "result.json").read_text())["field"]["parts"]
    assert set(collected) == {"geometry", "vignetting", "sensor"}
    for one in collected.values():
        assert f'href="{one["look"]}"' in page
        assert (folder / one["look"]).is_file()
    assert "The whole camera" in page
    page = done.ends[2].report.read_text()
    assert page.startswith("<!doctype html>")
    assert session_page(done.folder) == page
    (again,) = recompute(done.folder)
    assert again.identical, again
    assert photographs(done.folder) == [done.folder / shot.path for shot in done.shots[2]]


def concluded(root: Path, name: str, photographs: list, facts: dict) -> SimpleNamespace:
    """The last two steps of a plan, given its photographs."""
    waiting, whole = [path.read_bytes() for path in photographs], plan_named(name)
    count, good = len(waiting), Advice(True, "good")
    enough = lambda results, facts: Advice(len(results) == count, "counted")  # noqa: E731
    taken = Shoot("photograph", lambda frame, facts: good, estimate_none, enough, count)
    steps = (Step("taken", "Taken", "Take them.", (taken,)), whole.step("estimate"), whole.step("verdict"))
    setup = Setup(seed=1, virtual_time=True, develop=lambda opening: waiting.pop(0))
    incoming = root / "incoming"
    incoming.mkdir()
    truth = SimulatedBench(incoming, setup)
    bench = make_bench(simulated_tables(truth.address, incoming), folder=incoming, clock=truth.clock)
    bench.simulated = truth
    with Session.create(root, plan=name, camera="C", lens="L", config={}, clock=bench.clock, seed=1) as session:
        session.learn(facts)
        operator = ScriptedOperator()
        end = Run(replace(whole, steps=steps), bench, session, operator).go()
    bench.close()
    truth.close()
    (result,) = (event for event in operator.heard if isinstance(event, Result))
    return SimpleNamespace(end=end, result=result)


@pytest.fixture
def facts(done) -> dict:
    """Facts of the session without those of single photographs."""
    return {key: one for key, one in done.state.facts.items() if not key.startswith(SHOT_FACTS)}


@pytest.mark.nightly
def test_the_plan_field_concludes_from_the_places(done, facts, tmp_path, monkeypatch):
    def known_already(plane, *words, **more):
        return done.answers[field_estimate, plane.samples.tobytes()]

    monkeypatch.setattr(field_estimate, "estimate_psf", known_already)
    collected = concluded(tmp_path, "field", [done.folder / shot.path for shot in places_of(done.shots[2])], facts)
    assert collected.end.how == "finished"
    folder, whole = collected.result.folder, done.result.folder
    # the same estimates give the same field
    own, known = (read_field(one / "field.h5")["Y"] for one in (folder, whole))
    assert [node.position.tolist() for node in own.nodes] == [node.position.tolist() for node in known.nodes]
    assert {name.partition(".")[0] for name in read_camera_numbers(folder / "camera.h5").names} <= {"geometry", "psf"}
    assert "parts" not in json.loads((folder / "result.json").read_text())["field"]
    assert collected.end.report.read_text().startswith("<!doctype html>")


def test_the_plan_geometry_concludes_from_turned_views(done, facts, tmp_path, monkeypatch):
    def estimated(plane, *words, **more):
        known = done.answers.get((geometry_photographs, plane.samples.tobytes()))
        return known or estimate_psf(plane, *words, **more)

    monkeypatch.setattr(geometry_photographs, "estimate_psf", estimated)
    shots = [shot for shot in done.shots[2] if shot.step == "views"] + places_of(done.shots[2])[:1]
    collected = concluded(tmp_path, "geometry", [done.folder / shot.path for shot in shots], facts)
    assert collected.end.how == "finished"
    record = json.loads((collected.result.folder / "result.json").read_text())["planes"]["Y"]
    true = np.mean([one.truths[0].projection.principal_px for one in done.taken if one.truths][-VIEWS:])
    for name in ("fx", "fy"):
        assert record[name]["value"] == pytest.approx(true, abs=4 * record[name]["uncertainty"] + 0.003 * true), name
    assert (collected.result.folder / "report.html").is_file()
