"""Several photographs through the measured field, as one picture twice as fine as the sensor: how near it comes to the
scene that a renderer of its own drew on that grid, against one photograph corrected on the sensor's grid and enlarged.

python -m tests.benchmarks.finer_pictures
"""

import cv2
import numpy as np

from procedures.correction.estimate import CorrectionParameters, correct
from tests.procedures.correction.lens_photographs import RGGB, Sensor
from tests.procedures.correction.small_lens import RIM, SmallLens, burst, scene

SHAPE, PLANE = (120, 160), (60, 80)
COUNTS = (2, 4, 8)
SENSOR = Sensor(white_e=20000.0)


def psnr(picture: np.ndarray, truth: np.ndarray) -> float:
    """In dB, white = 1, a rim left out."""
    return float(-10 * np.log10(np.mean((picture - truth)[:, RIM:-RIM, RIM:-RIM] ** 2)))


def enlarged(picture: np.ndarray) -> np.ndarray:
    """Twice as fine, cubic between its pixels."""
    size, flags = (2 * picture.shape[2], 2 * picture.shape[1]), cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    to_pixels = np.array([[0.5, 0, 0], [0, 0.5, 0]])
    border = cv2.BORDER_REPLICATE
    return np.stack([cv2.warpAffine(one, to_pixels, size, flags=flags, borderMode=border) for one in picture])


def main() -> None:
    """Print a line for each scene, grey and as a mosaic."""
    rng = np.random.default_rng(1)
    lens, plane = SmallLens(SHAPE, 0.3, growth=0.5), SmallLens(PLANE, 0.25, growth=0.5)
    of = {"grey": ({"Y": lens}, 1), "mosaic": (dict.fromkeys(RGGB, plane), 3)}
    for words, (lenses, channels) in of.items():
        fields = {name: one.field(name).field for name, one in lenses.items()}
        for seed in (3, 4, 5):
            fine = scene((2 * SHAPE[0] + 2 * RIM, 2 * SHAPE[1] + 2 * RIM), seed=seed, channels=channels)
            moves = [(0.0, 0.0), *(tuple(rng.uniform(-4, 4, 2)) for _ in range(COUNTS[-1] - 1))]
            shots, truth = burst(lenses, fine, moves, SENSOR), fine[:, RIM:-RIM, RIM:-RIM]
            one = correct(shots[0], fields).value
            assert one is not None
            figures = [f"{words}, scene {seed}: one enlarged {psnr(enlarged(one.picture), truth):.1f} dB"]
            for count in COUNTS:
                found = correct(shots[0], fields, parameters=CorrectionParameters(scale=2), others=shots[1:count])
                assert found.value is not None
                value = found.value
                figures.append(
                    f"{count}: {psnr(value.picture, truth):.1f} ({value.resolved:.0%} resolved, {found.verdict})"
                )
            off = [np.abs(p.moved_px(SHAPE) - move).max() for p, move in zip(value.places, moves[1:], strict=True)]
            print(", ".join(figures), f"; places within {max(off):.3f} pixel", flush=True)


if __name__ == "__main__":
    main()
