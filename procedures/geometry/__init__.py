"""Intrinsics, distortion and poses of a camera, with covariance, from charts seen in many poses.

Photographs become views (`chart_bins`, `views`), views a camera (`estimate`): a first guess, bundle adjustment by
pycolmap with the chart as it should be (`bundle`), then with the chart as it is (`adjustment`, `shape`); the model is
chosen and doubted in `choice` and `misfit`, and `uncertainty` tells how well any place of the frame is known.
`conversion` says the same camera in another model's numbers. Imports `pattern_psf` and what the rooms share.
"""
