"""Whether a picture was sharpened: by the ring that this digs around a PSF, and by what it makes of white noise."""
