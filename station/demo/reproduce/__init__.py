"""The papers' tables and figures, computed again: each is one row of a page, the published values next to ours.

`row` defines a row, `runner` computes rows, writes page and record, `catalogue` lists them. The modules `*_rows` hold
one chapter each; `patterns`, `cameras` and `scenes` are used by them only. To add a row, decorate a function with its
chapter's `row`: name and docstring are the row's.
May import simulators, procedures and the station's pages; imported by the command only.
"""
