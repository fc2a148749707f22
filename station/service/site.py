"""The served application: the page, the interface for programs, and Alpaca."""

import asyncio
import mimetypes
import threading
from collections.abc import AsyncIterator, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from threading import Event

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response, StreamingResponse
from starlette.routing import Mount, Route

from drivers.errors import DeviceError
from procedures.outcome import BadParameter, ProcedureError
from station.common.durable_files import read_own, sha256_of
from station.results.result_files import RECORD
from station.service.access import API, COOKIE, STOP, Gate
from station.service.alpaca.server import AlpacaServer
from station.service.answers import NotThere, answer, error_response, json_of
from station.service.bench_state import ServedBench, run_record
from station.service.runs import read_order
from station.sessions.index import Index
from station.sessions.journal import Damaged, parse
from station.sessions.layout import JOURNAL, check_layout, inside, read_config
from station.sessions.reader import read_session, sessions_in
from station.sessions.state import DerivedResult

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
        redirect = RedirectResponse("/", 303)
        redirect.set_cookie(COOKIE, token, httponly=True, samesite="strict")
        return redirect
    text = files(__package__).joinpath("page.html").read_bytes()
    return Response(text, media_type="text/html", headers={"Content-Security-Policy": PAGE_POLICY})


@dataclass(frozen=True)
class Control:
    """Requests concerning the bench."""

    served: ServedBench

    def routes(self) -> list[Route]:
        return [
            Route("/status", self.status),
            Route("/picture", self.picture),
            Route("/plans", self.plans),
            Route("/run", self.run),
            Route("/run", self.start, methods=["POST"]),
            Route("/run/answer", self.reply, methods=["POST"]),
            Route("/run/end", self.end, methods=["POST"]),
            Route(STOP, self.stop, methods=["POST", "PUT"]),
        ]

    def status(self, request: Request) -> Response:
        return answer(self.served.status())

    def picture(self, request: Request) -> Response:
        picture = self.served.picture.take()
        if picture is None:
            raise NotThere("no photograph was taken yet", "start a run, or an exposure")
        headers = {"Cache-Control": "no-store", "X-Caption": picture.caption, "X-Number": str(picture.number)}
        return Response(picture.jpeg, media_type="image/jpeg", headers=headers)

    def plans(self, request: Request) -> Response:
        return answer({"plans": dict(self.served.lab.plans())})

    def run(self, request: Request) -> Response:
        """The run started last."""
        status = self.served.runs.status
        if status is None:
            raise NotThere("no run was started yet", "POST /station/v1/run starts one")
        return answer(run_record(status))

    async def start(self, request: Request) -> Response:
        order = read_order(await json_of(request), self.served.lab.names)
        await asyncio.to_thread(self.served.runs.start, order)
        status = self.served.runs.status
        assert status is not None
        return answer(run_record(status), 201)

    async def reply(self, request: Request) -> Response:
        data = await json_of(request)
        key, words = (data.get("key"), data.get("answer")) if isinstance(data, dict) else (None, None)
        if not isinstance(key, str) or not isinstance(words, str | int | float | bool):
            raise BadParameter(
                "an answer needs the question's key and the answer", 'send {"key": "move", "answer": true}'
            )
        self.served.runs.reply(key, str(words))
        return answer({})

    async def end(self, request: Request) -> Response:
        await asyncio.to_thread(self.served.runs.end)
        return answer({})

    async def stop(self, request: Request) -> Response:
        """Stop every device now, in the same way as signals. Needs no token."""
        loop = asyncio.get_running_loop()
        return answer(await loop.run_in_executor(self.served.stopper, self.served.stop))


REPORT = "report.html"


