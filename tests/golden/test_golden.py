"""The records and pages of all procedures stay as they are: `pytest tests/golden --freeze` writes them anew."""

import json
from pathlib import Path

import jsonschema
import pytest
from click.testing import CliRunner

from station.__main__ import main
from station.procedure.schema import procedure_named, schema_of
from tests.printed import print_faults, screen_faults

from .cases import CASES, OUT
from .frozen import FROZEN, check_frozen, differences, frozen_file, frozen_record, page_text, same_text, without_hashes

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", params=CASES)
def made(request, tmp_path_factory) -> tuple[str, Path]:
    """A case and the folder in which it ran."""
    name = request.param
    folder = tmp_path_factory.mktemp(name)
    words = CASES[name](folder)
    if words is not None:
        done = CliRunner().invoke(main, [*map(str, words), "--out", str(folder / OUT)], prog_name="station")
        assert done.exit_code in (0, 5), done.output
    return name, folder


def files_of(folder: Path, suffix: str) -> list[Path]:
    return sorted(path for path in (folder / OUT).rglob(f"*{suffix}") if not path.name.startswith("."))


def test_records_are_as_they_were(made, request):
    name, folder = made
    records = {
        without_hashes(str(one.relative_to(folder))): frozen_record(one, folder) for one in files_of(folder, ".json")
    }
    assert records
    kept = FROZEN / f"{name}.json"
    if request.config.getoption("--freeze"):
        kept.write_text(json.dumps(records, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    assert list(differences(json.loads(kept.read_text(encoding="utf-8")), records)) == []


def test_tables_and_arrays_are_as_they_were(made, request):
    name, folder = made
    files = [one for suffix in (".csv", ".npy", ".tiff") for one in files_of(folder, suffix)]
    found = {without_hashes(str(one.relative_to(folder))): frozen_file(one, folder) for one in files}
    check_frozen(request, f"{name}.tables", found)


def test_pages_are_as_they_were(made, request):
    name, folder = made
    lines = [line for page in files_of(folder, ".html") for line in (f"# {page.name}", *page_text(page, folder))]
    kept = FROZEN / f"{name}.txt"
    if request.config.getoption("--freeze"):
        kept.write_text("\n".join(lines) + "\n", encoding="utf-8")
    before = kept.read_text(encoding="utf-8").splitlines()
    assert len(before) == len(lines)
    assert [(a, b) for a, b in zip(before, lines, strict=True) if not same_text(a, b)] == []


@pytest.mark.parametrize("paper", ["A4", pytest.param("Letter", marks=pytest.mark.nightly)])
def test_pages_fit_on_paper_and_on_screens(made, browser, tmp_path, paper):
    pages = files_of(made[1], ".html")
    assert [fault for page in pages for fault in print_faults(browser, page, paper, tmp_path)] == []
    assert [fault for page in pages for fault in screen_faults(browser, page)] == []


def test_records_follow_the_schema_that_is_generated(made):
    _, folder = made
    for path in files_of(folder, "result.json"):
        record = json.loads(path.read_text(encoding="utf-8"))
        if record["schema"] != "station/batch/1":
            schema = schema_of(procedure_named(record["procedure"]))
            jsonschema.validate(record, schema, jsonschema.Draft202012Validator)
