"""400 photographs, 12 of them broken, through `station batch`: one process, two, and two that lose one.

python -m tests.benchmarks.batch [photographs, default 400] [--keep FOLDER]
"""

import contextlib
import json
import os
import platform
import signal
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from procedures.pattern import Chart
from simulators.bench.demonstration import EXPOSURE_S, ISO, SETUPS, S, stage
from simulators.camera.camera import pixels_at
from simulators.world.scene import Scene
from tests.benchmarks import ROOT, options

BOUND_MB, BOUND_RATIO = 600, 1.8
PROCEDURE = 'procedure = "pattern"\nplanes = ["G1"]\n[limits]\nmtf50_horizontal = { min = 0.4 }\n'


def make_frames(folder: Path, count: int) -> set[str]:
    """Photographs of four scenes with noise of their own, and twelve broken files; returns the names of those."""
    if folder.exists():  # kept from an earlier run
        return {path.name for path in folder.iterdir() if "-" in path.name}
    folder.mkdir(parents=True)
    chart, rng = Chart.from_seed(), np.random.default_rng(400)
    scenes = [(*stage(setup, chart),) for setup in SETUPS[:4]]
    lights = [camera.light(scene) for camera, scene in scenes]
    for i in range(count - 12):
        (camera, scene), light = scenes[i % 4], lights[i % 4]
        path = folder / f"frame{i:04d}.dng"
        camera.photograph(scene, rng, path, exposure_s=EXPOSURE_S, iso=ISO, bits=14, light=light)
    camera, scene = scenes[1]
    spoil(folder, camera, scene, chart, rng, (folder / "frame0000.dng").read_bytes())
    return {path.name for path in folder.iterdir() if "-" in path.name}


def spoil(folder: Path, camera, scene: Scene, chart: Chart, rng: np.random.Generator, good: bytes) -> None:  # type: ignore[no-untyped-def]
    """Twelve files that nothing can be estimated from."""

    def shoot(name: str, scene: Scene, **how: float) -> None:
        camera.photograph(scene, rng, folder / name, iso=ISO, bits=14, **{"exposure_s": EXPOSURE_S, **how})

    def placed(at: tuple[float, float]):  # type: ignore[no-untyped-def]
        return camera.place(chart, pixels=pixels_at(1.2, S), at=at)

    for share in (0.01, 0.5, 0.98):
        (folder / f"frame0010-truncated-{share}.dng").write_bytes(good[: int(share * len(good))])
    (folder / "frame0020-empty.dng").write_bytes(b"")
    (folder / "frame0030-text.dng").write_text("the card was full\n" * 1000)
    (folder / "frame0040-zeros.dng").write_bytes(bytes(3_000_000))
    (folder / "frame0050-jpeg.dng").write_bytes(b"\xff\xd8\xff\xe0" + bytes(100_000))
    shoot("frame0060-no-chart.dng", replace(scene, charts=()))
    shoot("frame0070-saturated.dng", scene, exposure_s=20 * EXPOSURE_S)
    shoot("frame0080-dark.dng", scene, exposure_s=EXPOSURE_S / 2000)
    shoot("frame0090-two-charts.dng", replace(scene, charts=(placed((0.25, 0.5)), placed((0.75, 0.5)))))
    shoot("frame0100-cut.dng", replace(scene, charts=(placed((0.99, 0.5)),)))


def children(pid: int) -> list[int]:
    """All processes below a process (Linux)."""
    found = []
    with contextlib.suppress(OSError):  # it has ended
        for task in Path(f"/proc/{pid}/task").glob("*/children"):
            for child in map(int, task.read_text().split()):
                found += [child, *children(child)]
    return found


def is_worker(pid: int) -> bool:
    """Whether a process is one that was spawned to work."""
    try:
        return b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False


