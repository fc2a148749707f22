"""pycolmap, imported without its handler of SIGTERM, which would end the program before the devices have stopped."""

import ctypes
import os
import signal

_system = ctypes.CDLL(None) if os.name == "posix" else None
_before = ctypes.create_string_buffer(512)  # larger than a `struct sigaction` of any system

if _system is not None:  # not by `signal`, which sets handlers in the main thread only
    _system.sigaction(int(signal.SIGTERM), None, _before)
import pycolmap as pycolmap  # noqa: E402

if _system is not None:
    _system.sigaction(int(signal.SIGTERM), _before, None)
