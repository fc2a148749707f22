"""Choice of s and k."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from procedures.choice import Trial, assess_trial, band_edge, choose, remaining_change
from procedures.psf import Psf, PsfTail
from tests.psfs import gaussian

SIGMA = 0.35


def psf_of(s: int, k: int, *, noise: float = 1e-5, tail: float = 0.0, sigma: float = SIGMA) -> Psf:
    outside = PsfTail(np.array([tail]), np.zeros((1, 1)), np.zeros((k * k, 1)))
    return replace(gaussian(sigma, s, k, noise), tail=outside)


def test_s_and_k_are_raised_while_they_leave_something_out_and_kept_where_given():
    psf = psf_of(2, 15)
    # the samples' own transform on a fine grid, over the ring from 0.8 to 1 of the band's half width of 1 cycle/pixel
    n = 256
    f = np.fft.fftfreq(n) * psf.s
    r = np.hypot(f, f[:, None])
    ring = (r > 0.8) & (r < 1)
    spectrum = np.abs(np.fft.fft2(np.pad(psf.h, ((0, n - 15), (0, n - 15)))))
    assert band_edge(psf) == pytest.approx(np.sqrt(np.mean(spectrum[ring] ** 2)), rel=0.1)  # a few radii stand for all
    assert band_edge(psf_of(5, 35)) < 1e-3
    # the tail's energy outside falls with the width, as that of 1/r^3 does
    result, tried = choose(
        lambda s, k: psf_of(s, k, tail=0.2 * s / k), lambda psf: psf, samples=200_000, most_s=5, s=None, k=None
    )
    assert len(tried) > 1
    assert (result.s, result.k) == (tried[-1].s, tried[-1].k)
    assert tried[-1].k > tried[0].k
    assert tried[0].better == (tried[1].s, tried[1].k)
    result, tried = choose(lambda s, k: psf_of(s, k, tail=0.1), lambda psf: psf, samples=200_000, most_s=5, s=4, k=9)
    assert (result.s, result.k) == (4, 9)
    assert len(tried) == 1
    assert tried[0].support_short
    assert tried[0].better is not None
    _, tried = choose(lambda s, k: psf_of(s, k), lambda psf: psf, samples=200_000, most_s=5, s=None, k=3)
    assert tried[0].s == 3
    _, tried = choose(lambda s, k: psf_of(s, k, tail=0.3), lambda psf: psf, samples=3000, most_s=4, s=None, k=None)
    assert max(trial.k for trial in tried) <= (3000 / 8) ** 0.5


def test_a_support_that_cuts_off_the_core_is_widened_while_that_helps() -> None:
    def trials(sigma: Callable[[int], float]) -> tuple[Psf, tuple[Trial, ...]]:
        def attempt(s: int, k: int) -> Psf:
            return psf_of(s, k, noise=1e-4, tail=1e-4, sigma=sigma(k))

        return choose(attempt, lambda psf: psf, samples=200_000, most_s=4, s=4, k=None)

    _, tried = trials(lambda k: 1.2)
    assert [trial.cuts_off for trial in tried] == [True, True, True, False]
    assert tried[-1].k == 35
    result, (trial,) = trials(lambda k: 1.2 if k == 17 else 50.0)
    assert trial.cuts_off  # uneven light ends nowhere: the narrower support is kept
    assert result.k == trial.k == 17


def test_settled_when_the_last_step_moved_nothing() -> None:
    trial = assess_trial(psf_of(4, 17))
    wider = assess_trial(psf_of(4, 25))
    assert remaining_change((trial,)) == 0
    assert remaining_change((trial, wider)) < 1e-3
