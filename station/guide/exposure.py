"""One exposure: wait until the rig has settled, read the devices' state, expose, store the file, then read it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

from drivers.errors import DeviceError, EmergencyStopped
from drivers.interfaces import ExposedFile, ImuBlock
from procedures.plan import Facts, Shake
from procedures.raw import RawFrame, read_frame
from station.guide.active_devices import ActiveDevices
from station.guide.coach import preview_of
from station.guide.dialogue import Conversation, Skipped
from station.guide.frontend import ProblemEvent, Stopped
from station.guide.vibration import NotSettled, Settling, SettlingTimeouts, VibrationLevel

if TYPE_CHECKING:
    from drivers.errors import Clock
    from station.sessions.session import Session, SessionShot


MOTION_HZ = 200.0
MOTION_MARGIN_S = 0.2
"""Margin of the IMU record before and after the exposure: lag of the shutter and uncertainty of the clocks."""
TRANSIENT_S = 0.5
"""Delay from the start of a path to the photograph, in which the transient decays."""
DEFAULT_OPEN_S = 2.0
"""Assumed exposure time where none is known."""


class Photographer(Protocol):
    """Source of photographs: the bench's camera, or the operator."""

    def expose(self) -> ExposedFile:
        """One photograph. Raises DeviceError."""


@dataclass(frozen=True, eq=False)
class RecordedPhotograph:
    """A photograph stored in the session: its entry, its planes, and the facts at its time."""

    shot: SessionShot
    frame: RawFrame
    facts: Facts


