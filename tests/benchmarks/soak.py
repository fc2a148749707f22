"""Random operation with photographs while the lines and the camera fail: positions, photographs, leaks.

    python -m tests.benchmarks.soak [--seeds 4] [--first 0] [--operations 500] [--firmware grbl.elf --box grbl_box]

Half of the operations are those of `station conform`; the others are guided runs that home, move, and take a series of
photographs into a session, under one random fault of a line or of the camera, some of them ended by a stop, an
emergency stop, or an exception of the front end. Every photograph carries the number of its exposure and where the axes
truly were. After each operation:

- nothing moves, and no position is wrong that the driver vouches for;
- each photograph in the session is that of the exposure which was requested for it, with the right axes and times;
- no exposure is missing without a reported problem or a stop, and its file is where the camera put it;
- no contact stays closed; threads and file descriptors are those of the beginning.

With `--firmware` the stage is GRBL's own program in simavr (see tests/conformance/grbl_transcript.py), else the twin.
"""

import hashlib
import json
import os
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import DeviceError
from procedures.outcome import Outcome, Verdict
from procedures.plan import Advice, Go, Home, Plan, Shoot, Step
from simulators.bench.bench import Setup, SimulatedBench
from simulators.bench.body import Opening
from simulators.devices.serial_device import Cable, Faults, plug, unplug
from station.bench import conform
from station.bench.conform import FAULTS, Broken, StageRig, disturb, require
from station.bench.opening import Bench, make_bench, simulated_tables
from station.guide.frontend import ProblemEvent
from station.guide.run import Run
from station.guide.scripted import ScriptedOperator
from station.guide.vibration import SettlingTimeouts
from station.sessions.session import Session
from tests.benchmarks import options, processor_s
from tests.conformance.grbl_firmware import FirmwareInSimavr
from tests.station.guide.benches import frame_bytes

PHOTOGRAPHS = 3
LINE_FAULTS = (*FAULTS, "clogged")
CAMERA_FAULTS = ("lose_frames", "half_frames")
ENDS = ("", "", "stop", "emergency stop", "exception")
CLOCK_S = 1e-5
"""Rounding of the times to microseconds, in several places."""
MARK = b"\nexposure "
DEVICES = ("stage", "shutter", "camera")
SWITCH_MM = 10.0
"""From where the machine in simavr begins to its switches, which are the zero of its machine space."""
QUICK = ("$120=400", "$121=400", "$130=25", "$131=25", "$132=25")
"""A short travel; at twice the feed simavr misses steps."""
LETTERS = (("z_mm", "X"), ("x_mm", "Y"))


class FirmwareRig(StageRig):
    """The stage of a machine in simavr, where it stands counted at the pins."""

    def truth(self) -> dict[str, float]:
        """Where the axes are."""
        firmware: FirmwareInSimavr = self.cable.device  # type: ignore[union-attr, assignment]
        places: list[tuple[float, ...]] = []
        self.cable.happen(lambda now_s: places.append(firmware.places(now_s)))  # type: ignore[union-attr]
        envelopes = self.stage.envelopes  # type: ignore[attr-defined]
        there = zip(LETTERS, places[0], strict=False)
        return {name: envelopes[name].to_user(place - SWITCH_MM) for (name, _), place in there}

    def moves(self) -> bool:
        """Whether a step comes within a while in which the slowest motion makes some."""
        before = self.truth()
        self.clock.sleep(0.03)
        return self.truth() != before


