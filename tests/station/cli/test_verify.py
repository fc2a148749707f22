"""A certificate is compared with its signature, record and originals, and its numbers are computed again."""

import json
import shutil
import subprocess

import pytest

from station.reports.certificate import record_digest
from station.reports.certificate_details import statement_of
from tests.program import run

from ...golden.cases import chart_photograph

pytest.importorskip("cryptography", reason="cryptography is not installed (extra `sign`)")


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    folder = tmp_path_factory.mktemp("verify")
    photo, details = chart_photograph(folder / "photo.dng", 1), folder / "certificate.toml"
    run("init", "--key", folder / "laboratory.pem")
    details.write_text('laboratory = "Optics laboratory"\nauthoriser = "A. Example"\nsigning_key = "laboratory.pem"\n')
    run("psf", "pattern", photo, "--certificate-details", details, "--out", folder / "out")
    return folder


@pytest.fixture
def copy(measured, tmp_path):
    shutil.copytree(measured, tmp_path / "copy")
    return tmp_path / "copy"


def checks(done):
    return {one["name"]: one["agrees"] for one in json.loads(done.stdout)["checks"]}


@pytest.mark.parametrize("name", ["certificate.html", "certificate.pdf"])
def test_untouched_certificate_agrees_with_record_originals_and_numbers(measured, name):
    done = run("verify", measured / "out" / name, "--json")
    names = ("signature", "record", "files of the result", "originals", "numbers")
    assert checks(done) == dict.fromkeys(names, True)


def test_changed_number_in_certificate_or_record_is_found(copy):
    page = copy / "out" / "certificate.html"
    page.write_text(page.read_text().replace("0.57", "0.67", 1))
    done = run("verify", page, "--json", code=4)
    assert checks(done)["files of the result"] is False
    assert checks(done)["signature"] is False
    record = copy / "out" / "result.json"
    record.write_text(record.read_text().replace('"verdict": "pass"', '"verdict": "doubtful"', 1))
    done = run("verify", copy / "out" / "certificate.pdf", "--json", code=4)
    assert checks(done) == {"signature": True, "record": False}


def test_an_edited_copy_under_another_name_is_found(copy):
    page = copy / "out" / "copy.html"
    page.write_bytes((copy / "out" / "certificate.html").read_bytes())
    assert checks(run("verify", page, "--json", code=4))["files of the result"] is True
    page.write_text(page.read_text().replace("0.57", "0.67", 1))
    assert checks(run("verify", page, "--json", code=4))["files of the result"] is False


def test_the_text_of_an_unsigned_certificate_of_a_session_is_compared_with_its_statement(copy, tmp_path):
    session = tmp_path / "session"
    shutil.copytree(copy / "out", session / "derived" / "1")
    page = session / "certificate.html"
    shutil.copy(copy / "out" / page.name, page)

    def certificate() -> bool | None:
        found = checks(run("verify", page, "--json", code=4))  # it has no journal
        assert found["record"]
        return found["certificate"]

    assert certificate() is None
    digest = record_digest(json.loads((copy / "out" / "result.json").read_text()))
    (session / "certificate.sha256").write_bytes(statement_of({page.name: page.read_bytes()}, {"record": digest}))
    assert certificate() is True
    page.write_text(page.read_text().replace("0.57", "0.67", 1))
    assert certificate() is False


def signature_of(out, *words):
    done = run("verify", out / "certificate.html", "--json", *words, code=None)
    return next(one for one in json.loads(done.stdout)["checks"] if one["name"] == "signature")


def test_the_signer_is_named_and_compared_with_known_keys(copy, tmp_path):
    out = copy / "out"
    assert "signed by A. Example, Optics laboratory" in signature_of(out)["words"]
    assert "the key of" in signature_of(out, "--signer", copy)["words"]
    run("init", "--key", tmp_path / "other.pem")
    assert signature_of(out, "--signer", tmp_path / "other.pub")["agrees"] is False
    statement = out / "certificate.sha256"
    statement.write_text(statement.read_text().replace("A. Example", "B. Example"))
    assert signature_of(out)["agrees"] is False
    statement.unlink()
    assert signature_of(out)["agrees"] is None
    assert signature_of(out, "--signer", copy / "laboratory.pub")["agrees"] is False


@pytest.mark.skipif(not shutil.which("openssl"), reason="openssl is not installed")
def test_other_programs_verify_the_signature(measured):
    out = measured / "out"
    subprocess.run(["sha256sum", "--check", "--strict", "certificate.sha256"], cwd=out, check=True)
    words = ["-verify", "-pubin", "-inkey", measured / "laboratory.pub", "-rawin", "-in", out / "certificate.sha256"]
    subprocess.run(["openssl", "pkeyutl", *words, "-sigfile", out / "certificate.sha256.sig"], check=True)


def test_originals_are_found_elsewhere_by_their_hash(copy, measured, tmp_path):
    record = json.loads((copy / "out" / "result.json").read_text())
    original = measured / "photo.dng"
    hidden = tmp_path / "archive"
    hidden.mkdir()
    try:
        shutil.move(original, hidden / "photo.dng")
        done = run("verify", copy / "out" / "certificate.pdf", "--json", code=4)
        assert checks(done)["originals"] is False
        done = run("verify", copy / "out" / "certificate.pdf", "--originals", hidden, "--json")
        original.symlink_to(hidden / "photo.dng")
        (tmp_path / "link").symlink_to(copy / "out" / "certificate.html")
        assert checks(run("verify", tmp_path / "link", "--json"))["originals"] is True
    finally:
        original.unlink(missing_ok=True)
        shutil.move(hidden / "photo.dng", original)
    assert record["arguments"] == [str(original)]


def test_file_without_a_digest_is_refused(tmp_path):
    other = tmp_path / "other.pdf"
    other.write_bytes(b"%PDF-1.4")
    run("verify", other, code=4, says="no digest")
