"""A session: a human-readable folder and an append-only journal.

```
2026-03-14-nikon-d90-50mm-pattern/
  session.toml      the configuration at its beginning; never changed
  journal.jsonl     everything that happened, one line each, chained by hashes; the authoritative record
  journal.head      number of lines of the journal, and the sum of the last
  originals/        the photographs as the camera wrote them, read-only
  given/1/          a file referred to by an answer, read-only, if there was one
  derived/1/        the first result, derived/2/ the one after a retake
  wire/             transcripts of all devices
  SHA256SUMS        `sha256sum --check SHA256SUMS`
```

A journal entry is on the disk before it is confirmed. A photograph is announced in the journal with its
hash, copied, read back, given an unused name in originals/, and then confirmed: opening the session
after a crash completes what was announced and not confirmed.
"""

import os
import shutil
import threading
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from datetime import UTC, datetime
from itertools import chain, count
from pathlib import Path
from typing import Any, Self

from drivers.errors import Clock
from drivers.interfaces import ExposedFile
from procedures.plan import Facts
from station.common.durable_files import (
    READ_ONLY,
    Disk,
    WriteFailed,
    files_in,
    hashes_in,
    holds,
    holds_all,
    make,
    release,
    sweep,
    write_errors,
)
from station.common.toml_text import toml_text
from station.sessions import layout
from station.sessions.journal import Contents, Journal, JournalLine, machine
from station.sessions.reader import SessionRecord, finish_adopting, read_session, recover, sums, verify
from station.sessions.state import DerivedResult, SessionShot, SessionState, after

__all__ = ["DerivedResult", "Session", "SessionShot", "SessionState"]

Today = Callable[[], datetime]


def utc_now() -> datetime:
    """The machine's date and time."""
    return datetime.now(UTC)


