"""What an Alpaca device cannot do, by the standard's numbers; a request that is none is an HTTP error."""

from __future__ import annotations

from drivers.errors import BadConfiguration, DeviceError, LineLost, NotConnected, NotHomed, OutsideTravel
from procedures.outcome import ProcedureError
from station.service.tenancy import InUse

NOT_IMPLEMENTED, INVALID_VALUE, VALUE_NOT_SET, NOT_CONNECTED = 0x400, 0x401, 0x402, 0x407
INVALID_OPERATION, ACTION_NOT_IMPLEMENTED, DRIVER = 0x40B, 0x40C, 0x500
KINDS: tuple[tuple[type[Exception], int], ...] = (
    (OutsideTravel, INVALID_VALUE),
    (BadConfiguration, INVALID_VALUE),
    (NotHomed, INVALID_OPERATION),
    (InUse, INVALID_OPERATION),
    (LineLost, NOT_CONNECTED),
    (NotConnected, NOT_CONNECTED),
)
"""Errors of ours that the standard has a number for; all others are the driver's own."""


class AlpacaError(Exception):
    """An answer with an error number, and what was required, what came, what to do."""

    def __init__(self, number: int, message: str) -> None:
        super().__init__(message)
        self.number, self.message = number, message


class BadRequest(Exception):
    """No request that this interface has: an unknown device or member, a parameter that is missing or unreadable."""


def as_alpaca(error: Exception) -> AlpacaError:
    """An error as the standard tells it."""
    if isinstance(error, AlpacaError):
        return error
    number = next((number for kind, number in KINDS if isinstance(error, kind)), DRIVER)
    if isinstance(error, DeviceError | ProcedureError):
        return AlpacaError(number, f"{error.reason}; {error.remedy}")
    return AlpacaError(number, f"{type(error).__name__}: {error}")
