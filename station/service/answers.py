"""How requests are answered: JSON, and errors as what was required, what came, and what to do."""

from __future__ import annotations

import json
from typing import Any

from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response

from drivers.errors import DeviceError
from procedures.outcome import BadParameter, ProcedureError
from station.results.result_files import plain
from station.service.access import refused

LARGEST_BODY = 1 << 16
"""Bytes of what a client sends: orders and answers are short."""


class NotThere(BadParameter):
    """What was asked for does not exist."""


def answer(data: Any, status: int = 200) -> JSONResponse:
    """Data as JSON; numbers that are not finite as null."""
    return JSONResponse(plain(data), status)


async def body_of(request: Request) -> bytes:
    """What a client sent. Raises BadParameter where it is too long, or did not come whole."""
    data = b""
    try:
        async for part in request.stream():
            data += part
            if len(data) > LARGEST_BODY:
                raise BadParameter(f"at most {LARGEST_BODY} bytes are taken, and more came", "send less")
    except ClientDisconnect as error:
        raise BadParameter("the whole body is required, and the connection ended before", "send it again") from error
    return data


async def json_of(request: Request) -> Any:
    """The JSON that a client sent; an empty body is an empty object. Raises BadParameter."""
    data = await body_of(request)
    if not data:
        return {}
    kind = request.headers.get("content-type", "").partition(";")[0].strip()
    if kind != "application/json":
        raise BadParameter(f"JSON is required, and {kind or 'no content type'} came", "send it as application/json")
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        raise BadParameter(f"the body is no JSON: {error}", "correct it") from error


def status_of(error: ProcedureError | DeviceError) -> int:
    """The HTTP status of an error of ours."""
    if isinstance(error, NotThere):
        return 404
    by_code = {2: 400, 3: 503, 4: 422, 5: 422, 75: 409}
    return by_code.get(error.exit_code, 500)


def explained(request: Request, error: Exception) -> Response:
    """The answer to a request that failed."""
    if isinstance(error, ProcedureError | DeviceError):
        return refused(status_of(error), error.reason, error.remedy)
    if isinstance(error, HTTPException):
        reason = f"{request.method} {request.url.path}: {error.detail.lower()}"
        return refused(error.status_code, reason, "`station manual serve` tells what there is")
    reason = f"the program failed on something it did not foresee: {type(error).__name__}: {error}"
    return refused(500, reason, "nothing that was taken is lost; go on, and report this if it comes again")
