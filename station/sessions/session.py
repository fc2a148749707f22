"""A session: a folder a person can read, and a journal that loses nothing.

```
2026-03-14-nikon-d90-50mm-pattern/
  session.toml      what was set when it began; never changed again
  journal.jsonl     everything that happened, one line each, chained by hashes; what the session is
  journal.head      how many lines the journal has, and the sum of the last
  originals/        the photographs as the camera wrote them, read-only
  given/1/          a file that an answer named, read-only, where one did
  derived/1/        the first result, derived/2/ the one after a retake
  wire/             every byte that passed between the devices and the program
  SHA256SUMS        `sha256sum --check SHA256SUMS`
```

Whatever the journal says is on the disk before anyone hears of it. A photograph is announced in the journal with its
hash, copied, read back, given a name in originals/ that nothing has, and then confirmed: whoever opens the session
after a crash finishes what was announced and not confirmed.
"""

from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from drivers.clock import Clock
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
    write_errors,
)
from station.common.leftovers import make, release, sweep
from station.common.toml_text import toml_text
from station.sessions.compute_environment import machine
from station.sessions.creation import furnish, settle
from station.sessions.given_files import copied
from station.sessions.journal import Journal, JournalLine
from station.sessions.layout import (
    DERIVED,
    JOURNAL,
    SCHEMA,
    SUMS,
    WIRE,
    Lock,
    check_layout,
    free_original,
    inside,
    own,
    safe_name,
)
from station.sessions.reader import SessionRecord, read_session, sums, verify
from station.sessions.recovery import finish_adopting, recover
from station.sessions.state import DerivedResult, SessionShot, SessionState, after

__all__ = ["DerivedResult", "Session", "SessionShot", "SessionState"]

Today = Callable[[], datetime]


def utc_now() -> datetime:
    """The date and time of the machine."""
    return datetime.now(UTC)


