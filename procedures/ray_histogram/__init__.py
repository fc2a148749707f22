"""Ray Histogram Fusion: pixels with similar sample distributions are averaged (Delbracio's thesis, chapter 4).

`film` gathers samples as a renderer casts them, `film_files` stores films, `filter` is Algorithm 1, `multiscale`
Algorithm 2 and the API for whole films, `sequence` that for sequences. `blend` combines candidates by cross-validation,
`render_files` reads renders as two halves. `uncertainty` estimates the error of a filtered picture, `adaptive`
distributes further samples, `kernels` holds the loops. Samples come as arrays from any renderer.
"""
