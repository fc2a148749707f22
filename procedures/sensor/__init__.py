"""Characterisation of a sensor by EMVA 1288 release 4.0: gain, noise, saturation, linearity, non-uniformity, each with
its interval; and the information content of photographs with a PSF and that sensor.

Works on arrays of digital numbers and reads no files. `levels` and `stacks` reduce pictures to statistics;
`photon_transfer`, `linearity`, `uniformity`, `spectrograms`, `defects` and `signal_to_noise` derive numbers from them;
`checks` gives verdicts, and `estimate` combines all.
"""
