"""All rows, and what of the papers cannot be computed here."""

from __future__ import annotations

from station.reproduce import camera_rows, gamma_rows, rival_rows, two_photo_rows
from station.reproduce.row import Row

ROWS: tuple[Row, ...] = (*gamma_rows.ROWS, *camera_rows.ROWS, *rival_rows.ROWS, *two_photo_rows.ROWS)
"""In the order of the papers."""

NOT_HERE: tuple[tuple[str, str], ...] = ()
