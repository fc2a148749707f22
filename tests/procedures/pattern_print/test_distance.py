import pytest

from procedures.pattern_print.distance import FOCAL_LENGTHS_MM, SAMPLES_PER_PIXEL, SENSORS, table_m


@pytest.mark.parametrize("noise_mm", [25.6, 240.0])
def test_at_the_table_s_distances_a_cell_is_one_sample_of_the_psf(noise_mm: float) -> None:
    for focal_mm, row in zip(FOCAL_LENGTHS_MM, table_m(noise_mm), strict=True):
        for sensor, distance_m in zip(SENSORS, row, strict=True):
            # a pinhole's image of one cell, against the spacing of the PSF's samples in a plane of a Bayer mosaic
            cell_um = noise_mm / 256 * 1000 * focal_mm / (1000 * distance_m)
            assert cell_um == pytest.approx(2 * sensor.pitch_um / SAMPLES_PER_PIXEL)
