"""Acts of browsers and hands on a viewer, without a browser."""

from __future__ import annotations

import asyncio
import inspect
import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

from hdplan.planner.certificate.certifier import certify
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.view.edit_steps import Fields
from hdplan.planner.view.motions import Shown
from hdplan.planner.view.things import Thing
from hdplan.planner.view.viewer import Viewer
from tests.waiting import PATIENCE

Opener = Callable[..., Viewer]
BALL, PRISM = Thing("obstacle", "ball"), Thing("obstacle", "prism")


def by_worker(viewer: Any, job: Callable[[], object]) -> None:
    """Have the viewer's thread do a job, and what follows from it."""
    viewer.worker.ask("test", lambda: (job(), None)[1])
    assert viewer.worker.settle(PATIENCE)


def settled(viewer: Viewer) -> None:
    """Wait until nothing is planned live, or drawn, any more."""
    assert viewer.panel.live.settle(20)
    assert viewer.worker.settle(20)


def heard(handle: Any, value: object, client: object = None) -> None:
    """Have a browser send a value of an input, and viser tell of it."""
    handle._impl.value = value
    for callback in handle._impl.update_cb:
        answer = callback(SimpleNamespace(client=client or object(), client_id=1, target=handle))
        if inspect.iscoroutine(answer):
            with ThreadPoolExecutor(1) as elsewhere:  # a browser's test may leave a loop running in this thread
                elsewhere.submit(asyncio.run, answer).result()


def tell(viewer: Viewer, message: object = None, **words: object) -> None:
    """Have a page send a message, as its script does."""
    text = message if isinstance(message, str) else json.dumps(words)
    heard(viewer.panel.page._field, text, SimpleNamespace(client_id=1))
    assert viewer.worker.settle(20)


def field_of(fields: Fields, name: str) -> Any:
    """The input of this name."""
    return next(handle for handle, each, _ in fields._fields if each == name)


def typed(viewer: Viewer, fields: Fields, name: str, value: object) -> Any:
    """Have somebody type a value into a field, and return its input."""
    handle = field_of(fields, name)
    heard(handle, value)
    assert viewer.worker.settle(20)
    return handle


def active_of(viewer: Viewer) -> Shown:
    """The active motion."""
    assert viewer.motions.active is not None
    return viewer.motions.active


def verdict_on(viewer: Viewer) -> str:
    """The certifier's words on the active motion in the scene as it is now."""
    return certify(viewer.scene, active_of(viewer).motion.trajectory, viewer.robot).text


def names(viewer: Viewer) -> list[str]:
    """The names of the obstacles."""
    return [obstacle.name for obstacle in viewer.scene.obstacles]


def straight(trajectory: Trajectory) -> Trajectory:
    """The straight way from a trajectory's start to its goal."""
    return Trajectory(trajectory.joint_names, trajectory.positions[[0, -1]])
