"""Distribution of a batch by Dask: to processes of this machine, or to workers that share its folders."""

import logging
import multiprocessing
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from procedures.outcome import BadParameter, Refused
from station.batch.process_pool import (
    NO_LIMIT,
    POLL_S,
    STOPPED_S,
    TRIES,
    Allowance,
    Lost,
    Stop,
    is_stopped,
    limited_memory,
    one_thread,
    single_threads,
    without_interrupts,
)

I = TypeVar("I")  # noqa: E741  (an item)
J = TypeVar("J")
R = TypeVar("R")

LOCAL = "local"
AHEAD = 2
"""Items per thread of the workers: one in work, one waiting."""
PATIENCE_S = 20
OPEN = "the local cluster speaks without TLS: whoever has an account on this machine can connect to it while it runs"


def run_on_cluster(
    function: Callable[[I, J], R], job: J, items: Sequence[I], jobs: int, stop: Stop, address: str,
    allowance: Allowance = NO_LIMIT, tls: tuple[Path, Path, Path] | None = None,
) -> Generator[tuple[int, R | Lost], None, None]:  # fmt: skip
    """`run_in_processes` on the cluster at an address, or on one of `jobs` processes started here ("local").

    Workers of a cluster need this program, and photographs and results under the same paths. The scheduler is trusted:
    its messages and those of its workers are unpickled here. Raises BadParameter if Dask is not installed, or no
    cluster answers at the address; Refused if the cluster goes away while it works.

    allowance : limits of each item on a local cluster; others have limits of their own
    tls : files for a cluster at tls://...: authority, own certificate, own key
    """
    with _client(address, jobs, tls) as client:
        # a task, not data: it is computed again if the workers that hold it die
        shared = client.submit(_same, job, pure=False)
        allowed = allowance if address == LOCAL else NO_LIMIT
        waiting, running, ended = deque(range(len(items))), dict[Any, int](), SimpleQueue[Any]()
        most = AHEAD * max(1, sum(client.nthreads().values()))
        while True:
            while waiting and len(running) < most and not stop.asked:
                number = waiting.popleft()
                future = client.submit(_alone, function, items[number], shared, allowed, pure=False)
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


def _alone(function: Callable[[I, J], R], item: I, job: J, allowance: Allowance) -> R:
    """The work in one thread; a process that exceeds its time kills itself."""
    one_thread()
    end = threading.Timer(allowance.time_s or 0.0, lambda: os.kill(os.getpid(), getattr(signal, "SIGKILL", 9)))
    end.daemon = True
    if allowance.time_s is not None:
        end.start()
    try:
        with limited_memory(allowance.memory_bytes):
            return function(item, job)
    finally:
        end.cancel()


def _answer(future: Any) -> Any:
    if future.status == "finished":
        return future.result()
    error = future.exception()
    if type(error).__name__ == "KilledWorker":
        return Lost("the workers that worked on it died or took too long, one after the other")
    return Lost(f"the cluster gave it up: {type(error).__name__}: {error}")


@contextmanager
def _client(address: str, jobs: int, tls: tuple[Path, Path, Path] | None) -> Iterator[Any]:
    """A client of the cluster; a local cluster is started and ended here."""
    try:
        from distributed import Client
    except ImportError as error:
        raise BadParameter("--cluster needs Dask", "pip install 'calibration-station[cluster]'") from error
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # the operator is informed here
    if address != LOCAL:
        with _connected(Client, address, tls) as client:
            yield client
        return
    kill = _killing(set(multiprocessing.active_children()))
    with kill(), _local(jobs) as cluster, _watched(cluster), Client(cluster) as client, kill():
        yield client


def _killing(others: set[Any]) -> Callable[[], AbstractContextManager[None]]:
    """A context in which any exception kills all processes except `others` at once.

    Dask would wait for each of them, and forgets those of a cluster that is incomplete.
    """

    @contextmanager
    def kill() -> Iterator[None]:
        try:
            yield
        except BaseException:
            for one in set(multiprocessing.active_children()) - others:
                with suppress(ValueError):  # it was closed meanwhile
                    one.kill()
            raise

    return kill


def _local(jobs: int) -> Any:
    """Local processes, closed to other users if the package cryptography is installed."""
    import dask
    from distributed import LocalCluster
    from distributed.security import Security

    security = Security.temporary() if has_tls() else None
    with dask.config.set({"distributed.scheduler.allowed-failures": TRIES - 1}), single_threads(), without_interrupts():
        return LocalCluster(
            n_workers=jobs,
            threads_per_worker=1,
            dashboard_address="127.0.0.1:0",  # None is 8787, on which a second batch finds the first one's
            silence_logs=logging.CRITICAL,
            security=security,
            protocol="tls://" if security else None,
        )


def has_tls() -> bool:
    """Whether a local cluster can be closed to other users: Dask needs the package cryptography for a certificate."""
    return find_spec("cryptography") is not None


@contextmanager
def _watched(cluster: Any) -> Iterator[None]:
    """Kill stopped processes of a local cluster, in a thread, whose answers would never come; Dask replaces them."""
    over = threading.Event()

    def look() -> None:
        since_s: dict[int, float] = {}
        while not over.wait(POLL_S):
            now = time.monotonic()
            processes = {one.pid for one in list(cluster.workers.values()) if one.pid}
            since_s = {one: since_s.get(one, now) for one in processes if is_stopped(one)}
            for process in (one for one, first_s in since_s.items() if now - first_s > STOPPED_S):
                with suppress(ProcessLookupError):
                    os.kill(process, signal.SIGKILL)

    thread = threading.Thread(target=look, name="stopped processes", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def _connected(connect: Callable[..., Any], address: str, tls: tuple[Path, Path, Path] | None) -> Any:
    from distributed.security import Security

    remedy = "start `dask scheduler` and `dask worker`, and give the scheduler's address"
    try:
        names = ("tls_ca_file", "tls_client_cert", "tls_client_key")
        files = {name: str(path) for name, path in zip(names, tls or (), strict=False)}
        security = Security(**files, require_encryption=True) if tls else None
        return connect(address, timeout=PATIENCE_S, security=security)
    except Exception as error:  # any program may listen there
        words = f"{type(error).__name__}: {error}" if not isinstance(error, OSError | ValueError) else error
        raise BadParameter(f"no cluster answers at {address}: {words}", remedy) from error
