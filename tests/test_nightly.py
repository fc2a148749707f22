"""The nightly command: its parts are there, its summary shows what became of each, and the workflow runs them all."""

import importlib.util
import os
import re
import sys
from importlib.machinery import SourceFileLoader
from itertools import groupby
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

ROOT = Path(__file__).resolve().parents[1]
SLOTS = {"tests/benchmarks/adversarial.py", ".ci/cpus"}
"""What other work adds: absent until then."""


@pytest.fixture(scope="module")
def nightly() -> ModuleType:
    path = ROOT / ".ci" / "nightly"
    if not path.is_file():
        pytest.skip("the command belongs to the checkout and is in no distribution")
    loader = SourceFileLoader("nightly", str(path))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader("nightly", loader))  # type: ignore[arg-type]
    sys.modules["nightly"] = module
    loader.exec_module(module)
    return module


def test_every_part_is_there_or_a_slot(nightly, tmp_path):
    parts = nightly.parts(7, tmp_path)
    assert len({part.name for part in parts}) == len(parts) > 10
    files = [
        str(word) for part in parts for word in (part.needs, *part.words) if re.match(r"tests/|.*/\.ci/", str(word))
    ]
    missing = {os.path.relpath(ROOT / one, ROOT) for one in files if not (ROOT / one).exists()}
    assert missing <= SLOTS


def test_the_summary_shows_result_duration_and_log_of_every_part(nightly, tmp_path, monkeypatch):
    def python(name, code, **more):
        return nightly.Part(name, f"about {name}", (sys.executable, "-c", code), **more)

    parts = [
        python("good", "print('heard')"),
        python("bad", "raise SystemExit(3)"),
        python("endless", "import time; time.sleep(600)", limit_s=0.5),
        python("slot", "", needs="tests/benchmarks/not_there.py"),
    ]
    monkeypatch.setattr(nightly, "parts", lambda seed, out: parts)
    monkeypatch.setattr(sys, "argv", ["nightly", "--out", str(tmp_path), "--seed", "5"])
    assert nightly.main() == 1
    assert (tmp_path / "good.log").read_text() == "heard\n"
    page = (tmp_path / "summary.md").read_text()
    assert "2 of 4 parts failed. Seed 5" in page
    assert "| good | about good | passed | 0.0 min | [good.log](good.log) |" in page
    assert "| bad | about bad | failed with code 3 |" in page
    assert "| endless | about endless | failed: still running after" in page
    assert "| slot | about slot | absent: there is no tests/benchmarks/not_there.py | 0.0 min |  |" in page


def test_a_part_that_does_not_exist_is_refused_with_those_that_do(nightly, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["nightly", "--only", "kill", "moon"])
    with pytest.raises(SystemExit):
        nightly.main()
    assert "no part is called moon; parts are tests, " in capsys.readouterr().err


def test_the_workflow_runs_every_part_once(nightly, tmp_path):
    text = (ROOT / ".github" / "workflows" / "nightly.yml").read_text()
    chosen = re.search(r"part:\s*\[(.*?)\]", text, re.DOTALL)[1].split(", ")
    runs = [[one for one in chosen if part.name.startswith(one)] for part in nightly.parts(7, tmp_path)]
    assert all(len(one) == 1 for one in runs), runs
    assert {one for (one,) in runs} == set(chosen)


class Item:
    """As much of a test as its place in the order depends on."""

    def __init__(self, number, *marks):
        self.path, self.number, self.marks = ROOT / f"{number % 5}.py", number, marks

    def get_closest_marker(self, name):
        return name in self.marks


def test_nightly_tests_run_with_the_option_alone_and_a_shuffled_order_is_its_seed_s(pytestconfig):
    hooks = pytestconfig.pluginmanager.get_plugin(str(ROOT / "tests" / "conftest.py"))

    def order(**given):
        config = SimpleNamespace(
            getoption=lambda name: given.get(name.removeprefix("--")),
            hook=SimpleNamespace(pytest_deselected=lambda items: None),
        )
        items = [Item(number, *(["nightly"] if number == 7 else [])) for number in range(20)]
        hooks.pytest_collection_modifyitems(config, items)
        return [item.number for item in items]

    assert 7 not in order()
    assert 7 in order(nightly=True)
    assert order(shuffle="1") == order(shuffle="1") != order(shuffle="2")
    assert sorted(order(shuffle="1")) == sorted(order())
    files = [number % 5 for number in order(shuffle="1")]
    assert len([one for one, _ in groupby(files)]) == 5  # a file's tests stay together: its fixtures are made once
