from pathlib import Path

import pytest


@pytest.fixture
def errands(monkeypatch):
    """The module whose functions other processes find by name: spawned ones get this process's search path."""
    monkeypatch.syspath_prepend(Path(__file__).parent)
    import errands

    return errands


@pytest.fixture
def procedure_file(tmp_path):
    """procedure_file(text): a procedure in TOML."""

    def write(text: str = "") -> Path:
        path = tmp_path / "procedure.toml"
        path.write_text(text)
        return path

    return write
