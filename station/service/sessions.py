"""Sessions with their results, reports and journals, read only."""

from __future__ import annotations

import asyncio
import mimetypes
from dataclasses import dataclass
from pathlib import Path
from threading import Event

from starlette.requests import Request
from starlette.responses import Response, StreamingResponse
from starlette.routing import Route

from station.common.durable_files import sha256_of
from station.results.result_files import RECORD
from station.service.answers import NotThere, answer
from station.service.journal_stream import events, lines_of
from station.sessions.index import Index
from station.sessions.journal import Damaged
from station.sessions.layout import inside
from station.sessions.reader import read_session, sessions_in
from station.sessions.state import DerivedResult

REPORT = "report.html"


@dataclass(frozen=True)
class Sessions:
    """Requests concerning the sessions in a folder."""

    root: Path
    closing: Event

    def routes(self) -> list[Route]:
        """The routes of the interface."""
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
        """All sessions, newest first."""
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
        """Its report, an HTML page."""
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
