"""Characterisation of a sensor by EMVA 1288 release 4.0: gain, noise, saturation, linearity, non-uniformity, each with
its interval; and the information content of photographs with a PSF and that sensor.

Works on arrays of digital numbers and reads no files. `stacks` reduces pictures to statistics; `curves`,
`photon_transfer`, `uniformity`, `spectrograms` and `defects` derive numbers from them, `information` those that need a
PSF too. `estimate` combines all and gives the verdict, `plan` guides through the recording.
"""
