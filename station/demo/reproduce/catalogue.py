"""All rows in the order of the papers, and the parts of the papers that cannot be computed here: `rows.toml`."""

import tomllib
from importlib.resources import files

from station.demo.reproduce.data_files import PublishedFile
from station.demo.reproduce.row import Row, read_row

_TABLES = tomllib.loads(files(__package__).joinpath("rows.toml").read_text("utf-8"))
ROWS: tuple[Row, ...] = tuple(read_row(name, table) for name, table in _TABLES["rows"].items())
NOT_HERE: tuple[tuple[str, str], ...] = tuple((one["place"], one["reason"]) for one in _TABLES["not_here"])
"""(place, reason)."""
PUBLISHED_FILES = tuple(PublishedFile(**one) for one in _TABLES["files"])
