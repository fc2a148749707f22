import hashlib
import os
from pathlib import Path

import pytest

from drivers.errors import SystemClock
from drivers.interfaces import CameraSettings, ExposedFile
from procedures.outcome import BadInput, BadParameter
from station.calibration.field_photographs import check_noted, focus_positions, photographs
from station.sessions.session import Session


def names(paths):
    return [path.name for path in paths]


def test_photographs_of_a_folder_come_by_name_and_other_files_do_not(tmp_path):
    for name in ("b.DNG", "a.pgm", ".hidden.dng", "notes.txt", "a.xmp", "c.tiff"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "folder.dng").mkdir()
    assert names(photographs(tmp_path)) == ["a.pgm", "b.DNG", "c.tiff"]


def test_pipe_among_them_is_named_by_whoever_reads_it_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.dng")
    assert names(photographs(tmp_path)) == ["pipe.dng"]
    check_noted(photographs(tmp_path), {"f_number": 8.0}, "--insist")


def photographed(session, number, counts) -> None:
    path = session.folder.parent / f"{number}.dng"
    path.write_bytes(bytes([number]) * 9)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    session.expect("tour", "place")
    exposure = ExposedFile(path, digest, 9, CameraSettings(0.02, 100), 1.0, 2.0)
    shot = session.adopt(exposure, step="tour", purpose="place", snapshot={})
    if counts is not None:
        session.judge(shot, counts)


def test_of_a_session_those_that_count(tmp_path):
    about = {"plan": "field", "camera": "C", "lens": "L", "config": {}}
    with Session.create(tmp_path, **about, clock=SystemClock()) as session:
        session.begin_step("tour")
        for number, counts in enumerate((False, True, None, True), 1):
            photographed(session, number, counts)
        kept = [session.folder / shot.path for shot in session.state.shots]
    # the last line was being written when the power went
    with (session.folder / "journal.jsonl").open("a") as journal:
        journal.write('{"seq":99,"event":"jud')
    assert photographs(session.folder) == [kept[1], kept[3]]


def test_of_a_folder_with_originals_those(tmp_path):
    (tmp_path / "originals").mkdir()
    (tmp_path / "originals" / "0001.dng").write_bytes(b"")
    (tmp_path / "preview.png").write_bytes(b"")
    assert names(photographs(tmp_path)) == ["0001.dng"]


@pytest.mark.parametrize("make", [True, False])
def test_no_folder_and_no_photographs_are_named(tmp_path, make):
    folder = tmp_path / "nothing"
    if make:
        folder.mkdir()
    with pytest.raises(BadParameter, match="there are no photographs in" if make else "there is no folder"):
        photographs(folder)


def test_focus_positions_come_with_or_without_headings(tmp_path):
    table = tmp_path / "focus.csv"
    table.write_text("photograph, position_mm\na.dng, 12.5\n\nb.dng,-0.25\n")
    assert focus_positions(table, [Path("a.dng")]) == {"a.dng": 12.5, "b.dng": -0.25}


def test_a_row_without_a_number_is_named(tmp_path):
    table = tmp_path / "focus.csv"
    table.write_text("a.dng,12.5\nb.dng,far\n")
    with pytest.raises(BadInput, match=r"row 2: .* got 'b\.dng,far'"):
        focus_positions(table, [Path("a.dng")])


def test_table_of_other_photographs_is_refused_before_any_work(tmp_path):
    (tmp_path / "focus.csv").write_text("name,mm\nx.dng,1\ny.dng,2\n")
    with pytest.raises(BadInput, match=r"the position of none of 1 photographs; it names x\.dng, y\.dng"):
        focus_positions(tmp_path / "focus.csv", [Path("a.dng")])
