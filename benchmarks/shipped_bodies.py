"""Fit bodies to the links of well-known arms that have none in the package yet, and ship them.

    python benchmarks/shipped_bodies.py

Links are found by the content of their geometry. Those that no arm has any more are dropped; the others keep their
bodies, though a newer fit may find better ones: plans with these arms are not to change for it.
"""

from __future__ import annotations

import json

from hdplan.planner.collision.link_bodies import enclosed, link_key
from hdplan.planner.collision.shipped_bodies import ARMS, FILE
from hdplan.planner.robot.robot import load_robot
from hdplan.scenes.robot_spec import RobotSpec


def main() -> None:
    """Write the file again."""
    found = {}
    for name in ARMS:
        robot = load_robot(RobotSpec(name=name))
        for link in robot.links:
            bodies = enclosed(robot, link)
            found[link_key(robot, link)] = [[body.vertices.tolist(), body.radius] for body in bodies]
    lines = [f" {json.dumps(key)}: {json.dumps(found[key])}" for key in sorted(found)]
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
