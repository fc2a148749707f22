"""The chart on paper: the same geometry as `pattern`, as PDF and SVG in exact millimetres, as PNG and PGM in pixels.

`source` says which cells and where they came from, `outline` turns them into one path, `caption` and `sheet` lay out
the page on a `paper`, `tiles` and `tile_sheets` spread it over several with the page of `assembly` before them,
`vector` and `raster` write it, `formats` chooses by the file's ending. Everything is returned as bytes; whoever asked
writes them. May import `pattern` and `outcome`; reportlab is imported only here.
"""
