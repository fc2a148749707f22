"""FITS files, as much of them as PSFs need: images and a table of one row. FITS standard 4.0, sections 3, 4 and 7."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.floating[Any]]
Cards = list[tuple[str, object]]
"""Names and values of a header, in their order."""

BLOCK = 2880
CARD = 80
LONGEST_TEXT = 34
"""Letters of a value: even if all of them are quotes, which are doubled, they fit into a card."""


def primary_image(data: Floats, cards: Cards) -> bytes:
    """An image as the file's first unit; float32 or float64 as the data are."""
    return _unit([("SIMPLE", True), *_size(data), *cards], _bytes(data))


def image_extension(data: Floats, cards: Cards) -> bytes:
    """An image as a further unit."""
    return _unit([("XTENSION", "IMAGE"), *_size(data), ("PCOUNT", 0), ("GCOUNT", 1), *cards], _bytes(data))


def table_of_one_cube(name: str, cube: npt.NDArray[np.float32], cards: Cards) -> bytes:
    """A file of a binary table with one column and one row, which holds an array of three axes."""
    axes = ",".join(str(n) for n in cube.shape[::-1])
    width = cube.size * 4
    head: Cards = [
        ("XTENSION", "BINTABLE"), ("BITPIX", 8), ("NAXIS", 2), ("NAXIS1", width), ("NAXIS2", 1), ("PCOUNT", 0),
        ("GCOUNT", 1), ("TFIELDS", 1), ("TTYPE1", name), ("TFORM1", f"{cube.size}E"), ("TDIM1", f"({axes})"),
    ]  # fmt: skip
    empty = _unit([("SIMPLE", True), ("BITPIX", 8), ("NAXIS", 0), ("EXTEND", True)], b"")
    return empty + _unit([*head, *cards], _bytes(cube))


def _size(data: Floats) -> Cards:
    axes: Cards = [(f"NAXIS{i}", n) for i, n in enumerate(data.shape[::-1], 1)]
    return [("BITPIX", -8 * data.itemsize), ("NAXIS", data.ndim), *axes]


def _bytes(data: Floats) -> bytes:
    return data.astype(data.dtype.newbyteorder(">")).tobytes()


def _unit(cards: Cards, data: bytes) -> bytes:
    """A header and its data, each filled up to whole blocks."""
    header = "".join(_card(name, value) for name, value in cards) + "END".ljust(CARD)
    return _filled(header.encode("ascii"), b" ") + _filled(data, b"\0")


def _card(name: str, value: object) -> str:
    if name == "COMMENT":
        return f"{name:<8}{value}".ljust(CARD)[:CARD]
    if isinstance(value, bool):
        text = f"{'T' if value else 'F':>20}"
    elif isinstance(value, str):
        text = "'" + _plain(value).replace("'", "''").ljust(8) + "'"
    else:
        text = f"{value!r:>20}".upper()  # the standard knows the exponents E and D, no small e
    return f"{name:<8}= {text}".ljust(CARD)[:CARD]


def _plain(text: str) -> str:
    """Letters that a header takes, as many as have room in a card."""
    return "".join(one if " " <= one <= "~" else "?" for one in text)[:LONGEST_TEXT]


def _filled(data: bytes, filling: bytes) -> bytes:
    return data + filling * (-len(data) % BLOCK)
