"""Commissioning of a stage: its controller's settings, a drive of each axis, recommended changes, and its table.
Nothing moves without the operator's consent, requested before homing and before each axis."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from drivers.errors import Clock
from drivers.grbl import GrblStage
from drivers.interfaces import Stage
from drivers.protocols.grbl import HOME_FIRST, GrblEnvelope
from drivers.tmcl.stage import TmclStage
from station.common.toml_text import toml_value

LATE = 0.1
"""Allowed excess of a move's duration, relative to the expected one."""
POLL_S = 1.0
"""Longest delay that polling adds to a move's duration."""
RULER = 0.002
"""Relative tolerance between ruler and stage: 0.5 mm on 250 mm."""

SCALES = {**dict.fromkeys(("esp301", "smc100", "apt", "gcs"), "scale"), "micromanager_stage": "unit_per_um"}
"""Key of an axis' scale by driver, where it is not `unit_per_step`."""


class Operator(Protocol):
    """The operator at the stage."""

    def show(self, words: str) -> None:
        """Display a line."""

    def agrees(self, question: str) -> bool:
        """Whether the operator consents; no by default."""

    def measures(self, question: str) -> float | None:
        """A measured length, or None."""


@dataclass(frozen=True)
class Recommendation:
    """A recommended change: reason and remedy."""

    reason: str
    change: str


@dataclass(frozen=True)
class AxisDrive:
    """A drive of one axis from end to end: distance, duration, expected duration, distance by a ruler."""

    axis: str
    way: float
    seconds: float
    expected_s: float | None = None
    ruler: float | None = None


def settings_text(stage: Stage) -> list[str]:
    """The controller's settings as text, a line for each axis and one in common; empty if they are not reported."""
    if isinstance(stage, TmclStage):
        return [f"{name}: {words}" for name, words in stage.settings().items()]
    if not isinstance(stage, GrblStage):
        return []
    controls = stage.link.controls
    switches = "hard limits on" if controls.flag(21) else "hard limits off"
    lines = [f"homing on, soft limits on, {switches}, pull-off {controls.positive(27, 0.0):g} mm"]
    for name, axis in stage.envelopes.items():
        lines.append(
            f"{name}: machine space {axis.low:g} .. {axis.high:g}, {axis.rate_per_min:g} per min, "
            f"{axis.acceleration_per_s2:g} per s^2, {controls.positive(100 + axis.index, 0.0):g} steps per unit"
        )
    return lines


def settings_findings(stage: Stage) -> list[Recommendation]:
    """Changes recommended before anything moves."""
    if isinstance(stage, TmclStage):
        caveats = [axis.caveat(name) for name, axis in stage.envelopes.items()]
        return [Recommendation(caveat.reason, caveat.remedy) for caveat in caveats if caveat is not None]
    if not isinstance(stage, GrblStage):
        return []
    findings, controls = [], stage.link.controls
    for name, axis in stage.envelopes.items():
        feed, rate, setting = axis.axis.feed_per_min, axis.rate_per_min, f"${110 + axis.index}"
        if feed > rate:
            reason = f"{name} is configured for {feed:g} per min, but its controller reaches {rate:g} ({setting})"
            findings.append(Recommendation(reason, f"write feed_per_min = {rate:g}, or raise {setting}"))
    if (caveat := stage.condition().caveat) is not None:
        findings.append(Recommendation(caveat.reason, caveat.remedy))
    if controls.flag(21) is False:
        findings.append(
            Recommendation("a limit switch does not stop it ($21=0)", "set $21=1 if every end has a switch")
        )
    if controls.moves_unhomed:
        flags = controls.bits(22)
        reason = f"after an unnoticed power failure it moves although its position is lost ($22={flags})"
        findings.append(Recommendation(reason, f"set $22={flags | HOME_FIRST}, which locks it until it is homed"))
    return findings


