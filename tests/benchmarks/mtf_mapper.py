"""Edges and noise charts that MTF Mapper's generator renders, measured by this program and, the edges, by MTF Mapper.

The generator clips polygons by the pixels of analytic or sampled spread functions and shares nothing with this project;
it prints the true MTF50. An edge picture holds four edges of 100 pixels, at 2.5 to 12 degrees; a chart is 64 to 110
pixels wide, rolled and tilted. Noise is Gaussian, 0.2 to 1 % of white.

python -m tests.benchmarks.mtf_mapper edges|charts FOLDER [pictures of each lens, default 1] [seed, default 5]

FOLDER holds `mtf_generate_rectangle` and `mtf_mapper`.
"""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from procedures import Chart, PatternParameters, estimate_edges, estimate_psf, read_frame
from procedures.numerics.arrays import Array
from procedures.outcome import Outcome, Verdict
from procedures.pattern import BLACK_BLOCKS, BLOCK, CELLS, block_corner, triangles
from procedures.reading.sensor_dump import DumpLayout

FINE = "--airy-samples 25"
LENSES = {
    "Gaussian": [f"-p gaussian -m {m}" for m in (0.08, 0.1, 0.13, 0.16, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5)],
    "diffraction, pixel": [f"-p airy-box --aperture {n} {FINE}" for n in (4, 5.6, 8, 11, 16)],
    "low-pass filter": [f"-p airy-4dot-olpf --aperture {n} {FINE}" for n in (4, 8)],
    "defocus, spherical": [
        f"-p wavefront-box --aperture 5.6 --w020 {w} --w040 {s} {FINE}" for w, s in ((0.5, 0), (1, 0), (-0.5, 0.6))
    ],
}
LEVELS = "-l --b16 --blacklevel 0.1 --whitelevel 0.75"
STATED = DumpLayout.parse("Y,0,65535")
MARGIN = 25.4


def render(folder: Path, words: str, rng: np.random.Generator, file: Path) -> float:
    """Render a picture with noise; returns its MTF50."""
    noise = f"-n {rng.choice([0.002, 0.005, 0.01])} -s {rng.integers(10**6)}"
    command = [str(folder / "mtf_generate_rectangle"), *f"{LEVELS} {noise} {words} -o".split(), str(file)]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return float(text.rpartition("MTF50 = ")[2].split()[0])


def black_areas() -> Iterator[Array]:
    """The chart's black polygons (n, 2) in cells: runs of cells, blocks and triangles."""
    for y, row in enumerate(Chart.from_seed().cells):
        steps = np.diff(np.pad(row.astype(int), 1, constant_values=1))
        for first, last in zip(np.flatnonzero(steps < 0), np.flatnonzero(steps > 0), strict=True):
            yield np.array([(first, y), (last, y), (last, y + 1), (first, y + 1)], float)
    for left, top in (block_corner(*block) for block in BLACK_BLOCKS):
        yield np.array([(left + x, top + y) for x, y in ((0, 0), (BLOCK, 0), (BLOCK, BLOCK), (0, BLOCK))])
    yield from triangles()


def write_chart(file: Path, rng: np.random.Generator) -> None:
    """The chart's polygons on the pixels of a random pose, as the generator reads them."""
    roll, scale = np.radians(rng.uniform(-4, 4)), rng.uniform(64, 110) / CELLS
    turn, tilt = scale * np.array([[np.cos(roll), np.sin(roll)], [-np.sin(roll), np.cos(roll)]]), rng.normal(0, 1e-4, 2)
    flat = [(area - CELLS / 2) @ turn for area in black_areas()]
    placed = [area / (1 + area @ tilt)[:, None] for area in flat]
    corner = np.min([area.min(axis=0) for area in placed], axis=0) - MARGIN - rng.uniform(0, 1, 2)
    lines = (f"{len(a)}\n" + "".join(f"{x:.9f} {y:.9f}\n" for x, y in a - corner) for a in placed)
    file.write_text("".join(lines))


def mapped(folder: Path, file: Path) -> list[float]:
    """MTF50 of the edges by MTF Mapper, of a picture linear in light."""
    subprocess.run([folder / "mtf_mapper", file, file.parent, "-l", "-q"], capture_output=True, check=True)
    return [float(value) for value in np.loadtxt(file.parent / "edge_mtf_values.txt", ndmin=2)[:, 3]]


def errors(outcome: Outcome[Any], truth: float, names: tuple[str, ...]) -> list[tuple[float, float, bool]]:
    """Error and stated uncertainty over the truth of each number, and whether it was accepted."""
    if outcome.value is None:
        return []
    quantities = [outcome.value.numbers[name] for name in names]
    return [(one.value / truth - 1, one.uncertainty / truth, outcome.verdict is Verdict.PASS) for one in quantities]


def show(lens: str, ours: list[tuple[float, float, bool]], theirs: list[float]) -> None:
    """Print the errors of all results, the stated uncertainty, and the largest error over it of accepted ones."""
    error, stated, accepted = (np.array(column) for column in zip(*ours, strict=True))
    z = np.abs(error / stated)[accepted]
    rms = np.sqrt(np.mean(error**2))
    line = (
        f"{lens:20s} {len(error):3d}, accepted {accepted.mean():.0%}: mean {error.mean():+.2%}, rms {rms:.2%}, stated "
    )
    line += f"{stated.mean():.1%}, z rms {np.sqrt(np.mean(z**2)):.2f}, largest {z.max(initial=0):.1f}"
    if theirs:
        line += f"; MTF Mapper {len(theirs)}: {np.mean(theirs):+.2%}, {np.sqrt(np.mean(np.square(theirs))):.2%}"
    print(line, flush=True)


def main(scene: str, folder: Path, pictures: int = 1, seed: int = 5) -> None:
    rng = np.random.default_rng(seed)
    with TemporaryDirectory() as place:
        file, areas = Path(place) / "picture.png", Path(place) / "areas.txt"
        for lens, settings in LENSES.items():
            ours, theirs = [], []
            for words in settings * pictures:
                if scene == "charts":
                    write_chart(areas, rng)
                    sampled = words.replace("gaussian", f"gaussian-sampled {FINE}")
                    truth = render(folder, f"{sampled} --target-poly {areas}", rng, file)
                    psf = estimate_psf(
                        read_frame(file, layout=STATED).planes["Y"], Chart.from_seed(), PatternParameters()
                    )
                    ours += errors(psf, truth, ("mtf50_horizontal", "mtf50_vertical"))
                    continue
                pose = f"-d 240 -a {rng.uniform(2.5, 12):.3f} -x {rng.uniform(-1, 1):.3f}"
                truth = render(folder, f"{words} {pose}", rng, file)
                for edge in estimate_edges(read_frame(file, layout=STATED).planes["Y"]):
                    ours += errors(edge, truth, ("mtf50",))
                theirs += [value / truth - 1 for value in mapped(folder, file)]
            show(lens, ours, theirs)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]).resolve(), *map(int, sys.argv[3:]))
