"""What the tests of TMCL move, send and look for."""

import struct

from drivers.tmcl.link import checksum
from drivers.tmcl.stage import TmclAxis

STEP = 1 / 320
"""Of a belt of 40 mm around, at 200 steps of 64 microsteps: millimetres."""
AXES = [TmclAxis("z_mm", 0, (0.0, 200.0), STEP), TmclAxis("x_mm", 1, (0.0, 200.0), STEP)]
MVP, MST, RFS = 4, 3, 13


def orders(module, command, kind=None):
    """The motors that were given such an order."""
    return [number for said, type_, number, _ in module.obeyed if said == command and kind in (None, type_)]


def datagram(module, command, kind=0, motor=0, value=0):
    body = struct.pack(">BBBBi", module, command, kind, motor, value)
    return body + bytes([checksum(body)])


def restart(bench, module):
    bench.cables["stage"].happen(module.restart)
