"""Batches of edges, of fields and of a series are the same work as that of their commands."""

import json

import cv2
import jsonschema
import pytest

from procedures import BadParameter, Refused, read_frame
from procedures.field import measuring as field
from station.batch import run as batch_run
from station.batch.item import Job, finished, work
from station.batch.procedure_file import read_procedure
from station.batch.run import run_batch
from station.calibration.folder_photographs import by_folder, find_frames, singly
from station.common.durable_files import WrittenFile
from station.procedure.schema import procedure_named, schema_of
from tests.station.manual.conftest import edge_of


def edge_picture(path, mtf50):
    path.parent.mkdir(exist_ok=True)
    cv2.imwrite(str(path), edge_of(mtf50))


def rows_of(tmp_path, text, items_of=singly):
    (tmp_path / "p.toml").write_text(text)
    out = tmp_path / "out"
    job = Job(read_procedure(tmp_path / "p.toml"), out, finished(out))
    return [work(item, job) for item in items_of(find_frames([tmp_path / "in"], out))]


EDGES = 'procedure = "edge"\nat = [0.1]\n[limits]\nmtf50 = { min = 0.2 }\n'


@pytest.mark.slow
def test_keys_of_an_edge_may_stand_beside_its_settings(tmp_path):
    edge_picture(tmp_path / "in" / "a.png", 0.25)
    keys = 'planes = ["Y"]\ntrust_typed = true\noptics = { pixel_pitch_um = 5, f_number = 2.8 }\nunit = "lp/mm"\n'
    (row,) = rows_of(tmp_path, f'procedure = "edge"\n{keys}at = [20]\n[settings]\nroi = "5,5,50,70"\n')
    assert row.planes["Y"].numbers["mtf50"]["value"] == pytest.approx(50, rel=0.01)  # 200 pixels to a millimetre
    record = json.loads((tmp_path / "out" / row.folder / "result.json").read_text())
    given = {name: record["parameters"][name] for name in ("roi", "f_number", "trust_typed", "unit", "at")}
    assert given == {"roi": [5, 5, 50, 70], "f_number": 2.8, "trust_typed": True, "unit": "lp/mm", "at": [0.1]}
    jsonschema.validate(record, schema_of(procedure_named("edge")))


def test_photographs_of_each_folder_are_one_field(tmp_path, monkeypatch):
    for name in ("one/a", "one/b", "two/c"):
        (tmp_path / "in" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "in" / f"{name}.png").write_bytes(name.encode())
    seen = []

    def measure(paths, *given, **more):
        seen.append([path.name for path in paths])
        raise Refused("too few charts", "photograph more")

    monkeypatch.setattr(field, "measure", measure)
    rows = rows_of(tmp_path, 'procedure = "field"\n', by_folder)
    assert seen == [["a.png", "b.png"], ["c.png"]]
    assert [(one.verdict, one.reason, len(one.sha256)) for one in rows] == [
        ("refused", "too few charts", 2),
        ("refused", "too few charts", 1),
    ]


@pytest.mark.slow
def test_a_field_whose_photograph_is_replaced_while_it_is_read_is_not_kept(tmp_path, monkeypatch):
    """The row's hash is of the bytes that were decoded, or there is no row of a measurement."""
    for name in "ab":
        edge_picture(tmp_path / "in" / f"{name}.png", 0.25)
    replaced, whole = tmp_path / "in" / "b.png", field.measure

    def measure(*args, **more):
        edge_picture(replaced, 0.2)
        return whole(*args, **more)

    monkeypatch.setattr(field, "measure", measure)
    (row,) = rows_of(tmp_path, 'procedure = "field"\n', by_folder)
    assert (row.verdict, row.folder) == ("unreadable", "")
    assert row.reason == f"{replaced} was changed while the batch read it"
    assert not finished(tmp_path / "out")
    monkeypatch.undo()
    (row,) = rows_of(tmp_path, 'procedure = "field"\n', by_folder)
    assert (row.verdict, len(finished(tmp_path / "out"))) == ("refused", 1)  # there is no chart in it
    decoded = [read_frame(path).sha256 for path in sorted(replaced.parent.iterdir())]
    assert row.sha256 == decoded


