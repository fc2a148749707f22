"""Results of one session with a camera and their joint covariance: geometry, lateral colour, PSF, vignetting, sensor.

`joint` combines parts and computes the covariance of every pair; `from_field` derives parts from a field's charts,
`from_others` from other photographs; `camera_file` writes and reads all as one file. `plan` guides through one session.
"""
