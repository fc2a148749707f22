"""From light to a DNG: optics, sensor, rendering, and the truth that a calibration should find."""
