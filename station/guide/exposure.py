"""One exposure: wait until the rig is still, ask the devices how they are, expose, keep the file, then read it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

from drivers.errors import DeviceError, EmergencyStopped
from drivers.interfaces import ExposedFile, ImuBlock, ShakePath
from procedures.plan import Facts, Shake
from procedures.raw import RawFrame, read_frame
from station.guide.active_devices import Rig, Snapshot
from station.guide.dialogue import Conversation, Skipped
from station.guide.frontend import ProblemEvent, Stopped
from station.guide.vibration import NotSettled, Settling, SettlingTimeouts, VibrationLevel

if TYPE_CHECKING:
    from drivers.clock import Clock
    from station.sessions.session import Session, SessionShot


MOTION_HZ = 200.0
MOTION_RIM_S = 0.2
"""What is kept of the IMU's record before and after the exposure: lag of the shutter, and comparison of clocks."""
SPRINGS_S = 0.5
"""From the beginning of a path to the photograph: what began with a jerk has died away."""
LONGEST_OPEN_S = 2.0
"""Exposure that is allowed for where none was asked for."""


class Photographer(Protocol):
    """What answers a request with a file: the bench's camera, or the operator."""

    def expose(self) -> ExposedFile:
        """One photograph. Raises DeviceError."""
        ...


@dataclass(frozen=True, eq=False)
class RecordedPhotograph:
    """A photograph that is in the session: its entry there, its planes, and the facts of its moment."""

    shot: SessionShot
    frame: RawFrame
    facts: Facts


class PhotographRecorder:
    """Takes photographs into a session."""

    def __init__(
        self,
        rig: Rig,
        camera: Photographer,
        session: Session,
        talk: Conversation,
        clock: Clock,
        patience: SettlingTimeouts | None = None,
    ) -> None:
        self._rig = rig
        self._camera = camera
        self._session = session
        self._talk = talk
        self._clock = clock
        self.settling = Settling(rig.imu, clock, patience)

    def take(self, purpose: str, step: str, *, moving: bool = False, shake: Shake | None = None) -> RecordedPhotograph:
        """One photograph: when the rig is still, or with the IMU recorded while it moves, shaken or by itself.

        Raises Skipped, Stopped.
        """
        tremor = None if moving else self._talk.attempt(self._still, self._rig.mend)
        shot = self._kept(purpose, step, tremor, moving=moving, shake=shake)
        frame = self._talk.attempt(lambda: read_frame(self._session.original(shot)))
        return RecordedPhotograph(shot, frame, {**self._talk.facts, **shot_facts(shot)})

    def _still(self) -> VibrationLevel | None:
        """Wait until the rig is still; an IMU that fails is waited without."""
        self._talk.doing("waiting until the rig is still")
        try:
            return self.settling.wait()
        except (NotSettled, EmergencyStopped):
            raise
        except DeviceError as error:
            self.settling.imu = None
            self._talk.notify(ProblemEvent(error.reason, f"going on without the IMU; {error.remedy}"))
            return self.settling.wait()

    def _kept(
        self, purpose: str, step: str, tremor: VibrationLevel | None, *, moving: bool, shake: Shake | None
    ) -> SessionShot:
        """Expose, and take the file in; a full disk lets the file wait where the camera put it."""
        number = self._talk.attempt(lambda: self._session.expect(step, purpose))
        kept: dict[str, Any] = {}

        def expose() -> ExposedFile:
            known = set(self._rig.silent)
            snapshot = self._rig.snapshot()
            for name in set(snapshot.silent) - known:
                self._talk.notify(
                    ProblemEvent(f"the {name} does not tell: {snapshot.silent[name]}", "look after it; the run goes on")
                )
            kept.update(record(snapshot, tremor))
            self._talk.doing("exposing")
            self._rig.announce(number)
            if not moving:
                return self._camera.expose()
            exposure, told = self._moved(shake)
            kept.update(told)
            return exposure

        try:
            exposure = self._talk.attempt(expose, self._rig.mend)
        except (Skipped, Stopped):
            self._session.note("gave_up", step=step, purpose=purpose)
            raise
        adopt = partial(self._session.adopt, exposure, step=step, purpose=purpose, snapshot=kept)
        return self._talk.attempt(adopt, always=True)

    def _moved(self, shake: Shake | None) -> tuple[ExposedFile, dict[str, Any]]:
        """One photograph while the rig moves, and what is known of that."""
        path = None if shake is None else self._rig.start_shaking(shake)
        if path is None:
            exposure, block = self._imu()
            return exposure, motion_record(exposure, block)
        try:
            self._clock.sleep(SPRINGS_S)
            exposure, block = self._imu()
            return exposure, {**motion_record(exposure, block), **self._path_record(path)}
        finally:
            self._rest()

    def _path_record(self, path: ShakePath) -> dict[str, Any]:
        """What the session keeps of the path; nothing where the shaker came to rest meanwhile."""
        try:
            return {"shake": {"began_s": self._rig.shaking_since_s(), **asdict(path)}}
        except DeviceError as error:  # the photograph is there: it must be kept
            self._talk.notify(ProblemEvent(error.reason, f"the motion is not known; {error.remedy}"))
            return {}

    def _rest(self) -> None:
        """The shaker comes to rest; a photograph that was taken is not lost where it does not."""
        try:
            self._rig.stop_shaking()
        except DeviceError as error:
            self._talk.notify(ProblemEvent(error.reason, error.remedy))

    def _imu(self) -> tuple[ExposedFile, ImuBlock | None]:
        """One photograph, and what the IMU felt meanwhile; None where there is none, or it fails."""
        imu = self._rig.imu
        try:
            if imu is not None:
                imu.start(MOTION_HZ)
        except EmergencyStopped:
            raise
        except DeviceError as error:
            self._talk.notify(ProblemEvent(error.reason, f"going on without the IMU; {error.remedy}"))
            imu = None
        exposure = self._camera.expose()
        if imu is None:
            return exposure, None
        try:
            block = imu.read_block(0.0)
            imu.stop()
        except DeviceError as error:  # the photograph is there: it must be kept
            self._talk.notify(ProblemEvent(error.reason, f"the motion is not known; {error.remedy}"))
            return exposure, None
        return exposure, block


