"""Two ways to one number: the PSF of the noise chart, and the chart's own slanted edges, from one frame.

Stands over the rooms it compares (`pattern_psf`, `slanted_edge`). `estimate` is the verb.
"""
