"""Samples of a sensor, row by row without a header or as a grey picture, whose layout is given separately."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procedures.outcome import BadInput, BadParameter
from procedures.reading.grey_image import read_grey

Samples = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

MONOCHROME = "Y"
ORDERS = ("RGGB", "BGGR", "GRBG", "GBRG", MONOCHROME)
"""Colours of the first two pixels of the first two rows, or Y for a sensor without a mosaic."""
KINDS = {"u8": "u1", "u16le": "<u2", "u16be": ">u2"}
"""NumPy's name for each kind of sample: 8 bit, or 16 bit with the low (le) or the high (be) byte first."""
PICTURE = "picture"
"""Kind of the samples in a grey PGM, PNG or TIFF, which states their size."""
EXAMPLE = "1920x1080,RGGB,u16le,64,1023"
_FORM = f"give WIDTHxHEIGHT,ORDER,KIND,BLACK,WHITE, as {EXAMPLE}, or ORDER,BLACK,WHITE of a grey picture"


@dataclass(frozen=True)
class DumpLayout:
    """Layout of a sensor's samples in a file.

    columns, rows : int, size of the frame; 0 for a picture
    order : one of ORDERS
    kind : one of KINDS, or PICTURE
    black, white : int, digital numbers of darkness and saturation
    """

    columns: int
    rows: int
    order: str
    kind: str
    black: int
    white: int

    @classmethod
    def parse(cls, text: str) -> "DumpLayout":
        """Parse WIDTHxHEIGHT,ORDER,KIND,BLACK,WHITE, or ORDER,BLACK,WHITE. Raises BadParameter."""
        words = [word.strip() for word in text.split(",")]
        if len(words) not in (3, 5):
            raise BadParameter(f"the layout of a sensor's samples must have five or three parts; got {text!r}", _FORM)
        columns = rows = 0
        kind = PICTURE
        if len(words) == 5:
            width, _, height = words.pop(0).lower().partition("x")
            columns, rows = _whole("width", width), _whole("height", height)
            kind = _one_of("kind of sample", words.pop(1).lower(), tuple(KINDS))
        order, black, white = words
        layout = cls(
            columns, rows, _one_of("order of colours", order.upper(), ORDERS), kind,
            _whole("black", black), _whole("white", white),
        )  # fmt: skip
        layout._check()
        return layout

    def _check(self) -> None:
        if self.kind != PICTURE and min(self.columns, self.rows) < 2:
            raise BadParameter(f"a frame must have at least 2 x 2 pixels; got {self.columns} x {self.rows}", _FORM)
        largest = int(np.iinfo(KINDS.get(self.kind, "u2")).max)
        if not self.black < self.white <= largest:
            requirement = f"black must be below white, and white at most {largest} for {self.kind}"
            raise BadParameter(
                f"{requirement}; got {self.black} and {self.white}", "give both as digital numbers of the file"
            )

    def __str__(self) -> str:
        levels = f"{self.black},{self.white}"
        if self.kind == PICTURE:
            return f"{self.order},{levels}"
        return f"{self.columns}x{self.rows},{self.order},{self.kind},{levels}"

    def read(self, data: bytes, name: str) -> Samples:
        """Samples (rows, columns).

        Raises BadInput if a dump has another size, a picture is not grey, or samples have more bits than white.
        """
        levels = read_grey(data, name)[0] if self.kind == PICTURE else self._dumped(data, name)
        most = (1 << self.white.bit_length()) - 1
        if levels.max() > most:
            reason = f"with a white of {self.white} samples must be at most {most}; {name} has {levels.max()}"
            raise BadInput(reason, "check the white level, and the byte order (u16le, u16be) of a dump")
        return levels

    def _dumped(self, data: bytes, name: str) -> Samples:
        kind = np.dtype(KINDS[self.kind])
        needed = self.columns * self.rows * kind.itemsize
        if len(data) != needed:
            size = f"{self.columns} x {self.rows} samples of {self.kind}"
            reason = f"a dump of {size} must have {needed} bytes; {name} has {len(data)}"
            raise BadInput(reason, "give the size and kind of the samples, and remove any header from the file")
        return np.frombuffer(data, kind).reshape(self.rows, self.columns)

    def first_pixels(self) -> dict[str, tuple[int, int]]:
        """(row, column) of each plane's first pixel: R, G1 (on the red rows), G2 and B, or Y."""
        if self.order == MONOCHROME:
            return {MONOCHROME: (0, 0)}
        row, column = divmod(self.order.index("R"), 2)
        return {"R": (row, column), "G1": (row, 1 - column), "G2": (1 - row, column), "B": (1 - row, 1 - column)}


def _whole(what: str, word: str) -> int:
    if not (word.isascii() and word.isdigit()):
        raise BadParameter(f"the {what} of a sensor's samples must be a whole number; got {word!r}", _FORM)
    return int(word)


def _one_of(what: str, word: str, known: tuple[str, ...]) -> str:
    if word not in known:
        raise BadParameter(f"the {what} of a sensor's samples must be one of {', '.join(known)}; got {word!r}", _FORM)
    return word


# first bytes of the RAW containers that LibRaw reads: dialects of TIFF (also Panasonic, Olympus, Phase One), CRW
_DIALECTS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+", b"IIU\0", b"IIRO", b"IIRS", b"MMOR", b"II\x1a\0", b"IIII", b"MMMM")
# RAF, X3F, MRW, Arri, Cine, Sinar, Rollei, Logitech, QuickTake
_MAGIC = (b"FUJIFILM", b"FOVb", b"\0MRM", b"ARRI", b"CI,\0", b"PWAD", b"DSC-Image", b"PXN\0", b"qktk", b"qktn")
# at an offset: CR3, Redcode, Nokia, Contax
_AT_OFFSET: tuple[tuple[int, bytes], ...] = ((4, b"ftypcrx"), (4, b"RED"), (0, b"NOKIARAW"), (25, b"ARECOYK"))


def has_raw_header(head: bytes) -> bool:
    """Whether a file's head is that of a RAW format; LibRaw identifies others by their size as those of old cameras."""
    return head.startswith(_DIALECTS + _MAGIC) or any(head[at:].startswith(magic) for at, magic in _AT_OFFSET)
