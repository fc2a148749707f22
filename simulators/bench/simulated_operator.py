"""Operator model of the simulated bench: hangs the chart, turns the focus ring, sets the exposure, reads the ruler.

The operator begins with an empty wall and arbitrary camera settings, and is inexact. The actions depend on the seed and
on the requests, not on time, so that a resumed session finds the bench in the same state.
"""

import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from simulators.bench.body import CameraBody
from simulators.bench.view import Mount, View
from simulators.camera.sheets import panel
from simulators.devices.serial_device import SimClock
from simulators.world.world import SinusoidalDrive, World

Known = str | float | bool
HAND = "hand_"  # prefix of a fact's name: the sum of all manual changes of that name requested so far
EYES_DIOPTRES = 0.04  # largest error of focusing by eye or autofocus
STEP_DIOPTRES = 0.03  # a small turn of the focus ring
EXACT = ("exposure_ev", "aperture_ev")  # settings with detents
RIM_PX, MAX_W = 8, 4.0
"""Margin of the marked region to the frame's edge, and the assumed widest blur, both in plane pixels."""
TAPE_MM = 5.0  # resolution of a distance read from a tape measure
SQUARE_DEG = 0.4  # standard deviation of each angle of a camera squared to a wall by eye
RELATIVE_ERROR = 0.04  # largest relative error of a manual change
SET_UP = (
    "printed", "panel", "mounted", "wall", "scene", "focused", "refocused", "refocused_near", "focused_near",
    "focused_far", "first", "first_moves", "second", "third", "truth",
)  # fmt: skip
"""Keys of the questions that trigger an action, in order."""
MOTION_OF = {"first_moves": 0, "second": 1, "third": 2}  # index of the rig's motion, by the question
F_NUMBERS = {"first": 4.0, "second": 2.8, "third": 5.6, "truth": 22.0}
"""f-number set for each question where apertures blur."""
LENS_AND_MOTIONS = {"first": 8.0, "truth": 22.0}
"""f-numbers where lens and motions blur: wide enough for defocus, with exposures long enough for the IMU."""
NEARER = 0.65  # fraction of a scene's distance that is nearer than anything in it


@dataclass(frozen=True)
class Person:
    """Initial settings of an operator without instructions: chart, lamp, exposure; and the printer's scale.

    `width_mm` is the width of the requested chart, chosen for the rail's travel; None accepts the proposal.
    """

    width_mm: float | None = 96.0
    printer: float = 0.994
    mount: Mount = field(default_factory=lambda: Mount(14.0, -9.0, yaw_deg=2.6, pitch_deg=-1.9, roll_deg=6.4))
    exposure_s: float = 1 / 160
    slope: tuple[float, float] = (-0.13, 0.04)


class Standing(Protocol):
    """Parts of the bench that the operator uses; `motions` are the rig's vibrations for each photograph."""

    world: World
    view: View
    body: CameraBody
    clock: SimClock
    motions: tuple[tuple[SinusoidalDrive, ...], ...]


