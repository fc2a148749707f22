"""An index of a folder of sessions, in SQLite. The sessions are authoritative: the index may be deleted.

A query reflects the present state of the folders: sessions whose journal has changed are read
again, missing ones are removed. An index that is damaged, of another version, or not writable is
replaced, in memory if necessary.
"""

import contextlib
import hashlib
import json
import os
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

from procedures.outcome import ProcedureError
from station.common.durable_files import files_in, holds
from station.common.sanitise import encodable
from station.results.result_files import RECORD
from station.sessions.journal import HEAD
from station.sessions.layout import CONFIG, DERIVED, FOLDERS, JOURNAL
from station.sessions.reader import damaged_results, read_session, sessions_in
from station.sessions.state import SessionState

FILE = ".index.sqlite"
VERSION = 2
LARGEST = 1e300
SCHEMA = f"""
CREATE TABLE cameras (id INTEGER PRIMARY KEY, name TEXT UNIQUE NOT NULL);
CREATE TABLE lenses (id INTEGER PRIMARY KEY, name TEXT UNIQUE NOT NULL);
CREATE TABLE sessions (
    id INTEGER PRIMARY KEY, folder TEXT UNIQUE NOT NULL, stamp TEXT NOT NULL,
    camera INTEGER REFERENCES cameras, lens INTEGER REFERENCES lenses, plan TEXT NOT NULL, began TEXT NOT NULL,
    ended TEXT, shots INTEGER NOT NULL, counting INTEGER NOT NULL, verdict TEXT NOT NULL, damage TEXT NOT NULL
);
CREATE TABLE results (
    session INTEGER NOT NULL REFERENCES sessions ON DELETE CASCADE, plane TEXT NOT NULL, verdict TEXT NOT NULL,
    quantity TEXT NOT NULL, value REAL, unit TEXT NOT NULL, uncertainty REAL, method TEXT NOT NULL, n INTEGER,
    PRIMARY KEY (session, plane, quantity)
);
PRAGMA user_version = {VERSION};
"""
"""The results are those of a session's last result; a refused plane has one row without a quantity."""


@dataclass(frozen=True)
class IndexEntry:
    """A session in a list.

    began : UTC, ISO 8601
    ended : "finished", "stopped", "emergency"; "" if it has not ended
    shots, counting : number of photographs, and of those used by the result
    verdict : of its last result; "" if there is none
    damage : defects of the folder; "" if there are none
    """

    folder: Path
    camera: str
    lens: str
    plan: str
    began: str
    ended: str
    shots: int
    counting: int
    verdict: str
    damage: str

    def record(self) -> dict[str, Any]:
        return {**asdict(self), "folder": str(self.folder)}


@dataclass(frozen=True)
class IndexedNumber:
    """One number of one session's last result."""

    folder: Path
    camera: str
    lens: str
    plan: str
    began: str
    plane: str
    verdict: str
    quantity: str
    value: float
    unit: str
    uncertainty: float


@dataclass(frozen=True)
class Filter:
    """Criteria: camera, lens, plan by exact name, begun on a date or later, verdict; None matches all."""

    camera: str | None = None
    lens: str | None = None
    plan: str | None = None
    since: str | None = None
    verdict: str | None = None


