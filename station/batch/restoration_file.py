"""The parameters of a batch's restorations as its procedure file says them: those of `station restore`, by name.

```toml
procedure = "restore"
pairs = { first = "_1", second = "_2" }       # how names end; or { table = "pairs.csv" }, a row of names for each item
[parameters]
blur = "motion"                               # "defocus", "motion", "both"
shape = ["path1.txt", "path2.txt"]            # beside this file
# imu = "{name}.csv"                          # beside each photograph, called as it is
# reference = "{name}_sharp.dng"              # ground truth, beside the first photograph
scheme = "20x(20+20)+5x20"
```
"""

from __future__ import annotations

from typing import Any

from station.calibration.restoration.blur_options import BlurOptions
from station.calibration.restoration.restorations import ENCODINGS, DescentOptions, RestorationOptions
from station.common.toml_table import Table

WORDS = {
    "shape": "shapes", "defocus_shape": "defocus_shapes", "recorded_path": "paths", "imu": "imu", "poses": "poses",
}  # fmt: skip
"""Keys of one text or several, and their options."""
NUMBERS = {
    "ratio": "ratios", "offset": "offsets", "defocus_ratio": "defocus_ratios", "defocus_offset": "defocus_offsets",
    "exposure_s": "exposure_s",
}  # fmt: skip
"""Keys of one number or several, and their options."""
OF_BLUR = {"prototype_region": str, "max_w": float, "focal_px": float, "max_inverse_depth": float}
OF_DESCENT = {
    "image_weight": float, "depth_weight": float, "scheme": str, "depth_start": str, "symmetric_axis": str,
    "total_variation": bool, "depth_total_variation": bool,
}  # fmt: skip
"""Keys of one value each."""
LEAST = 2
"""Photographs of an item."""


def read_restoration(table: Table) -> RestorationOptions:
    """The options that a table tells.

    Raises
    ------
    BadParameter
        If a key is not known, or options do not go together, as the command says it.
    """
    blur: dict[str, Any] = {"blur": table.get("blur", str, "")}
    blur |= {option: _several(table, key, str) for key, option in WORDS.items()}
    blur |= {option: _several(table, key, float) for key, option in NUMBERS.items()}
    blur |= _given(table, OF_BLUR)
    blur["samples_per_pixel"] = table.number_or("samples_per_pixel", "auto", None)
    encoding = table.get("encoding", str, "")
    if encoding and encoding not in ENCODINGS:
        raise table.wrong("encoding", f"is {encoding!r}", f"use one of {', '.join(ENCODINGS)}")
    descent, reference = DescentOptions(**_given(table, OF_DESCENT)), table.get("reference", str, "")
    found = RestorationOptions(BlurOptions(**blur), descent, encoding or None, reference=reference or None)
    table.end()
    found.spread(LEAST).blur.check(LEAST)
    _ = found.descent.parameters  # which says what cannot be meant
    return found


def _given(table: Table, kinds: dict[str, type]) -> dict[str, Any]:
    """The values of keys that are there."""
    return {key: table.get(key, kind, kind()) for key, kind in kinds.items() if table.has(key)}


def _several(table: Table, key: str, kind: type[str] | type[float]) -> tuple[Any, ...]:
    """One value or a list of them; a whole number passes for a number."""
    if not table.has(key):
        return ()
    found = table.peek(key)
    values = found if isinstance(found, list) else [found]
    if kind is float:
        values = [float(one) if type(one) is int else one for one in values]
    if not all(type(one) is kind for one in values):
        raise table.wrong(key, f"must be {'texts' if kind is str else 'numbers'}, one or a list of them")
    return tuple(values)