class Session:
    """A session that is open; made by `create` or `open`. Safe from any thread."""

    def __init__(self, record: SessionRecord, clock: Clock, today: Today, disk: Disk, lock: Lock) -> None:
        self.folder = record.folder
        self.config = record.config
        self.clock = clock
        self._today = today
        self._disk = disk
        self._lock = lock
        self._guard = threading.RLock()
        self._journal = Journal(self.folder / JOURNAL, record.contents, disk)
        self._state = record.state
        self._open = True
        self._wires: Path | None = None
        self.leftovers: tuple[Path, ...] = ()  # results that the journal does not speak of: never written over

    @property
    def state(self) -> SessionState:
        """What the journal says now."""
        return self._state

    # --- begin and end -------------------------------------------------------------------------------------------

    @classmethod
    def create(
        cls,
        root: Path,
        *,
        plan: str,
        camera: str,
        lens: str,
        config: Mapping[str, Any],
        clock: Clock,
        seed: int = 0,
        today: Today = utc_now,
        disk: Disk | None = None,
    ) -> Session:
        """A new session in a folder of its own inside `root`: there as a whole, or not at all.

        Parameters
        ----------
        config : what the run was set to, kept in session.toml; the bench's tables, the plan's parameters
        clock : the bench's, by which exposures and wires are timed
        seed : of everything random in it

        Raises
        ------
        NotKept
            If the disk does not take it.
        """
        disk = disk or Disk()
        began = today()
        head = {"schema": SCHEMA, "plan": plan, "camera": camera, "lens": lens, "began": began.isoformat()}
        first = JournalLine(1, began.isoformat(), clock.now_s(), "created", {**head, "seed": seed})
        names = (safe_name(camera, "camera"), safe_name(lens, "lens"), safe_name(plan, "plan"))
        with write_errors(root):
            root.mkdir(parents=True, exist_ok=True)
            sweep(root, ".creating-")
            raw, held = make(".creating-", root, 0o777)
        try:
            furnish(raw, toml_text({**head, "seed": seed, "config": config}).encode(), first, disk)
            folder = settle(raw, f"{began:%Y-%m-%d}-{'-'.join(names)}", disk)
        except BaseException:
            shutil.rmtree(raw, ignore_errors=True)
            raise
        finally:
            release(held)
        return cls.open(folder, clock, today=today, disk=disk)

    @classmethod
    def open(
        cls,
        folder: Path,
        clock: Clock,
        *,
        today: Today = utc_now,
        disk: Disk | None = None,
        without: Collection[int] = (),
    ) -> Session:
        """The session in a folder, as its journal tells it, with everything finished that a crash left half done.

        `state.notices` says what had to be mended and which exposures will have to be repeated.

        Parameters
        ----------
        without : numbers of shots whose photographs are lost for good; they count no more

        Raises
        ------
        BadInput
            If the folder is no session.
        Busy
            If another program has it open.
        Damaged
            If a photograph, the journal or the configuration is not what was written.
        NotKept
            If the disk takes nothing more.
        """
        check_layout(folder)
        lock = Lock(folder)
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
        """Note what passed on the wires, and let other programs in; any number of times."""
        with self._guard:
            if self._open:
                self._open = False
                if self._wires is not None:
                    with suppress(WriteFailed, OSError):  # the disk is full: they are kept, and not checked later
                        self.note("wired", folder=f"{WIRE}/{self._wires.name}", files=hashes_in(self._wires))
                self._journal.close()
                self._lock.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # --- the journal ---------------------------------------------------------------------------------------------

    def note(self, event: str, **data: Any) -> None:
        """Append a line to the journal; it is on the disk when this returns. Raises NotKept."""
        with self._guard:
            line = self._journal.append(event, self._today().isoformat(), self.clock.now_s(), data)
            self._state = after(self._state, line)

    def learn(self, facts: Facts) -> None:
        """Keep facts; nothing is written where they are known already. Raises NotKept."""
        new = {name: fact for name, fact in facts.items() if self.state.facts.get(name) != fact}
        if new:
            self.note("learned", facts=new)

    def forget(self, names: Sequence[str]) -> None:
        """These facts are not known any more; the journal keeps that they were. Raises NotKept."""
        self.note("forgot", names=list(names))

    def give(self, files: Sequence[Path]) -> tuple[str, ...]:
        """Keep copies of files that an answer names; their paths from the session's folder. Raises NotKept, Changed."""
        with self._guard:
            found = copied(self.folder, files, self._disk)
            self.note("given", source=str(files[0].absolute()), files=found)
            self.write_sums()
            return tuple(found)

    def begin_step(self, name: str) -> None:
        """A step begins, or begins anew. Raises NotKept."""
        self.note("step_began", step=name)

    def finish_step(self, name: str) -> None:
        """A step is done. Raises NotKept."""
        self.note("step_ended", step=name)

    def reopen(self, name: str) -> None:
        """This step and those after it are to be done again; their shots stay, but count no more. Raises NotKept."""
        self.note("reopened", step=name)

    def end(self, how: str) -> None:
        """The run ended: "finished", "stopped", "emergency". Raises NotKept."""
        self.note("ended", how=how)

    # --- photographs ---------------------------------------------------------------------------------------------

    def expect(self, step: str, purpose: str) -> int:
        """Before an exposure: should it never come in, whoever resumes is told. Returns the shot's number to be."""
        with self._guard:
            self.note("exposing", step=step, purpose=purpose)
            return self.state.next_number

    def adopt(self, exposure: ExposedFile, *, step: str, purpose: str, snapshot: Mapping[str, Any]) -> SessionShot:
        """Take a photograph in: a read-only copy in originals/ whose bytes were checked, in the journal.

        The file stays where the camera's software put it as well. Where the disk is full, it only stays there; with
        room again, calling this once more for it or opening the session goes on with it.

        Raises
        ------
        Changed
            If the file is not any more what was exposed.
        NotKept
            If the disk does not take it.
        """
        with self._guard:
            pending = self.state.adopting
            if pending is not None and pending.sha256 != exposure.sha256:
                finish_adopting(self, pending)
                pending = None
            if pending is None:
                number = self.state.next_number
                path = free_original(self.folder, number, exposure.path.name, exposure.sha256)
                told = {**asdict(exposure), "path": exposure.path.absolute()}
                file = (path, exposure.sha256, exposure.size_bytes)
                pending = self._announce(SessionShot(number, *file, purpose, step, exposure=told, snapshot=snapshot))
            return self.take_in(pending, exposure.path)

    def _announce(self, shot: SessionShot) -> SessionShot:
        told = asdict(shot)
        names = ("path", "sha256", "size_bytes", "purpose", "step", "exposure", "snapshot")
        self.note("adopting", shot=shot.number, **{name: told[name] for name in names})
        assert self.state.adopting is not None
        return self.state.adopting

    def judge(self, shot: SessionShot, counts: bool, reason: str = "") -> SessionShot:
        """Whether the result is drawn from it. The same photograph never counts twice. Raises NotKept."""
        with self._guard:
            for other in self.state.counting():
                if counts and other.sha256 == shot.sha256 and other.number != shot.number:
                    counts, reason = False, f"it is the photograph of shot {other.number}, bit for bit"
            self.note("judged", shot=shot.number, counts=counts, reason=reason)
            return self.state.shot(shot.number)

    def original(self, shot: SessionShot) -> Path:
        """Where its photograph is. Raises Damaged if it is not there."""
        return inside(self.folder, shot.path)

    def take_in(self, shot: SessionShot, source: Path) -> SessionShot:
        """Copy a photograph that was announced, unless it is there, and confirm it. Raises Changed, NotKept.

        Where something else has got its name meanwhile, it gets another.
        """
        if os.path.lexists(self.folder / shot.path) and not holds(self.folder / shot.path, shot.sha256):
            path = free_original(self.folder, shot.number, source.name, shot.sha256)
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

    # --- results -------------------------------------------------------------------------------------------------

    def result_folder(self) -> Path:
        """Where the next result goes; `keep_result` confirms it. Raises Damaged where a link lies there."""
        names = [Path(one.folder).name for one in self.state.results] + [path.name for path in self.leftovers]
        return own(self.folder / DERIVED / str(max(map(int, names), default=0) + 1))

    def keep_result(self, *, step: str, shots: Sequence[int], verdict: str, **about: Any) -> DerivedResult:
        """Confirm the files in `result_folder()` as the result of a step, drawn from these shots.

        Where the last result still stands and has the same files, it is kept and the new one removed: a step that
        was interrupted after its result is no second result. Where a result that the journal does not speak of has
        the same files, it is the one that is confirmed.

        Raises
        ------
        NotKept
            If the disk does not take it.
        """
        with self._guard:
            folder, standing = self.result_folder(), self.state.standing
            with write_errors(folder):
                files = self._synchronised(folder)
            if standing is not None and (standing.step, standing.files) == (step, files):
                shutil.rmtree(folder)
                return standing
            if (same := self._unconfirmed_with(files)) is not None:
                shutil.rmtree(folder)
                folder = same
            told = {"folder": f"{DERIVED}/{folder.name}", "files": files, "shots": list(shots), "step": step}
            self.note("derived", **told, verdict=verdict, machine=machine(), **about)
            self.write_sums()
            return self.state.results[-1]

    def _unconfirmed_with(self, files: Mapping[str, str]) -> Path | None:
        known = {self.folder / one.folder for one in self.state.results}
        return next((one for one in self.leftovers if one not in known and holds_all(one, files)), None)

    def _synchronised(self, folder: Path) -> dict[str, str]:
        """The hash of every file in a folder, once it is on the disk."""
        for path in files_in(folder):
            self._disk.settle(path)
        for one in (folder, folder.parent):
            self._disk.sync_folder(one)
        return hashes_in(folder)

    def wire_folder(self) -> Path:
        """Where this opening of the session keeps what passes on the wires; made now. Raises NotKept."""
        number = sum(line.event == "opened" for line in self._journal.lines)
        folder = own(self.folder / WIRE / f"{number:03d}")
        with write_errors(folder):
            folder.mkdir(exist_ok=True)
        self._wires = folder
        return folder

    def notice(self, say: str) -> None:
        """Something the operator must hear; `state.notices` holds it until `told`. Raises NotKept."""
        self.note("noticed", say=say)

    def told(self) -> None:
        """The operator has heard all notices. Raises NotKept."""
        if self.state.notices:
            self.note("told")

    def write_sums(self) -> None:
        """The hashes for `sha256sum --check`; where the disk is full they are written the next time."""
        text = sums(self.folder, self.state)
        path = self.folder / SUMS
        try:
            if not path.is_symlink() and path.is_file() and path.read_bytes() == text:
                return
            self._disk.write_whole(path, text)
        except (WriteFailed, OSError):
            return