def drive_through(stage: Stage, operator: Operator, clock: Clock) -> list[AxisDrive] | None:
    """Home, then drive each axis from its low end to its high end; None without consent to homing."""
    if not operator.agrees("Homing drives all axes to their switches. Is the way free and the emergency stop at hand?"):
        return None
    stage.home()
    operator.show("homed at " + ", ".join(f"{name} = {value:g}" for name, value in stage.position().items()))
    drives = []
    for name, travel in stage.travel().items():
        if operator.agrees(f"Drive {name} from {travel.low:g} to {travel.high:g}?"):
            stage.move_to(**{name: travel.low})
            way = travel.high - travel.low
            expected_s = _expected_s(stage, name, way)
            begin_s = clock.now_s()
            stage.move_to(**{name: travel.high})
            seconds = clock.now_s() - begin_s
            operator.show(f"{name} moved {way:g} in {seconds:.1f} s, {60 * way / seconds:.0f} per min on average")
            ruler = operator.measures(f"How far did {name} move by a ruler? (nothing: not measured)")
            drives.append(AxisDrive(name, way, seconds, expected_s, ruler))
    return drives


def _expected_s(stage: Stage, name: str, way: float) -> float | None:
    """Duration of this move according to the controller's settings; None if it does not report them."""
    if isinstance(stage, TmclStage):
        return stage.travel_s(name, way)
    return stage.pace({name: way})[1] if isinstance(stage, GrblStage) else None


def drive_findings(stage: Stage, drives: Sequence[AxisDrive], scale: str) -> list[Recommendation]:
    """Changes recommended after the drives; `scale` is the key of an axis' scale in station.toml."""
    envelopes = stage.envelopes if isinstance(stage, GrblStage) else {}
    findings = []
    for drive in drives:
        if drive.expected_s is not None and drive.seconds > (1 + LATE) * drive.expected_s + POLL_S:
            reason = f"{drive.axis} took {drive.seconds:.1f} s; its settings give {drive.expected_s:.1f} s"
            findings.append(
                Recommendation(reason, "set the feed override to 100 %, and check for mechanical resistance")
            )
        if drive.ruler is not None and abs(drive.ruler - drive.way) > RULER * drive.way:
            findings.append(_scale(drive, drive.ruler, envelopes.get(drive.axis), scale))
    return findings


def _scale(drive: AxisDrive, ruler: float, envelope: GrblEnvelope | None, key: str) -> Recommendation:
    reason = f"{drive.axis} moved {ruler:g} by the ruler instead of {drive.way:g}"
    if envelope is None:
        return Recommendation(reason, f"multiply {key} by {ruler / drive.way:.5f}")
    scale, travel = f"${100 + envelope.index}", f"${130 + envelope.index}"
    return Recommendation(reason, f"multiply {scale} by {drive.way / ruler:.5f}, then set {travel} again")


def _limits(axis: Mapping[str, Any], envelope: GrblEnvelope) -> dict[str, Any]:
    limits: dict[str, Any] = {"feed_per_min": min(axis["feed_per_min"], envelope.rate_per_min)}
    usual = (-(envelope.high - envelope.low), 0.0)
    return limits if (envelope.low, envelope.high) == usual else limits | {"space": [envelope.low, envelope.high]}


def commission(name: str, stage: Stage, table: Mapping[str, Any], operator: Operator, clock: Clock) -> str:
    """Read, drive and judge a connected stage, reporting everything; returns its table. Raises DeviceError."""
    operator.show(f"{name} at {stage.address}")
    for line in settings_text(stage):
        operator.show(f"  {line}")
    findings = settings_findings(stage)
    drives = drive_through(stage, operator, clock)
    if drives is None:
        operator.show(f"{name} was not moved: travel and speed are as reported by its controller")
    findings += drive_findings(stage, drives or [], SCALES.get(table["driver"], "unit_per_step"))
    for finding in findings:
        operator.show(f"to change: {finding.reason}: {finding.change}")
    if not findings:
        operator.show(f"nothing to change at {name}")
    rows = [f"[devices.{name}]"]
    rows += [f"{key} = {toml_value(value)}" for key, value in table.items() if key != "axes"]
    rows.append("axes = [")
    envelopes = stage.envelopes if isinstance(stage, GrblStage) else {}
    for axis in table["axes"]:
        envelope = envelopes.get(axis["name"])
        limits = {} if envelope is None else _limits(axis, envelope)
        rows.append(f"    {toml_value({**axis, **limits})},")
    text = "\n".join([*rows, "]"]) + "\n"
    operator.show(text)
    return text
