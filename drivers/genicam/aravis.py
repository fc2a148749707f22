"""Aravis, loaded on first use, with its errors converted to device errors."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from drivers.errors import BadConfiguration, DeviceError, LineLost, Rejected

INSTALL = (
    "install it: Aravis with its introspection data (Debian: gir1.2-aravis-0.8), and PyGObject "
    "(pip install 'calibration-station[genicam]', or Debian's python3-gi in an environment that sees system packages)"
)


def load() -> Any:
    """The library. Raises BadConfiguration if it or PyGObject is not installed."""
    try:
        import gi
    except ImportError as error:
        raise BadConfiguration("PyGObject is not installed", INSTALL) from error
    try:
        gi.require_version("Aravis", "0.8")
        from gi.repository import Aravis
    except (ValueError, ImportError) as error:
        raise BadConfiguration(f"Aravis 0.8 is not installed: {error}", INSTALL) from error
    return Aravis


@contextmanager
def translated_errors(address: str, remedy: str, kind: type[DeviceError] = Rejected) -> Iterator[None]:
    """Context that converts errors of Aravis and the camera to `kind`, and to LineLost if the camera is gone."""
    from gi.repository import GLib

    try:
        yield
    except GLib.Error as error:
        gone = error.matches(GLib.quark_from_string("arv-device-error-quark"), TIMEOUT)
        if gone:
            raise LineLost(f"{address} does not answer: {error.message}", "check its power and cable") from error
        raise kind(f"{address}: {error.message}", remedy) from error


TIMEOUT = 4
"""Aravis' error number of an unanswered request (ARV_DEVICE_ERROR_TIMEOUT)."""
