"""Values that are unlikely in hdplan's units: angles beyond a turn, and meshes far larger than the robot. They are used
unchanged, with a note."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hdplan.planner.geometry.meshes import ReadMesh
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.once import made_once
from hdplan.scenes.scene import Scene

LARGE_MESH = 100.0  # times the robot's reach: a mesh so large was hardly meant in metres


def unlikely_units(scene: Scene, robot: Robot) -> Iterator[str]:
    """Yield notes on meshes, of a scene whose files were read, that are hundreds of times as large as the robot
    reaches: they may be in millimetres."""
    notes, reach = _of_links(robot)
    yield from notes
    for obstacle in scene.obstacles:
        if isinstance(obstacle.shape, ReadMesh) and reach > 0.0:
            size = float(np.ptp(obstacle.shape.mesh.vertices, axis=0).max())
            if size > LARGE_MESH * reach:
                about = f"obstacle '{obstacle.name}': mesh {obstacle.shape.file.name}"
                yield f"{about} is {size:.3g} m large, {size / reach:.0f} times the robot's reach{HINT}"


@made_once(8)
def _of_links(robot: Robot) -> tuple[tuple[str, ...], float]:
    """Return the notes on a robot's links, and how far it reaches [m]: once for each robot, as all vertices count."""
    sizes = {link: _size_of(robot, link) for link in robot.link_geometry}
    arm = _chain(robot)
    notes = tuple(
        f"link '{link}' is {size:.3g} m large, {size / arm:.0f} times as far as the joints reach{HINT}"
        for link, size in sizes.items()
        if arm > 0.0 and size > LARGE_MESH * arm
    )
    return notes, arm + max(sizes.values(), default=0.0)


HINT = ": is it in millimetres? hdplan takes metres (a scale of 0.001 makes them)"


def _chain(robot: Robot) -> float:
    """Greatest distance of the joints' origins from the base, whatever the revolute joints do [m]."""
    model, far = robot.model, [0.0]
    for joint in range(1, model.njoints):
        far.append(far[model.parents[joint]] + float(np.linalg.norm(model.jointPlacements[joint].translation)))
    return max(far)


def _size_of(robot: Robot, link: str) -> float:
    """Extent of a link's collision geometry along an axis [m]."""
    found = 0.0
    for i in robot.link_geometry[link]:
        geometry = robot.collision.geometryObjects[i].geometry
        geometry.computeLocalAABB()
        found = max(found, float((geometry.aabb_local.max_ - geometry.aabb_local.min_).max()))
    return found
