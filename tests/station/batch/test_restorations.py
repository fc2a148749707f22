"""Batches of restorations: what their file says, which photographs belong together, and that all restore alike."""

import json
import pickle
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from procedures.outcome import BadInput, BadParameter
from station.batch.item import Job, finished, work
from station.batch.procedure_file import read_procedure
from station.calibration.folder_photographs import find_frames, in_pairs, in_rows
from tests.program import run

SLOW_FIXTURES = {"pairs"}

QUICK = 'procedure = "restore"\n[parameters]\nblur = "motion"\nshape = ["a.txt", "b.txt"]\nmax_w = 5.2\n'
QUICK += 'scheme = "2x(4+4)+1x6"\n[limits]\nw_median = { max = 0.1 }\n'
DEFOCUS = 'procedure = "restore"\n[parameters]\nblur = "defocus"\nshape = "pillbox"\nratio = 2\n'


def test_options_are_those_of_the_command(procedure_file):
    found = read_procedure(procedure_file(DEFOCUS + "max_w = 6\ntotal_variation = true\n"))
    settings = found.settings
    assert (settings.blur, settings.shape, settings.ratio, settings.max_w) == ("defocus", ("pillbox",), (2.0,), 6.0)
    assert (settings.total_variation, settings.depth_start, settings.scheme) == (True, "matched", "20x(20+20)+5x20")
    assert found.endings == ("_1", "_2")
    other = read_procedure(procedure_file(DEFOCUS))
    assert found.fingerprint() != other.fingerprint()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('blur = "shaken"', "one of defocus, motion, both"),
        ('blur = "defocus"\nshap = "pillbox"', "parameters.shap is not known; write shape"),
        ('blur = "defocus"\nshape = 3', "parameters.shape must be a list, each text"),
        ('blur = "motion"\nshape = "pillbox"', "--shape pillbox is a blur of --blur defocus"),
        ('blur = "defocus"\nshape = "pillbox"\nscheme = "often"', "scheme"),
        ('blur = "defocus"\nshape = "pillbox"\nmax_w = 0', "max w"),
        ('blur = "motion"\nimu = "{name}.csv"', "needs --focal-px"),
        ('blur = "defocus"\nshape = "pillbox"\nencoding = "gamma"', "one of linear, srgb"),
    ],
)
def test_what_cannot_be_meant_is_said_before_any_work(procedure_file, text, words):
    with pytest.raises(BadParameter, match=words):
        read_procedure(procedure_file(f'procedure = "restore"\n[parameters]\n{text}\n'))


def test_what_a_restoration_has_not_is_refused(procedure_file):
    with pytest.raises(BadParameter, match="chart is not known"):
        read_procedure(procedure_file(f"chart = {{ seed = 1 }}\n{DEFOCUS}"))


def test_files_lie_beside_the_procedure_and_records_beside_each_photograph(procedure_file):
    text = 'procedure = "restore"\n[parameters]\nblur = "motion"\nfocal_px = 900\nmax_inverse_depth = 1\n'
    file = procedure_file(text + 'imu = "{name}.csv"')
    placed = read_procedure(file).settings.of([Path("x/a_1.dng"), Path("x/a_2.dng")])
    assert placed.imu == ("x/a_1.csv", "x/a_2.csv")
    assert placed.files == [Path("x/a_1.csv"), Path("x/a_2.csv")]
    folder = file.parent
    radial = read_procedure(procedure_file(DEFOCUS.replace("pillbox", "radial:m.npy,c.npy"))).settings
    assert radial.of([Path("a"), Path("b")]).shape == (f"radial:{folder}/m.npy,{folder}/c.npy",)
    assert read_procedure(procedure_file(DEFOCUS)).settings.of([Path("a")]).files == []


def test_rows_of_a_table_name_what_belongs_together(tmp_path):
    frames = [tmp_path / name for name in ("one/a.dng", "one/b.dng", "two/a.dng", "c.dng")]
    table = tmp_path / "pairs.csv"
    table.write_text("first,second\none/a.dng,b.dng\na.dng,c.dng\nc.dng\nc.dng,d.dng\n\nb.dng,two/a.dng,c.dng\n")
    items = in_rows(frames, table)
    assert items[0].paths == (frames[0], frames[1])
    assert items[4].paths == (frames[1], frames[2], frames[3])
    assert [one.trouble for one in items] == [
        "", "pairs.csv: 2 photographs are called a.dng", "pairs.csv: 2 photographs are required; the row has 1",
        "pairs.csv: no photographs are called d.dng", "",
    ]  # fmt: skip
    assert "row has 3" in in_rows(frames, table, most=2)[4].trouble
    table.write_text("first,second\n")
    with pytest.raises(BadInput, match="has no rows"):
        in_rows(frames, table)


