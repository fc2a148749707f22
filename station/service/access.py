"""Who may ask what: the token, and no web page but this server's own.

Stopping needs no token: whoever sees that something goes wrong may stop it. A web page is another matter: what a
browser sends for a page of another site is refused, the stop too, as nobody at the bench has asked for it.
"""

from __future__ import annotations

import base64
import binascii
import ipaddress
import secrets
import socket
from http.cookies import CookieError, SimpleCookie

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from procedures.outcome import BadParameter

COOKIE = "station_token"
SHORTEST = 12
"""Characters of a token that a person chose: fewer are guessed in a day over a local network."""
NAMES_OF_LOOPBACK = frozenset(("localhost", "127.0.0.1", "::1"))
API = "/station/v1"
STOP = "/stop"
FREE = ("/", API + STOP)
"""What needs no token: the page, which shows nothing without it, and the stop."""
SEALED = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'"
"""The policy of every answer that has none of its own: reports and other files of sessions run no script, and are not
pages of this server to a browser."""


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
    return ipaddress.ip_address(host).is_loopback if is_address(host) else host == "localhost"


def is_address(host: str) -> bool:
    """Whether it is an IP address, no name."""
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True


def names_of(host: str) -> frozenset[str]:
    """The names by which a page may call the server at this address.

    Any site can have a name of its own lead to this machine, and its pages then pass for pages of this server
    (DNS rebinding): only names that others cannot give are taken.
    """
    if is_loopback(host):
        return NAMES_OF_LOOPBACK | {host.lower()}
    own = socket.gethostname().lower()
    short = own.partition(".")[0]
    return NAMES_OF_LOOPBACK | {host.lower(), own, short, f"{short}.local"}


def answered_beyond_limits(path: str) -> bool:
    """Whether a path is the page or a stop, which are answered where too many connections are open."""
    return path in FREE or path.rpartition("/")[2] in ("halt", "abortexposure", "action")


class Gate:
    """Lets requests through that may pass, and seals the answers.

    Parameters
    ----------
    token : what must come as `Authorization: Bearer`, as the password of basic authentication, or as a cookie; None
        lets everybody in
    host : the address that is listened at
    """

    def __init__(self, app: ASGIApp, token: str | None, host: str) -> None:
        self._app, self._token = app, token
        self._names, self._local = names_of(host), is_loopback(host)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""

        async def sealed(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.setdefault("Content-Security-Policy", SEALED)
                headers.setdefault("X-Content-Type-Options", "nosniff")
            await send(message)

        refusal = self._refusal(scope) if scope["type"] == "http" else None
        await (refusal or self._app)(scope, receive, sealed)

    def _refusal(self, scope: Scope) -> JSONResponse | None:
        headers, free = Headers(scope=scope), scope["path"] in FREE
        if free and "origin" not in headers:
            return None
        return self._foreign(headers) or (None if free else self._unknown(headers))

    def _foreign(self, headers: Headers) -> JSONResponse | None:
        """Refuses what a browser sends for a page of another site, and a name that is not this server's."""
        host, origin = headers.get("host", "").lower(), headers.get("origin")
        if origin is not None and origin.partition("://")[2].lower() != host:
            reason = f"a request must come from this server's own page, and it came from a page of {origin}"
            return refused(403, reason, "open this server's page, or use a program that is no browser")
        name = name_of(host)
        if name in self._names or (not self._local and (origin is None or is_address(name))):
            return None
        names = " or ".join(sorted(self._names))
        return refused(403, f"this server is called {names}, and the request was to {host!r}", f"ask for {names}")

    def _unknown(self, headers: Headers) -> JSONResponse | None:
        """Refuses what comes without the token."""
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
