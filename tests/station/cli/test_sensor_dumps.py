"""`--raw`: every command that reads photographs takes a sensor's dump, as it takes the same picture in a file."""

import json

import pytest

from tests.program import run
from tests.station.manual.conftest import edge_levels

LAYOUT = "60x80,Y,u16be,0,65535"


@pytest.fixture
def dump(tmp_path):
    path = tmp_path / "edge.raw"
    path.write_bytes(edge_levels().astype(">u2").tobytes())
    return path


@pytest.mark.slow
def test_edge_of_a_dump_is_that_of_the_same_picture_in_a_file(dump, tmp_path):
    picture = tmp_path / "edge.pgm"
    picture.write_bytes(b"P5 60 80 65535\n" + dump.read_bytes())
    records = []
    stated = ((picture,), (dump, "--raw", LAYOUT), (picture, "--raw", "Y,0,65535"))
    for name, words in zip(("file", "dump", "samples"), stated, strict=True):
        run("mtf", "edge", *words, "--out", tmp_path / name)
        records.append(json.loads((tmp_path / name / "result.json").read_text()))
    # a picture's numbers are as good as those of a dump, and less sure by what a program may have done to it
    for number in ("mtf50", "mtf20", "mtf_nyquist"):
        of_file, of_dump = (one["planes"]["Y"][number] for one in records[:2])
        assert of_file["value"] == of_dump["value"]
        assert of_file["uncertainty"] > of_dump["uncertainty"]
    assert records[1]["parameters"]["raw"] == LAYOUT
    assert records[2]["parameters"]["raw"] == "Y,0,65535"
    assert records[2]["planes"] == records[1]["planes"]


COMMANDS = [
    ("psf", "pattern", "{}"),
    ("psf", "two-photo", "{}", "{}"),
    ("mtf", "edge", "{}"),
    ("restore", "{}", "{}", "--blur", "defocus", "--shape", "gaussian"),
]


@pytest.mark.parametrize("words", COMMANDS, ids=lambda words: words[1])
def test_every_command_names_the_missing_options_of_a_dump(dump, tmp_path, words):
    words = [str(dump) if word == "{}" else word for word in words]
    done = run(*words, "--raw", "64x80,RGGB,u16le,64,1023", "--out", tmp_path / "out", code=4)
    assert f"64 x 80 samples of u16le must have 10240 bytes; {dump} has 9600" in done.output
    run(*words, "--out", tmp_path / "out", code=4, says="must have the header of a RAW format")
    done = run(*words, "--raw", "64x80,RGGB", "--out", tmp_path / "out", code=2)
    assert "as 1920x1080,RGGB,u16le,64,1023" in done.output


def test_field_names_the_dump_that_disagrees(dump, tmp_path):
    done = run("psf", "field", dump.parent, "--raw", "64x80,RGGB,u16le,64,1023", "--out", tmp_path / "out", code=None)
    assert done.exit_code != 0
    assert "64 x 80 samples of u16le must have 10240 bytes" in done.stderr
