"""Parse what an operator types into an answer, and format facts."""

import math
from decimal import Decimal

from procedures.plan import Ask, Fact

YES, NO = ("y", "yes", "ok", "done", "true"), ("n", "no", "false")


def parse(ask: Ask, text: str) -> Fact:
    """The answer in a line of text, empty for the default. Raises ValueError with the requirement if invalid."""
    text = text.strip()
    if not text and ask.default is not None:
        return ask.default
    match ask.kind:
        case "confirm":
            if not text or text.lower() in YES:
                return True
            if text.lower() in NO:
                return False
            raise ValueError("Press Enter when done; n if it cannot be done; s to stop.")
        case "number":
            try:
                value = float(text.replace(",", ".").removesuffix(ask.unit).strip())
            except ValueError as error:
                raise ValueError(f"Type a number{f' in {ask.unit}' if ask.unit else ''}.") from error
            low, high = -math.inf if ask.low is None else ask.low, math.inf if ask.high is None else ask.high
            if not low <= value <= high:
                raise ValueError(f"It must lie between {plain(low)} and {plain(high)} {ask.unit}.".replace(" .", "."))
            return value
        case "choice":
            if text.isdigit() and 1 <= int(text) <= len(ask.choices):
                return ask.choices[int(text) - 1]
            matches = [choice for choice in ask.choices if text and choice.lower().startswith(text.lower())]
            if len(matches) != 1:
                raise ValueError(f"Type one of: {', '.join(ask.choices)}.")
            return matches[0]
        case "text":
            if not text:
                raise ValueError("Type some text.")
            return text


def words(fact: Fact | None, unit: str = "") -> str:
    """A fact as text."""
    if fact is None:
        return ""
    if isinstance(fact, bool):
        return "yes" if fact else "no"
    return f"{plain(fact)} {unit}".strip() if isinstance(fact, float | int) else fact


def plain(value: float) -> str:
    """A number in six digits, an integer in all of its digits, without an exponent: 0.00001, 5.94, 9007199254740992."""
    digits = f"{value:.6g}" if value != round(value) else f"{value:.17g}"
    return f"{Decimal(digits).normalize():f}" if math.isfinite(value) else digits
