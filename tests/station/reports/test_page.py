import pytest

from procedures.reading.exposure import Exposure
from station.reports.page import exposure_words, percent, signed, stated


@pytest.mark.parametrize(
    ("value", "uncertainty", "words"),
    [
        (0.57824, 0.00137, "0.5782 ± 0.0014"),
        (-0.000368617, 2.7e-20, "−0.0003686 ± 2.7e−20"),
        (101.3, 12.0, "101 ± 12"),
        (-0.00004, 0.0018, "0.0000 ± 0.0018"),
        (-0.0123, 0.0018, "−0.0123 ± 0.0018"),
        (3.0, 0.0, "3"),
        (float("nan"), 1.0, "—"),
        (2.5, float("inf"), "2.5"),
    ],
)
def test_uncertainty_keeps_two_digits_and_the_value_follows(value, uncertainty, words):
    assert stated(value, uncertainty) == words


def test_shares_and_differences_are_written_as_people_do():
    assert [percent(share) for share in (0.02137, 0.9951, 0.0000028, -0.0013)] == [
        "2.14 %", "99.5 %", "0.00 %", "−0.13 %"
    ]  # fmt: skip
    assert [signed(value) for value in (0.44, -1.26, -0.01)] == ["+0.4", "−1.3", "+0.0"]


@pytest.mark.parametrize(
    ("exposure", "words"),
    [
        (Exposure(exposure_s=0.02, f_number=2.8, iso=400, focal_length_mm=50), "f/2.8, 1/50 s, ISO 400, 50 mm"),
        (Exposure(exposure_s=1.6), "1.6 s"),
        (Exposure(), ""),
    ],
)
def test_exposure_is_told_as_far_as_the_camera_noted_it(exposure, words):
    assert exposure_words(exposure) == words
