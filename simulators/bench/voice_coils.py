"""The shaker of the simulated bench: two voice coils that move the camera, driven by the box's channels."""

from __future__ import annotations

from collections.abc import Sequence

from simulators.world.world import PathDrive, World

STROKE_MM = 2.0
"""Displacement from rest at full deflection, along x and y."""
REST, DEEPEST = 2048, 2047


class VoiceCoils:
    """Channel 0 moves the camera to the right, channel 1 up."""

    def __init__(self, world: World) -> None:
        self._world = world

    def play(self, points: Sequence[tuple[int, int]], interval_s: float, now_s: float) -> None:
        """Move the camera around these points from now on."""
        ways = zip(*points, strict=True)
        rounds = (
            PathDrive(axis, now_s, interval_s, tuple(STROKE_MM * (step - REST) / DEEPEST for step in way))
            for axis, way in zip(("x_mm", "y_mm"), ways, strict=True)
        )
        self._world.drive(tuple(rounds), now_s)

    def rest(self, now_s: float) -> None:
        """Return to the rest position of the springs."""
        self._world.drive((), now_s)
