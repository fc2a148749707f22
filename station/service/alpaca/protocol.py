"""Errors, parameters and images as the standard transmits them: ImageBytes version 1, its errors by number."""

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from urllib.parse import parse_qsl

import numpy as np
import numpy.typing as npt

from drivers.errors import BadConfiguration, DeviceError, Held, LineLost, NotConnected, NotHomed, OutsideTravel
from drivers.interfaces import FrameFormat
from procedures.outcome import ProcedureError
from procedures.raw import Plane
from station.bench.opening import frame_format
from station.service.tenancy import InUse

NOT_IMPLEMENTED, INVALID_VALUE, VALUE_NOT_SET, NOT_CONNECTED = 0x400, 0x401, 0x402, 0x407
INVALID_OPERATION, ACTION_NOT_IMPLEMENTED, DRIVER = 0x40B, 0x40C, 0x500
HELD = 0x501
"""The driver's own error number of a stage that a person has paused: the action Resume continues."""
KINDS: tuple[tuple[type[Exception], int], ...] = (
    (OutsideTravel, INVALID_VALUE), (BadConfiguration, INVALID_VALUE), (NotHomed, INVALID_OPERATION),
    (InUse, INVALID_OPERATION), (LineLost, NOT_CONNECTED), (NotConnected, NOT_CONNECTED), (Held, HELD),
)  # fmt: skip
"""Errors for which the standard has a number; all others are the driver's own."""


class AlpacaError(Exception):
    """An answer with an error number, and what was required, what was received, the remedy."""

    def __init__(self, number: int, message: str) -> None:
        super().__init__(message)
        self.number, self.message = number, message


class BadRequest(Exception):
    """A request outside this interface: an unknown device or member, a missing or invalid parameter."""


def as_alpaca(error: Exception) -> AlpacaError:
    """Convert an error to the standard's form."""
    if isinstance(error, AlpacaError):
        return error
    number = next((number for kind, number in KINDS if isinstance(error, kind)), DRIVER)
    if isinstance(error, Held):
        return AlpacaError(number, f"{error.reason}; {error.remedy}: the action Resume continues it")
    if isinstance(error, DeviceError | ProcedureError):
        return AlpacaError(number, f"{error.reason}; {error.remedy}")
    return AlpacaError(number, f"{type(error).__name__}: {error}")


LARGEST_ID = 2**32 - 1


@dataclass(frozen=True)
class Parameters:
    """The parameters of a request. A missing or invalid one raises BadRequest."""

    given: Mapping[str, str]
    any_case: bool

    @staticmethod
    def of_query(text: str) -> "Parameters":
        return Parameters({name.lower(): value for name, value in parse_qsl(text, keep_blank_values=True)}, True)

    @staticmethod
    def of_form(data: bytes) -> "Parameters":
        return Parameters(dict(parse_qsl(data.decode("utf-8", "replace"), keep_blank_values=True)), False)

    def text(self, name: str) -> str:
        """The value as sent."""
        value = self.given.get(name.lower() if self.any_case else name)
        if value is None:
            raise BadRequest(f"the parameter {name} is required; received {', '.join(self.given) or 'none'}")
        return value

    def whole(self, name: str) -> int:
        """An integer."""
        text = self.text(name).strip()
        if len(text) > 12 or not text.removeprefix("-").isascii() or not text.removeprefix("-").isdigit():
            raise BadRequest(f"{name} must be a whole number; got {text[:40]!r}")
        return int(text)

    def number(self, name: str) -> float:
        """A finite number."""
        text = self.text(name).strip()
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise BadRequest(f"{name} must be a number; got {text[:40]!r}")
        return value

    def flag(self, name: str) -> bool:
        """True or False, case-insensitive."""
        text = self.text(name).strip().lower()
        if text not in ("true", "false"):
            raise BadRequest(f"{name} must be True or False; got {text[:40]!r}")
        return text == "true"

    def client(self) -> int:
        """The client's number, 0 if not given."""
        return self._identity("ClientID")

    def transaction(self) -> int:
        """The client's number of this request, 0 if not given."""
        self.client()
        return self._identity("ClientTransactionID")

    def _identity(self, name: str) -> int:
        if (name.lower() if self.any_case else name) not in self.given:
            return 0
        value = self.whole(name)
        if not 0 <= value <= LARGEST_ID:
            raise BadRequest(f"{name} must be between 0 and {LARGEST_ID}; got {value}")
        return value


Mosaic = npt.NDArray[np.uint16]
BYTES = "application/imagebytes"
HEADER = struct.Struct("<11i")
INT32, UINT16 = 2, 8
"""Element types of the standard: of the numbers, and of their transmission."""


def sensor_image(planes: Sequence[Plane]) -> Mosaic:
    """Reassemble the planes of a photograph to the sensor's mosaic."""
    form = frame_format(planes)
    mosaic = np.zeros((form.rows, form.columns), np.uint16)
    for plane in planes:
        x, y = plane.origin
        scaled = plane.samples.astype(np.float64) * (plane.white - plane.black) + plane.black
        mosaic[y :: plane.pitch, x :: plane.pitch] = np.clip(np.rint(scaled), 0, np.iinfo(np.uint16).max).astype(
            np.uint16
        )
    return mosaic


def first_red(form: FrameFormat) -> tuple[int, int] | None:
    """The first red pixel (x, y); None for a monochrome sensor."""
    if form.cfa is None:
        return None
    y, x = divmod(form.cfa.index("R"), 2)
    return x, y


def image_bytes(levels: Mosaic, client: int, server: int) -> bytes:
    """The numbers as bytes: a header of eleven words, then column by column, two bytes each."""
    rows, columns = levels.shape
    head = HEADER.pack(1, 0, _signed(client), _signed(server), HEADER.size, INT32, UINT16, 2, columns, rows, 0)
    return head + np.ascontiguousarray(levels.T, dtype="<u2").tobytes()


def _signed(number: int) -> int:
    """Reinterpret 32 bits as a signed integer."""
    return number - 2**32 if number >= 2**31 else number
