"""The ground lies below the robot's base, as low as the lowest static part, so that it crosses nothing."""

from __future__ import annotations

from collections.abc import Sequence

from hdplan.planner.robot.robot import Robot
from hdplan.planner.view.drawing.camera import Boxes
from hdplan.planner.view.drawing.skins import obstacle_parts, shown_skins
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.poses import Vector3
from hdplan.scenes.robot_spec import RobotSpec


def ground_of(robot: Robot, spec: RobotSpec, obstacles: Sequence[Obstacle]) -> Vector3:
    """Return the middle of the ground [m], in the world: of the base, of links that never move, and of obstacles at
    their poses, none reaches below it."""
    x, y, z = spec.base.position
    feet = [float(skin.vertices[:, 2].min()) for skin in shown_skins(robot, spec)[0] if not skin.joint]
    boxes = Boxes.around([obstacle_parts(each) for each in obstacles], [each.pose.matrix for each in obstacles])
    return x, y, min([z, *feet, *boxes.lowest().tolist()])
