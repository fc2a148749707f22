"""What a PSF is made of: the photosite's aperture, the low-pass filter, diffraction and the lens's aberrations.

`estimate` is the verb: `pupil` and `sensor` are the parts' transfer functions, `model` puts them together on the
PSF's own grid, `fit` weighs by the PSF's covariance, and `choice` says which parts the data ask for.
"""
