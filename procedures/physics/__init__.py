"""Physical model of a PSF: photosite aperture, optical low-pass filter, diffraction and lens aberrations.

Entry point: `estimate`. `pupil` and `sensor` hold the transfer functions of the parts, `model` combines them on the
PSF's grid, `fit` weights by the PSF's covariance, and `choice` selects the parts that the data support.
"""
