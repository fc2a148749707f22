"""`station init`: what it writes can be read as it stands, and every line that is commented out means something."""

import re
from dataclasses import fields

import pytest
from PIL import Image

from drivers.errors import BadConfiguration
from procedures.outcome import BadParameter
from station.batch.procedure_file import USUAL_PROCEDURE, read_procedure
from station.bench.opening import make_bench, read_config
from station.common.signature import public_key
from station.procedure.builtin.pattern import PatternSettings
from station.reports.certificate_details import CertificateDetails
from station.results.specification_file import read_specification
from station.results.terms import USUAL
from tests.program import run

SETTING = re.compile(r"^#(?=\[|\w+ = )", re.MULTILINE)


@pytest.fixture
def written(tmp_path):
    done = run("init", tmp_path)
    assert done.stdout.splitlines() == [
        str(tmp_path / "station.toml"),
        str(tmp_path / "procedure.toml"),
        str(tmp_path / "specification.toml"),
        str(tmp_path / "certificate.toml"),
    ]
    return tmp_path


def test_folder_is_made(tmp_path):
    run("init", tmp_path / "lab" / "bench")
    assert (tmp_path / "lab" / "bench" / "station.toml").exists()
    run("init", tmp_path / "lab" / "bench" / "station.toml", code=2)


def without_comment_marks(path):
    path.write_text(SETTING.sub("", path.read_text(encoding="utf-8")), encoding="utf-8")
    return path


def test_written_files_are_examples_whose_every_key_is_known(written):
    with pytest.raises(BadConfiguration, match="configures no devices"):
        read_config(written / "station.toml")
    tables = read_config(without_comment_marks(written / "station.toml"))
    bench = make_bench(tables, folder=written)
    assert set(bench.devices) == {
        "stage", "room", "head", "shutter", "shaker", "watchdog", "camera", "imu", "rangefinder", "light",
    }  # fmt: skip
    bench.close()
    procedure = read_procedure(written / "procedure.toml")
    assert procedure.name == USUAL_PROCEDURE
    assert procedure.terms == USUAL
    assert procedure.settings == PatternSettings(seed=1)
    procedure = read_procedure(without_comment_marks(written / "procedure.toml"))
    assert {limit.number for limit in procedure.terms.specification.limits} == {
        "mtf50_horizontal", "mtf50_vertical", "energy_above_nyquist",
    }  # fmt: skip
    assert procedure.settings.layout is not None
    assert None not in procedure.settings.optics.values()
    with pytest.raises(BadParameter, match="sets no limit"):
        read_specification(written / "specification.toml")
    parsed = read_specification(without_comment_marks(written / "specification.toml"))
    assert [(one.number, one.at, str(one.place)) for one in parsed.limits] == [
        ("mtf50", None, "anywhere"),
        ("fwhm", None, "anywhere"),
        ("energy_above_nyquist", None, "anywhere"),
        ("mtf", 0.25, "centre"),
        ("mtf50", None, "corners"),
    ]


def test_nothing_that_is_there_is_touched(tmp_path):
    (tmp_path / "procedure.toml").write_text("mine", encoding="utf-8")
    run("init", tmp_path, code=2, says="has procedure.toml already")
    assert [path.name for path in tmp_path.iterdir()] == ["procedure.toml"]
    assert (tmp_path / "procedure.toml").read_text(encoding="utf-8") == "mine"


def test_every_detail_of_the_certificate_is_known(written):
    Image.new("L", (1, 1)).save(written / "logo.png")
    (written / "laboratory.pem").touch()
    details = CertificateDetails.read(without_comment_marks(written / "certificate.toml"))
    assert all(getattr(details, one.name) for one in fields(details))


def test_a_key_is_written_for_its_owner_and_never_over_another(tmp_path):
    pytest.importorskip("cryptography", reason="cryptography is not installed (extra `sign`)")
    key = tmp_path / "laboratory.pem"
    run("init", "--key", key)
    assert sorted(one.name for one in tmp_path.iterdir()) == ["laboratory.pem", "laboratory.pub"]
    assert key.stat().st_mode & 0o077 == 0
    assert public_key(key) == public_key(key.with_suffix(".pub"))
    run("init", "--key", key, code=2, says="name a file that does not exist")
