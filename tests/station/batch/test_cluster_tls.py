"""A cluster that speaks TLS: who has its authority's certificate works with it, nobody else gets in."""

import pytest

from procedures.outcome import BadParameter
from station.batch.dask_pool import run_on_cluster
from station.batch.process_pool import Stop

pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore::ResourceWarning"),  # whom Dask turns away, and what it opens while it starts
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


@pytest.fixture
def cluster(tmp_path):
    """Scheduler and worker on the loopback, in threads of this process; and the files that let one in."""
    pytest.importorskip("cryptography")
    distributed = pytest.importorskip("distributed")
    from .certificates import write_certificates

    files = write_certificates(tmp_path / "own")
    stated = dict(zip(NAMES, map(str, files * 3), strict=True))
    security = distributed.Security(**stated, require_encryption=True)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, host="127.0.0.1", protocol="tls://", security=security,
        dashboard_address="127.0.0.1:0",
    ) as running:  # fmt: skip
        yield running.scheduler_address, files


NAMES = [
    f"tls_{kind}" for role in ("client", "scheduler", "worker") for kind in ("ca_file", f"{role}_cert", f"{role}_key")
]


def test_work_goes_to_a_cluster_with_tls_and_to_nobody_without_its_certificate(cluster, errands, tmp_path, monkeypatch):
    from .certificates import write_certificates

    address, files = cluster
    errand = errands.Errand(tmp_path)
    assert address.startswith("tls://127.0.0.1:")
    found = dict(run_on_cluster(errands.square, errand, range(3), Stop(), address, tls=files))
    assert found == {n: n * n for n in range(3)}
    monkeypatch.setattr("station.batch.dask_pool.PATIENCE_S", 1)
    others = write_certificates(tmp_path / "other")
    for address_of, tls in ((address, None), (address, others), (address.replace("tls", "tcp"), None)):
        with pytest.raises(BadParameter, match=f"no cluster answers at {address_of}"):
            list(run_on_cluster(errands.square, errand, range(3), Stop(), address_of, tls=tls))
