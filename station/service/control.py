"""The bench's interface: its state, its picture, runs and their answers, and the stop."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from procedures.outcome import BadParameter
from station.guide.workspace import StationLab
from station.service.access import STOP
from station.service.answers import NotThere, answer, json_of
from station.service.bench_state import ServedBench, run_record
from station.service.runs import read_order


@dataclass(frozen=True)
class Control:
    """Requests concerning the bench."""

    served: ServedBench

    def routes(self) -> list[Route]:
        """The routes of the interface."""
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

    @property
    def _lab(self) -> StationLab:
        return self.served.lab

    def status(self, request: Request) -> Response:
        """Devices, run, picture."""
        return answer(self.served.status())

    def picture(self, request: Request) -> Response:
        """The newest photograph, a JPEG."""
        picture = self.served.picture.take()
        if picture is None:
            raise NotThere("no photograph was taken yet", "start a run, or an exposure")
        headers = {"Cache-Control": "no-store", "X-Caption": picture.caption, "X-Number": str(picture.number)}
        return Response(picture.jpeg, media_type="image/jpeg", headers=headers)

    def plans(self, request: Request) -> Response:
        """The available plans."""
        return answer({"plans": dict(self._lab.plans())})

    def run(self, request: Request) -> Response:
        """The run started last."""
        status = self.served.runs.status
        if status is None:
            raise NotThere("no run was started yet", "POST /station/v1/run starts one")
        return answer(run_record(status))

    async def start(self, request: Request) -> Response:
        """Start a run in a new session."""
        order = read_order(await json_of(request), self._lab.names)
        await asyncio.to_thread(self.served.runs.start, order)
        status = self.served.runs.status
        assert status is not None
        return answer(run_record(status), 201)

    async def reply(self, request: Request) -> Response:
        """Answer the run's open question."""
        data = await json_of(request)
        key, words = (data.get("key"), data.get("answer")) if isinstance(data, dict) else (None, None)
        if not isinstance(key, str) or not isinstance(words, str | int | float | bool):
            raise BadParameter(
                "an answer needs the question's key and the answer", 'send {"key": "move", "answer": true}'
            )
        self.served.runs.reply(key, str(words))
        return answer({})

    async def end(self, request: Request) -> Response:
        """End the run after its present operation."""
        await asyncio.to_thread(self.served.runs.end)
        return answer({})

    async def stop(self, request: Request) -> Response:
        """Stop every device now, in the same way as signals. Needs no token."""
        loop = asyncio.get_running_loop()
        return answer(await loop.run_in_executor(self.served.stopper, self.served.stop))
