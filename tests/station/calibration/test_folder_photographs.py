"""Which photographs a batch finds, and what it makes of their names."""

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from procedures.outcome import BadInput, BadParameter
from procedures.raw import read_photograph
from station.calibration.folder_photographs import find_frames, in_pairs, singly, unread
from station.common.sanitise import cell, encodable, printable, safe_stem


@pytest.fixture
def folder(tmp_path):
    def make(*names: str) -> Path:
        for name in names:
            path = tmp_path / "in" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch()
        return tmp_path / "in"

    return make


def found(folder, out):
    return [path.relative_to(folder).as_posix() for path in find_frames([folder], out)]


def test_photographs_are_found_by_suffix_in_folders_and_below_in_their_order(folder):
    here = folder("b.DNG", "a.nef", "._a.nef", "~b.dng", "a.xmp", "sub/c.pgm", ".hidden/d.dng", "a.jpg", "Sub2/e.tiff")
    assert found(here, here / "out") == ["a.nef", "b.DNG", "Sub2/e.tiff", "sub/c.pgm"]


def test_results_are_no_photographs(folder):
    here = folder("a.dng", "out/b.dng", "out/results/a-1/psf_G1.png")
    assert found(here, here / "out") == ["a.dng"]
    assert found(here / "out", here / "out") == ["b.dng"]
    folder("earlier/restored.tiff", "theirs/c.dng")
    for name, text in (("earlier", '{\n "schema": "station/restoration/1",'), ("theirs", '{"width": 640}')):
        (here / name / "result.json").write_text(text)
    assert found(here, here / "out") == ["a.dng", "theirs/c.dng"]
    assert found(here / "earlier", here / "out") == ["restored.tiff"]


def test_pipes_and_links_that_lead_nowhere_are_found_and_refused_by_name(folder):
    here = folder("a.dng")
    os.mkfifo(here / "pipe.dng")
    for name, target in (("gone", "nowhere"), ("round", "round"), ("zero", "/dev/zero")):
        (here / f"{name}.dng").symlink_to(target if target[0] == "/" else here / f"{target}.dng")
    assert found(here, here / "out") == ["a.dng", "gone.dng", "pipe.dng", "round.dng", "zero.dng"]
    for name, words in (
        ("gone", "the link leads to"),
        ("pipe", "is a pipe"),
        ("round", "Too many"),
        ("zero", "device"),
    ):
        with pytest.raises(BadInput, match=rf"{name}\.dng.*{words}"):
            read_photograph(here / f"{name}.dng")


def test_each_photograph_is_found_once(folder):
    here = folder("a.dng", "sub/b.dng")
    frames = find_frames([here, here / "sub", here / "a.dng"], here / "out")
    assert [path.name for path in frames] == ["a.dng", "b.dng"]


def test_nothing_to_do_is_said(folder, tmp_path):
    with pytest.raises(BadParameter, match="no photographs in"):
        find_frames([folder("notes.txt")], tmp_path / "out")
    with pytest.raises(BadParameter, match="there is no folder"):
        find_frames([tmp_path / "none"], tmp_path / "out")


def test_pairs_are_found_by_their_endings_and_a_lone_photograph_is_said():
    frames = [Path(name) for name in ("a/w_near.dng", "a/w_far.dng", "b/w_near.dng", "b/other.dng")]
    pair, *alone = in_pairs(frames, ("_near", "_far"))
    assert pair.paths == (Path("a/w_near.dng"), Path("a/w_far.dng"))
    assert [item.paths[0].as_posix() for item in alone] == ["b/other.dng", "b/w_near.dng"]
    assert all("has no partner" in item.trouble for item in alone)


names = st.text(st.characters(codec=None, exclude_characters="/\0"), min_size=1, max_size=80)


@given(names)
def test_no_name_leads_a_result_out_of_its_folder(name):
    stem = safe_stem(Path("in") / name)
    assert (Path("out") / stem).resolve().parent == Path("out").resolve()
    assert stem.isascii()
    assert 0 < len(stem) <= 48


@given(names)
def test_any_name_can_be_written_and_shown_on_one_line(name):
    assert encodable(name).encode()
    for shown in (printable(name), singly([Path(name)])[0].shown):
        assert "".join(shown.split()).isprintable()
        assert len(shown.splitlines()) <= 1


@given(names)
def test_no_name_is_a_formula(name):
    assert cell(name)[0] not in "=+-@\t\r"


def test_harmless_names_stay_as_they_are():
    assert safe_stem(Path("IMG_0042.CR2")) == "IMG_0042"
    assert [cell("a.dng"), printable("ä b.dng"), encodable("ä")] == ["a.dng", "ä b.dng", "ä"]


def test_an_unreadable_folder_is_reported_and_the_others_are_read(folder, tmp_path, monkeypatch):
    here = folder("a.dng", "locked/b.dng", "sub/c.dng")
    scandir = os.scandir

    def refusing(path):
        if str(path).endswith("locked"):
            raise PermissionError(13, "Permission denied", str(path))
        return scandir(path)

    monkeypatch.setattr(os, "scandir", refusing)
    missed = []
    found = find_frames([here], tmp_path / "out", lambda path, error: missed.append(unread(path, error)))
    assert [path.name for path in found] == ["a.dng", "c.dng"]
    (item,) = missed
    assert (item.paths, item.trouble) == ((here / "locked",), "the folder cannot be read: Permission denied")
    with pytest.raises(BadInput, match="locked cannot be read: Permission denied"):
        find_frames([here], tmp_path / "out")


def test_names_of_no_encoding_are_found_and_written_and_shown(folder, tmp_path):
    here = folder("a.dng")
    os.rename(here / "a.dng", os.fsencode(here) + b"/\xff\x1b[31m,\n.dng")
    (item,) = singly(find_frames([here], tmp_path / "out"))
    assert item.files[0].endswith("/\\udcff\x1b[31m,\n.dng")
    assert item.shown.endswith("/\\udcff\\x1b[31m,\\n.dng")
