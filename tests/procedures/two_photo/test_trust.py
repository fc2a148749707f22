"""Which check fails for one bad number among good ones, and how strong its evidence is."""

from dataclasses import fields, replace

import numpy as np
import pytest

from procedures.choice import Trial
from procedures.outcome import Check, Refused, Verdict
from procedures.psf import Sampling
from procedures.two_photo.diagnostics import PairDiagnostics
from procedures.two_photo.trust import check_distance, check_light, checks_of, most_samples_per_pixel

ONES = {"agreement", "near_noise", "sharpness_ratio", "gain", "mismatch", "streaks", "smoothing", "colour", "detail"}
"""Numbers that are 1 where nothing is wrong; others are 0."""
GOOD = replace(
    PairDiagnostics(**{field.name: float(field.name in ONES) for field in fields(PairDiagnostics)}),
    determined_horizontal=2.0, determined_vertical=2.0, scale=4.6, missing_light=-1.0,
)  # fmt: skip
TRIAL = Trial(3, 13, (0.3, 0.3), 0.01, 0.0, 0.0)
FREE = Sampling(None, None, "ls", ())


def failed(sampling: Sampling = FREE, trial: Trial = TRIAL, *, raw: bool = False, **changed: float) -> list[Check]:
    checks = checks_of(replace(GOOD, **changed), sampling, (trial,), trial.s, [], raw=raw)
    return [one for one in checks if one.fails]


@pytest.mark.parametrize("raw", [False, True])
def test_a_pair_without_a_flaw_fails_no_check(raw: bool) -> None:
    assert failed(raw=raw) == []


@pytest.mark.parametrize(
    ("number", "limit", "name", "severity"),
    [
        ("agreement", 0.3, "agreement", Verdict.REFUSED),
        ("local_shift_px", 0.1, "local shift", Verdict.REFUSED),
        ("relief_px", 0.25, "relief", Verdict.REFUSED),
        ("relief_px", 0.06, "relief", Verdict.DOUBTFUL),
        ("sharpness_ratio", 0.2, "sharpness", Verdict.REFUSED),
        ("sharpness_ratio", 0.4, "sharpness", Verdict.DOUBTFUL),
        ("sharpness_ratio", 1.8, "sharpness", Verdict.DOUBTFUL),
        ("excess", 0.05, "sharpness", Verdict.DOUBTFUL),
        ("relative_uncertainty", 1.0, "uncertainty", Verdict.REFUSED),
        ("relative_uncertainty", 0.3, "uncertainty", Verdict.DOUBTFUL),
        ("determined_vertical", 1.5, "band", Verdict.DOUBTFUL),
        ("determined_horizontal", 1.5, "band", Verdict.DOUBTFUL),
        ("outliers", 0.02, "outliers", Verdict.DOUBTFUL),
        ("scale_spread", 0.25, "scale", Verdict.DOUBTFUL),
        ("gain", 1.15, "contrast", Verdict.DOUBTFUL),
        ("light_change", 0.1, "light", Verdict.DOUBTFUL),
        ("saturated", 0.01, "clipping", Verdict.DOUBTFUL),
        ("near_noise_bias", 1.0, "noise", Verdict.DOUBTFUL),
        ("support_cut", 0.15, "support", Verdict.DOUBTFUL),
        ("moved_px", 0.1, "convergence", Verdict.DOUBTFUL),
        ("colour", 1.6, "coarse residual", Verdict.DOUBTFUL),
        ("colour", 0.8, "fine residual", Verdict.DOUBTFUL),
        ("light_turned", 0.005, "direction of the light", Verdict.DOUBTFUL),
        ("coarse_residual", 0.05, "coarse detail", Verdict.DOUBTFUL),
        ("smoothing", 1.35, "smoothing", Verdict.DOUBTFUL),
        ("streaks", 1.4, "streaks", Verdict.DOUBTFUL),
        ("detail", 1.5, "residual at detail", Verdict.DOUBTFUL),
        ("beyond_light", 0.02, "MTF of light", Verdict.DOUBTFUL),
        ("missing_light", 4.0, "MTF of light", Verdict.DOUBTFUL),
        ("focus_effect", 0.15, "near focus", Verdict.DOUBTFUL),
        ("near_noise", 0.8, "near noise", Verdict.DOUBTFUL),
        ("turned", 0.1, "direction of fine detail", Verdict.DOUBTFUL),
        ("mismatch", 9.0, "parts", Verdict.DOUBTFUL),
    ],
)
def test_one_number_beyond_its_limit_fails_its_check_alone(
    number: str, limit: float, name: str, severity: Verdict
) -> None:
    outwards = 1 if limit > getattr(GOOD, number) else -1
    found = [(one.name, one.severity) for one in failed(**{number: limit + outwards * 1e-3 * limit})]
    assert (name, severity) in found
    assert {one for one, _ in found} == {name}
    assert (name, severity) not in [
        (one.name, one.severity) for one in failed(**{number: limit - outwards * 1e-3 * limit})
    ]