@dataclass(frozen=True)
class Sessions:
    """Requests concerning the sessions in a folder."""

    root: Path
    closing: Event

    def routes(self) -> list[Route]:
        return [
            Route("/sessions", self.everything),
            Route("/sessions/{name}", self.one),
            Route("/sessions/{name}/result", self.result),
            Route("/sessions/{name}/results/{number:int}/{file:path}", self.file),
            Route("/sessions/{name}/report", self.report),
            Route("/sessions/{name}/journal", self.journal),
        ]

    def _folder(self, request: Request) -> Path:
        """The session named in the path. Raises NotThere."""
        name = request.path_params["name"]
        for folder in sessions_in(self.root):
            if folder.name == name:
                return folder
        raise NotThere(f"there is no session {name!r}", "GET /station/v1/sessions lists them")

    def everything(self, request: Request) -> Response:
        if not self.root.is_dir():
            return answer({"schema": "station/sessions/1", "sessions": []})
        with Index(self.root) as index:
            entries = index.sessions()
        return answer({"schema": "station/sessions/1", "sessions": [entry.record() for entry in entries]})

    def one(self, request: Request) -> Response:
        """One session: facts, shots and results, as in `station session show --json`."""
        return answer(read_session(self._folder(request)).record())

    def result(self, request: Request) -> Response:
        """The record of its last result, unchanged."""
        folder = self._folder(request)
        results = read_session(folder).state.results
        if not results:
            raise NotThere(f"{folder.name} has no result yet", "carry out its plan, or request another session")
        return _file(folder, results[-1], RECORD)

    def file(self, request: Request) -> Response:
        """One file of one result: `psf_G1.npy` of result 1."""
        folder, number, name = self._folder(request), request.path_params["number"], request.path_params["file"]
        for result in read_session(folder).state.results:
            if result.folder.endswith(f"/{number}") and name in result.files:
                return _file(folder, result, name)
        raise NotThere(f"{folder.name} has no file {name!r} in a result {number}", "its session lists the files")

    def report(self, request: Request) -> Response:
        folder = self._folder(request)
        results = read_session(folder).state.results
        if results and REPORT in results[-1].files:
            return _file(folder, results[-1], REPORT)
        if not (folder / REPORT).is_file():
            raise NotThere(f"{folder.name} has no report", f"write it: station session report {folder.name}")
        return Response(inside(folder, REPORT).read_bytes(), media_type="text/html")

    async def journal(self, request: Request) -> Response:
        """Its journal as server-sent events, from `Last-Event-ID` on, including new lines."""
        folder = await asyncio.to_thread(self._folder, request)
        last = request.headers.get("last-event-id", request.query_params.get("after", "0"))
        follow = request.query_params.get("follow", "true") != "false"
        lines = await asyncio.to_thread(lines_of, folder)
        after = int(last) if last.isascii() and last.isdigit() and len(last) < 10 else 0
        stream = events(folder, lines, after, follow=follow, closing=self.closing)
        return StreamingResponse(stream, media_type="text/event-stream", headers={"Cache-Control": "no-store"})


def _file(folder: Path, result: DerivedResult, name: str) -> Response:
    """A result's file, if it matches the journal. Raises Damaged."""
    path = inside(folder, f"{result.folder}/{name}")
    if sha256_of(path) != result.files.get(name):
        raise Damaged(f"{path} has been changed", "bring it back from a copy")
    kind = mimetypes.guess_type(name)[0] or "application/octet-stream"
    return Response(path.read_bytes(), media_type=kind)


LOOK_S = 0.25
"""Polling interval of the journal, which any program may write."""
ALIVE_S = 15.0


def lines_of(folder: Path) -> Sequence[bytes]:
    """The complete lines of a session's journal, verified. Raises BadInput, Damaged."""
    check_layout(folder)
    _, first_sum = read_config(folder)
    path = folder / JOURNAL
    data = read_own(path)
    return data[: parse(data, first_sum, str(path)).length].splitlines()


async def events(
    folder: Path, lines: Sequence[bytes], after: int, *, follow: bool, closing: threading.Event
) -> AsyncIterator[bytes]:
    """The lines after number `after`, then new ones, until `closing` or the end of the journal's folder."""
    silent_s = 0.0
    size = 0
    while True:
        for number, line in enumerate(lines[after:], after + 1):
            yield b"id: %d\ndata: %s\n\n" % (number, line)
            silent_s = 0.0
        after = max(after, len(lines))
        if not follow or closing.is_set():
            return
        await asyncio.sleep(LOOK_S)
        silent_s += LOOK_S
        if silent_s >= ALIVE_S:
            yield b": nothing new\n\n"
            silent_s = 0.0
        try:
            now = (folder / JOURNAL).stat().st_size
        except OSError:
            return
        if now != size:
            size, lines = now, await asyncio.to_thread(lines_of, folder)
