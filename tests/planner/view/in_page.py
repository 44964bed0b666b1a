"""A page's own knowledge of its scene, as viser's client keeps it for tests: its camera, its nodes, and how many
pictures it has drawn.

A full processor draws few pictures, and a page takes what it was sent only as it draws. What a test presses is
therefore looked up in the page, and waited for there: the server knows neither what is drawn nor from where.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdplan.planner.view.drawing.handle import SIZE as SIZE_OF_HANDLE
from hdplan.planner.view.looking import RESIZED, Looking
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.poses import Vector3
from tests.waiting import PATIENCE, until

EYE, TARGET = (0.4, -2.2, 2.6), (0.4, 0.3, 0.0)  # from where the whole planar arm is seen
SAME_PLACE = 1e-3  # [m]
EVERY = 100  # [ms] between two looks at a page
DRAWN = """(least) => {
  __viserMutable.requestRender();
  return __viserTestpoints.rendererInfo.render.frame >= least;
}"""
SEEN = """(point) => {
  const {camera, canvas, nodeRefFromName} = __viserMutable, box = canvas.getBoundingClientRect();
  const at = nodeRefFromName[''].localToWorld(camera.position.clone().fromArray(point));
  const ahead = -at.clone().applyMatrix4(camera.matrixWorldInverse).z;
  at.project(camera);
  const scale = box.height / (2 * ahead * Math.tan(camera.fov * Math.PI / 360));
  return [box.x + 0.5 * (1 + at.x) * box.width, box.y + 0.5 * (1 - at.y) * box.height, scale];
}"""
LOOKS = """([eye, target, most]) => {
  const {camera, nodeRefFromName} = __viserMutable, root = nodeRefFromName[''];
  const at = (point) => root.localToWorld(camera.position.clone().fromArray(point));
  const towards = at(target).sub(at(eye)).normalize();
  return camera.position.distanceTo(at(eye)) < most
    && camera.getWorldDirection(towards.clone()).distanceTo(towards) < most;
}"""
STANDS = """([name, point, most]) => {
  const {camera, nodeRefFromName} = __viserMutable, node = nodeRefFromName[name];
  const at = nodeRefFromName[''].localToWorld(camera.position.clone().fromArray(point));
  return Boolean(node) && at.clone().setFromMatrixPosition(node.matrixWorld).distanceTo(at) < most;
}"""
HAS = """(names) => {
  const {messageQueue, nodeRefFromName} = __viserMutable;
  return !messageQueue.length && names.every((name) => nodeRefFromName[name]);
}"""
ASPECT = "__viserMutable.camera.aspect"
UNDER = "([x, y]) => document.elementsFromPoint(x, y).slice(0, 3).map((each) => each.outerHTML.slice(0, 200))"
SENT = itertools.count()
HOLDS = "!__viserMutable.cameraControl.enabled"  # a handle in a hand keeps the camera still


def wait_for(page: Any, true: str, given: object = None) -> None:
    """Wait until a condition holds in the page."""
    page.wait_for_function(true, arg=given, polling=EVERY)


def drawn(page: Any) -> None:
    """Wait until the page has drawn two more pictures: the first of them may have begun before the change."""
    wait_for(page, DRAWN, page.evaluate("__viserTestpoints.rendererInfo.render.frame") + 2)


def complete(page: Any, server: Any, looking: Looking) -> None:
    """Wait until the page has drawn all that its server has sent, from where it is best seen at the page's width."""
    bodies = [name for name, node in server.scene._handle_from_node_name.items() if not hasattr(node, "text")]
    wait_for(page, HAS, bodies)

    def framed() -> bool:
        drawn(page)
        aspect, views = page.evaluate(ASPECT), [looking._set.get(number) for number in server.get_clients()]
        return any(view is not None and abs(view[1] - aspect) <= RESIZED * aspect for view in views)

    until(framed, "the page is not framed")
    drawn(page)


def seen(page: Any, point: NDArray[np.float64]) -> tuple[float, float]:
    """Place on the page of a point of the scene [px]."""
    x, y, _ = page.evaluate(SEEN, point.tolist())
    return x, y


def grip(page: Any, place: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """A point on an arrow of the handle that stands at `place` (4, 4): (3,) [m]."""
    *_, scale = page.evaluate(SEEN, place[:3, 3].tolist())
    return np.asarray(place[:3, 3] + 0.7 * SIZE_OF_HANDLE / scale * place[:3, axis])


def heard(page: Any, viewer: Viewer) -> None:
    """Wait until the server has all messages of the page: the place of its camera comes last."""
    clients = viewer.server.get_clients
    before = {number: client.camera.update_timestamp for number, client in clients().items()}
    drawn(page)
    page.evaluate("__viserMutable.sendCamera()")
    until(
        lambda: any(client.camera.update_timestamp != before[number] for number, client in clients().items()),
        "the page does not say from where it looks",
    )
    viewer.worker.settle(PATIENCE)


def look(page: Any, viewer: Viewer, eye: Vector3 = EYE, target: Vector3 = TARGET) -> None:
    """Let every page look from one point at another, and wait until this one does and its server knows: one that hears
    late how wide a page's picture is frames the scene again."""
    clients = viewer.server.get_clients
    until(lambda: clients() and clients().keys() <= viewer.panel.looking._set.keys(), "the page is not framed")

    def stays() -> bool:
        viewer.worker.settle(PATIENCE)
        for client in clients().values():
            client.camera.position = eye
            client.camera.look_at = target
        heard(page, viewer)
        known = (client.camera.position for client in clients().values())
        return page.evaluate(LOOKS, (eye, target, SAME_PLACE)) and any(
            np.abs(position - eye).max() < SAME_PLACE for position in known
        )

    until(stays, "the camera does not stay where it is set")


def handled(page: Any, viewer: Viewer) -> None:
    """Wait until the handle of what is selected is drawn: the newest one, as each move of it puts another there."""

    def stands() -> bool:
        viewer.worker.settle(PATIENCE)
        handle = viewer.panel.handles.grip.node
        return handle is not None and bool(
            page.evaluate(STANDS, (handle.name, tuple(handle.position.tolist()), SAME_PLACE))
        )

    until(stands, "the handle is not drawn")
    arrived(page, viewer)


def arrived(page: Any, viewer: Viewer) -> None:
    """Wait until the page has all that the server has sent, as what lets the mouse through: a node is sent last."""
    name = f"/arrived{next(SENT)}"
    marker = viewer.server.scene.add_frame(name, show_axes=False)
    wait_for(page, HAS, [name])
    marker.remove()
    drawn(page)


def gripped(page: Any, at: Sequence[float]) -> None:
    """Press the button on a part of a handle, and wait until it is held."""
    page.mouse.move(*at)
    page.mouse.down()
    try:
        wait_for(page, HOLDS)
    except Exception as error:  # playwright is imported where a browser is
        raise AssertionError(f"at {at} nothing is held, but {page.evaluate(UNDER, list(at))}") from error
