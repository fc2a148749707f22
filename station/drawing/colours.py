"""All colours of figures, pages, certificates and terminals.

The ink of figures is softer than that of text, which is smaller.
"""

from __future__ import annotations

# --- figures -----------------------------------------------------------------------------------------------------

INK, FAINT = "#2b3036", "#9aa3ad"
MARK = "#ff8c1a"
"""Of detected features in a picture."""
ALONG = {"horizontal": "#1f5fa8", "vertical": "#c4541a"}
LIMIT_COLOUR = "#6b4c9a"
"""Of the diffraction limit."""
PLANE_COLOURS = {"R": "#c0392b", "G1": "#1e8449", "G2": "#7dbb42", "B": "#2e6fbf", "Y": "#444444"}
SERIES = (INK, *ALONG.values(), PLANE_COLOURS["G1"], "#8e44ad", "#b8860b")
"""Of the curves of one frame, in order."""

# --- text --------------------------------------------------------------------------------------------------------

TEXT, SOFT = "#1d2329", "#59636e"
RULE, FAINT_RULE = "#dfe3e8", "#eef0f2"
"""Of rules, and of those between the rows of a table."""
PAPER, GROUND = "#ffffff", "#f4f6f8"
"""Of pages, and of their background."""
LINK = ALONG["horizontal"]
PASS, DOUBTFUL, REFUSED = "#1a7f4b", "#a86400", "#b3261e"
VERDICT_COLOURS = {
    **dict.fromkeys(("pass", "meets"), PASS),
    **dict.fromkeys(("doubtful", "undecided"), DOUBTFUL),
    **dict.fromkeys(("refused", "fail", "does not meet"), REFUSED),
}
"""Of the verdicts on measurements and specifications."""

# --- terminals ---------------------------------------------------------------------------------------------------

TERMINAL_COLOURS = {"pass": "green", "doubtful": "yellow", "left out": "yellow", "refused": "red", "fail": "red"}
"""Names of terminal colours by verdict."""
MARK_TEXT, MARK_GROUND = "black", "yellow"
"""Of a mark in a thumbnail, and of its background."""
