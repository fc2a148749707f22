import pytest

from . import benches


@pytest.fixture
def bench(tmp_path):
    with benches.quick_bench(tmp_path) as bench:
        yield bench


@pytest.fixture
def session(tmp_path, bench):
    with benches.new_session(tmp_path, bench) as session:
        yield session
