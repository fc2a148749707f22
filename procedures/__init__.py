"""Computation: from arrays to results. No terminal and no device; files only in `raw` and `pattern_print`.

Packages such as `pattern_psf` are independent of each other. They share `quality`, `raw`, `psf`, `pattern` and
`outcome`, and below these `numerics`, which is mathematics without cameras. A new package has its main function in
`estimate.py`; add it to the contract in `pyproject.toml`.

The public API for scripts and notebooks is in `__init__.pyi`, stable between releases; other names may move. Each name
is loaded on first use, to keep imports fast.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
