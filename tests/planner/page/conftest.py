"""A light scene, a motion through it, and a browser for pages."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.page.browser import Browser, find_browser
from hdplan.planner.plan import plan
from hdplan.planner.result import PlanResult
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view.drawing.motion import ShownMotion
from hdplan.scenes.yaml_format.reader import load_scene


@pytest.fixture(scope="session")
def result() -> PlanResult:
    return plan(load_scene("planar_arm"))


@pytest.fixture(scope="session")
def setup(result: PlanResult) -> Setup:
    return Setup.of(load_scene("planar_arm"))


@pytest.fixture(scope="session")
def motion(result: PlanResult, setup: Setup) -> ShownMotion:
    return ShownMotion.of("found", result.trajectory, Certifier(setup), result.certificate)


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """One browser for all tests of pages, each with a new page."""
    program = find_browser()
    if program is None:
        pytest.skip("no browser found: apt-get install chromium")
    with Browser(program) as found:
        yield found
