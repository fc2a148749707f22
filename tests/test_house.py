"""Rules of style, format, types and imports, checked by `.ci/check`."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from .procedures.test_library import PAGES, five_lines, in_python, photographed, python_blocks, site_of_wheel

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.parametrize("rule", ["style", "format", pytest.param("types", marks=pytest.mark.slow), "imports"])
def test_rule_holds(rule: str) -> None:
    environment = {**os.environ, "PYTHON": sys.executable}
    done = subprocess.run([ROOT / ".ci" / "check", rule], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
def test_a_wheel_gives_the_five_lines_and_has_types_for_scripts(tmp_path: Path) -> None:
    site, cache = site_of_wheel(tmp_path), tmp_path / "cache"
    photographed(tmp_path)
    code = f"import procedures; print(procedures.__file__)\n{five_lines(PAGES[0])}"
    done = in_python(code, tmp_path, PYTHONPATH=str(site))
    assert done.stdout.startswith(str(site)), done.stderr
    assert "mtf50_horizontal = " in done.stdout
    # after the types above, whose cache holds the types of other packages
    if (kept := ROOT / ".mypy_cache").is_dir():
        shutil.copytree(kept, cache)
    script = tmp_path / "page.py"
    script.write_text("\n".join(python_blocks(PAGES[0])), encoding="utf-8")
    environ = {**os.environ, "MYPYPATH": "", "PYTHONPATH": str(site)}
    typed = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--warn-unreachable", "--cache-dir", cache, script],
        cwd=tmp_path, env=environ, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert typed.returncode == 0, typed.stdout + typed.stderr
