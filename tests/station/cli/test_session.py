import json

import pytest

from station.cli.session.group import newest_unfinished
from station.guide import recompute
from station.guide.recompute import MovedNumber, RecomputedResult
from station.guide.workspace import kept_in
from station.sessions.session import Session
from tests.program import run

from ..sessions.test_index import make
from ..sessions.work import FixedClock

HOSTILE = "\x1b[31mRED\x1b[0m\n\u202e../../x"


@pytest.fixture
def root(tmp_path):
    root = tmp_path / "sessions"
    for day, mtf50 in ((10, 0.300), (12, 0.290), (14, 0.281)):
        make(root, mtf50=mtf50, day=day)
    make(root, camera="Other", day=15)
    return root


@pytest.fixture
def session(root):
    """Run `station session ...` on these sessions."""
    return lambda *words, code=None, **how: run("session", *words, "--sessions", root, code=code, **how)


def test_list_shows_the_newest_first_and_filters(session):
    lines = session("list", "--camera", "Box", "--since", "2026-03-12").stdout.splitlines()
    assert [line.split()[0] for line in lines] == [
        "session",
        "2026-03-14-box-50-mm-pattern",
        "2026-03-12-box-50-mm-pattern",
    ]


def test_list_as_json_has_every_field(session):
    record = json.loads(session("list", "--json").stdout)
    assert len(record["sessions"]) == 4
    assert record["sessions"][-1] | {"folder": ""} == {
        "folder": "", "camera": "Box", "lens": "50 mm", "plan": "pattern", "began": "2026-03-10T09:26:53+00:00",
        "ended": "finished", "shots": 0, "counting": 0, "verdict": "pass", "damage": "",
    }  # fmt: skip


@pytest.mark.parametrize(("sigmas", "agree"), [(-6e-5, True), (0.3, False)])
def test_negligible_changes_are_reported_as_agreement(session, monkeypatch, sigmas, agree):
    moved = (MovedNumber("G1", "mtf50_radial", 0.3, 0.3 + sigmas * 1e-3, sigmas),)
    result = RecomputedResult("derived/1", (), ("result.json",), (), (), numbers=56, moved=moved)
    monkeypatch.setattr(recompute, "recompute", lambda folder, numbers: iter([result]))
    done = session("recompute", NAME)
    assert done.exit_code == 1  # its bytes differ all the same
    assert "computed by a version that was not installed" in done.stderr
    assert ("all numbers agree within 6e-05 of their uncertainties" in done.stderr) is agree
    assert (
        f"1 of 56 numbers moved, the most mtf50_radial of G1, 0.3 then and {0.3 + sigmas * 1e-3:.6g} now" in done.stderr
    )


NAME = "2026-03-10-box-50-mm-pattern"


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (("list", "--camera", "a\udcff"), 0, "no session"),  # no text
        (("list", "--since", "yesterday"), 2, "--since requires a date"),
        (("trend", "Bx"), 0, "cameras: Box, Other"),
        (("trend", "Box", "--out", "trend.jpg"), 2, "svg or png"),
        (("trend", "Box", "--out", "trend"), 2, "svg or png"),
        (("resume", NAME, "--back-to", "nowhere"), 2, "shots"),
        (("report", "2026-03-15-other-50-mm-pattern"), 5, "resume"),
        *(((command, "nothing"), 4, "not a session") for command in ("show", "recompute", "report", "resume")),
    ],
)
def test_commands_report_what_is_missing(session, words, code, message):
    session(*words, code=code, says=message)


def test_a_damaged_index_is_rebuilt(session, root):
    (root / ".index.sqlite").write_bytes(b"x")
    assert "4 sessions, 2 cameras, 1 lenses" in session("index", "--rebuild").stderr


def test_an_empty_list_is_no_error(tmp_path):
    run("session", "list", "--sessions", tmp_path, says="no session")
    run("session", "list", "--sessions", tmp_path / "typo", code=2, says="name the one that holds the sessions")


@pytest.mark.parametrize(
    "words", [["list"], ["list", "--json"], ["trend", HOSTILE], ["trend", HOSTILE, "--json"], ["show"]]
)
def test_terminal_gets_no_control_characters_whatever_a_camera_is_called(tmp_path, words):
    folder = make(tmp_path, camera=HOSTILE, lens=HOSTILE, mtf50=0.3)
    with Session.open(folder, FixedClock()) as session:
        session.learn({HOSTILE: HOSTILE})
        session.note("noticed", say=HOSTILE)
    name = [folder.name] if words == ["show"] else []
    done = run("session", *words, *name, "--sessions", tmp_path)
    for line in (done.stdout + done.stderr).splitlines():
        assert line.isprintable(), ascii(line)
    if "--json" in words:
        json.loads(done.stdout)


