"""All that one session tells of a camera, with one covariance: geometry, lateral colour, PSF, vignetting, sensor.

`joint` puts parts together and says of every pair what they share; `from_field` makes the parts of a field's charts,
`from_others` those that come of other photographs; `camera_file` writes and reads all as one file. `plan` guides
through all of it in one session.
"""
