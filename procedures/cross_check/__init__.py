"""Comparison of MTF50 by the noise chart's PSF and by the chart's slanted edges, from one frame.

May import the packages that it compares, `pattern_psf` and `slanted_edge`.
"""
