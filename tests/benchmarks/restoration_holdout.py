"""Restoration on other scenes than the shared pairs, against the same restoration that knows the true depth.

`python -m tests.benchmarks.restoration_holdout [--noise 40] [--blur KIND] [--depth KIND] [--seed N]`

`--noise clean`, 40 or 20 dB; KIND of blur: vibration, uniform, coma, pillbox; of depth: square, leaf. The penalties
of matching were chosen on pairs of seed 1 at 40 and 20 dB, how the depth's prior yields to noise on seeds 1 to 3 at
20 dB: from `--seed 4` on, nothing was chosen on the picture and its noise.
"""

import platform
import time

import numpy as np
from numpy.typing import NDArray

from procedures.restoration.joint import joint_descent
from procedures.restoration.joint.data_term import restore_picture
from procedures.restoration.joint.estimate import RestorationParameters, noise_of, restore
from procedures.restoration.joint.schedule import Schedule, Scheme
from tests.benchmarks import options
from tests.benchmarks.restoration_scenes import Scene, scene

Array = NDArray[np.floating]
BLURS, DEPTHS = ("vibration", "uniform", "coma", "pillbox"), ("square", "leaf")


def at_true_depth(case: Scene) -> Array:
    """The picture (H, W) at the true depth with the best of several weights: what knowing both would give."""
    data, other = joint_descent.problem_of(case.z, case.stacks, np.ones((2, 1, *case.w.shape)), np.float32)
    sigma = noise_of(case.z, case.stacks)
    problem = joint_descent.JointProblem(data, other, Scheme(), Schedule(20), sigma, 12)
    state = joint_descent.begin(problem, case.w)
    R, least = data.R, max(sigma**2 / joint_descent.CONTRAST, 1e-7)
    found = [restore_picture(data, state.u, factor * least, 150)[0, R:-R, R:-R] for factor in (0.3, 1.0, 3.0)]
    return np.asarray(min(found, key=case.error))


def compare(case: Scene) -> None:
    """Print one line."""
    known = case.error(at_true_depth(case))
    start = time.process_time()
    ours = restore(list(case.z), case.stacks, RestorationParameters()).value
    seconds = time.process_time() - start
    assert ours is not None
    picture, w, first = case.error(ours.sharp[0]), case.w_error(ours.w), case.w_error(ours.start.w)
    print(
        f"{case.name:24s} known depth {known:5.2f}   restored {picture:5.2f} = {picture / known:4.2f} x"
        f"   w {w:.3f} px (start {first:.3f})   {seconds:.0f} s of processor",
        flush=True,
    )


def main() -> None:
    """Print the environment and a line for each case."""
    asked = options(__doc__, noise=["clean", "40", "20"], blur=list(BLURS), depth=list(DEPTHS), seed=1)
    print(f"Python {platform.python_version()}, {platform.machine()}")
    for noise in asked.noise:
        for blur in asked.blur:
            for depth in asked.depth:
                noise_db = None if noise == "clean" else float(noise)
                compare(scene(blur, depth, noise_db, asked.seed))


if __name__ == "__main__":
    main()
