"""Vignetting of lens and sensor, by plane, from photographs of even light (flats).

`cells` averages small parts of a plane, `surface` fits a smooth surface and a radial formula to those of all flats,
`estimate` derives numbers and verdict. May import the packages that all procedures share.
"""
