"""Access control: the token, and the origin of requests.

A stop needs no token: anybody who sees a problem may stop the bench. Requests that a browser sends for a page of
another site are refused, including the stop, as nobody at the bench has made them.
"""

import base64
import binascii
import ipaddress
import re
import secrets
import socket
from http.cookies import CookieError, SimpleCookie

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from procedures.outcome import BadParameter

COOKIE = "station_token"
SHORTEST = 12
"""Smallest length of a chosen token: shorter ones can be guessed within a day over a local network."""
NAMES_OF_LOOPBACK = frozenset(("localhost", "127.0.0.1", "::1"))
API = "/station/v1"
STOP = "/stop"
FREE = ("/", API + STOP)
"""Paths without token: the page, which shows nothing without it, and the stop."""
ALPACA_STOPS = re.compile(r"/api/v1/[a-z]+/\d+/(halt|abortexposure|action)")
"""Alpaca's members that can stop something; of its actions without token only the emergency stop is carried out."""
RIGHTS = "station.rights"
EVERYTHING, STOP_ONLY = "everything", "stop only"
"""The rights of a request with the token, and without; kept in its scope."""
SEALED = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'"
"""The default policy of answers: reports and other files of sessions run no script, and are not
pages of this server to a browser."""


def new_token() -> str:
    """A random token."""
    return secrets.token_urlsafe(16)


def check_token(token: str) -> str:
    """The token, if it is valid. Raises BadParameter."""
    if len(token) < SHORTEST or not token.isascii() or not token.isprintable() or " " in token:
        reason = f"a token must have {SHORTEST} ASCII characters or more, without spaces; got {len(token)}"
        raise BadParameter(reason, "omit --token, or unset STATION_TOKEN, to have one made")
    return token


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach the address."""
    return ipaddress.ip_address(host).is_loopback if is_address(host) else host == "localhost"


def is_address(host: str) -> bool:
    """Whether it is an IP address, not a name."""
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True


def names_of(host: str) -> frozenset[str]:
    """Names by which a page may address the server at this address.

    Any site can let a name of its own resolve to this machine, and its pages would then pass for pages of this server
    (DNS rebinding): only names that others cannot assign are accepted.
    """
    if is_loopback(host):
        return NAMES_OF_LOOPBACK | {host.lower()}
    hostname = socket.gethostname().lower()
    short = hostname.partition(".")[0]
    return NAMES_OF_LOOPBACK | {host.lower(), hostname, short, f"{short}.local"}


def answered_beyond_limits(path: str) -> bool:
    """Whether a path is the page or a stop, which are answered even with too many open connections."""
    return path in FREE or ALPACA_STOPS.fullmatch(path) is not None


class Gate:
    """Passes permitted requests, and adds the security headers to answers.

    token : required as `Authorization: Bearer`, as the password of basic authentication, or as a cookie; None disables
        the check
    host : the address of the server
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
        headers, path = Headers(scope=scope), scope["path"]
        free = path in FREE or (scope["method"] == "PUT" and ALPACA_STOPS.fullmatch(path) is not None)
        unknown = self._unknown(headers)
        scope[RIGHTS] = EVERYTHING if unknown is None else STOP_ONLY
        if free and "origin" not in headers:
            return None
        return self._foreign(headers) or (None if free else unknown)

    def _foreign(self, headers: Headers) -> JSONResponse | None:
        """Refuse requests of a browser for a page of another site, and names that are not this server's."""
        host, origin = headers.get("host", "").lower(), headers.get("origin")
        if origin is not None and origin.partition("://")[2].lower() != host:
            reason = f"a request must come from this server's own page; it came from a page of {origin}"
            return refused(403, reason, "open this server's page, or use a program other than a browser")
        name = name_of(host)
        if name in self._names or (not self._local and (origin is None or is_address(name))):
            return None
        names = " or ".join(sorted(self._names))
        return refused(403, f"this server is called {names}; the request was to {host!r}", f"request {names}")

    def _unknown(self, headers: Headers) -> JSONResponse | None:
        if self._token is None or any(secrets.compare_digest(self._token.encode(), t) for t in tokens_in(headers)):
            return None
        return token_required("a wrong one was sent" if tokens_in(headers) else "none was sent")


def token_required(given: str) -> JSONResponse:
    """The answer to a request without the right token."""
    return refused(
        401,
        f"the token is required; {given}",
        "send `Authorization: Bearer TOKEN` with the token that `station serve` printed; Alpaca clients give it as "
        "password: any:TOKEN@host:port",
    )


def refused(status: int, reason: str, remedy: str) -> JSONResponse:
    """An error answer: what was required, what was received, the remedy."""
    headers = {"WWW-Authenticate": "Bearer"} if status == 401 else None
    return JSONResponse({"reason": reason, "remedy": remedy}, status, headers)


def name_of(host: str) -> str:
    """A Host header without its port and brackets."""
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.partition(":")[0].lower()


def tokens_in(headers: Headers) -> list[bytes]:
    """All tokens in a request."""
    kind, _, value = headers.get("authorization", "").partition(" ")
    tokens = []
    if kind.lower() == "bearer":
        tokens.append(value.strip().encode())
    elif kind.lower() == "basic":
        tokens.append(_password(value))
    try:
        cookie = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    except CookieError:
        cookie = None
    if cookie is not None:
        tokens.append(cookie.value.encode())
    return [token for token in tokens if token]


def _password(encoded: str) -> bytes:
    try:
        return base64.b64decode(encoded, validate=True).partition(b":")[2]
    except (binascii.Error, ValueError):
        return b""
