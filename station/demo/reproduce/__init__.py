"""The papers' tables and figures, computed again: each one row of one page, what was published beside what we get.

`row` says what a row is, `runner` computes them, `page` shows them, `catalogue` lists them; the modules `*_rows` hold
one chapter each, with what exists only for them: `patterns` (calibration patterns as functions, and their gamma),
`rivals` (the methods that the papers compare with), `cameras` and `scenes` (what was photographed).
A further row is a `Row` in the tuple at the end of its chapter's module.
May import simulators, procedures and the station's pages; nothing but the command imports it.
"""
