"""Versions of this program and of what it computes with."""

from __future__ import annotations

import os
import re
import sys
from functools import cache
from pathlib import Path
from typing import Any

METADATA = re.compile(r"(?P<name>[^-]+)-(?P<version>[^-]+)(-py[\d.]+)?\.(dist|egg)-info")
"""Folders that tell what is installed."""
PACKAGES = ("numpy", "scipy", "numba", "opencv-contrib-python-headless", "rawpy")


def software() -> dict[str, Any]:
    """Versions of this program and of the packages its numbers come from."""
    return {"version": _version("calibration-station"), "packages": {name: _version(name) for name in PACKAGES}}


def _version(distribution: str) -> str | None:
    return _versions().get(distribution.replace("-", "_"))


@cache
def _versions() -> dict[str, str]:
    """Versions of what is installed, as the folders of metadata are named: reading those takes thirty times as long.

    Source: PyPA, "Recording installed projects". The first on Python's path counts.
    """
    folders = [Path(place) for place in reversed(sys.path) if os.path.isdir(place or ".")]
    named = [METADATA.fullmatch(name) for folder in folders for name in os.listdir(folder)]
    return {found["name"].lower(): found["version"] for found in named if found}
