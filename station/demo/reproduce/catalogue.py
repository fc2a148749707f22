"""All rows, and the parts of the papers that cannot be computed here."""

from __future__ import annotations

from station.demo.reproduce import (
    camera_rows,
    gamma_rows,
    photograph_rows,
    rays_rows,
    restoration_rows,
    rival_rows,
    two_photo_rows,
)
from station.demo.reproduce.row import Row

ROWS: tuple[Row, ...] = (
    *gamma_rows.ROWS,
    *rival_rows.ROWS,
    *camera_rows.ROWS,
    *photograph_rows.ROWS,
    *two_photo_rows.ROWS,
    *rays_rows.ROWS,
    *restoration_rows.ROWS,
)
"""In the order of the papers."""

NOT_HERE: tuple[tuple[str, str], ...] = (
    (
        "Thesis, Figures 2.10 to 2.20 and 3.5 to 3.10, as numbers of the Canon EOS 400D",
        "Of its photographs one of the chart and one pair of a wall are published. Other rows simulate the camera.",
    ),
    (
        "Thesis, Figure 2.14",
        "The photographs of the pattern that measures the camera's response are not published; the response is refined"
        " with every PSF.",
    ),
    (
        "Thesis, Figures 1.3, 2.20 and 3.10, the curve of Imatest",
        "A commercial program; our ISO 12233 slanted edge replaces it.",
    ),
    (
        "Thesis, Figures 3.7 and 3.8, the photographs of a concrete wall and of a magazine",
        "Not published. The zooms are computed from a simulated and from the published wall.",
    ),
    (
        "Thesis, Tables 4.1 to 4.3 and Figures 4.3 to 4.19 but the Cornell box",
        "Films with histograms of these scenes are not published, other numbers of bins need the samples themselves,"
        " and ASR is another group's program.",
    ),
    (
        "Sorel 2007, chapter 11",
        "The photographs and the recorded motions are not published.",
    ),
)
"""(place, reason)."""
