"""Every plan of the catalogue passes on its own bench for an operator who presses Enter only.

`pytest --nightly tests/end_to_end/test_enter_only.py` walks every plan with three seeds in both front ends; without
the option, only the walks of `EVERY_CHANGE` run.
"""

import pytest

from station.guide.catalogue import PLANS
from tests.end_to_end.enter_only import FRONTENDS, walk

SEEDS = (0, 1, 2)
EVERY_CHANGE = frozenset({("edge", 0, "app")})
"""The walk in the normal suite; others walk the plans of the chart (`test_guide`, `test_app`) and of sensors."""


def _walk(plan: str, seed: int, frontend: str) -> object:
    mark = pytest.mark.slow if (plan, seed, frontend) in EVERY_CHANGE else pytest.mark.nightly
    return pytest.param(plan, seed, frontend, marks=mark)


@pytest.mark.parametrize(
    ("plan", "seed", "frontend"),
    [_walk(plan, seed, frontend) for plan in PLANS for seed in SEEDS for frontend in FRONTENDS],
)
def test_enter_alone_leads_to_a_pass(plan, seed, frontend, tmp_path, record_property):
    walked = walk(plan, seed, frontend, tmp_path)
    record_property("walk", walked.summary)
    assert walked.passed, f"{walked.summary}\n{walked.transcript}"