@dataclass
class Soak:
    """A bench under soak, with what its exposures were."""

    bench: Bench
    world: SimulatedBench
    rig: StageRig
    folder: Path
    rng: np.random.Generator
    openings: dict[int, Opening] = field(default_factory=dict)
    taken: dict[int, str] = field(default_factory=dict)
    """The session of each exposure that has come to one."""
    counts: Counter[str] = field(default_factory=Counter)
    base: tuple[int, int] | None = None
    where: str = ""
    at_contact: dict[str, float] = field(default_factory=dict)

    @property
    def clock(self) -> Any:
        """The bench's clock."""
        return self.bench.clock

    def develop(self, picture: bytes, opening: Opening) -> bytes:
        """A RAW file with the number of its exposure and the true axes at its end."""
        self.openings[opening.number] = opening
        return picture + MARK + json.dumps({"number": opening.number, "axes": self.at_contact}).encode()

    def watch_contact(self) -> None:
        """Keep where the axes are when the contact closes."""
        close = self.world.body.close

        def closing(now_s: float) -> None:
            self.at_contact = dict(self.rig.truth())
            close(now_s)

        self.world.body.close = closing  # type: ignore[method-assign]

    def cut_power(self, now_s: float) -> None:
        """Switch the stage off and on again."""
        device: Any = self.world.cables["stage"].device
        device.restart(now_s)

    # --- one operation

    def operate(self, n: int) -> None:
        """One operation, and all that must hold after it. Raises Broken."""
        if self.rng.random() < 0.5:
            fault = str(self.rng.choice(FAULTS))
            self.counts[f"stage: {fault}"] += 1
            self.where = f"stage under {fault}"
            conform.operate(self.rig, self.rng, fault)
        else:
            self.run(n)
        try:
            self.make_ready()
            self.check_leaks()
        except Broken as broken:
            raise Broken(f"after {self.where}: {broken}") from broken

    def run(self, n: int) -> None:
        """A guided run under a fault, ended in some way."""
        fault, cable, end = self._disturb(), str(self.rng.choice(("stage", "shutter"))), str(self.rng.choice(ENDS))
        self.where = where = f"run under {fault} at the {cable}, end: {end or 'its own'}"
        self.counts[f"run: {fault}"] += 1
        self.counts[f"end: {end or 'its own'}"] += 1
        works: list[Callable[[], object]] = []
        if fault == "clogged":
            begin_s = self.clock.now_s() + self.rng.uniform(0.0, 20.0)
            self.world.cables[cable].faults = Faults(clogged=((begin_s, begin_s + self.rng.uniform(0.5, 5.0)),))
        elif fault in FAULTS:
            disturb(self.world.cables[cable], fault, self.clock.now_s() + self.rng.uniform(0.0, 15.0), self.rng)
            if fault == "reset":
                restart = self.world.devices["shutter"].restart if cable == "shutter" else self.cut_power
                works.append(
                    self.rig.later(
                        self.rng.uniform(0.0, 20.0),
                        partial(self.world.cables[cable].happen, restart),  # type: ignore[arg-type]
                    )
                )
        before, sessions = len(self.world.body.openings), self.folder / "sessions"
        operator = ScriptedOperator(
            {"trouble": lambda ask: str(self.rng.choice(["try again", "try again", "try again", "skip", "stop"]))},
            patience=8,
        )
        if end == "exception":
            operator.listen = partial(_fail_at, operator, int(self.rng.integers(3, 14)))
        with Session.create(
            sessions, plan="soak", camera="C", lens="L", config={}, clock=self.clock, seed=n
        ) as session:
            run = Run(self._plan(), self.bench, session, operator, SettlingTimeouts(quiet=1.0))
            works.insert(0, run.go)
            if "stop" in end:
                stop = run.stop_now if end == "emergency stop" else run.ask_to_stop
                works.append(self.rig.later(self.rng.uniform(0.0, 25.0), stop))
            (outcome, *_) = self.rig.together(*works)
            folder, shots = session.folder, session.state.shots
        failed = isinstance(outcome, FrontEndFailed)
        if isinstance(outcome, Exception) and not failed:
            raise Broken(f"{where}: {outcome!r}")
        self.counts["photographs"] += len(shots)
        self._check_shots(where, folder, shots)
        new = [opening.number for opening in self.world.body.openings[before:]]
        missing = [number for number in new if number not in self.taken]
        problems = sum(isinstance(event, ProblemEvent) for event in operator.heard)
        ended_early = failed or getattr(outcome, "how", "") != "finished"
        allowed = problems + ended_early
        require(len(missing) <= allowed, f"{where}: {missing} of {new} are in no session, {problems} problems reported")
        self.counts["exposures without a photograph"] += len(missing)

    def _disturb(self) -> str:
        """A fault; one of the camera is prepared."""
        fault = str(self.rng.choice((*LINE_FAULTS, *CAMERA_FAULTS)))
        if fault in CAMERA_FAULTS:
            body = self.world.body
            coming = frozenset({len(body.openings) + int(self.rng.integers(1, PHOTOGRAPHS + 1))})
            setattr(body.settings, fault, getattr(body.settings, fault) | coming)
        return fault

    def _plan(self) -> Plan:
        """Home, go somewhere, take a series."""
        share = self.rng.random(2)
        place = dict(zip(self.rig.stage.travel(), share, strict=False))
        travels = self.rig.stage.travel()
        places = {name: travels[name].low + part * (travels[name].high - travels[name].low)
                  for name, part in place.items()}  # fmt: skip
        shoot = Shoot(
            "shot",
            lambda frame, facts: Advice(True, "good"),
            lambda frame, facts, results, known: {name: Outcome(None, Verdict.PASS) for name in frame.planes},
            lambda results, facts: Advice(len(results) >= PHOTOGRAPHS, f"{len(results)} shots"),
            most=PHOTOGRAPHS + 2,
        )
        requests = (Home(), Go(lambda facts: places, lambda facts: "moving"), shoot)
        return Plan("soak", "A series", (Step("series", "Series", "Shoot.", requests),))

    def _check_shots(self, where: str, folder: Path, shots: Any) -> None:
        """Each photograph is that of its request, with the true axes and times, and is there again when reopened."""
        for shot in shots:
            data = (folder / shot.path).read_bytes()
            require(hashlib.sha256(data).hexdigest() == shot.sha256, f"{where}: {shot.path} was changed")
            require(MARK in data, f"{where}: {shot.path} is not complete")
            mark = json.loads(data.rpartition(MARK)[2])
            number, exposure = mark["number"], shot.exposure
            opening = self.openings[number]
            require(number not in self.taken, f"{where}: exposure {number} is in {self.taken.get(number)}, too")
            self.taken[number] = f"shot {shot.number} of {folder.name}"
            inside = exposure["requested_s"] <= opening.begin_s <= exposure["received_s"]
            require(inside, f"{where}: shot {shot.number} is the photograph of another request ({number})")
            shutter = exposure["shutter"] or {}
            if shutter.get("flash_s") is not None:
                late, within = shutter["flash_s"] - opening.begin_s, shutter["within_s"] + CLOCK_S
                stated = f"{1000 * late:.3f} ms off, stated within {1000 * within:.3f} ms"
                require(abs(late) <= within, f"{where}: shot {shot.number} opened {stated}")
            for name, value in shot.snapshot.get("axes", {}).items():
                off = abs(mark["axes"].get(name, value) - value)
                require(off < conform.TOLERANCE, f"{where}: shot {shot.number} has {name} {value}, off by {off:.3f}")
        with Session.open(folder, self.clock) as again:
            require(again.state.shots == shots, f"{where}: the session reads differently when opened again")

    # --- afterwards

    def make_ready(self) -> None:
        """All lines clean, all devices connected, no exposure pending; contacts are open, files are where they were."""
        for cable in self.world.cables.values():
            cable.faults = Faults()
        self.clock.sleep(6.0)  # the box's watchdog, and the body's last file
        box = self.world.devices["shutter"]
        require(box._shot is None, "a contact stays closed")  # type: ignore[attr-defined]
        # without its line, or while no stop gets through, a stage goes on to its target
        if self.rig.stage.condition().word != "not connected" and "clogged at the stage" not in self.where:
            require(not self.rig.moves(), "it moves after the operation has ended")
        for name in DEVICES[1:]:
            device = self.bench.devices[name]
            device.close()
            with suppress(DeviceError):
                device.connect()
            require(device.condition().usable, f"the {name} does not recover on a clean line")
        self.rig.ready()
        incoming = {path.name for path in (self.folder / "incoming").iterdir()}
        lost = self.world.body.settings.lose_frames
        expected = sum(count not in lost for count in range(1, len(self.world.body.openings) + 1))
        require(len(incoming) == expected, f"{len(incoming)} files of {expected} exposures are in the camera's folder")

    def check_leaks(self) -> None:
        """Threads and descriptors are those after the first operation."""
        now = threading.active_count(), len(os.listdir("/proc/self/fd")) if Path("/proc/self/fd").is_dir() else 0
        self.base = self.base or now
        names = sorted(thread.name for thread in threading.enumerate())
        require(now[0] <= self.base[0], f"threads have leaked: {names}")
        require(now[1] <= self.base[1], f"file descriptors have leaked: {now[1]} instead of {self.base[1]}")