@pytest.mark.slow
def test_a_field_names_the_photograph_that_cannot_be_read(tmp_path):
    edge_picture(tmp_path / "in" / "a.png", 0.25)
    (tmp_path / "in" / "b.png").symlink_to("nowhere")
    (row,) = rows_of(tmp_path, 'procedure = "field"\n', by_folder)
    assert row.verdict == "refused"
    assert row.sha256[1] == ""


@pytest.mark.slow
def test_what_the_camera_noted_stands_in_the_row(tmp_path, chart_photograph, monkeypatch):
    path = chart_photograph(tmp_path / "in" / "a.dng")
    exposure = read_frame(path).exposure
    monkeypatch.setattr("station.procedure.builtin.pattern.calibrate", lambda *args, **more: iter(()))
    monkeypatch.setattr("station.batch.item._judged", lambda row, planes: row)
    (row,) = rows_of(tmp_path, 'procedure = "series"\n')
    assert row.noted["f_number"] == exposure.f_number
    assert (row.noted["exposure_s"], row.noted["iso"]) == (exposure.exposure_s, exposure.iso)
    assert row.noted["focus_distance_mm"] == exposure.subject_distance_mm


def test_a_series_says_which_of_the_optics_is_missing(tmp_path):
    edge_picture(tmp_path / "in" / "a.png", 0.25)  # no camera noted its f-number
    (row,) = rows_of(tmp_path, 'procedure = "series"\nphysics = true\noptics = { pixel_pitch_um = 4 }\n')
    assert row.verdict == "refused"
    assert row.reason == "the physics of a PSF needs the f-number, which the camera did not record"
    assert row.remedy.startswith("give --f-number (")
    (row,) = rows_of(tmp_path, 'procedure = "series"\nphysics = true\n')
    assert row.remedy.startswith("give --pixel-pitch-um and --f-number (")


def test_files_of_somebody_else_are_not_written_over(tmp_path):
    edge_picture(tmp_path / "in" / "a.png", 0.25)
    (tmp_path / "p.toml").write_text(EDGES)
    out = tmp_path / "out"
    out.mkdir()
    (out / "report.html").write_text("mine")
    job = Job(read_procedure(tmp_path / "p.toml"), out)
    with pytest.raises(BadParameter, match=r"holds report\.html, which no batch has written"):
        run_batch([], job)
    run_batch([], job, force=True)
    run_batch([], job)  # what a batch wrote, a batch writes over
    (out / "summary.csv").write_text("edited")
    with pytest.raises(BadParameter, match=r"holds summary\.csv"):
        run_batch([], job)
    assert (out / "summary.csv").read_text() == "edited"


@pytest.mark.slow
@pytest.mark.parametrize("crash", [1, 2, 3, 4])
def test_a_batch_that_was_killed_between_its_files_goes_on(tmp_path, monkeypatch, crash):
    edge_picture(tmp_path / "in" / "a.png", 0.25)
    (tmp_path / "p.toml").write_text(EDGES)
    job, written = Job(read_procedure(tmp_path / "p.toml"), tmp_path / "out"), []
    # processes of its own would take seconds each; the files are written by this one in any case
    here = lambda items, job, *rest: ((number, work(item, job)) for number, item in enumerate(items))  # noqa: E731
    monkeypatch.setattr(batch_run, "_answers", here)
    monkeypatch.setattr("station.calibration.edges.edge_picture", lambda *stated: b"drawn by the other tests")
    run_batch([], job)

    publish = WrittenFile.publish

    def killed(file):
        if len(written) == crash:
            raise KeyboardInterrupt
        written.append(publish(file))

    items = singly(find_frames([tmp_path / "in"], tmp_path / "out"))
    for _ in range(2):  # once more on top of what the first left
        with monkeypatch.context() as crashing:
            crashing.setattr(WrittenFile, "publish", killed)
            with pytest.raises(KeyboardInterrupt):
                run_batch(items, job, jobs=1)
        written.clear()
        items = items * 2
    assert len(run_batch(items, job, jobs=1)[0].rows) == 4
    assert not (tmp_path / "out" / ".publishing.json").exists()
