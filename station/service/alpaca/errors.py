"""Errors of Alpaca devices, by the standard's numbers; an invalid request is an HTTP error."""

from drivers.errors import BadConfiguration, DeviceError, Held, LineLost, NotConnected, NotHomed, OutsideTravel
from procedures.outcome import ProcedureError
from station.service.tenancy import InUse

NOT_IMPLEMENTED, INVALID_VALUE, VALUE_NOT_SET, NOT_CONNECTED = 0x400, 0x401, 0x402, 0x407
INVALID_OPERATION, ACTION_NOT_IMPLEMENTED, DRIVER = 0x40B, 0x40C, 0x500
HELD = 0x501
"""The driver's own error number of a stage that a person has paused: the action Resume continues."""
KINDS: tuple[tuple[type[Exception], int], ...] = (
    (OutsideTravel, INVALID_VALUE),
    (BadConfiguration, INVALID_VALUE),
    (NotHomed, INVALID_OPERATION),
    (InUse, INVALID_OPERATION),
    (LineLost, NOT_CONNECTED),
    (NotConnected, NOT_CONNECTED),
    (Held, HELD),
)
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
