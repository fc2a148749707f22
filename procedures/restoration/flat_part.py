"""The part of a scene at one distance: as marked by the operator, or candidates for it."""

from collections.abc import Iterator
from typing import Literal

import cv2

from procedures.outcome import BadParameter
from procedures.restoration.masks.blur_operator import Array

Box = tuple[int, int, int, int]
"""x, y, width and height, pixels."""
Whole = Literal["whole"]
"""The whole frame is at one distance."""

DETAIL_PX = 8.0
"""Scale of a scene's detail; larger variations are shading."""
CANDIDATES = 4
"""Number of parts of the picture that are tried as the one at a single depth, where none was marked."""


def region_of(text: str) -> Box | Whole | None:
    """The marked part x,y,width,height in pixels; None for auto. Raises BadParameter."""
    word = text.strip().lower()
    if word == "auto":
        return None
    if word == "whole":
        return "whole"
    try:
        x, y, width, height = (int(part) for part in text.split(","))
    except ValueError as error:
        raise BadParameter(
            f"a part is X,Y,W,H in pixels, auto or whole; got {text!r}", "give four whole numbers with commas between"
        ) from error
    return x, y, width, height


def check_region(region: Box, shape: tuple[int, int]) -> None:
    """Refuse a part outside photographs of given height and width. Raises BadParameter."""
    x, y, width, height = region
    if not (0 <= x < x + width <= shape[1] and 0 <= y < y + height <= shape[0]):
        raise BadParameter(
            f"the part {x},{y},{width},{height} must lie within photographs of {shape[1]} x {shape[0]}",
            "mark one inside them",
        )


def parts(picture: Array, side: int) -> Iterator[Box]:
    """Squares with most detail, the best first, none overlapping another by more than half."""
    rows, columns = picture.shape
    side = min(side, rows, columns)
    fine = (picture - cv2.GaussianBlur(picture, (0, 0), DETAIL_PX)) ** 2
    places = [(x, y) for y in range(0, rows - side + 1, side // 2) for x in range(0, columns - side + 1, side // 2)]
    places.sort(key=lambda place: -float(fine[place[1] : place[1] + side, place[0] : place[0] + side].mean()))
    for x, y in places[:CANDIDATES]:
        yield x, y, side, side
