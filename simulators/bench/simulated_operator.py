"""A person's hands and eyes at the simulated bench: they hang the chart, turn the ring, set the dial, read the ruler.

They begin with an empty wall and a camera that is set to anything, and are never quite exact. What they do depends on
the seed and on what was asked of them, not on when: whoever goes on with a session finds the bench as it was left.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from simulators.bench.body import CameraBody
from simulators.bench.view import Mount, View
from simulators.camera.subjects import panel
from simulators.devices.serial_device import SimClock
from simulators.world.world import Drive, World

Known = str | float | bool
HAND = "hand_"
"""Before a name: how much was asked of the hands under it, all in all."""
EYES_DIOPTRES = 0.04
"""How well focus is found by eye or autofocus."""
STEP_DIOPTRES = 0.03
"""A small turn of the focus ring."""
EXACT = ("exposure_ev",)
"""What has clicks."""
RIM_PX, MAX_W = 8, 4.0
"""Of the marked part of a scene from the frame's side; of the widest blur as it is guessed, both in plane pixels."""
TAPE_MM = 5.0
"""A distance is read off a tape to this."""
SQUARE_DEG = 0.4
"""How square to a wall a camera is put by eye."""
SLOPPY = 0.04
"""Hands do what they are asked to this share of it."""
SET_UP = (
    "printed",
    "panel",
    "mounted",
    "wall",
    "scene",
    "focused",
    "refocused",
    "focused_near",
    "focused_far",
    "first",
    "first_moves",
    "second",
    "third",
    "truth",
)
"""The questions by whose keys something is done, in their order."""
MOTION_OF = {"first_moves": 0, "second": 1, "third": 2}
"""Which of its motions the rig is set in, by the question."""
F_NUMBERS = {"first": 4.0, "second": 2.8, "third": 5.6, "truth": 22.0}
"""That the ring of apertures is set to, by the question, where apertures blur."""
LENS_AND_MOTIONS = {"first": 8.0, "truth": 22.0}
"""The same where the lens blurs beside motions: so wide that it does, and so long exposed that the IMU feels a path."""
NEARER = 0.65
"""Of a scene's distance: nearer than anything in it."""


@dataclass(frozen=True)
class Person:
    """How somebody leaves things who was not told numbers: the chart, the lamp, the dial; and what the printer does.

    `width_mm` of the chart that is ordered, which the rail's reach suits; None orders what is proposed.
    """

    width_mm: float | None = 96.0
    printer: float = 0.994
    mount: Mount = field(default_factory=lambda: Mount(14.0, -9.0, yaw_deg=2.6, pitch_deg=-1.9, roll_deg=6.4))
    exposure_s: float = 1 / 160
    slope: tuple[float, float] = (-0.13, 0.04)


class Standing(Protocol):
    """What hands and eyes reach of a bench; `motions` are what shakes the rig during each photograph."""

    world: World
    view: View
    body: CameraBody
    clock: SimClock
    motions: tuple[tuple[Drive, ...], ...]


