"""Who may ask what: the token, and no page of somebody else's in this machine's browser.

Stopping needs no token: whoever sees that something goes wrong may stop it.
"""

from __future__ import annotations

import base64
import binascii
import ipaddress
import secrets
from collections.abc import Iterable
from http.cookies import CookieError, SimpleCookie

from starlette.datastructures import Headers
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from procedures.outcome import BadParameter

COOKIE = "station_token"
SHORTEST = 12
"""Characters of a token that a person chose: fewer are guessed in a day over a local network."""
NAMES_OF_LOOPBACK = frozenset(("localhost", "127.0.0.1", "::1"))


def new_token() -> str:
    """A token that nobody guesses."""
    return secrets.token_urlsafe(16)


def check_token(token: str) -> str:
    """The token, where it will do. Raises BadParameter."""
    if len(token) < SHORTEST or not token.isascii() or not token.isprintable() or " " in token:
        reason = f"a token of {SHORTEST} ASCII characters or more is needed, without spaces; {len(token)} came"
        raise BadParameter(reason, "leave --token out, and one is made")
    return token


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches that address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


class Gate:
    """Lets requests through that may pass.

    Parameters
    ----------
    token : what must be told as `Authorization: Bearer`, as the password of basic authentication, or as a cookie; None
        lets everybody in
    free : paths that need none
    names : by which this server may be called; None for any. A page elsewhere that has its own name lead here is
        turned away by this
    """

    def __init__(
        self, app: ASGIApp, token: str | None, free: Iterable[str], names: frozenset[str] | None = None
    ) -> None:
        self._app, self._token, self._free, self._names = app, token, frozenset(free), names

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""
        refusal = self._refusal(scope) if scope["type"] == "http" else None
        await (refusal or self._app)(scope, receive, send)

    def _refusal(self, scope: Scope) -> JSONResponse | None:
        headers = Headers(scope=scope)
        host, origin = headers.get("host", ""), headers.get("origin")
        if self._names is not None and name_of(host) not in self._names:
            names = " or ".join(sorted(self._names))
            return refused(403, f"this is {names}, and a request to {host!r} came", f"ask for {names}")
        if scope["path"] in self._free:
            return None
        if origin is not None and origin.partition("://")[2] != host:
            return refused(403, f"a page of {origin} asks, which is not this server's", "use this server's own page")
        if self._token is None or any(secrets.compare_digest(self._token.encode(), one) for one in tokens_in(headers)):
            return None
        given = "another one came" if tokens_in(headers) else "none came"
        return refused(
            401,
            f"the token is required, and {given}",
            "send `Authorization: Bearer TOKEN` with the token that `station serve` printed; Alpaca clients give it as "
            "password: any:TOKEN@host:port",
        )


def refused(status: int, reason: str, remedy: str) -> JSONResponse:
    """An answer that says what was required, what came, and what to do."""
    headers = {"WWW-Authenticate": "Bearer"} if status == 401 else None
    return JSONResponse({"reason": reason, "remedy": remedy}, status, headers)


def name_of(host: str) -> str:
    """A Host header without its port and brackets."""
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.partition(":")[0].lower()


def tokens_in(headers: Headers) -> list[bytes]:
    """Every token that a request tells."""
    kind, _, told = headers.get("authorization", "").partition(" ")
    found = []
    if kind.lower() == "bearer":
        found.append(told.strip().encode())
    elif kind.lower() == "basic":
        found.append(_password(told))
    try:
        cookie = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    except CookieError:
        cookie = None
    if cookie is not None:
        found.append(cookie.value.encode())
    return [one for one in found if one]


def _password(told: str) -> bytes:
    try:
        return base64.b64decode(told, validate=True).partition(b":")[2]
    except (binascii.Error, ValueError):
        return b""