def motion_record(exposure: ExposedFile, block: ImuBlock | None) -> dict[str, Any]:
    """What the session keeps of the IMU: its samples about the time the shutter was open, by the host's clock."""
    if block is None or not len(block.host_s):
        return {}
    shutter, open_s = exposure.shutter, exposure.settings.exposure_s or LONGEST_OPEN_S
    begin_s = shutter.closed_s - MOTION_RIM_S if shutter else -float("inf")
    end_s = shutter.closed_s + open_s + 2 * MOTION_RIM_S if shutter else float("inf")
    inside = (block.host_s >= begin_s) & (block.host_s <= end_s)
    return {
        "motion": {
            "host_s": [round(float(t), 6) for t in block.host_s[inside]],
            "acceleration_m_s2": [[round(float(v), 5) for v in row] for row in block.acceleration_m_s2[inside]],
            "rotation_rad_s": [[round(float(v), 6) for v in row] for row in block.rotation_rad_s[inside]],
            "lost": block.lost,
        }
    }


def record(snapshot: Snapshot, tremor: VibrationLevel | None) -> dict[str, Any]:
    """What the session keeps of a moment."""
    kept = snapshot.record()
    if tremor is not None:
        kept |= {"acceleration_m_s2": tremor.acceleration_m_s2, "rotation_rad_s": tremor.rotation_rad_s}
    return kept


def shot_facts(shot: SessionShot) -> Facts:
    """The facts of a photograph's moment, from what the session kept of it."""
    axes = {f"at_{name}": float(value) for name, value in shot.snapshot.get("axes", {}).items()}
    others = {name: value for name, value in shot.snapshot.items() if isinstance(value, int | float)}
    return {**axes, **others}
