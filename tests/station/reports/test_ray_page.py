import re

import numpy as np

from station.reports.ray_page import CLOSE_UP_PX, RenderRow, close_ups, ray_page


def test_the_page_holds_its_pictures_and_details(rng):
    pictures = tuple((name, rng.random((60, 70, 3))) for name in ("as rendered", "filtered", "converged"))
    page = ray_page("Rays & <rooms>", (RenderRow("room", pictures, np.ones((60, 70)), ("It gained 12 dB.",)),)).decode()
    assert page.count("data:image/png;base64,") == 3 + 2 * 3 + 1  # the pictures, two details of each, the map
    assert "Rays &amp; &lt;rooms&gt;" in page
    assert "It gained 12 dB." in page
    assert not re.search(r'(src|href)="(?!data:)', page)
    noisy, filtered, similar = np.zeros((200, 300, 3)), np.zeros((200, 300, 3)), np.full((200, 300), 100.0)
    noisy[20:30, 200:210] = 1.0
    similar[150:190, 10:50] = 1.0
    for (_, top, left), (row, column) in zip(close_ups(noisy, filtered, similar), ((25, 205), (170, 30)), strict=True):
        assert top <= row < top + CLOSE_UP_PX
        assert left <= column < left + CLOSE_UP_PX
    small = rng.random((10, 12, 3))
    assert [(top, left) for _, top, left in close_ups(small, small, small[..., 0])] == [(0, 0), (0, 0)]
