import errno
import hashlib
import json
import math
import os
from contextlib import suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from station.common.durable_files import Disk, WriteFailed
from station.sessions.journal import Contents, Damaged, Gap, Journal, gap, parse, read_journal

FIRST = "0" * 64


def journal_in(folder, disk=None) -> Journal:
    path = folder / "journal.jsonl"
    path.touch()
    return Journal(path, read_journal(path, FIRST), disk or Disk())


def filled(folder, n=3) -> bytes:
    journal = journal_in(folder)
    for i in range(n):
        journal.append("event", "2026-03-14", 0.5 * i, {"say": f"line {i}", "i": i})
    journal.close()
    return journal.path.read_bytes()


@pytest.fixture(scope="module")
def three(tmp_path_factory) -> bytes:
    return filled(tmp_path_factory.mktemp("journal"))


json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**12), 10**12) | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


@given(value=json_values)
@settings(max_examples=50, deadline=None)
def test_what_is_appended_is_read_back(tmp_path_factory, value):
    folder = tmp_path_factory.mktemp("journal")
    journal = journal_in(folder)
    journal.append("event", "2026-03-14", 1.5, {"value": value})
    journal.close()
    (line,) = read_journal(journal.path, FIRST).lines
    assert line.data == {"value": value}
    assert (line.seq, line.event, line.clock_s) == (1, "event", 1.5)


def test_numbers_that_are_not_finite_come_back_and_every_parser_reads_the_line(tmp_path):
    journal = journal_in(tmp_path)
    journal.append("event", "", 0.0, {"value": math.nan, "values": [math.inf, -math.inf]})
    journal.close()
    json.loads(journal.path.read_text(), parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    (line,) = read_journal(journal.path, FIRST).lines
    assert math.isnan(line.data["value"])
    assert line.data["values"] == [math.inf, -math.inf]


def test_cuts_and_alterations_of_any_byte_are_found(three):
    ends = [i + 1 for i, byte in enumerate(three) if byte == ord("\n")]
    for cut in range(len(three) + 1):
        contents = parse(three[:cut], FIRST, "journal")
        assert len(contents.lines) == sum(end <= cut for end in ends)
        assert three[: contents.length] + contents.torn == three[:cut]
    whole = parse(three, FIRST, "journal").lines
    for i in range(len(three)):
        altered = bytearray(three)
        altered[i] ^= 0x01
        try:
            contents = parse(bytes(altered), FIRST, "journal")
        except Damaged:
            continue
        # only the last line can pass for one that was being written
        assert contents.lines == whole[:2]
        assert contents.torn


@pytest.mark.parametrize(
    "rearranged",
    [
        lambda lines: lines[1:],
        lambda lines: [lines[0], lines[2]],
        lambda lines: [lines[1], lines[0], lines[2]],
        lambda lines: [*lines[:2], lines[1], lines[2]],
        lambda lines: [*lines, lines[2]],
    ],
)
def test_lines_taken_out_or_put_in_are_found(three, rearranged):
    with pytest.raises(Damaged, match=r"line \d"):
        parse(b"".join(rearranged(three.splitlines(keepends=True))), FIRST, "journal")


def test_lines_and_head_are_chained_as_documented(tmp_path):
    lines, last = filled(tmp_path).splitlines(), FIRST
    entries = []
    for number, line in enumerate(lines, 1):
        body, _, recorded = line.rpartition(b',"sum":"')
        last = hashlib.sha256(last.encode() + body).hexdigest()
        assert recorded == last.encode() + b'"}'
        assert list(json.loads(line)) == ["seq", "at", "clock_s", "event", "say", "i", "sum"]
        words = f"{number:010d} {last}"
        entries.append(f"{words} {hashlib.sha256(words.encode()).hexdigest()[:8]}\n")
    assert (tmp_path / "journal.head").read_text() == entries[1] + entries[2]  # even numbers first


def test_another_configuration_is_found(three):
    with pytest.raises(Damaged, match="line 1"):
        parse(three, "1" * 64, "journal")


@given(data=st.binary(max_size=200))
@settings(max_examples=200, deadline=None)
def test_no_bytes_make_it_fail_in_another_way(data):
    with suppress(Damaged):
        assert parse(data, FIRST, "journal").lines == ()


@pytest.mark.parametrize("tail", [b"\0" * 100, b'{"seq":4,"at"', b"\0" * 30 + b"\n", b"\xff\xfe\n"])
def test_tail_of_a_power_cut_is_cut_away_before_the_next_line(tmp_path, tail):
    data = filled(tmp_path)
    path = tmp_path / "journal.jsonl"
    path.write_bytes(data + tail)
    contents = read_journal(path, FIRST)
    assert contents.torn == tail
    journal = Journal(path, contents, Disk())
    journal.append("event", "", 0.0, {})
    journal.close()
    assert [line.seq for line in read_journal(path, FIRST).lines] == [1, 2, 3, 4]


class FullDisk(Disk):
    room = 10**9

    def write(self, descriptor, data):
        if self.room <= 0:
            self.room = 10**9  # somebody makes room
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        taken = super().write(descriptor, data[: self.room])
        self.room -= taken
        return taken


def test_full_disk_is_named_and_leaves_whole_lines(tmp_path):
    disk = FullDisk()
    journal = journal_in(tmp_path, disk)
    journal.append("event", "", 0.0, {})
    files = journal.path, tmp_path / "journal.head"
    before = [path.read_bytes() for path in files]
    disk.room = 85 + 30  # an entry of the head, and a part of the line
    with pytest.raises(WriteFailed, match="No space left") as refusal:
        journal.append("event", "", 0.0, {"lost": True})
    assert "make room" in refusal.value.remedy
    assert [path.read_bytes() for path in files] == before
    journal.append("event", "", 0.0, {"kept": True})
    journal.close()
    assert [line.data for line in read_journal(journal.path, FIRST).lines] == [{}, {"kept": True}]


def test_journal_behind_a_link_is_not_read(tmp_path):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.write_bytes(b"")
    (tmp_path / "journal.jsonl").symlink_to(elsewhere)
    with pytest.raises(Damaged, match="cannot be read"):
        read_journal(tmp_path / "journal.jsonl", FIRST)
    with pytest.raises(WriteFailed):
        Journal(tmp_path / "journal.jsonl", Contents((), FIRST, 0), Disk())


def test_a_head_that_cannot_be_read_counts_no_line_as_missing(tmp_path):
    found = gap(tmp_path, ["0" * 64], expected=True)  # a folder in its place
    assert found.lines == 0
    assert "cannot be read" in found.words
    assert gap(tmp_path / "journal.head", [], expected=False) == Gap()
    assert gap(tmp_path / "journal.head", [], expected=True).words.startswith("journal.head is missing")