def test_a_table_and_endings_are_not_both_given(procedure_file):
    head, _, rest = DEFOCUS.partition("\n")
    with pytest.raises(BadParameter, match="both given"):
        read_procedure(procedure_file(f'{head}\npairs = {{ table = "p.csv", first = "_a" }}\n{rest}'))
    found = read_procedure(procedure_file(f'{head}\npairs = {{ table = "p.csv" }}\n{rest}'))
    assert found.pairs.name == "p.csv"


@pytest.fixture(scope="module")
def pairs(shared_data, tmp_path_factory):
    """A corner of the vibrating pair, once as it is and once saturated, and the procedure with its shapes."""
    made = tmp_path_factory.mktemp("pairs")
    (made / "in").mkdir()
    for n, name in ((1, "a.txt"), (2, "b.txt")):
        source = shared_data / "synthetic" / "restoration"
        image = cv2.imread(str(source / f"vibration_40dB_{n}.pgm"), cv2.IMREAD_UNCHANGED)[100:164, 180:260]
        cv2.imwrite(str(made / "in" / f"good_{n}.pgm"), image)
        white = image.copy()
        white[:40] = 65535 - n
        cv2.imwrite(str(made / "in" / f"white_{n}.pgm"), white)
        shutil.copy(source / f"vibration_shape{n}.txt", made / name)
    (made / "p.toml").write_text(QUICK)
    return made


def test_batch_and_command_restore_alike(pairs):
    procedure, out = read_procedure(pairs / "p.toml"), pairs / "out"
    items = in_pairs(find_frames([pairs / "in"], out), procedure.endings)
    job = pickle.loads(pickle.dumps(Job(procedure, out)))  # as it comes to a process of a pool or of a cluster
    good, white = (work(item, job) for item in items)
    assert good.verdict in ("pass", "doubtful")
    assert white.verdict == "refused"
    assert "saturated" in white.reason
    assert good.specification == "does not meet"
    words = ["restore", *(str(pairs / "in" / f"good_{n}.pgm") for n in (1, 2)), "--blur", "motion", "--shape"]
    words += [str(pairs / "a.txt"), str(pairs / "b.txt"), "--max-w", "5.2", "--scheme", "2x(4+4)+1x6"]
    run(*words, "--out", pairs / "command")
    kept = pairs / "out" / good.folder
    np.testing.assert_array_equal(np.load(kept / "w.npy"), np.load(pairs / "command" / "w.npy"))
    number = good.planes["Y"].numbers["w_median"]
    assert number["value"] == pytest.approx(np.median(np.load(kept / "w.npy")), rel=1e-6)
    assert number["uncertainty"] == pytest.approx(np.median(np.load(kept / "w_std.npy")), rel=1e-6)
    record = json.loads((kept / "result.json").read_text())
    assert (record["schema"], record["parameters"]["scheme"]) == ("station/restore/1", "2x(4+4)+1x6")
    assert [Path(one["path"]).name for one in record["parameters"]["files"]] == ["a.txt", "b.txt"]


def test_another_shape_is_another_result(pairs, tmp_path):
    shutil.copytree(pairs, tmp_path / "p", ignore=shutil.ignore_patterns("out*", "command"))
    procedure, out = read_procedure(tmp_path / "p" / "p.toml"), tmp_path / "out"
    items = in_pairs(find_frames([tmp_path / "p" / "in"], out), procedure.endings)
    white = next(one for one in items if "white" in one.files[0])
    first = work(white, Job(procedure, out))
    assert work(white, Job(procedure, out, finished(out))).reused
    shutil.copy(tmp_path / "p" / "b.txt", tmp_path / "p" / "a.txt")
    again = work(white, Job(procedure, out, finished(out)))
    assert not again.reused
    assert again.folder != first.folder
