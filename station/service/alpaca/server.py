"""Alpaca over HTTP: `/api/v1/KIND/NUMBER/MEMBER` and `/management`, transactions numbered, errors by number."""

import asyncio
import itertools
import json
from collections.abc import Callable
from contextlib import suppress
from typing import Any, cast

import numpy as np
from starlette.requests import Request
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.routing import Route

from drivers.interfaces import Stage
from station.common.versions import software
from station.service.access import RIGHTS, STOP_ONLY, refused, token_required
from station.service.alpaca.camera import BenchCamera
from station.service.alpaca.clients import ClientList
from station.service.alpaca.conditions import ProbeConditions
from station.service.alpaca.device import AlpacaDevice, is_stop
from station.service.alpaca.focuser import AxisFocuser
from station.service.alpaca.protocol import BYTES, INT32, BadRequest, Parameters, as_alpaca, image_bytes
from station.service.alpaca.switch import BenchSwitch, lines_of
from station.service.answers import body_of
from station.service.bench_state import ServedBench

JSON = "application/json"


def devices_of(served: ServedBench) -> list[AlpacaDevice]:
    """The bench's camera, a focuser for each axis in millimetres, a switch over lamp, shutter and laser, its probes."""
    bench = served.bench
    if bench is None:
        return []
    devices: list[AlpacaDevice] = [BenchCamera(served, 0)] if "camera" in bench.devices else []
    axes = [
        (name, axis)
        for name, device in bench.devices.items()
        if hasattr(device, "move_to")
        for axis in cast(Stage, device).travel()
        if axis.endswith("_mm")
    ]
    devices += [AxisFocuser(served, number, stage, axis) for number, (stage, axis) in enumerate(axes)]
    devices += [BenchSwitch(served, 0)] if lines_of(bench) else []
    probes = [name for name, device in bench.devices.items() if hasattr(device, "read")]
    return [*devices, *(ProbeConditions(served, number, name) for number, name in enumerate(probes))]


class AlpacaServer:
    """Answers the requests of Alpaca clients."""

    def __init__(self, served: ServedBench) -> None:
        self._served = served
        self._devices = {(device.kind, device.number): device for device in devices_of(served)}
        self._transactions = itertools.count(1)
        self._clients = ClientList()
        served.clients = self.clients

    def routes(self) -> list[Route]:
        return [
            Route("/management/apiversions", self._constant([1])),
            Route("/management/v1/description", self._constant(DESCRIPTION)),
            Route("/management/v1/configureddevices", self._constant([listed(one) for one in self._devices.values()])),
            Route("/setup", to_page),
            Route("/setup/v1/{kind}/{number:int}/setup", to_page),
            Route("/api/v1/{kind}/{number}/{member}", self.device, methods=["GET", "PUT"]),
        ]

    def clients(self) -> list[dict[str, Any]]:
        """The clients, the one that sent the last request first."""
        return self._clients.records({f"{one.kind} {one.number}": one.clients for one in self._devices.values()})

    def _constant(self, value: Any) -> Callable[[Request], Response]:
        return lambda request: self._answered(
            Parameters.of_query(request.url.query), lambda client: self._framed(client, Value=value)
        )

    async def device(self, request: Request) -> Response:
        """A member of a device."""
        reading, data = request.method != "PUT", await body_of(request)
        given = Parameters.of_query(request.url.query) if reading else Parameters.of_form(data)
        kind, number, member = (request.path_params[name] for name in ("kind", "number", "member"))
        device = self._devices.get((kind, int(number))) if number.isascii() and number.isdigit() else None
        if device is None:
            known = ", ".join(f"{kind}/{number}" for kind, number in self._devices) or "none"
            return PlainTextResponse(f"there is no device {kind}/{number}; there are {known}", 400)
        rights, stops = request.scope[RIGHTS], not reading and is_stop(member, given)
        if rights == STOP_ONLY and not stops:
            return token_required("without it only stops are carried out")
        with suppress(BadRequest):  # it is answered below
            self._clients.note(request.client.host if request.client else "", given.client(), rights)
        as_bytes = BYTES in request.headers.get("accept", "")

        def make(client: int) -> Response:
            value = device.answer("GET" if reading else "PUT", member, given)
            if isinstance(value, np.ndarray):
                if as_bytes:
                    return Response(image_bytes(value, client, next(self._transactions)), media_type=BYTES)
                return self._framed(client, Type=INT32, Rank=2, Value=value.T.tolist())
            return self._framed(client, **({} if value is None else {"Value": value}))

        threads = self._served.stopper if stops else device.polls
        work = asyncio.get_running_loop().run_in_executor(threads, self._answered, given, make)
        left = asyncio.ensure_future(request.receive())  # the request is complete: the next event is a disconnection
        with suppress(asyncio.CancelledError):  # the server shuts down
            await asyncio.wait((work, left), return_when=asyncio.FIRST_COMPLETED)
        left.cancel()
        if work.done():
            return work.result()
        work.cancel()  # nobody waits for it any more; work in progress is completed
        return refused(503, f"the server shut down before {device.name} answered", "ask again once it runs")

    def _answered(self, given: Parameters, make: Callable[[int], Response]) -> Response:
        """The answer of `make` to the client's number; an error becomes its number and message."""
        client = 0
        try:
            client = given.transaction()
            return make(client)
        except BadRequest as error:
            return PlainTextResponse(str(error), 400)
        except Exception as error:  # any error is reported to the client
            failure = as_alpaca(error)
            return self._framed(client, ErrorNumber=failure.number, ErrorMessage=failure.message)

    def _framed(self, client: int, **fields: Any) -> Response:
        """An answer in the standard's frame; also used for a failed image, which all clients accept."""
        ids = {"ClientTransactionID": client, "ServerTransactionID": next(self._transactions)}
        return Response(json.dumps({"ErrorNumber": 0, "ErrorMessage": "", **ids, **fields}), media_type=JSON)


DESCRIPTION = {
    "ServerName": "Calibration station",
    "Manufacturer": "Calibration station",
    "ManufacturerVersion": software()["version"] or "0",
    "Location": "",
}


def listed(device: AlpacaDevice) -> dict[str, Any]:
    """A device's entry in the list of devices."""
    names = {"DeviceName": device.name, "DeviceType": device.type_name or device.kind.capitalize()}
    return {**names, "DeviceNumber": device.number, "UniqueID": device.unique_id}


def to_page(request: Request) -> Response:
    """Redirect to the page, which shows the bench: there is nothing to set up here."""
    return RedirectResponse("/", 303)
