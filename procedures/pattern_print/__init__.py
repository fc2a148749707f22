"""Printing of the chart with the geometry of `pattern`: PDF and SVG in exact millimetres, PNG and PGM in pixels.

`source` has the cells and their origin, `sheet` and `panel` lay out the page with its caption, `tile_sheets` divides a
large chart into several sheets, `formats` encodes it by the file's suffix, `distance` gives the distance to photograph
it from. Results are bytes. Reportlab is imported only here.
"""