class Index:
    """The index of one folder of sessions, updated on entry."""

    TIMEOUT_S = 5.0
    """How long to wait for another program that is writing it."""

    def __init__(self, root: Path, *, rebuild: bool = False) -> None:
        self.root = root
        self.path = root / FILE
        self._rebuild = rebuild

    def __enter__(self) -> Self:
        if self._rebuild:
            _discard(self.path)
        try:
            self._database = self._opened(str(self.path))
            self.update()
        except sqlite3.DatabaseError as error:
            self._close()
            if _is_damage(error):
                _discard(self.path)
            self._database = self._fresh() if _is_damage(error) else self._opened(":memory:")
            self.update()
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    def sessions(self, wanted: Filter | None = None) -> list[IndexEntry]:
        """The sessions, newest first."""
        clause, values = _where(wanted or Filter())
        rows = self._database.execute(
            "SELECT folder, cameras.name, lenses.name, plan, began, ended, shots, counting, verdict, damage"
            " FROM sessions LEFT JOIN cameras ON cameras.id = camera LEFT JOIN lenses ON lenses.id = lens"
            f" {clause} ORDER BY began DESC, folder DESC",
            values,
        )
        return [IndexEntry(self.root / row[0], row[1] or "", row[2] or "", *row[3:]) for row in rows]

    def measured(self, wanted: Filter | None = None, quantities: Sequence[str] = ()) -> list[IndexedNumber]:
        """The numbers with an uncertainty of the sessions' last results, oldest first; all where none is named."""
        clause, values = _where(wanted or Filter())
        rows = self._database.execute(
            "SELECT folder, cameras.name, lenses.name, plan, began, plane, results.verdict, quantity, value, unit,"
            " uncertainty FROM results JOIN sessions ON sessions.id = session"
            " JOIN cameras ON cameras.id = camera JOIN lenses ON lenses.id = lens"
            f" {clause} {'AND' if clause else 'WHERE'} value IS NOT NULL AND uncertainty > 0"
            " ORDER BY began, folder, plane, quantity",
            values,
        )
        return [IndexedNumber(self.root / row[0], *row[1:]) for row in rows if not quantities or row[7] in quantities]

    def names(self, table: str) -> list[str]:
        """All cameras, or all lenses. Raises KeyError."""
        query = {"cameras": "SELECT name FROM cameras", "lenses": "SELECT name FROM lenses"}[table]
        return sorted(row[0] for row in self._database.execute(query))

    def update(self) -> None:
        """Read every new or changed session; remove missing ones."""
        known = dict(self._database.execute("SELECT folder, stamp FROM sessions"))
        stamps = {
            folder.name: _stamp(folder) for folder in sessions_in(self.root) if folder.name == encodable(folder.name)
        }
        with self._database:
            gone = [(name,) for name in known if name not in stamps]
            self._database.executemany("DELETE FROM sessions WHERE folder = ?", gone)
            for name, stamp in stamps.items():
                if known.get(name) != stamp:
                    self._read(name, stamp)
            self._database.execute("DELETE FROM cameras WHERE id NOT IN (SELECT camera FROM sessions WHERE camera)")
            self._database.execute("DELETE FROM lenses WHERE id NOT IN (SELECT lens FROM sessions WHERE lens)")

    def _read(self, name: str, stamp: str) -> None:
        self._database.execute("DELETE FROM sessions WHERE folder = ?", (name,))
        try:
            record = read_session(self.root / name)
        except Exception as error:  # a damaged session, whatever is in it, must not hide the others
            reason = error.reason if isinstance(error, ProcedureError) else f"it cannot be read: {error!r}"
            self._insert(name, stamp, None, damage=reason)
            return
        wrong = damaged_results(self.root / name, record.state)
        damage = [*record.oddities, *([f"{', '.join(wrong)}: missing or changed"] if wrong else [])]
        self._insert(name, stamp, record.state, damage="; ".join(damage))

    def _insert(self, name: str, stamp: str, state: SessionState | None, damage: str = "") -> None:
        if state is None:
            row: tuple[Any, ...] = (name, stamp, None, None, "", "", "", 0, 0, "", encodable(damage))
        else:
            camera, lens = self._name("cameras", state.camera), self._name("lenses", state.lens)
            counting = len(state.results[-1].shots) if state.results else len(state.counting())
            verdict = state.results[-1].verdict if state.results else ""
            began = encodable(state.began).replace("Z", "+00:00")  # sortable; journals are written in UTC
            about = (encodable(state.plan), began, state.ended or "", len(state.shots), counting, verdict)
            row = (name, stamp, camera, lens, *about, encodable(damage))
        session = self._database.execute(f"INSERT INTO sessions VALUES (NULL, {', '.join('?' * 11)})", row).lastrowid
        if state is not None:
            rows = [(session, *row) for row in _numbers(self.root / name, state)]
            self._database.executemany(f"INSERT OR REPLACE INTO results VALUES ({', '.join('?' * 9)})", rows)

    def _name(self, table: str, name: str) -> int:
        text = encodable(name)
        self._database.execute(f"INSERT OR IGNORE INTO {table} (name) VALUES (?)", (text,))
        number: int = self._database.execute(f"SELECT id FROM {table} WHERE name = ?", (text,)).fetchone()[0]
        return number

    def _opened(self, where: str) -> sqlite3.Connection:
        """The database, with its tables. Raises sqlite3.DatabaseError."""
        database = sqlite3.connect(where, timeout=self.TIMEOUT_S)
        self._database = database
        database.execute("PRAGMA foreign_keys = ON")
        if where != ":memory:":
            database.execute("PRAGMA journal_mode = WAL")
        if database.execute("PRAGMA quick_check(1)").fetchone()[0] != "ok":
            raise sqlite3.DatabaseError("the index is damaged")
        version = database.execute("PRAGMA user_version").fetchone()[0]
        if version == 0:
            database.executescript(f"BEGIN; {SCHEMA} COMMIT;")
        elif version != VERSION:
            raise sqlite3.DatabaseError(f"index of version {version}")
        return database

    def _fresh(self) -> sqlite3.Connection:
        """A new index in place of the old one, in memory if it cannot be written."""
        try:
            return self._opened(str(self.path))
        except sqlite3.DatabaseError:
            self._close()
            return self._opened(":memory:")

    def _close(self) -> None:
        if hasattr(self, "_database"):
            self._database.close()


