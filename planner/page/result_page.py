"""A plan as a page: `result.show()`, in a notebook or in any browser once it is saved."""

from __future__ import annotations

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.html_page import HtmlPage
from hdplan.planner.page.recorded_page import page_of
from hdplan.planner.result import PlanResult
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view.drawing.motion import ShownMotion
from hdplan.scenes.errors import InputError


def result_page(result: PlanResult) -> HtmlPage:
    """Return the page of a plan's motion. Raises InputError for a result that does not say in which scene it is."""
    if result.requested is None:
        raise InputError("result.show: this result does not hold the scene that was planned in")
    setup = Setup.of(result.requested)
    return page_of(setup, [ShownMotion.of("planned", result.trajectory, Certifier(setup), result.certificate)])
