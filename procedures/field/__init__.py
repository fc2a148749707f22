"""The PSF over the whole frame: charts at many places, the field between them, the maps drawn from it, its file.

May import `pattern_psf` (a node is one of its estimates) and what all rooms share; no terminal, no port. A new way to
interpolate is a model in `models.py` and a recipe in `interpolate.py`; a new map is a function in `maps.py`.
"""