class Watch(threading.Thread):
    """Resident memory of the workers of a process, MB, every half second; may kill one worker after some lines."""

    def __init__(self, process: subprocess.Popen[str], out: Path, kill_after: int | None) -> None:
        super().__init__()
        self.process, self.out, self.kill_after = process, out, kill_after
        self.memory: list[tuple[int, float]] = []
        self.killed = 0

    def run(self) -> None:
        """Watch until it ends."""
        while self.process.poll() is None:
            with contextlib.suppress(OSError, ValueError):  # a process that ended meanwhile
                self._look()
            time.sleep(0.5)

    def _look(self) -> None:
        workers = [pid for pid in children(self.process.pid) if is_worker(pid)]
        lines = self.out / "results.jsonl"
        done = lines.read_bytes().count(b"\n") if lines.exists() else 0
        pages = [int(Path(f"/proc/{pid}/statm").read_text().split()[1]) for pid in workers]
        if pages:
            self.memory.append((done, max(pages) * os.sysconf("SC_PAGE_SIZE") / 1e6))
        if self.kill_after is not None and done >= self.kill_after and not self.killed:
            self.killed = workers[-1]
            os.kill(self.killed, signal.SIGKILL)

    def stated(self) -> str:
        """The greatest memory, and that of the second and the last fifth of the photographs."""
        last = self.memory[-1][0]
        early = [mb for done, mb in self.memory if 0.2 * last <= done < 0.4 * last] or [0.0]
        late = [mb for done, mb in self.memory if done >= 0.8 * last] or [0.0]
        most = max(mb for _, mb in self.memory)
        return (
            f"memory of a worker at most {most:.0f} MB (bound {BOUND_MB}), {max(early):.0f} early, {max(late):.0f} late"
        )


def run(folder: Path, out: Path, *words: str, kill_after: int | None = None) -> tuple[float, float, Watch]:
    """One batch as a user would start it; wall time and processor time in seconds."""
    procedure = out.parent / "procedure.toml"
    procedure.write_text(PROCEDURE)
    command = [sys.executable, "-m", "station", "batch", str(folder), "--procedure", str(procedure), "--out", str(out)]
    start, before = time.perf_counter(), processor_s()
    with (out.parent / f"{out.name}.log").open("w") as log:
        process = subprocess.Popen([*command, *words], cwd=ROOT, stdout=log, stderr=log, text=True)
        watch = Watch(process, out, kill_after)
        watch.start()
        process.wait()
    took = time.perf_counter() - start
    watch.join()
    return took, processor_s() - before, watch


def processor_s() -> float:
    """Processor time of all processes that were started here and have ended."""
    used = os.times()
    return used.children_user + used.children_system


def rows(out: Path) -> list[dict[str, object]]:
    """What became of the photographs, without what may differ."""
    lines = [json.loads(line) for line in (out / "results.jsonl").read_text().splitlines()]
    return [{key: value for key, value in row.items() if key not in ("duration_s", "reused")} for row in lines]


def check(out: Path, broken: set[str], count: int) -> str:
    """How many good ones were estimated and how many broken ones named."""
    verdicts = {Path(row["files"][0]).name: row for row in rows(out)}  # type: ignore[index]
    named = [
        name for name in broken if verdicts[name]["verdict"] in ("unreadable", "refused") and verdicts[name]["reason"]
    ]
    good = [name for name, row in verdicts.items() if name not in broken and row["verdict"] == "pass"]
    return f"{len(good)} of {count - len(broken)} good ones pass, {len(named)} of {len(broken)} broken ones named"


def main() -> None:
    """Make the frames, run, print."""
    given = options(__doc__, "count", count=400, keep=None)
    with tempfile.TemporaryDirectory() as temporary:
        root = given.keep or Path(temporary)
        start = time.perf_counter()
        broken = make_frames(root / "frames", given.count)
        print(f"Python {platform.python_version()}, {platform.machine()}, {os.cpu_count()} cores")
        print(f"{given.count} frames of 1.5 megapixels made in {time.perf_counter() - start:.0f} s")
        measure(root, broken, given.count)


def measure(root: Path, broken: set[str], count: int) -> None:
    """One process, two, and two with a killed one."""
    frames, third = root / "frames", count // 3
    one, cpu, watch = run(frames, root / "one", "--jobs", "1")
    print(f"one process   {one:6.1f} s, processor {cpu:6.1f} s; {watch.stated()}; {check(root / 'one', broken, count)}")
    two, cpu, watch = run(frames, root / "two", "--jobs", "2")
    print(f"two processes {two:6.1f} s, {cpu:6.1f} s CPU; {watch.stated()}; {one / two:.2f} x as fast ({BOUND_RATIO})")
    again, cpu, _ = run(frames, root / "two", "--jobs", "2")
    print(f"  again       {again:6.1f} s, processor {cpu:6.1f} s: nothing is done twice")
    took, cpu, watch = run(frames, root / "killed", "--jobs", "2", kill_after=third)
    same = rows(root / "killed") == rows(root / "one") == rows(root / "two")
    print(f"one killed    {took:6.1f} s, processor {cpu:6.1f} s; process {watch.killed} killed; same results: {same}")


if __name__ == "__main__":
    main()
