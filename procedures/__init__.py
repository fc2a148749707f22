"""What is computed: arrays become results. No terminal and no port; files only in `raw` and `pattern_print`.

Rooms stand side by side (`pattern_psf`, ...) over what they share (`quality`, `raw`, `psf`, `pattern`,
`outcome`), over `numerics`, which is mathematics without cameras. A new room is a package whose verb is in
`estimate.py`; add it to the contract in `pyproject.toml`.
"""
