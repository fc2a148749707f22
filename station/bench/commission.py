"""A stage is taken into service: what its controller is set to, what it does, what to change, and its table.

Nothing moves without the operator's consent, asked before homing and before each axis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from drivers.clock import Clock
from drivers.grbl import GrblStage
from drivers.grbl_envelope import HOME_FIRST, Controls, Envelope
from drivers.interfaces import Stage, Travel
from drivers.tmcl.stage import TmclStage
from station.common.toml_text import toml_value

LATE = 0.1
"""Part of the expected time by which a move may last longer."""
POLL_S = 1.0
"""What asking the controller adds to a move's time at most."""
RULER = 0.002
"""Part of a length within which a ruler and a stage agree: 0.5 mm on 250 mm."""


class Person(Protocol):
    """Who stands beside the stage."""

    def tell(self, words: str) -> None:
        """Read this."""
        ...

    def agrees(self, question: str) -> bool:
        """Whether that may be done; no unless said."""
        ...

    def measures(self, question: str) -> float | None:
        """A length, or None."""
        ...


@dataclass(frozen=True)
class Finding:
    """Something to change: why, and what to set where."""

    reason: str
    change: str


@dataclass(frozen=True)
class Drive:
    """One axis driven from end to end: how far, in which time, in which it should have been, what a ruler said."""

    axis: str
    way: float
    seconds: float
    expected_s: float | None = None
    ruler: float | None = None


def settings_told(stage: Stage) -> list[str]:
    """What the controller is set to, a line for each axis and one for the whole; nothing where it does not tell."""
    if isinstance(stage, TmclStage):
        return [f"{name}: {words}" for name, words in stage.settings().items()]
    if not isinstance(stage, GrblStage):
        return []
    controls = stage.link.controls
    switches = "hard limits on" if controls.flag(21) else "hard limits off"
    lines = [f"homing on, soft limits on, {switches}, pull-off {controls.setting(27) or 0.0:g} mm"]
    for name, one in stage.envelopes.items():
        lines.append(
            f"{name}: machine space {one.low:g} .. {one.high:g}, {one.rate_per_min:g} per min, "
            f"{one.acceleration_per_s2:g} per s^2, {controls.setting(100 + one.index) or 0.0:g} steps per unit"
        )
    return lines


def settings_findings(stage: Stage) -> list[Finding]:
    """What to change before anything moves."""
    if isinstance(stage, TmclStage):
        doubts = [one.caveat(name) for name, one in stage.envelopes.items()]
        return [Finding(caveat.reason, caveat.remedy) for caveat in doubts if caveat is not None]
    if not isinstance(stage, GrblStage):
        return []
    found = [_too_fast(name, one) for name, one in stage.envelopes.items()]
    caveat = stage.condition().caveat
    found.append(None if caveat is None else Finding(caveat.reason, caveat.remedy))
    if stage.link.controls.flag(21) is False:
        found.append(Finding("a switch that is hit does not stop it ($21=0)", "set $21=1 where every end has a switch"))
    found.append(_moves_unhomed(stage.link.controls))
    return [one for one in found if one is not None]


def _moves_unhomed(controls: Controls) -> Finding | None:
    if not controls.moves_unhomed:
        return None
    told = int(controls.setting(22) or 0)
    reason = f"after a power failure that nobody noticed it moves by a position that is lost ($22={told})"
    return Finding(reason, f"set $22={told | HOME_FIRST}, which locks it until it is homed")


def _too_fast(name: str, one: Envelope) -> Finding | None:
    asked, rate = one.axis.feed_per_min, one.rate_per_min
    if asked <= rate:
        return None
    reason = f"{name} is asked for {asked:g} per min, and its controller does {rate:g} (${110 + one.index})"
    return Finding(reason, f"write feed_per_min = {rate:g}, or raise ${110 + one.index}")


def drive_through(stage: Stage, person: Person, clock: Clock) -> list[Drive] | None:
    """Home, then each axis from its low end to its high end; None where homing was not agreed to."""
    if not person.agrees("Homing drives all axes to their switches. Is the way free, and the emergency stop at hand?"):
        return None
    stage.home()
    person.tell("homed at " + ", ".join(f"{name} = {value:g}" for name, value in stage.position().items()))
    drives = []
    for name, travel in stage.travel().items():
        if person.agrees(f"Drive {name} from {travel.low:g} to {travel.high:g}?"):
            drives.append(_drive(stage, name, travel, person, clock))
    return drives