class PhotographRecorder:
    """Takes photographs into a session."""

    def __init__(
        self,
        rig: ActiveDevices,
        camera: Photographer,
        session: Session,
        talk: Conversation,
        clock: Clock,
        timeouts: SettlingTimeouts | None = None,
    ) -> None:
        self.rig, self.session, self.talk = rig, session, talk
        self.camera, self._clock = camera, clock
        self.settling = Settling(rig.imu, clock, timeouts)
        self._exposures_s: set[float] = set()

    def take(self, purpose: str, step: str, *, moving: bool = False, shake: Shake | None = None) -> RecordedPhotograph:
        """One photograph: of a settled rig, or of a moving one with its IMU record, shaken or not. Raises Skipped,
        Stopped."""
        vibration = None if moving else self.talk.attempt(self._settled, self.rig.recover)
        photograph = self.read(self._store(purpose, step, vibration, moving=moving, shake=shake))
        self._check_flicker(photograph.frame.exposure.exposure_s)
        return photograph

    def read(self, shot: SessionShot) -> RecordedPhotograph:
        """A stored photograph. Raises Skipped, Stopped."""
        frame = self.talk.attempt(lambda: read_frame(self.session.original(shot)))
        axes = {f"at_{name}": float(value) for name, value in shot.snapshot.get("axes", {}).items()}
        others = {name: value for name, value in shot.snapshot.items() if isinstance(value, int | float)}
        return RecordedPhotograph(shot, frame, {**self.talk.facts, **axes, **others})

    def preview(self) -> tuple[RawFrame, Facts]:
        """A frame for the coach, which is not kept, and the facts at its time. Raises DeviceError, BadInput."""
        facts = {**self.talk.facts, **self.rig.snapshot().facts()}
        return preview_of(self.rig.expose()), facts

    def _settled(self) -> VibrationLevel | None:
        """Wait until the rig has settled; without the IMU if it fails."""
        self.talk.doing("waiting until the rig is still")
        try:
            return self.settling.wait()
        except (NotSettled, EmergencyStopped):
            raise
        except DeviceError as error:
            self.settling.imu = None
            self.talk.notify(ProblemEvent(error.reason, f"continuing without the IMU; {error.remedy}"))
            return self.settling.wait()

    def _store(
        self, purpose: str, step: str, vibration: VibrationLevel | None, *, moving: bool, shake: Shake | None
    ) -> SessionShot:
        """Expose and store the file; on a full disk the file stays where the camera put it."""
        number = self.talk.attempt(lambda: self.session.expect(step, purpose))
        moment: dict[str, Any] = {}

        def expose() -> ExposedFile:
            reported = set(self.rig.silent)
            snapshot = self.rig.snapshot()
            for name in set(snapshot.silent) - reported:
                self.talk.notify(
                    ProblemEvent(f"the {name} does not answer: {snapshot.silent[name]}", "check it; the run continues")
                )
            moment.update(snapshot.record(), **({} if vibration is None else vibration._asdict()))
            self.talk.doing("exposing")
            self.rig.announce(number)
            if not moving:
                return self.camera.expose()
            exposure, motion = self._expose_moving(shake)
            moment.update(motion)
            return exposure

        try:
            exposure = self.talk.attempt(expose, self.rig.recover)
        except (Skipped, Stopped):
            self.session.note("gave_up", step=step, purpose=purpose)
            raise
        adopt = partial(self.session.adopt, exposure, step=step, purpose=purpose, snapshot=moment)
        return self.talk.attempt(adopt, always=True)

    def _check_flicker(self, exposure_s: float | None) -> None:
        """Report, once for each exposure time, that photographs are too short for the lamp's modulation."""
        if exposure_s and exposure_s not in self._exposures_s:
            self._exposures_s.add(exposure_s)
            if (caveat := self.rig.flicker(exposure_s)) is not None:
                self.talk.notify(ProblemEvent(caveat.reason, caveat.remedy))

    def _expose_moving(self, shake: Shake | None) -> tuple[ExposedFile, dict[str, Any]]:
        """One photograph while the rig moves, and the record of the motion."""
        path = None if shake is None else self.rig.start_shaking(shake)
        if path is None:
            exposure, block = self._expose_with_imu()
            return exposure, motion_record(exposure, block)
        try:
            self._clock.sleep(TRANSIENT_S)
            exposure, block = self._expose_with_imu()
            record = dict[str, Any]()
            with self._after_exposure("the motion is not known; "):
                record["shake"] = {"began_s": self.rig.shaking_since_s(), **asdict(path)}
            return exposure, {**motion_record(exposure, block), **record}
        finally:
            with self._after_exposure():
                self.rig.stop_shaking()

    @contextmanager
    def _after_exposure(self, consequence: str = "") -> Iterator[None]:
        """Report device errors: the photograph was taken and must be stored."""
        try:
            yield
        except DeviceError as error:
            self.talk.notify(ProblemEvent(error.reason, f"{consequence}{error.remedy}"))

    def _expose_with_imu(self) -> tuple[ExposedFile, ImuBlock | None]:
        """One photograph and the IMU's samples; None where there is no IMU, or it fails."""
        imu = self.rig.imu
        try:
            if imu is not None:
                imu.start(MOTION_HZ)
        except EmergencyStopped:
            raise
        except DeviceError as error:
            self.talk.notify(ProblemEvent(error.reason, f"continuing without the IMU; {error.remedy}"))
            imu = None
        exposure = self.camera.expose()
        block = None
        with self._after_exposure("the motion is not known; "):
            if imu is not None:
                block = imu.read_block(0.0)
                imu.stop()
        return exposure, block


def motion_record(exposure: ExposedFile, block: ImuBlock | None) -> dict[str, Any]:
    """The IMU's samples around the exposure as stored in the session, by the host's clock."""
    if block is None or not len(block.host_s):
        return {}
    shutter, open_s = exposure.shutter, exposure.settings.exposure_s or DEFAULT_OPEN_S
    begin_s = shutter.closed_s - MOTION_MARGIN_S if shutter else -float("inf")
    end_s = shutter.closed_s + open_s + 2 * MOTION_MARGIN_S if shutter else float("inf")
    inside = (block.host_s >= begin_s) & (block.host_s <= end_s)
    return {
        "motion": {
            "host_s": [round(float(t), 6) for t in block.host_s[inside]],
            "acceleration_m_s2": [[round(float(v), 5) for v in row] for row in block.acceleration_m_s2[inside]],
            "rotation_rad_s": [[round(float(v), 6) for v in row] for row in block.rotation_rad_s[inside]],
            "lost": block.lost,
            **({} if block.clock is None else {"clock": asdict(block.clock)}),
        }
    }
