"""What a sensor does with light, by EMVA 1288 release 4.0: gain, noise, saturation, linearity, non-uniformity, each
with its interval; and what a PSF of that sensor carries of information.

Works on arrays of digital numbers and reads no files. One idea a module: `levels` and `stacks` reduce pictures to
statistics, `photon_transfer`, `linearity`, `dark_current`, `uniformity`, `spectrograms`, `defects` turn these into
numbers, `checks` judges, `estimate` is the table of contents.
"""
