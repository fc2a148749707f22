"""Intrinsics, distortion and poses of a camera, with covariance, from photographs of a chart in many poses.

Photographs give views (`chart_bins`, `views`); views give a camera (`estimate`): an initial estimate by pycolmap
(`bundle`), then an adjustment that includes the shape of the chart (`adjustment`, `shape`). `reference` is the model
of the camera, `formulas` are fitted to it, `misfit` and `model_discrepancy` test both, `uncertainty` propagates the
covariance to the frame, `conversion` converts to other models.
"""
