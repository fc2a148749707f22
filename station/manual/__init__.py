"""The manual: Markdown pages by part, read in the terminal and in a browser that is offline.

A page is one file in `tutorial/`, `how-to/`, `reference/` or `explanation/`; a new file is a new topic, nothing else
lists it. Its first line is its title. A block fenced as `sh run` is run by the tests, with `slow` or `nightly` behind
it by those marked so, with the files that `tests/station/manual/conftest.py` makes. May import the reports' pages, in
whose style it is written; the command line hands its own commands down for their reference.
"""
