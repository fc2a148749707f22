"""One exposure: wait until the rig is still, ask the devices how they are, expose, keep the file, then read it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

from drivers.errors import DeviceError, EmergencyStopped
from drivers.interfaces import Exposure
from procedures.plan import Facts
from procedures.raw import RawFrame, read_frame
from station.conversation import Conversation, Skipped
from station.operator import Stopped, Trouble
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
        shot = self._kept(purpose, step, tremor)
        frame = self._talk.attempt(lambda: read_frame(self._session.original(shot)))
        return Taken(shot, frame, {**self._talk.facts, **shot_facts(shot)})

    def _still(self) -> Tremor | None:
        """Wait until the rig is still; an IMU that fails is waited without."""
        self._talk.doing("waiting until the rig is still")
        try:
            return self.settling.wait()
        except (Unrest, EmergencyStopped):
            raise
        except DeviceError as error:
            self.settling.imu = None
            self._talk.hear(Trouble(error.reason, f"going on without the IMU; {error.remedy}"))
            return self.settling.wait()

    def _kept(self, purpose: str, step: str, tremor: Tremor | None) -> Shot:
        """Expose, and take the file in; a full disk lets the file wait where the camera put it."""
        number = self._talk.attempt(lambda: self._session.expect(step, purpose))
        kept: dict[str, Any] = {}

        def expose() -> Exposure:
            known = set(self._rig.silent)
            snapshot = self._rig.snapshot()
            for name in set(snapshot.silent) - known:
                self._talk.hear(
                    Trouble(f"the {name} does not tell: {snapshot.silent[name]}", "look after it; the run goes on")
                )
            kept.update(record(snapshot, tremor))
            self._talk.doing("exposing")
            self._rig.announce(number)
            return self._camera.expose()

        try:
            exposure = self._talk.attempt(expose, self._rig.mend)
        except (Skipped, Stopped):
            self._session.note("gave_up", step=step, purpose=purpose)
            raise
        adopt = partial(self._session.adopt, exposure, step=step, purpose=purpose, snapshot=kept)
        return self._talk.attempt(adopt, always=True)


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
