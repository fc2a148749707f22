"""ASCII drawings of the steps in `steps.txt`, each below its name, shown until there is a photograph.

Each fits into 52 columns and 11 lines, the free space of a terminal of 80 x 24 next to the list of steps.
"""

import re
from importlib.resources import files

_PARTS = re.split(r"^\[([A-Z]+)\]\n", files(__package__).joinpath("steps.txt").read_text("utf-8"), flags=re.MULTILINE)
DRAWINGS = {name: text.strip("\n") for name, text in zip(_PARTS[1::2], _PARTS[2::2], strict=True)}


def __getattr__(name: str) -> str:
    """The drawing of that name."""
    if name not in DRAWINGS:
        raise AttributeError(name)
    return DRAWINGS[name]
