"""One exposure: wait until the rig is still, ask the devices how they are, expose, keep the file, then read it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from drivers.errors import DeviceError
from drivers.interfaces import Exposure
from procedures.plan import Facts
from procedures.raw import RawFrame, read_frame
from station.conversation import Conversation
from station.operator import Trouble
from station.rig import Rig, Snapshot
from station.settling import Patience, Settling, Tremor, Unrest

if TYPE_CHECKING:
    from drivers.clock import Clock
    from station.session import Session, Shot


class Photographer(Protocol):
    """What answers a request with a file: the bench's camera, or the operator."""

    def expose(self) -> Exposure:
        """One photograph. Raises DeviceError."""
        ...


@dataclass(frozen=True, eq=False)
class Taken:
    """A photograph that is in the session: its entry there, its planes, and the facts of its moment."""

    shot: Shot
    frame: RawFrame
    facts: Facts


class Exposer:
    """Takes photographs into a session."""

    def __init__(
        self,
        rig: Rig,
        camera: Photographer,
        session: Session,
        talk: Conversation,
        clock: Clock,
        patience: Patience | None = None,
    ) -> None:
        self._rig = rig
        self._camera = camera
        self._session = session
        self._talk = talk
        self.settling = Settling(rig.imu, clock, patience)

    def take(self, purpose: str, step: str) -> Taken:
        """One photograph. Raises Skipped, Stopped."""
        tremor = self._talk.attempt(self._still, self._rig.mend)
        shot = self._talk.attempt(lambda: self._expose(purpose, step, tremor), self._rig.mend)
        frame = self._talk.attempt(lambda: read_frame(self._session.folder / shot.path))
        return Taken(shot, frame, {**self._talk.facts, **shot_facts(shot)})

    def _still(self) -> Tremor | None:
        """Wait until the rig is still; an IMU that fails is waited without."""
        self._talk.doing("waiting until the rig is still")
        try:
            return self.settling.wait()
        except Unrest:
            raise
        except DeviceError as error:
            self.settling.imu = None
            self._talk.hear(Trouble(error.reason, f"going on without the IMU; {error.remedy}"))
            return self.settling.wait()

    def _expose(self, purpose: str, step: str, tremor: Tremor | None) -> Shot:
        snapshot = self._rig.snapshot()
        self._talk.doing("exposing")
        exposure = self._camera.expose()
        return self._session.adopt(exposure, step=step, purpose=purpose, snapshot=record(snapshot, tremor))


def record(snapshot: Snapshot, tremor: Tremor | None) -> dict[str, Any]:
    """What the session keeps of a moment."""
    kept = snapshot.record()
    if tremor is not None:
        kept |= {"acceleration_m_s2": tremor.acceleration_m_s2, "rotation_rad_s": tremor.rotation_rad_s}
    return kept


def shot_facts(shot: Shot) -> Facts:
    """The facts of a photograph's moment, from what the session kept of it."""
    axes = {f"at_{name}": float(value) for name, value in shot.snapshot.get("axes", {}).items()}
    others = {name: value for name, value in shot.snapshot.items() if isinstance(value, int | float)}
    return {**axes, **others}
