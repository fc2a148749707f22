from __future__ import annotations

import json

import pytest

from procedures.outcome import BadInput, BadParameter
from station.field_input import focus_positions, photographs


def names(paths):
    return [path.name for path in paths]


def test_photographs_of_a_folder_come_by_name_and_other_files_do_not(tmp_path):
    for name in ("b.DNG", "a.pgm", ".hidden.dng", "notes.txt", "a.xmp", "c.tiff"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "folder.dng").mkdir()
    assert names(photographs(tmp_path)) == ["a.pgm", "b.DNG", "c.tiff"]


def test_of_a_session_those_that_count(tmp_path):
    lines = [
        {"seq": 1, "event": "created", "plan": "field"},
        {"seq": 2, "event": "adopting", "shot": 1, "path": "originals/0001.dng"},
        {"seq": 3, "event": "judged", "shot": 1, "counts": True},
        {"seq": 4, "event": "adopting", "shot": 2, "path": "originals/0002.dng"},
        {"seq": 5, "event": "judged", "shot": 2, "counts": True},
        {"seq": 6, "event": "adopting", "shot": 3, "path": "originals/0003.dng"},
        {"seq": 7, "event": "judged", "shot": 1, "counts": False},
    ]
    text = "".join(json.dumps(line) + "\n" for line in lines)
    # the last line was being written when the power went
    (tmp_path / "journal.jsonl").write_text(text + '{"seq":8,"event":"jud')
    assert photographs(tmp_path) == [tmp_path / "originals" / "0002.dng"]


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
    assert focus_positions(table) == {"a.dng": 12.5, "b.dng": -0.25}


def test_a_row_without_a_number_is_named(tmp_path):
    table = tmp_path / "focus.csv"
    table.write_text("a.dng,12.5\nb.dng,far\n")
    with pytest.raises(BadInput, match=r"row 2: .* got 'b\.dng,far'"):
        focus_positions(table)
