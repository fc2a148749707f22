"""Every colour that is drawn or printed: in figures, on pages and certificates, in terminals. Figures have a softer ink
than text, which is read at smaller sizes."""

INK, FAINT = "#2b3036", "#9aa3ad"
MARK = "#ff8c1a"
ALONG = {"horizontal": "#1f5fa8", "vertical": "#c4541a"}
LIMIT_COLOUR = "#6b4c9a"
PLANE_COLOURS = {"R": "#c0392b", "G1": "#1e8449", "G2": "#7dbb42", "B": "#2e6fbf", "Y": "#444444"}
SERIES = (INK, *ALONG.values(), PLANE_COLOURS["G1"], "#8e44ad", "#b8860b")
"""Curves of one frame, the first of which is drawn first."""

TEXT, SOFT = "#1d2329", "#59636e"
RULE, FAINT_RULE = "#dfe3e8", "#eef0f2"
PAPER, GROUND = "#ffffff", "#f4f6f8"
LINK = ALONG["horizontal"]
PASS, DOUBTFUL, REFUSED = "#1a7f4b", "#a86400", "#b3261e"
VERDICT_COLOURS = {
    **dict.fromkeys(("pass", "meets"), PASS),
    **dict.fromkeys(("doubtful", "undecided"), DOUBTFUL),
    **dict.fromkeys(("refused", "fail", "does not meet"), REFUSED),
}

TERMINAL_COLOURS = {
    **dict.fromkeys(("pass", "reproduced"), "green"),
    **dict.fromkeys(("doubtful", "same direction", "not computed"), "yellow"),
    **dict.fromkeys(("refused", "fail", "not reproduced"), "red"),
}
MARK_TEXT, MARK_GROUND = "black", "yellow"
PRESENT_LINE, WANTED_LINE = "rgb(230,126,34)", "rgb(52,172,224)"
"""Outlines of a pose on a terminal: as it is, and as it is wanted."""
