"""Corruptions of photographs, each a score test with a false-alarm rate or a nuisance.

`family` names them, and holds the threshold of all tests and the marginal of a nuisance; `noise` and `paper` detect
processing in the noise, `ring` in the PSF, `evidence` in the fit. An estimator computes the scores that its data
allow, and takes checks and terms of its budget from `family`.
"""
