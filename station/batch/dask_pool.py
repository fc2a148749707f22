"""The same work shared out by Dask: to processes of this machine, or to workers that share its folders."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

from procedures.outcome import BadParameter
from station.batch.process_pool import Lost, Stop, one_thread, single_threads, without_interrupts

I = TypeVar("I")  # noqa: E741  (an item)
J = TypeVar("J")
R = TypeVar("R")

LOCAL = "local"
AHEAD = 2
"""Items given out for each thread of the workers: one runs, one waits."""
PATIENCE_S = 20


def run_on_cluster(
    function: Callable[[I, J], R], job: J, items: Sequence[I], jobs: int, stop: Stop, address: str
) -> Generator[tuple[int, R | Lost], None, None]:
    """As `run_in_processes`, on the cluster at an address, or on one of `jobs` processes started here ("local").

    Workers of a cluster must have this program, and see photographs and results under the same paths.

    Raises
    ------
    BadParameter
        If Dask is not installed, or no cluster answers at the address.
    """
    with _client(address, jobs) as client:
        from distributed import as_completed

        # a task, not data: if the workers that hold it die, it is made again
        shared = client.submit(_same, job, pure=False)
        waiting = deque(range(len(items)))
        given: dict[Any, int] = {}
        running = as_completed(raise_errors=False)

        def give() -> None:
            if waiting and not stop.asked:
                number = waiting.popleft()
                future = client.submit(_alone, function, items[number], shared, pure=False)
                given[future] = number
                running.add(future)

        for _ in range(AHEAD * max(1, sum(client.nthreads().values()))):
            give()
        for future in running:
            number = given.pop(future)
            if future.status in ("finished", "error"):
                yield number, _answer(future)
            else:  # the worker died with the answer before it was fetched
                waiting.appendleft(number)
            give()


def _same(job: J) -> J:
    return job


def _alone(function: Callable[[I, J], R], item: I, job: J) -> R:
    """The work, in one thread."""
    one_thread()
    return function(item, job)


def _answer(future: Any) -> Any:
    if future.status == "finished":
        return future.result()
    error = future.exception()
    if type(error).__name__ == "KilledWorker":
        return Lost("the workers that worked on it died, one after the other")
    return Lost(f"the cluster gave it up: {type(error).__name__}: {error}")


@contextmanager
def _client(address: str, jobs: int) -> Iterator[Any]:
    """A client of the cluster; a local one is started and ended here."""
    try:
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise BadParameter("--cluster needs Dask", "pip install 'calibration-station[cluster]'") from error
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what matters to the operator is said here
    if address != LOCAL:
        with _connected(Client, address) as client:
            yield client
        return
    with single_threads(), without_interrupts():
        cluster = LocalCluster(
            n_workers=jobs, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL
        )
    with cluster, Client(cluster) as client:
        yield client


def _connected(connect: Callable[..., Any], address: str) -> Any:
    try:
        return connect(address, timeout=PATIENCE_S)
    except (OSError, ValueError) as error:
        reason = f"no cluster answers at {address}: {error}"
        raise BadParameter(
            reason, "start `dask scheduler` and `dask worker`, and give the scheduler's address"
        ) from error