class SimulatedActions:
    """Actions of the operator at this bench."""

    def __init__(self, at: Standing, seed: int, person: Person | None = None) -> None:
        self._at = at
        self._seed = seed
        self._person = person or Person()
        self._asked: dict[str, float] = {}
        self._stops = 0.0
        self._held, self._f_number = at.view.held, at.view.camera.lens.f_number
        self._dioptres = 1 / 5.0
        self.empty_the_room()

    def empty_the_room(self) -> None:
        """Remove the chart and reset the camera to arbitrary settings."""
        view, body = self._at.view, self._at.body
        view.mount, view.slope, view.focus_mm = None, self._person.slope, 1000 / self._dioptres
        body.settings.exposure_s = self._person.exposure_s

    def _rng(self, what: str) -> np.random.Generator:
        return np.random.default_rng([self._seed, zlib.crc32(what.encode())])

    @property
    def in_real_time(self) -> bool:
        """Whether waiting for the bench takes time."""
        return self._at.clock.speed < math.inf

    def knows(self, key: str) -> Known | None:
        """Values read at the bench: rulers to a quarter of a millimetre, the camera's data sheet."""
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
            **(self._depth_answers() if self._at.motions else {}),
        }
        return known.get(key)

    def _depth_answers(self) -> dict[str, Known]:
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

    def do(self, key: str, facts: Mapping[str, Known]) -> None:
        """Carry out the action of a confirmed question."""
        view = self._at.view
        if key in F_NUMBERS and facts.get("blur_by") == "apertures":
            self._stop_down(F_NUMBERS[key])
        if key in LENS_AND_MOTIONS and facts.get("blur_by") == "motions and lens":
            self._stop_down(LENS_AND_MOTIONS[key])
        match key:
            case "printed":
                ordered_mm = facts.get("chart_width_mm", self._person.width_mm or Person.width_mm)
                view.cell_mm = float(ordered_mm or 0.0) / 320 * self._person.printer
            case "mounted":
                view.sheets = ()  # remove the panel
                view.mount = self._mount()
            case "panel":
                view.sheets = view.sheets or panel().sheets
                view.mount = self._before_wall()
            case "wall" | "scene":
                view.mount = self._before_wall()
            case "first" | "truth":
                self._at.world.drive((), self._at.clock.now_s())
            case "first_moves" | "second" | "third" if self._at.motions and facts.get("blur_by") != "apertures":
                self._at.world.drive(self._at.motions[MOTION_OF[key]], self._at.clock.now_s())
            case "focused" | "refocused" | "refocused_near" | "focused_near" | "focused_far":
                distance_mm = self._at.world.distance_mm(self._at.clock.now_s())
                distance_mm *= NEARER if facts.get("blur_by") == "apertures" else 1.0
                error = self._rng(key).uniform(-EYES_DIOPTRES, EYES_DIOPTRES)
                self._dioptres = 1000 / distance_mm + float(error)
                self._asked["focus_steps"] = 0.0
                self._focus()

    def follow(self, by_hand: Mapping[str, float]) -> None:
        """Carry out manual changes, by name."""
        for name, change in by_hand.items():
            inexact = 1 + float(self._rng(f"{name} {change:.6g}").uniform(-RELATIVE_ERROR, RELATIVE_ERROR))
            self._asked[name] = self._asked.get(name, 0.0) + change * (1.0 if name in EXACT else inexact)
        self._apply()

    def take_up(self, facts: Mapping[str, Known]) -> None:
        """Restore the bench from the facts of an earlier run, except for the axes."""
        for key in SET_UP:
            if facts.get(key):
                self.do(key, facts)
        self._asked = {n.removeprefix(HAND): float(v) for n, v in facts.items() if n.startswith(HAND)}
        self._apply()

    def _stop_down(self, f_number: float) -> None:
        """Set the aperture and compensate the exposure time."""
        self._set_aperture(f_number)
        self._stops = 2 * float(np.log2(f_number / F_NUMBERS["first"]))
        self._apply()

    def _set_aperture(self, f_number: float) -> None:
        camera = self._at.view.camera
        self._at.view.camera = replace(camera, lens=replace(camera.lens, f_number=round(f_number, 2)))

    def _before_wall(self) -> Mount:
        """Mount of a wall centred on the camera and squared by eye."""
        world, rng = self._at.world, self._rng("wall")
        pose = world.pose(np.array([self._at.clock.now_s()]))
        x_mm, y_mm = (sum(world.room.travel[name]) / 2 for name in ("x_mm", "y_mm"))
        yaw, pitch, roll = (float(angle) for angle in rng.normal(0.0, SQUARE_DEG, 3))
        return Mount(float(pose.x_mm[0]) - x_mm, y_mm - float(pose.y_mm[0]), yaw, pitch, roll)

    def _mount(self) -> Mount:
        initial, asked = self._person.mount, self._asked
        off = 1.0 - min(asked.get("aim", 0.0), 1.0)
        return replace(
            initial,
            right_mm=off * initial.right_mm,
            down_mm=off * initial.down_mm,
            yaw_deg=initial.yaw_deg + asked.get("chart_yaw_deg", 0.0),
            pitch_deg=initial.pitch_deg + asked.get("chart_pitch_deg", 0.0),
            roll_deg=initial.roll_deg + asked.get("chart_roll_deg", 0.0),
        )

    def _apply(self) -> None:
        view, body = self._at.view, self._at.body
        if view.mount is not None and not view.sheets:
            view.mount = self._mount()
        closed = self._asked.get("aperture_ev", 0.0)
        if "aperture_ev" in self._asked:
            self._set_aperture(self._f_number * 2 ** (closed / 2))
        more = self._stops + closed + self._asked.get("exposure_ev", 0.0)
        thirds = round(3 * np.log2(self._person.exposure_s * 2**more))  # of stops from 1 s
        body.settings.exposure_s = float(2 ** (thirds / 3))
        view.slope = (0.0, 0.0) if self._asked.get("even_light") else self._person.slope
        turns = [self._asked.get(f"screw_{i}_turns", 0.0) for i in range(1, self._held.count + 1)]
        view.held = self._held.turned(turns) if any(turns) else self._held
        self._focus()

    def _focus(self) -> None:
        """Set the focus: the initial focus plus the requested steps towards infinity."""
        dioptres = self._dioptres - STEP_DIOPTRES * self._asked.get("focus_steps", 0.0)
        self._at.view.focus_mm = 1000 / max(dioptres, 1e-3)
