"""The parameters of a request: names are case-insensitive in a query, case-sensitive in a form (the standard, 2.2)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from urllib.parse import parse_qsl

from station.service.alpaca.errors import BadRequest

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