class Session:
    """An open session; made by `create` or `open`. Thread-safe."""

    def __init__(self, record: SessionRecord, clock: Clock, today: Today, disk: Disk, lock: layout.Lock) -> None:
        self.folder = record.folder
        self.config = record.config
        self.clock = clock
        self._today = today
        self._disk = disk
        self._lock = lock
        self._guard = threading.RLock()
        self._journal = Journal(self.folder / layout.JOURNAL, record.contents, disk)
        self._state = record.state
        self._open = True
        self._wires: Path | None = None
        self.leftovers: tuple[Path, ...] = ()  # results that are not in the journal: never overwritten

    @property
    def state(self) -> SessionState:
        """The state according to the journal."""
        return self._state

    @classmethod
    def create(
        cls, root: Path, *, plan: str, camera: str, lens: str, config: Mapping[str, Any], clock: Clock, seed: int = 0,
        today: Today = utc_now, disk: Disk | None = None,
    ) -> "Session":  # fmt: skip
        """Create a session in a new folder inside `root`, atomically. Raises WriteFailed.

        config : configuration of the run, stored in session.toml: the bench's tables, the plan's parameters
        clock : the bench's, for the times of exposures and transcripts
        seed : of all random numbers in it
        """
        disk = disk or Disk()
        began = today()
        head = {"schema": layout.SCHEMA, "plan": plan, "camera": camera, "lens": lens, "began": began.isoformat()}
        first = JournalLine(1, began.isoformat(), clock.now_s(), "created", {**head, "seed": seed})
        names = (layout.safe_name(camera, "camera"), layout.safe_name(lens, "lens"), layout.safe_name(plan, "plan"))
        with write_errors(root):
            root.mkdir(parents=True, exist_ok=True)
            sweep(root, ".creating-")
            raw, lock = make(".creating-", root, 0o777)
        try:
            furnish(raw, toml_text({**head, "seed": seed, "config": config}).encode(), first, disk)
            folder = settle(raw, f"{began:%Y-%m-%d}-{'-'.join(names)}", disk)
        except BaseException:
            shutil.rmtree(raw, ignore_errors=True)
            raise
        finally:
            release(lock)
        return cls.open(folder, clock, today=today, disk=disk)

    @classmethod
    def open(
        cls, folder: Path, clock: Clock, *, today: Today = utc_now, disk: Disk | None = None,
        without: Collection[int] = (),
    ) -> "Session":  # fmt: skip
        """Open the session in a folder, and complete everything that a crash interrupted.

        `state.notices` lists what was repaired and which exposures must be repeated.

        Raises BadInput if the folder is not a session; Busy if another program has it open; Damaged if a photograph,
        the journal or the configuration is damaged; WriteFailed if the disk refuses.

        without : numbers of shots whose photographs are permanently lost; they no longer count.
        """
        layout.check_layout(folder)
        lock = layout.Lock(folder)
        try:
            record = read_session(folder)
            session = cls(record, clock, today, disk or Disk(), lock)
        except BaseException:
            lock.release()
            raise
        try:
            verify(folder, session.state, without)
            recover(session, record, without)
        except BaseException:
            session.close()
            raise
        return session

    def close(self) -> None:
        """Record the hashes of the transcripts, and release the session; any number of times."""
        with self._guard:
            if self._open:
                self._open = False
                if self._wires is not None:
                    with suppress(WriteFailed, OSError):  # the disk is full: the files stay, but are not verified later
                        self.note("wired", folder=f"{layout.WIRE}/{self._wires.name}", files=hashes_in(self._wires))
                self._journal.close()
                self._lock.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def note(self, event: str, **data: Any) -> None:
        """Append a line to the journal; it is on the disk when this returns. Raises WriteFailed."""
        with self._guard:
            line = self._journal.append(event, self._today().isoformat(), self.clock.now_s(), data)
            self._state = after(self._state, line)

    def learn(self, facts: Facts) -> None:
        """Record facts; nothing is written if they are known already. Raises WriteFailed."""
        new = {name: fact for name, fact in facts.items() if self.state.facts.get(name) != fact}
        if new:
            self.note("learned", facts=new)

    def forget(self, names: Sequence[str]) -> None:
        """Revoke these facts; the journal keeps their history. Raises WriteFailed."""
        self.note("forgot", names=list(names))

    def give(self, files: Sequence[Path]) -> tuple[str, ...]:
        """Keep copies of files referred to by an answer; returns their paths. Raises WriteFailed, ContentChanged."""
        with self._guard:
            hashes = layout.copied(self.folder, files, self._disk)
            self.note("given", source=str(files[0].absolute()), files=hashes)
            self.write_sums()
            return tuple(hashes)

    def begin_step(self, name: str) -> None:
        """Begin a step, possibly again. Raises WriteFailed."""
        self.note("step_began", step=name)

    def finish_step(self, name: str) -> None:
        """Finish a step. Raises WriteFailed."""
        self.note("step_ended", step=name)

    def reopen(self, name: str) -> None:
        """Schedule this step and later ones again; their shots stay, but no longer count. Raises WriteFailed."""
        self.note("reopened", step=name)

    def end(self, how: str) -> None:
        """Record the end of the run: "finished", "stopped", "emergency". Raises WriteFailed."""
        self.note("ended", how=how)

    def expect(self, step: str, purpose: str) -> int:
        """Announce an exposure, so that a missing one is reported on resuming. Returns the future shot's number."""
        with self._guard:
            self.note("exposing", step=step, purpose=purpose)
            return self.state.next_number

    def adopt(self, exposure: ExposedFile, *, step: str, purpose: str, snapshot: Mapping[str, Any]) -> SessionShot:
        """Adopt a photograph: a verified read-only copy in originals/, recorded in the journal.

        The file also stays where the camera's software put it. On a full disk it stays only there; once there is room,
        calling this again for it, or opening the session, continues. Raises ContentChanged if the file has changed
        since its exposure; WriteFailed if the disk refuses.
        """
        with self._guard:
            pending = self.state.adopting
            if pending is not None and pending.sha256 != exposure.sha256:
                finish_adopting(self, pending)
                pending = None
            if pending is None:
                number = self.state.next_number
                path = layout.free_original(self.folder, number, exposure.path.name, exposure.sha256)
                record = {**asdict(exposure), "path": exposure.path.absolute()}
                file = (path, exposure.sha256, exposure.size_bytes)
                pending = self._announce(SessionShot(number, *file, purpose, step, exposure=record, snapshot=snapshot))
            return self.take_in(pending, exposure.path)

    def _announce(self, shot: SessionShot) -> SessionShot:
        fields = asdict(shot)
        names = ("path", "sha256", "size_bytes", "purpose", "step", "exposure", "snapshot")
        self.note("adopting", shot=shot.number, **{name: fields[name] for name in names})
        assert self.state.adopting is not None
        return self.state.adopting

    def judge(self, shot: SessionShot, counts: bool, reason: str = "") -> SessionShot:
        """Decide whether the result uses this shot. The same photograph never counts twice. Raises WriteFailed."""
        with self._guard:
            for other in self.state.counting():
                if counts and other.sha256 == shot.sha256 and other.number != shot.number:
                    counts, reason = False, f"it is the photograph of shot {other.number}, bit for bit"
            self.note("judged", shot=shot.number, counts=counts, reason=reason)
            return self.state.shot(shot.number)

    def original(self, shot: SessionShot) -> Path:
        """The path of its photograph. Raises Damaged if it is missing."""
        return layout.inside(self.folder, shot.path)

    def take_in(self, shot: SessionShot, source: Path) -> SessionShot:
        """Copy an announced photograph, under a free name, and confirm it. Raises ContentChanged, WriteFailed."""
        if os.path.lexists(self.folder / shot.path) and not holds(self.folder / shot.path, shot.sha256):
            path = layout.free_original(self.folder, shot.number, source.name, shot.sha256)
            shot = self._announce(replace(shot, path=path))
        target = self.folder / shot.path
        if holds(target, shot.sha256):
            with write_errors(target):
                target.chmod(target.stat().st_mode & READ_ONLY)
                self._disk.settle(target)
        else:
            self._disk.copy(source, target, shot.sha256)
        self.note("adopted", shot=shot.number)
        self.write_sums()
        return self.state.shot(shot.number)

    def result_folder(self) -> Path:
        """The folder of the next result; `keep_result` confirms it. Raises Damaged if it is a link."""
        names = [Path(result.folder).name for result in self.state.results] + [path.name for path in self.leftovers]
        return layout.own(self.folder / layout.DERIVED / str(max(map(int, names), default=0) + 1))

    def keep_result(self, *, step: str, shots: Sequence[int], verdict: str, **about: Any) -> DerivedResult:
        """Confirm the files in `result_folder()` as the result of a step, computed from these shots.

        If the last result still stands and has the same files, it is kept and the new one removed: a step that was
        interrupted after its result yields no second one. If a result that is not in the journal has the same files,
        that one is confirmed. Raises WriteFailed.
        """
        with self._guard:
            folder, standing = self.result_folder(), self.state.standing
            with write_errors(folder):
                for path in files_in(folder):
                    self._disk.settle(path)
                for each in (folder, folder.parent):
                    self._disk.sync_folder(each)
                files = hashes_in(folder)
            if standing is not None and (standing.step, standing.files) == (step, files):
                shutil.rmtree(folder)
                return standing
            known = {self.folder / result.folder for result in self.state.results}
            if same := next((path for path in self.leftovers if path not in known and holds_all(path, files)), None):
                shutil.rmtree(folder)
                folder = same
            about_files = {
                "folder": f"{layout.DERIVED}/{folder.name}",
                "files": files,
                "shots": list(shots),
                "step": step,
            }
            self.note("derived", **about_files, verdict=verdict, machine=machine(), **about)
            self.write_sums()
            return self.state.results[-1]

    def wire_folder(self) -> Path:
        """Create the folder of this opening's transcripts. Raises WriteFailed."""
        number = sum(line.event == "opened" for line in self._journal.lines)
        folder = layout.own(self.folder / layout.WIRE / f"{number:03d}")
        with write_errors(folder):
            folder.mkdir(exist_ok=True)
        self._wires = folder
        return folder

    def notice(self, say: str) -> None:
        """Record a message for the operator, kept in `state.notices` until acknowledged. Raises WriteFailed."""
        self.note("noticed", say=say)

    def acknowledge_notices(self) -> None:
        """Record that the operator has seen all notices. Raises WriteFailed."""
        if self.state.notices:
            self.note("acknowledged")

    def write_sums(self) -> None:
        """Write the hashes for `sha256sum --check`; postponed if the disk is full."""
        text = sums(self.folder, self.state)
        path = self.folder / layout.SUMS
        try:
            if not path.is_symlink() and path.is_file() and path.read_bytes() == text:
                return
            self._disk.write_whole(path, text)
        except (WriteFailed, OSError):
            return


def furnish(folder: Path, config: bytes, first: JournalLine, disk: Disk) -> None:
    """Write everything that a session needs, durably."""
    for name in layout.FOLDERS:
        with write_errors(folder / name):
            (folder / name).mkdir()
    for name, data in ((layout.CONFIG, config), (layout.JOURNAL, b"")):
        disk.write_whole(folder / name, data)
    _, first_sum = layout.read_config(folder)
    journal = Journal(folder / layout.JOURNAL, Contents((), first_sum, 0), disk)
    try:
        journal.append(first.event, first.at, first.clock_s, first.data)
    finally:
        journal.close()


def settle(raw: Path, name: str, disk: Disk) -> Path:
    """Rename the folder to its name, with a number if that is taken."""
    names = chain([name], (f"{name}-{number}" for number in count(2)))
    folder = next(path for path in map(raw.with_name, names) if not os.path.lexists(path))
    with write_errors(folder):
        disk.replace(raw, folder)
        disk.sync_folder(folder.parent)
    return folder
