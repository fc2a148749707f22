"""Distribution of a batch by Dask to workers that share its folders; processes of one machine: `process_pool`."""

import logging
from collections import deque
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from procedures.outcome import BadParameter, Refused
from station.batch.process_pool import POLL_S, Lost, Stop, one_thread

I = TypeVar("I")  # noqa: E741  (an item)
J = TypeVar("J")
R = TypeVar("R")

AHEAD = 2
"""Items per thread of the workers: one in work, one waiting."""
PATIENCE_S = 20


def run_on_cluster(
    function: Callable[[I, J], R], job: J, items: Sequence[I], stop: Stop, address: str,
    tls: tuple[Path, Path, Path] | None = None,
) -> Generator[tuple[int, R | Lost], None, None]:  # fmt: skip
    """`run_in_processes` on the cluster at an address, whose workers have limits of their own.

    The workers need this program, and photographs and results under the same paths. The scheduler is trusted: its
    messages and those of its workers are unpickled here. Raises BadParameter if Dask is not installed, or no cluster
    answers at the address; Refused if the cluster goes away while it works.

    tls : files for a cluster at tls://...: authority, own certificate, own key
    """
    with _connected(address, tls) as client:
        # a task, not data: it is computed again if the workers that hold it die
        shared = client.submit(_same, job, pure=False)
        waiting, running, ended = deque(range(len(items))), dict[Any, int](), SimpleQueue[Any]()
        most = AHEAD * max(1, sum(client.nthreads().values()))
        while True:
            while waiting and len(running) < most and not stop.asked:
                number = waiting.popleft()
                future = client.submit(_alone, function, items[number], shared, pure=False)
                running[future] = number
                future.add_done_callback(ended.put)
            if not running:
                return
            try:
                future = ended.get(timeout=POLL_S)
            except Empty:
                continue
            number = running.pop(future)
            if future.status in ("finished", "error"):
                yield number, _answer(future)
            elif client.status == "running":  # the worker died with the answer before it was fetched
                waiting.appendleft(number)
            else:
                raise Refused(f"the cluster at {address} went away", "start it and the batch again; what is done stays")


def _same(job: J) -> J:
    return job


def _alone(function: Callable[[I, J], R], item: I, job: J) -> R:
    one_thread()
    return function(item, job)


def _answer(future: Any) -> Any:
    if future.status == "finished":
        return future.result()
    error = future.exception()
    if type(error).__name__ == "KilledWorker":
        return Lost("the workers that worked on it died or took too long, one after the other")
    return Lost(f"the cluster gave it up: {type(error).__name__}: {error}")


def _connected(address: str, tls: tuple[Path, Path, Path] | None) -> Any:
    try:
        from distributed import Client
        from distributed.security import Security
    except ImportError as error:
        raise BadParameter("--cluster needs Dask", "pip install 'calibration-station[cluster]'") from error
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # the operator is informed here
    remedy = "start `dask scheduler` and `dask worker`, and give the scheduler's address"
    try:
        names = ("tls_ca_file", "tls_client_cert", "tls_client_key")
        files = {name: str(path) for name, path in zip(names, tls or (), strict=False)}
        security = Security(**files, require_encryption=True) if tls else None
        return Client(address, timeout=PATIENCE_S, security=security)
    except Exception as error:  # any program may listen there
        words = f"{type(error).__name__}: {error}" if not isinstance(error, OSError | ValueError) else error
        raise BadParameter(f"no cluster answers at {address}: {words}", remedy) from error
