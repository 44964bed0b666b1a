"""Planned motions, executed by a body in MuJoCo: tracking errors, and executed clearance against the proven one.

    python benchmarks/executed.py [NAME ...]

Each scene, with limits of velocity, acceleration and jerk where it has none, is planned and executed by the scene's
robot in MuJoCo (`control.MuJoCoArm`). The errors that were measured, times MARGIN, become its `robot.tracking`; it is
planned for these, so that the motion is proven in a tube about itself, and executed, until the errors stay in the tube.
It *holds* if they do, and nothing comes closer than is proven: exact distances of the robot's meshes at each executed
step, of 1 ms. A replanner drives to its goal while a person walks past; the proven clearance is then the least that any
command was proven for, against all that the person could have done. No proof of a job knows a tube: its row is what
happened.
"""

from __future__ import annotations

import argparse
import dataclasses
from concurrent.futures import Executor, Future
from typing import Any

import numpy as np

import hdplan
from hdplan import control
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.control.mujoco_arm import execute_in_mujoco
from hdplan.planner.control.simulation import fitting
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.setup import Setup
from hdplan.planner.studies.report import markdown_text

LIMITS = hdplan.Limits(velocity="urdf", acceleration=7.5, jerk=500)
SCENES = ("panda_cage", "panda_bookshelf", "panda_gate", "kinova_shelf", "ur5_table", "ur5_ceiling", "xarm7_post")
JOBS = ("panda_pick_place",)
REPLANNER = "replanner"
MARGIN, ROUNDS = 1.5, 4  # of the tube over the errors that were measured before; how often it is planned again
LAG, LAG_SPEED = 0.01, 0.4  # [rad], [rad/s] the tube of the replanner

Row = dict[str, str | float | None]


def executed(scene: hdplan.Scene, motion: Trajectory) -> tuple[Any, float]:
    """Return the executed motion, and the least exact distance [m] at any step of it."""
    setup = Setup.of(scene)
    done = execute_in_mujoco(setup, fitting(setup, motion))
    return done, least(setup, done.positions, done.times)


def least(setup: Setup, positions: np.ndarray, times: np.ndarray) -> float:
    certifier, found = Certifier(setup), np.inf
    for q, t in zip(positions, times.tolist(), strict=True):
        place = certifier.nearest(q, found, time=t)[0]
        found = found if place is None else min(found, place.distance)
    return float(found)


def row(
    name: str, done: Any, bare: float | None, tube: float | None, proven: float | None, met: float, inside: bool
) -> Row:
    """Return a row of the table: `bare` is proven without a tube, `proven` in it; `met` was measured."""
    holds = "–" if proven is None else "yes" if inside and met >= proven else "NO"
    return {
        "": name,
        "off [mrad]": f"{1e3 * np.abs(done.errors).max():.1f}",
        "off [rad/s]": f"{np.abs(done.velocity_errors).max():.2f}",
        "proven without a tube [mm]": "–" if bare is None else f"{1e3 * bare:.1f}",
        "tube [mrad]": "–" if tube is None else f"{1e3 * tube:.1f}",
        "proven in the tube [mm]": "–" if proven is None else f"{1e3 * proven:.1f}",
        "executed [mm]": f"{1e3 * met:.1f}",
        "holds": holds,
    }


def of_scene(name: str) -> Row:
    scene = hdplan.load_scene(name)
    if scene.limits == hdplan.Limits():
        scene = dataclasses.replace(scene, limits=LIMITS)
    first = planned = hdplan.plan(scene)
    done, met = executed(scene, first.trajectory)
    tube = [MARGIN * np.abs(each).max(axis=0) for each in (done.errors, done.velocity_errors)]
    inside = False
    for _ in range(ROUNDS):
        lag = hdplan.Tracking(*(tuple(each.tolist()) for each in tube))
        known = dataclasses.replace(scene, robot=dataclasses.replace(scene.robot, tracking=lag))
        planned = hdplan.plan(known)
        if not planned.certified:
            break
        done, met = executed(known, planned.trajectory)
        most = [np.abs(each).max(axis=0) for each in (done.errors, done.velocity_errors)]
        if inside := all((found <= size).all() for found, size in zip(most, tube, strict=True)):
            break
        tube = [np.maximum(MARGIN * found, size) for found, size in zip(most, tube, strict=True)]
    proven = planned.certificate.clearance if planned.certified else None
    return row(name, done, first.certificate.clearance, float(tube[0].max()), proven, met, inside)


def of_job(name: str) -> Row:
    """The whole job by one loop; no proof of a job knows a tube."""
    scene = hdplan.load_scene(name)
    planned = hdplan.plan_job(scene)
    done = control.Loop(control.MuJoCoArm.of(scene)).follow(planned.trajectory)
    distances = []
    for stage in planned.certificate.stages:
        setup = Setup.of(stage.scene)
        if setup.robot.joint_names == done.joint_names:  # not of the fingers
            rows = (done.times >= stage.begins) & (done.times <= stage.ends)
            distances.append(least(setup, done.positions[rows], done.times[rows] - stage.begins))
    return row(name, done, planned.certificate.clearance, None, None, min(distances), True)


class AtOnce(Executor):
    def submit(self, work: Any, /, *args: Any, **named: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(work(*args, **named))
        return future


def of_replanner() -> dict[str, str | float | None]:
    person = hdplan.Uncertainty(0.01, speed=0.4)
    shape, speed = hdplan.Capsule(0.1, 0.6), 0.3
    scene = hdplan.Scene(
        robot=hdplan.RobotSpec("panda", tracking=hdplan.Tracking(LAG, LAG_SPEED)),
        obstacles=[hdplan.Obstacle("floor", hdplan.Box([2, 2, 0.1]), [0, 0, -0.1])],
        start=[0.9, 0.3, 0, -1.9, 0, 2.2, 0.785],
        goal=[-0.9, 0.3, 0, -1.9, 0, 2.2, 0.785],
        limits=hdplan.Limits(velocity="urdf", acceleration=10, jerk=1000),
    )

    def at(t: float) -> list[float]:
        return [0.75, -0.5 + speed * t, 0.5]

    arm = control.MuJoCoArm.of(scene)
    with hdplan.Replanner(scene, clock=arm.time, executor=AtOnce()) as replanner:

        def see(t: float) -> None:
            seen = max(t - 0.05, 0.0)
            replanner.update([hdplan.Obstacle("person", shape, at(seen), uncertainty=person)], at=seen)

        done = control.Loop(arm).replan(replanner, 20.0, see)
    setup = Setup.of(scene)
    met = np.inf
    for k in range(0, len(done.times), 5):
        if np.abs(done.velocities[k]).max() < 1e-3:
            continue  # what comes to a robot that stands is not its contact
        there = [*scene.obstacles, hdplan.Obstacle("person", shape, at(float(done.times[k])))]
        world = setup.changed(obstacles=there)
        place = Certifier(world).nearest(done.positions[k], met)[0]
        met = met if place is None else min(met, place.distance)
    proven = min(command.clearance for command in done.commands if command.clearance is not None)
    inside = bool(np.abs(done.errors).max() <= LAG and np.abs(done.velocity_errors).max() <= LAG_SPEED)
    return row(REPLANNER, done, None, LAG, proven, met, inside)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"scenes, jobs, or {REPLANNER}")
    chosen = parser.parse_args().names or [*SCENES, *JOBS, REPLANNER]
    rows = [
        of_replanner() if name == REPLANNER else of_job(name) if name in JOBS else of_scene(name) for name in chosen
    ]
    print(markdown_text(rows))


if __name__ == "__main__":
    main()
