"""A small session as a run would drive it: looks, shots that count, a result; it goes on where the session stands."""

import hashlib
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from drivers.interfaces import CameraSettings, ExposedFile
from station.results.result_files import ResultFolder, write_record
from station.sessions.layout import is_session
from station.sessions.session import Session

COUNTING = 2


class FixedClock:
    """No time passes."""

    def now_s(self) -> float:
        return 12.5

    def sleep(self, duration_s: float) -> None: ...

    def wait(self, condition, ready, deadline_s) -> bool:
        return ready()


def today() -> datetime:
    return datetime(2026, 3, 14, 9, 26, 53, tzinfo=UTC)


@dataclass
class Camera:
    """Its software saves each frame under a new name; what is in it depends on what it is taken for, and on `noise`."""

    folder: Path
    exposures: list[str] = field(default_factory=list)
    noise: str = ""

    def expose(self, what: str) -> ExposedFile:
        self.folder.mkdir(exist_ok=True)
        self.exposures.append(what)
        data = hashlib.sha256((what + self.noise).encode()).digest() * 40
        path = self.folder / f"IMG_{len(list(self.folder.iterdir())) + 1:04d}.DNG"
        path.write_bytes(data)
        return exposure_of(path)


def created(root: Path, disk) -> Session:
    return Session.create(
        root, plan="p", camera="c", lens="l", config={}, clock=FixedClock(), today=today, disk=disk
    )  # fmt: skip


def opened(folder: Path, **options) -> Session:
    return Session.open(folder, FixedClock(), today=today, **options)


def exposure_of(path: Path) -> ExposedFile:
    data = path.read_bytes()
    return ExposedFile(path, hashlib.sha256(data).hexdigest(), len(data), CameraSettings(0.02, 100), 1.0, 2.0)


@dataclass
class Work:
    """What a run did and was notified of; `stored` are the shots confirmed as kept."""

    root: Path
    camera: Camera
    stored: dict[int, str] = field(default_factory=dict)
    notices: list[str] = field(default_factory=list)

    def go(self, disk) -> Session:
        """From the beginning, or from where the session stands, to the end."""
        session = self._session(disk)
        try:
            self.notices += session.state.notices
            session.acknowledge_notices()
            self.steps(session)
        finally:
            session.close()
        return session

    def steps(self, session: Session) -> None:
        for name, step in (("focus", self._focus), ("shots", self._shots), ("estimate", self._estimate)):
            if name not in session.state.done:
                session.begin_step(name)
                step(session)
                session.finish_step(name)

    def _session(self, disk) -> Session:
        made = [path for path in self.root.glob("[!.]*") if is_session(path)]
        if made:
            return opened(made[0], disk=disk)
        about = {"plan": "test", "camera": "Box", "lens": "50 mm", "config": {"s": 4}}
        return Session.create(self.root, **about, clock=FixedClock(), seed=3, today=today, disk=disk)

    def _take(self, session: Session, step: str, what: str):
        session.expect(step, what)
        exposure = self.camera.expose(what)
        shot = session.adopt(exposure, step=step, purpose=what, snapshot={"axes": {"z_mm": 3.5}})
        self.stored[shot.number] = shot.sha256
        return shot

    def _focus(self, session: Session) -> None:
        session.judge(self._take(session, "focus", "look"), False, "a trial")
        session.learn({"best_mm": 1.25})

    def _shots(self, session: Session) -> None:
        earlier = [shot for shot in session.state.shots if shot.step == "shots"]
        for shot in earlier:
            if shot.counts is None:
                session.judge(shot, True)
        while len(counting := session.state.counting()) < COUNTING:
            session.judge(self._take(session, "shots", f"frame {len(counting)}"), True)

    def _estimate(self, session: Session) -> None:
        shots = session.state.counting()
        folder = session.result_folder()
        data = b"".join(session.original(shot).read_bytes() for shot in shots)
        with ResultFolder(folder) as files:
            files.write("sum.txt", hashlib.sha256(data).hexdigest().encode())
            write_record(files, {"facts": session.state.facts, "input": [shot.sha256 for shot in shots]})
        session.keep_result(step="estimate", shots=[shot.number for shot in shots], verdict="pass")


def result_of(folder: Path) -> dict[str, bytes]:
    """Every file under derived/."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in (folder / "derived").rglob("*") if p.is_file()}
