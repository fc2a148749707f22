"""PSF over the whole frame: charts at many positions, interpolation between them, derived maps, file format.

May import `pattern_psf` (a node is one of its estimates) and the packages that all procedures share; no terminal, no
port. A new interpolation is a model in `models.py` and a recipe in `interpolate.py`; a new map is a function in
`maps.py`.
"""