def test_statistics_count_where_they_are_significant():
    assert [one.name for one in failed(streaks=1 / 1.41)] == ["streaks"]
    assert [one.name for one in failed(gain=0.84)] == ["contrast"]
    # four times the variance is twice the deviation
    (check,) = failed(mismatch=36.0)
    assert check.statistic / check.threshold == pytest.approx(2)
    assert "6.0 times their noise" in check.sentence
    assert failed(local_shift_px=0.021, local_shift_significance=5.9) == []
    assert [one.name for one in failed(local_shift_px=0.021, local_shift_significance=6.1)] == ["local shift"]
    soft = {"sharpness_ratio": 0.19, "smoothing": 1.4}
    shifted = failed(local_shift_px=0.05, local_shift_significance=20.0, **soft)
    assert max((one for one in shifted if one.severity is Verdict.DOUBTFUL), key=lambda one: one.evidence).name == (
        "local shift"
    )
    assert {one.name for one in failed(sharpness_ratio=1.9, beyond_light=0.1, missing_light=9.0)} == {"sharpness"}
    assert failed(trial=replace(TRIAL, band_edge=1.0), missing_light=9.0) == []
    assert failed(trial=replace(TRIAL, band_edge=1.0), beyond_light=0.1)
    short = replace(TRIAL, truncation=0.5, band_edge=1.0, better=(4, 17))
    assert failed(trial=short) == []
    checks = failed(Sampling(3, 13, "ls", ()), short)
    assert [one.name for one in checks] == ["truncation", "band edge"]
    assert all("-s 4 -k 17" in one.remedy for one in checks)
    assert [one.name for one in failed(trial=replace(TRIAL, mtf50=(0.3, None)))] == ["MTF50"]


@pytest.mark.parametrize(("zoom", "most"), [(3.05, 2), (3.07, 3), (1.5, 2), (40.0, 6)])
def test_the_samples_stay_below_the_smallest_zoom(zoom: float, most: int) -> None:
    H = np.diag([2 * zoom, zoom, 1.0])
    assert most_samples_per_pixel(H, (60, 80)) == most
    for s in (2, 3, 5):
        if s < zoom:
            check_distance(H, (60, 80), s)
        else:
            with pytest.raises(Refused, match=f"more than {s} times the near one's distance; it is from {zoom:.2f}"):
                check_distance(H, (60, 80), s)


def test_light_is_neither_clipped_nor_missing(rng: np.random.Generator) -> None:
    wall = rng.uniform(0.2, 0.8, (60, 60)).astype(np.float32)
    assert check_light(wall, wall) == 0
    for bad, match in (
        (np.where(wall > 0.75, 1, wall), "not be clipped"), (0.01 * wall, "brighter than black"),
        (wall[:2], "60 x 2"), (wall[:, :2], "2 x 60"),
    ):  # fmt: skip
        for pair in ((wall, bad), (bad, wall)):
            with pytest.raises(Refused, match=match):
                check_light(*pair)
    check_light(wall[:3, :3], wall)
