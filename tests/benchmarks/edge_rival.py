"""MTF50 of edges that MTF Mapper's generator renders, measured by this program and by MTF Mapper.

The generator clips polygons by the pixels of analytic or sampled spread functions and shares nothing with this project.
A picture holds four edges of 100 pixels, at an angle of 2.5 to 12 degrees, with Gaussian noise of 0.2 to 1 % of white.

python -m tests.benchmarks.edge_rival FOLDER [pictures of each lens, default 4] [seed, default 5]

FOLDER holds `mtf_generate_rectangle` and `mtf_mapper`.
"""

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from procedures import estimate_edges, read_frame
from procedures.outcome import Verdict
from procedures.reading.sensor_dump import DumpLayout

FINE = "--airy-samples 12"
LENSES = {
    "Gaussian": [f"-p gaussian -m {m}" for m in (0.08, 0.1, 0.13, 0.16, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5)],
    "diffraction, pixel": [f"-p airy-box --aperture {n} {FINE}" for n in (4, 5.6, 8, 11, 16)],
    "low-pass filter": [f"-p airy-4dot-olpf --aperture {n} {FINE}" for n in (4, 8)],
    "defocus, spherical": [
        f"-p wavefront-box --aperture 5.6 --w020 {w} --w040 {s} {FINE}" for w, s in ((0.5, 0), (1, 0), (-0.5, 0.6))
    ],
}
LEVELS = "-l --b16 -d 240 --blacklevel 0.1 --whitelevel 0.75"
STATED = DumpLayout.parse("Y,0,65535")


def render(folder: Path, words: str, rng: np.random.Generator, file: Path) -> float:
    """Render a picture with a random pose and noise; returns its MTF50."""
    pose = f"-a {rng.uniform(2.5, 12):.3f} -x {rng.uniform(-1, 1):.3f} -n {rng.choice([0.002, 0.005, 0.01])}"
    command = [
        str(folder / "mtf_generate_rectangle"),
        *f"{LEVELS} {pose} -s {rng.integers(10**6)} {words} -o".split(),
        str(file),
    ]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return float(said.rpartition("MTF50 = ")[2].split()[0])


def mapped(folder: Path, file: Path) -> list[float]:
    """MTF50 of the edges by MTF Mapper, of a picture linear in light."""
    subprocess.run([folder / "mtf_mapper", file, file.parent, "-l", "-q"], capture_output=True, check=True)
    table = np.loadtxt(file.parent / "edge_mtf_values.txt", ndmin=2)
    return [float(value) for value in table[:, 3]]


def show(lens: str, ours: list[tuple[float, float, bool]], theirs: list[float]) -> None:
    """Print errors relative to the truth: of all edges, and of the accepted ones over their stated uncertainty."""
    errors, stated, accepted = (np.array(column) for column in zip(*ours, strict=True))
    z = np.abs(errors / stated)[accepted]
    print(
        f"{lens:20s} {len(errors):3d} edges, accepted {accepted.mean():.0%}: mean {errors.mean():+.2%}, rms "
        f"{np.sqrt(np.mean(errors**2)):.2%}, stated {stated.mean():.1%}, largest z {z.max(initial=0):.1f}; MTF Mapper "
        f"{len(theirs)}: {np.mean(theirs):+.2%}, {np.sqrt(np.mean(np.square(theirs))):.2%}",
        flush=True,
    )


def main(folder: Path, pictures: int = 4, seed: int = 5) -> None:
    rng = np.random.default_rng(seed)
    with TemporaryDirectory() as place:
        file = Path(place) / "edges.png"
        for lens, settings in LENSES.items():
            ours, theirs = [], []
            for words in settings * pictures:
                truth = render(folder, words, rng, file)
                for edge in estimate_edges(read_frame(file, layout=STATED).planes["Y"]):
                    if edge.value is not None:
                        mtf50 = edge.value.numbers["mtf50"]
                        relative = mtf50.value / truth - 1, mtf50.uncertainty / truth
                        ours.append((*relative, edge.verdict is Verdict.PASS))
                theirs += [value / truth - 1 for value in mapped(folder, file)]
            show(lens, ours, theirs)


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), *map(int, sys.argv[2:]))
