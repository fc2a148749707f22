"""Physical model of a PSF: photosite aperture, optical low-pass filter, diffraction and lens aberrations.

`model` combines the transfer functions of the parts on the PSF's grid; `estimate` fits them, weighted by the PSF's
covariance, and selects the parts that the data support.
"""
