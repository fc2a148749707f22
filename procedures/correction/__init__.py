"""Correction of a photograph by the measured PSF field: deblurring and demosaicking in one, tile by tile.

Input are planes of a photograph and the fields of the same planes; output is the sharp picture with its estimated
gain and error. Built on `psf_field`, `raw` and `numerics`; files are written by the station.
"""
