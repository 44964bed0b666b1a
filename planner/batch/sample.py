"""Random problems in one scene: starts and goals that are free, or the places of a job, as a table of the fields in
which they differ."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hdplan.planner.batch.places import moved_places
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.geometry.shape_table import operations
from hdplan.planner.job.places import link_pose, pose_of
from hdplan.planner.robot.link_frame import end_effector
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.goals import may_end
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.obstacles import Seen
from hdplan.scenes.values import Choice, Number, Whole, checked
from hdplan.scenes.yaml_format.reader import find_scene, load_scene
from hdplan.scenes.yaml_format.variants import load_variant

GOALS = ("joints", "pose")
MOST_TRIES = 1000  # draws of one end, or of obstacles, before a problem is given up


@dataclass
class Sampled:
    """Accepted problems, and the numbers of rejected ones by reason."""

    rows: list[dict[str, Any]] = field(default_factory=list)
    rejected: Counter[str] = field(default_factory=Counter)

    @property
    def text(self) -> str:
        """Say both in one line."""
        vain = ", ".join(f"{count} {why}" for why, count in sorted(self.rejected.items())) or "none"
        return f"{len(self.rows)} problems; rejected: {vain}"


def sample(
    scene: Path,
    count: int,
    *,
    seed: int = 0,
    goal: str = "joints",
    jitter: float = 0.0,
    resize: float = 0.0,
    report: Callable[[int, int, str], None] = lambda done, of, what: None,
    stop: Callable[[], bool] = lambda: False,
) -> Sampled:
    """Draw problems whose start and goal are free, with the scene's clearance, and keep its path constraints; of a job
    the places at which its objects are taken and let go.

    Args:
        scene: a hdplan scene's file, or a shipped scene's name.
        count: how many.
        seed: the same seed gives the same problems; a longer table begins with a shorter one.
        goal: "joints", or "pose": of the end effector, in the drawn configuration, with the scene format's tolerances.
        jitter: [m] by at most which each obstacle is moved along each axis; of a job each place, along x and y.
        resize: share, below 1, by at most which each obstacle's sizes are changed.

    Joints without limits are drawn within a turn, and slides without limits within a metre, about the scene's start.

    Raises InputError for bad values and files, and if nothing free is found in MOST_TRIES draws.
    """
    file = find_scene(scene)
    count = checked(Whole(1, 10_000_000), count, "n")
    seed = checked(Whole(0, 2**63 - 1), seed, "seed")
    checked(Choice(GOALS), goal, "goal")
    jitter, resize = checked(Number(low=0.0, unit="m"), jitter, "jitter"), checked(Number(0.0, 0.9), resize, "resize")
    of_job = load_scene(file).job is not None
    if of_job and (not jitter or resize or goal != GOALS[0]):
        raise InputError(f"{file}: holds a job, whose places are drawn: give --jitter, and neither --resize nor --goal")
    made = Sampled()
    for i in range(count):
        if stop():
            break
        rng = np.random.default_rng([seed, i])
        if of_job:
            made.rows.append(_draw_job(file, rng, jitter, i))
        else:
            made.rows.append(_draw(file, rng, goal, jitter, resize, i, made.rejected))
        report(i + 1, count, f"problem {i + 1}")
    return made


def _draw(
    file: Path, rng: np.random.Generator, goal: str, jitter: float, resize: float, number: int, rejected: Counter[str]
) -> dict[str, Any]:
    fields = dict(_moved(file, rng, jitter, resize)) if jitter or resize else {}
    changed = load_variant(file, fields, f"{file.stem} {number}") if fields else load_scene(file)
    certifier = Certifier(Setup.of(changed))
    certifier.setup.refuse_moving_ends("sampled problems begin and end at rest")
    ends = {end: _free(certifier, rng, end, rejected) for end in ("start", "goal")}
    robot = certifier.robot
    row: dict[str, Any] = {"name": f"{file.stem}/{number:06d}"}
    row |= {f"start.joints.{name}": float(x) for name, x in zip(robot.joint_names, ends["start"], strict=True)}
    if goal == "joints":
        row |= {f"goal.joints.{name}": float(x) for name, x in zip(robot.joint_names, ends["goal"], strict=True)}
    else:
        row |= _pose(robot, ends["goal"])
    return row | fields


def _draw_job(file: Path, rng: np.random.Generator, jitter: float, number: int) -> dict[str, Any]:
    fields, drawn = moved_places(load_scene(file), rng, jitter)
    name = f"{file.stem}/{number:06d}"
    found = load_variant(file, fields, name)  # refuses what the scene's file cannot hold
    if (found.job, found.obstacles) != (drawn.job, drawn.obstacles):
        raise InputError(
            f"{file}: job: the numbers of its stages are not those of its entries: write out each `repeat`"
        )
    return {"name": name, **fields}


def _free(certifier: Certifier, rng: np.random.Generator, end: str, rejected: Counter[str]) -> Array:
    """Draw a configuration in which a motion may begin and end."""
    robot, scene = certifier.robot, certifier.scene
    middle = robot.configuration(scene.start, scene.from_request)
    reach = np.where([kind.startswith("JointModelP") for kind in _kinds(robot)], 1.0, np.pi)
    low, high = (np.where(np.isfinite(x), x, middle + s * reach) for x, s in ((robot.lower, -1), (robot.upper, 1)))
    for _ in range(MOST_TRIES):
        q = rng.uniform(low, high)
        if may_end(certifier, q, scene.planner.clearance):
            return np.asarray(q)
        rejected[f"{end}s too close or off the path"] += 1
    raise InputError(f"{scene.source}: no free {end} in {MOST_TRIES} draws")


def _kinds(robot: Robot) -> list[str]:
    return [robot.model.joints[robot.model.getJointId(name)].shortname() for name in robot.joint_names]


def _pose(robot: Robot, q: Array) -> dict[str, Any]:
    """Return the pose of the end effector as fields of a goal."""
    link = end_effector(robot, "goal")
    pose = pose_of(link_pose(robot, q, link))
    place = {f"goal.pose.position.{i}": x for i, x in enumerate(pose.position)}
    turn = {f"goal.pose.quaternion_xyzw.{i}": x for i, x in enumerate(pose.quaternion_xyzw)}
    return {"goal.pose.link": link, **place, **turn}


def _moved(file: Path, rng: np.random.Generator, jitter: float, resize: float) -> Iterator[tuple[str, Any]]:
    """Yield the fields of obstacles that are moved and resized."""
    for obstacle in load_scene(file).obstacles:
        where = f"obstacles.{obstacle.name}"
        if jitter and obstacle.motion is None:
            place = obstacle.pose.position + rng.uniform(-jitter, jitter, 3)
            yield from ((f"{where}.pose.position.{i}", float(x)) for i, x in enumerate(place))
        if resize:
            sizes = "" if isinstance(obstacle.shape, Seen) else operations(obstacle.shape).sizes
            for name in sizes.split():  # what was measured keeps its size
                size = np.asarray(getattr(obstacle.shape, name)) * rng.uniform(1.0 - resize, 1.0 + resize)
                if size.ndim:
                    yield from ((f"{where}.shape.{name}.{i}", float(x)) for i, x in enumerate(size))
                else:
                    yield f"{where}.shape.{name}", float(size)
