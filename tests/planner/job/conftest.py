"""The shipped job in which a can is picked and placed, planned once; modules with a job of their own have their own."""

from __future__ import annotations

import pytest

import hdplan
from hdplan import JobResult, Scene


@pytest.fixture(scope="session")
def planned() -> JobResult:
    found = hdplan.plan_job(hdplan.load_scene("panda_pick_place"))
    assert found.certified, found.text
    return found


@pytest.fixture(scope="session")
def scene(planned: JobResult) -> Scene:
    return planned.scene