def _drive(stage: Stage, name: str, travel: Travel, person: Person, clock: Clock) -> Drive:
    stage.move_to(**{name: travel.low})
    way = travel.high - travel.low
    expected_s = _expected_s(stage, name, way)
    begin_s = clock.now_s()
    stage.move_to(**{name: travel.high})
    seconds = clock.now_s() - begin_s
    person.tell(f"{name} went {way:g} in {seconds:.1f} s, {60 * way / seconds:.0f} per min on average")
    ruler = person.measures(f"How far did {name} move by a ruler? (nothing: not measured)")
    return Drive(name, way, seconds, expected_s, ruler)


def _expected_s(stage: Stage, name: str, way: float) -> float | None:
    """How long its controller's settings make that way last; None where it does not tell."""
    if isinstance(stage, TmclStage):
        return stage.travel_s(name, way)
    return stage.pace({name: way})[1] if isinstance(stage, GrblStage) else None


def drive_findings(stage: Stage, drives: Sequence[Drive]) -> list[Finding]:
    """What to change after it has moved."""
    envelopes = stage.envelopes if isinstance(stage, GrblStage) else {}
    found = []
    for one in drives:
        if one.expected_s is not None and one.seconds > (1 + LATE) * one.expected_s + POLL_S:
            reason = f"{one.axis} took {one.seconds:.1f} s where its settings say {one.expected_s:.1f} s"
            found.append(Finding(reason, "set the feed override to 100 %, and look for what holds it back"))
        if one.ruler is not None and abs(one.ruler - one.way) > RULER * one.way:
            found.append(_scale(one, one.ruler, envelopes.get(one.axis)))
    return found


def _scale(drive: Drive, ruler: float, one: Envelope | None) -> Finding:
    reason = f"{drive.axis} went {ruler:g} by the ruler where it was sent {drive.way:g}"
    if one is None:
        return Finding(reason, f"multiply unit_per_step by {ruler / drive.way:.5f}")
    return Finding(reason, f"multiply ${100 + one.index} by {drive.way / ruler:.5f}, then set ${130 + one.index} anew")


def device_table(name: str, table: Mapping[str, Any], stage: Stage) -> str:
    """The stage's table for station.toml, with feeds that its controller reaches and the ends of its machine space."""
    rows = [f"[devices.{name}]"]
    rows += [f"{key} = {toml_value(value)}" for key, value in table.items() if key != "axes"]
    rows.append("axes = [")
    envelopes = stage.envelopes if isinstance(stage, GrblStage) else {}
    for axis in table["axes"]:
        one = envelopes.get(axis["name"])
        told = {} if one is None else _told(axis, one)
        rows.append(f"    {toml_value({**axis, **told})},")
    return "\n".join([*rows, "]"]) + "\n"


def _told(axis: Mapping[str, Any], one: Envelope) -> dict[str, Any]:
    told: dict[str, Any] = {"feed_per_min": min(axis["feed_per_min"], one.rate_per_min)}
    usual = (-(one.high - one.low), 0.0)
    return told if (one.low, one.high) == usual else told | {"space": [one.low, one.high]}


def commission(name: str, stage: Stage, table: Mapping[str, Any], person: Person, clock: Clock) -> str:
    """Read, drive and judge a connected stage, telling all of it; its table for station.toml. Raises DeviceError."""
    person.tell(f"{name} at {stage.address}")
    for line in settings_told(stage):
        person.tell(f"  {line}")
    findings = settings_findings(stage)
    drives = drive_through(stage, person, clock)
    if drives is None:
        person.tell(f"{name} was not moved: travel and speed are as its controller tells them")
    findings += drive_findings(stage, drives or [])
    for finding in findings:
        person.tell(f"to change: {finding.reason}: {finding.change}")
    if not findings:
        person.tell(f"nothing to change at {name}")
    text = device_table(name, table, stage)
    person.tell(text)
    return text