class Hands:
    """What a person does at this bench."""

    def __init__(self, at: Standing, seed: int, person: Person | None = None) -> None:
        self._at = at
        self._seed = seed
        self._person = person or Person()
        self._asked: dict[str, float] = {}
        self._stops = 0.0
        self._held = at.view.held
        self._dioptres = 1 / 5.0
        self.empty_the_room()

    def empty_the_room(self) -> None:
        """No chart, the camera set to anything."""
        view, body = self._at.view, self._at.body
        view.mount, view.slope, view.focus_mm = None, self._person.slope, 1000 / self._dioptres
        body.settings.exposure_s = self._person.exposure_s

    def _rng(self, what: str) -> np.random.Generator:
        return np.random.default_rng([self._seed, zlib.crc32(what.encode())])

    # --- what a person would answer

    def knows(self, key: str) -> Known | None:
        """What is read off here: rulers to a quarter of a millimetre, the camera's data sheet."""
        camera = self._at.view.camera
        ruler = round(400 * self._person.printer) / 4
        known: dict[str, Known] = {
            **({} if self._person.width_mm is None else {"chart_width_mm": self._person.width_mm}),
            "ruler_mm": ruler,
            "focal_length_mm": camera.lens.focal_length_mm,
            "pixel_pitch_um": camera.pitch_um,
            "sensor_kind": "monochrome" if camera.sensor.cfa is None else "mosaic",
            "typed_f_number": camera.lens.f_number,
            "near_mm": round(self._at.world.distance_mm(self._at.clock.now_s()) / TAPE_MM) * TAPE_MM,
            "screw_count": float(self._held.count),
            "screw_radius_mm": self._held.radius_mm,
            "screw_pitch_mm": self._held.pitch_mm,
            "first_screw_deg": self._held.first_deg,
            **(self._of_depth() if self._at.motions else {}),
        }
        return known.get(key)

    def _of_depth(self) -> dict[str, Known]:
        """What is seen of a scene in depth and its rig: where the nearest sheet is, and how far its details smear."""
        camera = self._at.view.camera
        rows, columns = (size // camera.plane_pitch_px for size in (camera.sensor.rows, camera.sensor.columns))
        return {
            "blur_by": "motions",
            "region": f"{RIM_PX},{RIM_PX},{columns // 2 - RIM_PX},{rows - 2 * RIM_PX}",
            "max_w": MAX_W,
            "focus_m": round(1 / self._dioptres, 2),
            "lens_f_number": LENS_AND_MOTIONS["first"],
            **{f"{which}_f_number": f_number for which, f_number in F_NUMBERS.items()},
        }

    # --- what a person does

    def do(self, key: str, facts: Mapping[str, Known]) -> None:
        """Confirmed: it was done."""
        view = self._at.view
        if key in F_NUMBERS and facts.get("blur_by") == "apertures":
            self._stop_down(F_NUMBERS[key])
        if key in LENS_AND_MOTIONS and facts.get("blur_by") == "motions and lens":
            self._stop_down(LENS_AND_MOTIONS[key])
        match key:
            case "printed":
                view.cell_mm = float(facts["chart_width_mm"]) / 320 * self._person.printer
            case "mounted":
                view.sheets = ()  # a panel that was before the lens is put away
                view.mount = self._mount()
            case "panel":
                view.sheets = view.sheets or panel().sheets
                view.mount = self._before_wall()
            case "wall" | "scene":
                view.mount = self._before_wall()
            case "first" | "truth":
                self._shake(())
            case "first_moves" | "second" | "third" if self._at.motions and facts.get("blur_by") != "apertures":
                self._shake(self._at.motions[MOTION_OF[key]])
            case "focused" | "refocused" | "focused_near" | "focused_far":
                distance_mm = self._at.world.distance_mm(self._at.clock.now_s())
                distance_mm *= NEARER if facts.get("blur_by") == "apertures" else 1.0
                error = self._rng(key).uniform(-EYES_DIOPTRES, EYES_DIOPTRES)
                self._dioptres = 1000 / distance_mm + float(error)
                self._asked["focus_steps"] = 0.0
                self._focus()

    def follow(self, by_hand: Mapping[str, float]) -> None:
        """What was asked in numbers: so much more of each."""
        for name, change in by_hand.items():
            inexact = 1 + float(self._rng(f"{name} {change:.6g}").uniform(-SLOPPY, SLOPPY))
            self._asked[name] = self._asked.get(name, 0.0) + change * (1.0 if name in EXACT else inexact)
        self._apply()

    def take_up(self, facts: Mapping[str, Known]) -> None:
        """The bench as the facts of an earlier run tell that it was left, the axes being there already."""
        for key in SET_UP:
            if facts.get(key):
                self.do(key, facts)
        self._asked = {n.removeprefix(HAND): float(v) for n, v in facts.items() if n.startswith(HAND)}
        self._apply()

    def _stop_down(self, f_number: float) -> None:
        """The ring of apertures, and as much more or less time."""
        camera = self._at.view.camera
        self._at.view.camera = replace(camera, lens=replace(camera.lens, f_number=f_number))
        self._stops = 2 * float(np.log2(f_number / F_NUMBERS["first"]))
        self._apply()

    def _shake(self, drives: tuple[Drive, ...]) -> None:
        self._at.world.drive(drives, self._at.clock.now_s())

    def _before_wall(self) -> Mount:
        """The wall's middle before the camera where it is, seen squarely as far as the eye can tell."""
        world, rng = self._at.world, self._rng("wall")
        pose = world.pose(np.array([self._at.clock.now_s()]))
        x_mm, y_mm = (sum(world.room.travel[name]) / 2 for name in ("x_mm", "y_mm"))
        yaw, pitch, roll = (float(angle) for angle in rng.normal(0.0, SQUARE_DEG, 3))
        return Mount(float(pose.x_mm[0]) - x_mm, y_mm - float(pose.y_mm[0]), yaw, pitch, roll)

    def _mount(self) -> Mount:
        hung, asked = self._person.mount, self._asked
        off = 1.0 - min(asked.get("aim", 0.0), 1.0)
        return replace(
            hung,
            right_mm=off * hung.right_mm,
            down_mm=off * hung.down_mm,
            yaw_deg=hung.yaw_deg + asked.get("chart_yaw_deg", 0.0),
            pitch_deg=hung.pitch_deg + asked.get("chart_pitch_deg", 0.0),
            roll_deg=hung.roll_deg + asked.get("chart_roll_deg", 0.0),
        )

    def _apply(self) -> None:
        view, body = self._at.view, self._at.body
        if view.mount is not None and not view.sheets:
            view.mount = self._mount()
        more = self._stops + self._asked.get("exposure_ev", 0.0)
        body.settings.exposure_s = _nearest_third(self._person.exposure_s * 2**more)
        view.slope = (0.0, 0.0) if self._asked.get("even_light") else self._person.slope
        turns = [self._asked.get(f"screw_{i}_turns", 0.0) for i in range(1, self._held.count + 1)]
        view.held = self._held.turned(turns) if any(turns) else self._held
        self._focus()

    def _focus(self) -> None:
        """The ring as it stands: so many small steps towards infinity from where eye or autofocus left it."""
        dioptres = self._dioptres - STEP_DIOPTRES * self._asked.get("focus_steps", 0.0)
        self._at.view.focus_mm = 1000 / max(dioptres, 1e-3)


def _nearest_third(seconds: float) -> float:
    """The camera's dial has thirds of stops, from 1 s."""
    return float(2 ** (round(3 * np.log2(seconds)) / 3))