class FrontEndFailed(RuntimeError):
    """The front end of a run fails."""


def _fail_at(operator: ScriptedOperator, count: int, event: object) -> None:
    if len(operator.heard) == count:
        raise FrontEndFailed


@contextmanager
def soaked(folder: Path, seed: int, firmware: FirmwareInSimavr | None = None) -> Iterator[Soak]:
    """A bench of stage, shutter box and camera in virtual time."""
    incoming, picture = folder / "incoming", frame_bytes(0)
    incoming.mkdir()
    soak: Soak
    world = SimulatedBench(incoming, Setup(seed, virtual_time=True, develop=lambda one: soak.develop(picture, one)))
    tables = {name: simulated_tables(world.address, incoming)[name] for name in DEVICES}
    if firmware is not None:
        world.clock.detach(world.cables["stage"])
        unplug(f"{world.name}/stage")
        world.cables["stage"] = Cable(firmware, world.clock)
        plug(f"{world.name}/stage", world.cables["stage"])
        tables["stage"]["axes"] = [{"name": one, "letter": axis, "feed_per_min": 1000.0} for one, axis in LETTERS]
    bench = make_bench(tables, folder=incoming, clock=world.clock)
    cable = world.cables["stage"]
    if firmware is None:
        rig = StageRig(bench.stage, world.clock, world.world.axes, cable)
    else:
        rig = FirmwareRig(bench.stage, world.clock, {}, cable)
    try:
        bench.connect()
        bench.stage.home()
        soak = Soak(bench, world, rig, folder, np.random.default_rng(seed))
        soak.watch_contact()
        yield soak
    finally:
        bench.close()
        world.close()


