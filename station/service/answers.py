"""Answers to requests: JSON; errors state what was required, what was received, and the remedy."""

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
"""Largest request body in bytes: commands and answers are short."""


class NotThere(BadParameter):
    """The requested object does not exist."""


def answer(data: Any, status: int = 200) -> JSONResponse:
    """Data as JSON; non-finite numbers become null."""
    return JSONResponse(plain(data), status)


async def body_of(request: Request) -> bytes:
    """The body of a request. Raises BadParameter if it is too long or incomplete."""
    data = b""
    try:
        async for part in request.stream():
            data += part
            if len(data) > LARGEST_BODY:
                raise BadParameter(f"a request may have at most {LARGEST_BODY} bytes; more were sent", "send less")
    except ClientDisconnect as error:
        raise BadParameter("the whole body is required; the connection ended earlier", "send it again") from error
    return data


async def json_of(request: Request) -> Any:
    """The JSON of a request; an empty body is an empty object. Raises BadParameter."""
    data = await body_of(request)
    if not data:
        return {}
    kind = request.headers.get("content-type", "").partition(";")[0].strip()
    if kind != "application/json":
        raise BadParameter(f"JSON is required; got {kind or 'no content type'}", "send it as application/json")
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        raise BadParameter(f"the body is not JSON: {error}", "correct it") from error


def error_response(request: Request, error: Exception) -> Response:
    """The answer to a failed request."""
    if isinstance(error, ProcedureError | DeviceError):
        by_code = {2: 400, 3: 503, 4: 422, 5: 422, 75: 409}
        status = 404 if isinstance(error, NotThere) else by_code.get(error.exit_code, 500)
        return refused(status, error.reason, error.remedy)
    if isinstance(error, HTTPException):
        reason = f"{request.method} {request.url.path}: {error.detail.lower()}"
        return refused(error.status_code, reason, "`station manual serve` lists the interface")
    reason = f"the program failed unexpectedly: {type(error).__name__}: {error}"
    return refused(500, reason, "everything recorded is intact; continue, and report this if it happens again")
