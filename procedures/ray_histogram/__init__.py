"""Ray Histogram Fusion: pixels whose samples are distributed alike share them (Delbracio's thesis, chapter 4).

`film` gathers samples as a renderer casts them, `film_files` keeps films, `filter` is Algorithm 1, `multiscale`
Algorithm 2 and the door for whole films, `sequence` that for sequences; `uncertainty` says how far a filtered picture
may be off, `adaptive` where to cast more; `kernels` holds the loops.
Nothing here knows a renderer: whoever casts samples hands them over as arrays.
"""
