"""What a field's maps say beside their colours."""

from __future__ import annotations

import numpy as np
import pytest

from station.reports.field_figures import covered


@pytest.mark.parametrize(("empty", "words"), [(0, ""), (3, "75% of the frame"), (12, "0% of the frame")])
def test_a_map_says_which_share_of_the_frame_it_tells_of(empty, words):
    values = np.ones((3, 4))
    values.flat[:empty] = np.nan
    assert covered(values) == words
