"""Workspace of a front end: the bench, the sessions of a folder, and runs. Importing this module is fast: numpy is
loaded by the first method that needs it, which a front end calls from a thread after its first paint."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from procedures.outcome import BadParameter, ProcedureError
from station.common.durable_files import temporary_folder

if TYPE_CHECKING:
    from station.bench.opening import Bench, DeviceRow
    from station.guide.frontend import Frontend
    from station.guide.run import Run
    from station.sessions.session import Session


MAX_DIFFERENCES = 3


@dataclass(frozen=True)
class SessionSummary:
    """Summary of a session from its journal."""

    folder: Path
    plan: str
    camera: str
    lens: str
    began: str
    done: tuple[str, ...]
    ended: str | None


@dataclass(frozen=True)
class OpenedBench:
    """The opened bench, None where none is configured, and the answer of each device."""

    bench: Bench | None
    rows: Sequence[DeviceRow] = ()


class StationLab:
    """Bench and sessions: of a station.toml, simulated, or by hand; all but `emergency_stop` block. `names` are
    proposed for a new session."""

    def __init__(
        self,
        *,
        sessions: Path,
        config: Path | None,
        simulate: bool = False,
        seed: int = 0,
        specification: Path | None = None,
        unit: str | None = None,
        shaker: bool = False,
        speed: float = 1.0,
    ) -> None:
        self.sessions = sessions
        self._shaker, self._speed = shaker, speed
        self.names = ("simulated camera", "simulated lens") if simulate else ("camera", "lens")
        self._config, self._simulate, self._seed = config, simulate, seed
        self._specification, self._unit = specification, unit
        self._tables: Mapping[str, Any] = {}
        self._opening = threading.Lock()
        self._bench: Bench | None = None
        self._opened: OpenedBench | None = None
        self._session: Session | None = None
        self._running: Run | None = None
        self._scratch = contextlib.ExitStack()

    def open(self) -> OpenedBench:
        """The bench, with the devices that answer; opened by the first call. Raises DeviceError."""
        with self._opening:
            if self._opened is None:
                self._bench = self._make_bench()
                self._opened = OpenedBench(self._bench, self._bench.rows() if self._bench is not None else ())
            return self._opened

    def _make_bench(self) -> Bench | None:
        from station.bench.opening import make_bench, simulated_bench

        if self._simulate:
            folder = self._scratch.enter_context(temporary_folder())
            virtual = self.virtual_time
            return simulated_bench(
                folder, seed=self._seed, virtual_time=virtual, shaker=self._shaker, speed=self._speed
            )
        tables = self._read_tables()
        return make_bench(tables, folder=self._config.resolve().parent) if self._config and tables else None

    def _read_tables(self) -> Mapping[str, Any]:
        """The devices' tables of the configuration, read once; none of the simulated bench."""
        if self._config is not None and not self._simulate and not self._tables:
            from station.bench.opening import read_config

            self._tables = read_config(self._config)
        return self._tables

    virtual_time = False
    """Whether the simulated bench's time jumps while it is waited for: for tests."""

    def plans(self) -> Mapping[str, str]:
        """The titles of the plans, by name."""
        from station.guide.catalogue import entries

        return {name: entry.title for name, entry in entries().items()}

    def kept(self) -> Sequence[SessionSummary]:
        """The sessions whose journals can be read, newest first."""
        return kept_in(self.sessions)

    def begin(self, plan: str, camera: str, lens: str, operator: Frontend) -> Run:
        """A run of a new session. Raises ProcedureError."""
        from drivers.errors import SystemClock
        from station.sessions.session import Session

        bench = self.open().bench
        clock = bench.clock if bench is not None else SystemClock()
        self._one_run()
        self._fit_shaker(self._shaker)
        settings = self._settings(bench)
        session = Session.create(
            self.sessions, plan=plan, camera=camera, lens=lens, config=settings, clock=clock, seed=self._seed
        )
        return self._run(session, operator)

    def resume(
        self, folder: Path, operator: Frontend, *, back_to: str | None = None, without: Collection[int] = ()
    ) -> Run:
        """Run a session from `back_to` or where it stopped, `without` shots whose photographs are lost. Raises
        ProcedureError."""
        from drivers.errors import SystemClock
        from station.sessions.session import Session

        self._check_bench(folder)  # before any device is connected
        bench = self.open().bench
        self._one_run()
        self._leave_session(going_on=folder)
        session = Session.open(folder, bench.clock if bench is not None else SystemClock(), without=without)
        if back_to is not None:
            session.reopen(back_to)
        self._fit_shaker("shaker" in session.config.get("config", {}).get("drivers", {}))
        return self._run(session, operator)

    def _check_bench(self, folder: Path) -> None:
        """Raises BadParameter where the session began on another bench."""
        from station.bench.device_models import bench_differences
        from station.sessions.layout import read_config

        config = read_config(folder)[0].get("config", {})
        began, simulated, file = (config.get(key) for key in ("devices", "simulate", "file"))
        if simulated is not None and bool(simulated) != self._simulate:
            raise BadParameter(
                f"a session must go on with the bench on which it began, a {'simulated' if simulated else 'real'} one; "
                f"got a {'simulated' if self._simulate else 'real'} one",
                "resume it with --simulate" if simulated else "resume it without --simulate",
            )
        if isinstance(began, Mapping) and (differences := bench_differences(began, self._read_tables())):
            remedy = f"give --config {file}" if file else "resume it with the configuration with which it began, if any"
            raise BadParameter(
                f"a session must go on with the bench on which it began; {self._config or 'no configuration'} has "
                f"another: {'; '.join(differences[:MAX_DIFFERENCES])}",
                f"{remedy}, or begin a new session",
            )

    def _fit_shaker(self, wanted: bool) -> None:
        """Equip the simulated bench with a shaker as at the session's begin; real ones are set in station.toml."""
        if self._simulate and self._bench is not None:
            from station.bench.opening import fit_shaker

            fit_shaker(self._bench, wanted=wanted)

    def _settings(self, bench: Bench | None) -> dict[str, Any]:
        """Settings frozen in a session: the bench's configuration, the unit of its results and the specification."""
        drivers = dict(bench.drivers) if bench is not None else {}
        file = None if self._config is None or self._simulate else str(self._config.resolve())
        settings = {"simulate": self._simulate, "file": file, "drivers": drivers, "devices": self._tables}
        from station.sessions.state import KEY, UNIT, frozen

        unit = {} if self._unit is None else {UNIT: self._unit}
        return {**settings, **unit, **({} if self._specification is None else {KEY: frozen(self._specification)})}

    def _run(self, session: Session, operator: Frontend) -> Run:
        from station.guide.catalogue import plan_named
        from station.guide.run import Run

        self._leave_session()
        self._session = session
        self._running = Run(plan_named(session.state.plan, session.folder), self.open().bench, session, operator)
        return self._running

    def _leave_session(self, going_on: Path | None = None) -> None:
        """Close the session; one without answers and photographs is deleted, unless it is being resumed."""
        if self._session is None:
            return
        from station.sessions.reader import delete_session

        session, self._session = self._session, None
        session.close()
        if session.state.empty and session.folder != going_on:
            with suppress(ProcedureError, OSError):  # it can be deleted later
                delete_session(session.folder)

    def _one_run(self) -> None:
        """Raises BadParameter while a run uses the bench."""
        if self._running is not None and not self._running.over.is_set():
            raise BadParameter("the bench is in use by another run", "end that run first")

    def emergency_stop(self) -> None:
        """Stop every device; one that is still being opened does not move yet."""
        if self._bench is not None:
            self._bench.emergency_stop()

    @property
    def has_run(self) -> bool:
        """Whether a run has begun."""
        return self._running is not None

    def stop_run(self) -> None:
        """Stop every device, and end the last run, if any."""
        if self._running is not None:
            self._running.stop_now()
        else:
            self.emergency_stop()

    def ask_run_to_stop(self) -> None:
        """End the last run after its current action; without a run, end the program."""
        if self._running is None:
            raise KeyboardInterrupt
        self._running.ask_to_stop()

    def close(self) -> None:
        """Close bench and session: the lamp goes out before the disk is awaited."""
        if self._bench is not None:
            self._bench.close()
        self._leave_session()
        self._scratch.close()


def kept_in(root: Path) -> Sequence[SessionSummary]:
    """The readable sessions of a folder, newest first."""
    from station.sessions.reader import read_session

    sessions = []
    for folder in sorted(root.glob("*/")) if root.is_dir() else ():
        try:
            one = read_session(folder).state
        except (ProcedureError, OSError):
            continue  # `station session list` reports the reason
        sessions.append(SessionSummary(folder, one.plan, one.camera, one.lens, one.began, one.done, one.ended))
    return sorted(sessions, key=lambda one: one.began, reverse=True)
