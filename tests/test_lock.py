"""The lock file names a version, with hashes, for everything that pyproject.toml asks for, and nothing outside it."""

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]
LOCK = ROOT / ".ci" / "requirements.lock"
EXTRAS = ("test", "exr", "cluster")


@pytest.fixture(scope="module")
def locked():
    """Versions by name; every entry has hashes."""
    if not LOCK.is_file():
        pytest.skip("the lock file belongs to the checkout and is in no distribution")
    entries = re.split(r"\n(?=[a-z0-9])", re.sub(r"(?m)^ *#.*\n", "", LOCK.read_text()))
    found = {}
    for entry in filter(None, entries):
        name, version = re.match(r"([a-z0-9.-]+)==([\w.!+]+)", entry).groups()
        assert re.search(r"--hash=sha256:[0-9a-f]{64}", entry), name
        found[name] = version
    return found


def test_the_lock_has_a_fitting_version_of_all_and_no_place_to_load_from(locked):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    asked = [*project["dependencies"], *(one for extra in EXTRAS for one in project["optional-dependencies"][extra])]
    for words in asked:
        requirement = Requirement(words)
        name = re.sub(r"[-_.]+", "-", requirement.name).lower()
        assert name in locked, f"{words}: write the lock file again, as its head says"
        assert requirement.specifier.contains(locked[name]), f"{words}: the lock file has {locked[name]}"
    assert len(locked) > 20
    text = LOCK.read_text()
    assert not re.search(r"https?:|\b[a-z-]+\.(org|com|net|io|dev)\b", text)
    assert not re.search(r"--index|--find-links|--extra", re.sub(r"(?m)^ *#.*", "", text))
