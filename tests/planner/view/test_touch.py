"""By a finger, on a narrow screen: the panel is a sheet from below, and what is dragged above it follows."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from hdplan.planner.view.page_script import LOW, SHEET, WIDTH
from hdplan.planner.view.things import place_of
from hdplan.planner.view.viewer import Viewer
from tests.planner.view.events import BALL
from tests.planner.view.in_browser import SIZE, calm, selected
from tests.planner.view.in_page import HOLDS, grip, look, seen, wait_for
from tests.waiting import until

NARROW = {"width": 420, "height": 640}


@pytest.fixture
def touched(page: Any) -> Iterator[Any]:
    """The page that tests share, on a screen that is touched."""
    touch = page.context.new_cdp_session(page)
    touch.send("Emulation.setTouchEmulationEnabled", {"enabled": True})
    yield page
    touch.send("Emulation.setTouchEmulationEnabled", {"enabled": False})
    page.set_viewport_size(SIZE)


def dragged(page: Any, begin: tuple[float, float], end: tuple[float, float], last: str) -> None:
    """Drag a handle by a finger, which is lifted last, or taken by the browser: playwright taps alone."""
    touch = page.context.new_cdp_session(page)

    def send(kind: str, *points: tuple[float, float]) -> None:
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": x, "y": y} for x, y in points]})

    assert page.evaluate("(at) => document.elementFromPoint(...at).tagName", begin) == "CANVAS"
    send("touchStart", begin)
    wait_for(page, HOLDS)
    for share in np.linspace(0.1, 1.0, 8):
        x, y = (1 - share) * np.array(begin) + share * np.array(end)
        send("touchMove", (float(x), float(y)))
    send(last)


def test_a_finger_drags_above_the_sheet(touched: Any, watched: Viewer) -> None:
    page = touched
    for width in (NARROW["width"], SHEET - 20):  # viser's own sheet, and the panel that it docks beside the scene
        page.set_viewport_size({**NARROW, "width": width})
        sheet, canvas = page.locator("div:has(> div > .hdplan-page)"), page.locator("canvas").first
        until(lambda width=width, canvas=canvas: canvas.bounding_box()["width"] == width, "the scene is not as wide")

        boxes: list[Any] = []

        def stands(sheet: Any = sheet, width: int = width, boxes: list[Any] = boxes) -> bool:
            """True once the sheet, which the page may be rebuilding, is below the whole scene."""
            of = "e => e.closest('[style*=absolute], [style*=fixed]').getBoundingClientRect().toJSON()"
            boxes.append(sheet.evaluate(of))
            return (boxes[-1]["width"], boxes[-1]["bottom"]) == (width, NARROW["height"])

        until(stands, "the sheet does not stand below the scene")
        box = boxes[-1]
        assert box["height"] <= 0.01 * LOW * NARROW["height"] + 1
        assert canvas.bounding_box()["height"] <= box["top"] + 1
    page.set_viewport_size({**NARROW, "width": 1000})  # the panel grows with the window
    until(lambda: 0 <= 1000 - WIDTH - canvas.bounding_box()["width"] < 10, "the panel is not as wide as it may be")
    page.set_viewport_size(NARROW)
    x, y, z = place_of(watched.edited, BALL, watched.stage.tip).position
    look(page, watched, (x, y - 2.0, z + 1.5), (x, y, z))
    for last in ("touchEnd", "touchCancel"):
        place, before = selected(page, watched, BALL), watched.edited
        held = grip(page, place, 0)
        dragged(page, seen(page, held), seen(page, held - [0.2, 0.0, 0.0]), last)
        until(
            lambda before=before: watched.edited is not before and not watched.panel.handles.dragging,
            "it is not let go",
        )
        calm(watched)
        now = place_of(watched.edited, BALL, watched.stage.tip).matrix[:3, 3]
        assert now[0] < place[0, 3] - 0.1
        np.testing.assert_allclose(now[1:], (y, z), atol=1e-6)
