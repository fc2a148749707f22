"""Vignetting of lens and sensor, by plane, from photographs of even light (flats).

`surface` fits a smooth surface and a radial formula to the cells of all flats, `estimate` derives numbers and
verdict. May import the packages that all procedures share.
"""
