"""The program at a bench on pseudo-terminals, in real time."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from simulators.bench.bench import SimulatedBench
from station.bench.opening import simulated_tables
from station.common.toml_text import toml_text

ROOT = Path(__file__).resolve().parents[2]


def on_ports(bench: SimulatedBench, folder: Path, **more: dict[str, Any]) -> None:
    """Open a rail and a shutter, and write the station.toml of them and of more devices."""
    ports = bench.open_ports(["stage", "shutter"])
    tables = simulated_tables(lambda name: ports[name][0] if name in ports else "", folder)
    used = {name: tables[name] for name in ("stage", "shutter", "camera")}
    (folder / "station.toml").write_text(toml_text({"devices": used | more}))


@pytest.fixture
def homing_program(bench, tmp_path, start_program, read_until) -> subprocess.Popen[str]:
    """The guide at this bench, about to home the rail."""
    words = ["--plain", "--config", tmp_path / "station.toml", "--sessions", tmp_path / "kept"]
    program = start_program(
        [sys.executable, "-m", "station", *words], cwd=ROOT, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    program.stdin.write("\n" * 20)
    program.stdin.flush()
    read_until(program.stdout, "homing: keep clear")
    return program
