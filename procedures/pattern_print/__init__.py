"""Printing of the chart with the geometry of `pattern`: PDF and SVG in exact millimetres, PNG and PGM in pixels.

`source` has the cells and their origin, `outline` converts them to one path, `caption` and `sheet` lay out the page on
a `paper`, `tiles` and `tile_sheets` divide it into several sheets preceded by the page of `assembly`, `vector` and
`raster` encode it, `formats` selects the encoder by the file's suffix. Results are bytes. May import `pattern` and
`outcome`; reportlab is imported only here.
"""
