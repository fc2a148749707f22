"""The served application: the page, the interface for programs, and Alpaca."""

from __future__ import annotations

import threading
from importlib.resources import files

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.routing import Mount, Route

from drivers.errors import DeviceError
from procedures.outcome import ProcedureError
from station.service.access import API, COOKIE, Gate
from station.service.alpaca.server import AlpacaServer
from station.service.answers import error_response
from station.service.bench_state import ServedBench
from station.service.control import Control
from station.service.sessions import Sessions

PAGE_POLICY = "default-src 'self'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; frame-ancestors 'none'"


def site(served: ServedBench, *, host: str, token: str | None, closing: threading.Event) -> Starlette:
    """The application; `host` is the address of the server."""
    programs = [*Control(served).routes(), *Sessions(served.lab.sessions, closing).routes()]
    return Starlette(
        routes=[Route("/", page), Mount(API, routes=programs), *AlpacaServer(served).routes()],
        middleware=[Middleware(Gate, token=token, host=host)],
        exception_handlers=dict.fromkeys((ProcedureError, DeviceError, HTTPException, Exception), error_response),
    )


async def page(request: Request) -> Response:
    """The page for a phone, which waits for no other request. A token in its address becomes a cookie."""
    if token := request.query_params.get("token"):
        answer = RedirectResponse("/", 303)
        answer.set_cookie(COOKIE, token, httponly=True, samesite="strict")
        return answer
    text = files(__package__).joinpath("page.html").read_bytes()
    return Response(text, media_type="text/html", headers={"Content-Security-Policy": PAGE_POLICY})
