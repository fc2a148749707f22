"""What the operator typed becomes the answer a question asks for, or a sentence that says what is wanted."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from procedures.plan import Ask, Fact


class NotAnAnswer(Exception):
    """What was typed does not answer the question; the text says what would."""


def read_answer(ask: Ask, text: str) -> Fact:
    """The answer of the kind asked for; nothing typed is the default. Raises NotAnAnswer."""
    text = text.strip()
    if ask.kind == "confirm":
        return True
    if not text and ask.default is not None:
        return ask.default
    if ask.kind == "number":
        return _number(ask, text)
    if ask.kind == "choice" and text not in ask.choices:
        raise NotAnAnswer(f"one of {', '.join(ask.choices)} is wanted")
    if not text:
        raise NotAnAnswer("a few words are wanted")
    return text


def _number(ask: Ask, text: str) -> float:
    try:
        value = float(text.removesuffix(ask.unit).strip().replace(",", "."))
    except ValueError:
        value = math.nan
    low, high = -math.inf if ask.low is None else ask.low, math.inf if ask.high is None else ask.high
    if not (math.isfinite(value) and low <= value <= high):
        raise NotAnAnswer(wanted(ask))
    return value


def wanted(ask: Ask) -> str:
    """The kind of answer, in words: "a number from 50 to 2000 mm"."""
    if ask.kind != "number":
        return ""
    limits = {
        (True, True): f" from {ask.low} to {ask.high}",
        (True, False): f" of at least {ask.low}",
        (False, True): f" of at most {ask.high}",
        (False, False): "",
    }[ask.low is not None, ask.high is not None]
    return f"a number{limits} {ask.unit}".rstrip()
