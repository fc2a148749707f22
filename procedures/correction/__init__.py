"""A photograph through the measured PSF field, undone: deblurred and demosaicked in one, tile by tile.

What comes in are planes of a photograph and the fields of the same planes; what goes out is the sharp picture with
what it is worth. Over `psf_field`, `space_variant`, `raw` and `numerics`; files are written by the station.
"""