def soak_seed(seed: int, operations: int, firmware: tuple[str, str] | None = None) -> Counter[str]:
    """The counts of one seed. Raises Broken with the number of the operation."""
    with tempfile.TemporaryDirectory() as place:
        machine = None if firmware is None else FirmwareInSimavr(*firmware, QUICK)
        before = threading.active_count()
        try:
            with soaked(Path(place), seed, machine) as soak:
                for n in range(operations):
                    try:
                        soak.operate(n)
                    except Broken as broken:
                        raise Broken(f"operation {n + 1} of {operations}: {broken}") from broken
        finally:
            if machine is not None:
                machine.end()
        require(threading.active_count() <= before, f"threads remain: {threading.enumerate()}")
        return soak.counts


def main() -> int:
    """Soak each seed; print its counts."""
    given = options(__doc__, seeds=4, first=0, operations=500, firmware="", box="")
    firmware = (given.firmware, given.box) if given.firmware else None
    wrong = 0
    for seed in range(given.first, given.first + given.seeds):
        start_s, begin_s = processor_s(), time.monotonic()
        try:
            counts = soak_seed(seed, given.operations, firmware)
            words_of_it = ", ".join(f"{count} {name}" for name, count in sorted(counts.items()))
        except Broken as broken:
            wrong, words_of_it = wrong + 1, f"BROKEN: {broken}"
        spent = f"{processor_s() - start_s:.0f} s of processor, {time.monotonic() - begin_s:.0f} s"
        print(f"seed {seed}: {given.operations} operations, {spent}; {words_of_it}", flush=True)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