def _is_damage(error: sqlite3.DatabaseError) -> bool:
    """Whether the file is corrupt, rather than busy or in a folder that is not writable."""
    code = getattr(error, "sqlite_errorcode", None)
    return code is None or code & 0xFF in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_ERROR)


def _discard(path: Path) -> None:
    for name in (path.name, f"{path.name}-wal", f"{path.name}-shm"):
        with contextlib.suppress(OSError):  # if it cannot be removed, an index in memory is used
            path.with_name(name).unlink(missing_ok=True)


def _stamp(folder: Path) -> str:
    """Changes with configuration, journal, its head and files of results, and if a folder is missing."""
    files = [folder / name for name in (CONFIG, JOURNAL, HEAD, *FOLDERS)] + files_in(folder / DERIVED)
    facts = [(path.name, stat.st_size, stat.st_mtime_ns) for path in files if (stat := _stat(path))]
    return hashlib.sha256(repr(facts).encode()).hexdigest()


def _stat(path: Path) -> os.stat_result | None:
    try:
        return path.lstat()
    except OSError:
        return None


def _where(wanted: Filter) -> tuple[str, list[str]]:
    conditions = {
        "cameras.name =": wanted.camera,
        "lenses.name =": wanted.lens,
        "plan =": wanted.plan,
        "began >=": wanted.since,
        "sessions.verdict =": wanted.verdict,
    }
    given = {column: value for column, value in conditions.items() if value is not None}
    return ("WHERE " + " AND ".join(f"{column} ?" for column in given) if given else ""), list(given.values())


def _numbers(folder: Path, state: SessionState) -> Iterator[tuple[Any, ...]]:
    """Plane, verdict, and each quantity of the last result, if its record matches the journal."""
    last = state.results[-1] if state.results else None
    path = folder / last.folder / RECORD if last else folder
    if last is None or not holds(path, last.files.get(RECORD, "")):
        return
    try:
        planes = json.loads(path.read_bytes())["planes"]
        for plane, entry in planes.items():
            yield from _rows(encodable(str(plane)), entry)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) and abs(value) < LARGEST else None


def _rows(plane: str, entry: Mapping[str, Any]) -> Iterator[tuple[Any, ...]]:
    verdict = encodable(str(entry["verdict"]))
    quantities = {name: part for name, part in entry.items() if isinstance(part, dict) and "uncertainty" in part}
    for name, part in quantities.items():
        unit, method = (encodable(str(part.get(key, ""))) for key in ("unit", "method"))
        value, uncertainty, n = (_number(part.get(key)) for key in ("value", "uncertainty", "n"))
        yield plane, verdict, encodable(name), value, unit, uncertainty, method, n
    if not quantities:
        yield (plane, verdict, "", None, "", None, "", None)
