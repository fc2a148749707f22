"""The record of a driver's trials: its digest, its signature, its page."""

import json
import re

import pytest

from procedures.outcome import BadInput
from station.bench.conform import TrialResult
from station.reports.conformance import (
    PAGE,
    RECORD,
    check_conformance,
    conformance_record,
    source_of,
    write_conformance,
)

pytest.importorskip("cryptography", reason="cryptography is not installed (extra `sign`)")
TRIALS = [TrialResult("arrives", True, "within 0.0001"), TrialResult("soak", False, "it moves on <here>")]


@pytest.fixture
def folder(tmp_path):
    """A signed record with its page; `key` is beside its folder."""
    import drivers.newport

    record = conformance_record(
        "esp301", at="its twin", identity={"model": "Newport ESP301", "firmware": "3.0.1"},
        source=source_of(drivers.newport.__name__), seed=3, operations=500, trials=TRIALS,
    )  # fmt: skip
    write_conformance(tmp_path / "out", record, tmp_path / "key.pem")
    return tmp_path / "out"


def agreement(folder, key=None):
    return {one.name: one.agrees for one in check_conformance(folder, key)}


def test_what_was_written_agrees_and_the_page_states_it(folder):
    assert agreement(folder, folder.parent / "key.pem") == dict.fromkeys(
        ("record", "page", "signature", "driver"), True
    )
    assert (folder.parent / "key.pem").stat().st_mode & 0o077 == 0
    record, text = json.loads((folder / RECORD).read_text()), (folder / PAGE).read_text()
    assert record["sha256"] in text
    assert record["signature"]["public_key"] in text
    assert "within 0.0001" in text
    assert "it moves on &lt;here&gt;" in text
    assert "500, seed 3" in text
    assert "promises broken" in text


def changed(folder, **values):
    record = json.loads((folder / RECORD).read_text())
    (folder / RECORD).write_text(json.dumps({**record, **values}))


def test_a_changed_figure_is_found(folder):
    changed(folder, trials=[{"trial": "soak", "kept": True, "figure": "500 operations"}])
    assert agreement(folder) == {"record": False, "page": False, "signature": False, "driver": True}


def test_a_changed_page_is_found(folder):
    text = (folder / PAGE).read_text()
    (folder / PAGE).write_text(re.sub("SHA-256 [0-9a-f]{64}", "SHA-256 " + 64 * "0", text))
    assert agreement(folder)["page"] is False


def test_a_record_that_was_signed_again_is_not_ours(folder, tmp_path):
    record = json.loads((folder / RECORD).read_text())
    forged = {name: value for name, value in record.items() if name not in ("sha256", "signature")} | {"kept": True}
    write_conformance(folder, forged, tmp_path / "other.pem")
    assert agreement(folder)["signature"] is True
    assert agreement(folder, folder.parent / "key.pem")["signature"] is False


def test_a_driver_that_was_changed_since_is_found(folder):
    record = json.loads((folder / RECORD).read_text())
    contents = {name: value for name, value in record.items() if name not in ("sha256", "signature")}
    write_conformance(folder, {**contents, "source": {**record["source"], "sha256": 64 * "0"}})
    assert agreement(folder) == {"record": True, "page": True, "signature": None, "driver": False}


def test_a_key_is_asked_for_and_not_created_to_verify(folder, tmp_path):
    with pytest.raises(BadInput, match=r"absent\.pem is no private key without password"):
        agreement(folder, tmp_path / "absent.pem")
    assert not (tmp_path / "absent.pem").exists()


def test_a_folder_without_record_is_refused(tmp_path):
    with pytest.raises(BadInput, match="is no record of a conformance"):
        agreement(tmp_path)
