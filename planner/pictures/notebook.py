"""A plan in a notebook: its verdict, and the motion on a small sheet if matplotlib is installed."""

from __future__ import annotations

import base64
import html
import importlib.util
import io

from hdplan.planner.pictures.plot import Subject
from hdplan.planner.result import PlanResult
from hdplan.planner.robot.setup import Setup

DOTS, WIDTH = 110, 760  # per inch of the picture, and its width on the page [px]
GOOD, BAD = "#1a7f37", "#b42318"


def result_html(result: PlanResult) -> str:
    """Return the result as self-contained HTML."""
    color = GOOD if result.certified else BAD
    parts = [
        f'<p style="margin:0"><b style="color:{color}">{html.escape(result.certificate.text)}</b><br>',
        html.escape(
            f"{result.scene} with {result.robot}: {result.trajectory.extent}, {result.iterations} iterations, "
        ),
        f"{sum(vars(result.times).values()):.2f} s</p>",
    ]
    if result.requested is not None and importlib.util.find_spec("matplotlib") is not None:
        parts.append(_sheet(Subject.planned(Setup.of(result.requested), result)))
    return "".join(parts)


def _sheet(subject: Subject) -> str:
    from hdplan.planner.pictures.sheet import sheet

    picture = io.BytesIO()
    sheet(subject).savefig(picture, format="png", dpi=DOTS)
    data = base64.b64encode(picture.getvalue()).decode()
    return f'<img width="{WIDTH}" alt="the motion on one sheet" src="data:image/png;base64,{data}">'
