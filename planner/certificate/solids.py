"""The bodies that are compared: every link's real collision geometry, every obstacle's true shape, in pieces."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hdplan.planner.certificate.cloud_pieces import box_pieces, moving_box_pieces, moving_pieces, standing_pieces
from hdplan.planner.certificate.exact_proximity import link_pieces, obstacle_pieces
from hdplan.planner.certificate.intervals import Body
from hdplan.planner.geometry.clouds import balls_in
from hdplan.planner.geometry.voxel_grids import boxes_in
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.once import made_once, read_only
from hdplan.scenes.voxel_grids import OctoMap, Voxels

if TYPE_CHECKING:
    from hdplan.scenes.obstacle_motion import ObstacleMotion


@made_once(8)
def link_bodies(robot: Robot) -> tuple[Body, ...]:
    """Return the pieces of the links' collision geometry; once per robot, as meshes take long."""
    items = [(link, robot.collision.geometryObjects[i]) for link, own in robot.link_geometry.items() for i in own]
    return tuple(
        Body(link, piece, int(item.parentJoint), item.placement.homogeneous)
        for link, item in items
        for piece in link_pieces(item.geometry, item.name)
    )


def obstacle_bodies(obstacle: Obstacle) -> list[Body]:
    """Return the pieces of the true shape of an obstacle whose file was read."""
    name, pose, motion = obstacle.name, obstacle.pose.matrix, _motion_of(obstacle)
    shape = obstacle.shape
    match shape:
        case Cloud() if motion is None:
            pieces, frames = standing_pieces(balls_in(shape))
        case Cloud():
            return [Body(name, piece, 0, pose, motion) for piece in moving_pieces(balls_in(shape))]
        case Voxels() | OctoMap() if motion is None:
            pieces, frames = box_pieces(boxes_in(shape))
        case Voxels() | OctoMap():
            return [Body(name, piece, 0, pose, motion) for piece in moving_box_pieces(boxes_in(shape))]
        case _:
            return [Body(name, piece, 0, pose, motion) for piece in obstacle_pieces(obstacle)]
    return [Body(name, piece, 0, place) for piece, place in zip(pieces, read_only(pose @ frames), strict=True)]


def _motion_of(obstacle: Obstacle) -> ObstacleMotion | None:
    """Return the motion of an obstacle; None if it is static."""
    if obstacle.motion is None:
        return None
    from hdplan.scenes.obstacle_motion import ObstacleMotion

    return ObstacleMotion.of(obstacle)
