"""Results of one session with a camera and their joint covariance: geometry, lateral colour, PSF, vignetting, sensor.

`from_field` derives parts from a field's charts, sensor and flats, and joins them with the covariance of every pair;
`camera_file` writes and reads all as one file. `plan` guides through one session.
"""