def test_damaged_session_is_named_without_its_escapes(tmp_path):
    folder = make(tmp_path)
    (folder / "session.toml").write_text('camera = "\x1b[31m')
    done = run("session", "list", "--sessions", tmp_path)
    assert "damaged" in done.stdout
    assert "\x1b" not in done.stdout + done.stderr
    run("session", "show", folder, code=4)


def test_show_takes_a_path_or_a_name(session, root):
    assert session("show", NAME).stdout == run("session", "show", root / NAME).stdout
    state = json.loads(session("show", NAME, "--json").stdout)["state"]
    assert state["results"][0]["verdict"] == "pass"


def test_show_detects_a_missing_photograph(session, root):
    from ..sessions.work import Camera

    (folder,) = root.glob("*other*")
    with Session.open(folder, FixedClock()) as opened:
        shot = opened.adopt(Camera(root.parent / "incoming").expose("x"), step="s", purpose="p", snapshot={})
        opened.original(shot).unlink()
    session("show", folder.name, code=4, says="missing or changed")
    session("show", folder.name, "--no-check", code=0)


def test_trend_reports_a_decrease_and_its_rate(session, tmp_path):
    done = session("trend", "Box", "--json", "--out", tmp_path / "trend.svg")
    (trend,) = json.loads(done.stdout)["trends"]
    # 0.019 in four days; each uncertain by 0.002
    assert trend["line"]["slope"] == pytest.approx(-0.019 / 4 * 365.25, rel=1e-3)
    assert trend["finding"] == "falls"
    assert "falls" in session("trend", "Box").stdout
    session("trend", "Box", "--strict", code=1)
    session("trend", "Other", "--strict", code=1)  # nothing to judge
    assert (tmp_path / "trend.svg").read_text().lstrip().startswith("<?xml")


def test_picture_of_a_hostile_camera_runs_nothing(tmp_path):
    camera = "<script>alert(1)</script> $\\frac{1}{0}$"
    make(tmp_path, camera=camera, mtf50=0.3)
    run("session", "trend", camera, "--sessions", tmp_path, "--out", tmp_path / "trend.svg")
    assert "<script" not in (tmp_path / "trend.svg").read_text()


def test_resume_of_an_unknown_plan_names_the_plans(tmp_path):
    folder = make(tmp_path, plan="../../evil")
    run("session", "resume", folder, "--back-to", "x", code=2, says="no plan")


def test_a_session_is_deleted_when_that_is_confirmed(session, root):
    name = "2026-03-14-box-50-mm-pattern"
    session("delete", name, code=130)  # nobody answers
    assert (root / name).is_dir()
    session("delete", name, "--yes", code=0)
    assert not (root / name).exists()
    assert len(list(root.glob(".deleting-*"))) == 0
    assert "2026-03-14" not in session("list").stdout


def test_a_folder_that_is_no_session_and_a_session_that_is_open_are_not_deleted(session, root, tmp_path):
    (root / "mine").mkdir()
    (root / "mine" / "diary.txt").write_text("dear diary")
    assert "is not a session" in session("delete", "mine", "--yes").stderr
    assert (root / "mine" / "diary.txt").exists()
    with Session.open(root / "2026-03-14-box-50-mm-pattern", FixedClock()):
        assert "open in another program" in session("delete", "2026-03-14-box-50-mm-pattern", "--yes").stderr
    assert (root / "2026-03-14-box-50-mm-pattern").is_dir()


def test_resume_without_a_name_needs_an_unfinished_session(session, root, tmp_path):
    for folder in root.iterdir():
        if (folder / "journal.jsonl").is_file():
            with Session.open(folder, FixedClock()) as one:
                one.end("finished")
    session("resume", code=2, says="is unfinished")


def test_the_newest_unfinished_session_is_resumed(root):
    for end in (None, "stopped", "finished"):
        with Session.create(root, plan="pattern", camera="C", lens="L", config={}, clock=FixedClock()) as one:
            if end:
                one.end(end)
    finished, stopped, _, *_ = kept_in(root)
    assert (finished.ended, stopped.ended) == ("finished", "stopped")
    assert newest_unfinished(root) == stopped.folder
