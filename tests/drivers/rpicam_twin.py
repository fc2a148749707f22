"""The program `rpicam-still` of the simulators, at a path of its own."""

import os
import sys
from pathlib import Path

REPOSITORY = Path(__file__).parent.parent.parent


def install_twin(folder: Path) -> Path:
    """Write the program into a folder."""
    program = folder / "rpicam-still"
    path = os.pathsep.join((str(REPOSITORY), os.environ.get("PYTHONPATH", "")))
    program.write_text(f'#!/bin/sh\nPYTHONPATH="{path}" exec "{sys.executable}" -m tests.drivers.rpicam_still "$@"\n')
    program.chmod(0o755)
    return program
