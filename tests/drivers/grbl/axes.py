"""The axes that the tests of GRBL move."""

from drivers.protocols.grbl import GrblAxis

AXES = [GrblAxis("z_mm", "X", 3000.0), GrblAxis("x_mm", "Y", 1500.0)]
