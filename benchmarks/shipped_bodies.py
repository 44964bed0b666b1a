"""Fit bodies to the links of well-known robots that have none in the package yet, and ship them with what is found
about them.

    python benchmarks/shipped_bodies.py

Links are found by the content of their geometry. Those that no robot has any more are dropped; the others keep their
bodies, though a newer fit may find better ones: plans with these robots do not change for it. What is found about the
bodies is computed again, in a cache of its own.
"""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path

from hdplan.planner.collision.collision_model import collision_model_of
from hdplan.planner.collision.link_bodies import enclosed, link_key
from hdplan.planner.collision.shipped_bodies import FILE, KINDS, RESULTS, ROBOTS
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.scenes.planner_settings import PlannerSettings
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.yaml_format.reader import load_scene, shipped_scenes


def main() -> None:
    """Write the files again."""
    RESULTS.write_text("{}\n", encoding="utf-8")  # nothing of it is taken over
    found = {}
    for name in ROBOTS:
        robot = load_robot(RobotSpec(name=name))
        for link in robot.links:
            bodies = enclosed(robot, link)
            found[link_key(robot, link)] = [[body.vertices.tolist(), body.radius] for body in bodies]
    lines = [f" {json.dumps(key)}: {json.dumps(found[key])}" for key in sorted(found)]
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["HDPLAN_CACHE"] = folder
        held = [load_scene(name) for name in shipped_scenes()]  # some hold a gripper's fingers open
        shown = [load_scene_robot(scene) for scene in held if scene.robot.name in ROBOTS and not scene.attached]
        for robot in (*(load_robot(RobotSpec(name=name)) for name in ROBOTS), *shown):
            collision_model_of(robot, PlannerSettings().link_bodies, PlannerSettings().normals)
        kept = {kind: sorted(Path(folder, kind).glob("*.json")) for kind in KINDS}
        rows = {kind: [f'  "{file.stem}": {file.read_text().splitlines()[1]}' for file in kept[kind]] for kind in KINDS}
    kinds = (f' "{kind}": {{\n' + ",\n".join(rows[kind]) + "\n }" for kind in KINDS)
    RESULTS.write_text("{\n" + ",\n".join(kinds) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
