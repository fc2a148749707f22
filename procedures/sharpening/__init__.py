"""Detection of sharpening in a picture, from the ring around a PSF's core and from correlated noise."""
