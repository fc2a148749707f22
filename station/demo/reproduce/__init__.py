"""The papers' tables and figures, computed again: each is one row of a page, the published values next to ours.

`row` defines a row, `runner` computes rows, `page` shows them, `catalogue` lists them. The modules `*_rows` hold one
chapter each; `patterns`, `rivals`, `cameras` and `scenes` are used by them only.
To add a row, append a `Row` to the tuple at the end of its chapter's module.
May import simulators, procedures and the station's pages; imported by the command only.
"""
