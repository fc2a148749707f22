import pytest

from station.common.progress import StepRate


@pytest.mark.parametrize(
    ("total", "seconds", "words"),
    [(11, 0.2, "5.0/s, 0:02 left"), (100, 2.0, "2.0 s each, 3:18 left"), (5000, 2.0, "2.0 s each, 2:46:38 left")],
)
def test_rate_and_time_left_are_reported(total, seconds, words):
    times = iter([0.0, seconds])
    assert StepRate(total, lambda: next(times)).step() == words


def test_rate_is_that_of_the_last_steps():
    now = [0.0]
    rate = StepRate(1000, lambda: now[0])
    for i in range(200):
        now[0] += 5.0 if i < 100 else 0.1  # the first ones were slow
        reported = rate.step()
    assert reported == "10.0/s, 1:20 left"
