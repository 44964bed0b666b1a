"""A job's time against that of its legs, planned one by one: each from rest to rest, as somebody who has no jobs would.

Measured are the shipped jobs that have blends, as they are, and random rounds of an arm above a table: above each of
four places in turn, straight down, a signal to the gripper, straight up, and above the next one; where an arm goes over
from a motion into the next one, within a radius. Both are planned by the same planner with the same seed, within
the same limits, and certified. A round that cannot be blended counts as 1.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

import hdplan

SHIPPED = ("panda_seam", "ur5_palletize")
ARMS = {  # link, its roll, pitch and yaw when it points down, the axis about which it may turn then, and where to begin
    "panda": ("panda_hand_tcp", (math.pi, 0.0, 0.0), "z", [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]),
    "ur5": ("ee_link", (0.0, 0.5 * math.pi, 0.0), "x", [0.3, -1.5, 1.9, -1.97, -1.57, 0.0]),
}
PLACES, DOWN, BLEND = 4, 0.12, 0.06  # places; [m]
NEAR, FAR, ROUND = 0.4, 0.6, 1.2  # [m] from the base, [rad] to both sides
ABOVE = 0.3  # [m]
LIMITS = hdplan.Limits(velocity="urdf", acceleration=7.5, jerk=500.0)


def rounds(count: int, first: int) -> Iterator[tuple[str, hdplan.Scene]]:
    """Yield random rounds; the k-th depends on k alone."""
    for number in range(first, first + count):
        rng, arm = np.random.default_rng(number), list(ARMS)[number % len(ARMS)]
        link, turned, free, start = ARMS[arm]
        stages: list[hdplan.Move | hdplan.Line | hdplan.Set] = []
        for place in range(PLACES):
            away, angle = rng.uniform(NEAR, FAR), rng.uniform(-ROUND, ROUND)
            pose = hdplan.Pose.from_rpy([away * math.cos(angle), away * math.sin(angle), ABOVE], turned)
            goal = hdplan.PoseTarget(link, pose, free_rotation=free)
            stages += [
                hdplan.Move(goal, blend=BLEND),
                hdplan.Line(by=[0.0, 0.0, -DOWN], link=link),
                hdplan.Set({"gripper": place % 2 == 0}),
                hdplan.Line(by=[0.0, 0.0, DOWN], link=link, blend=BLEND if place < PLACES - 1 else 0.0),
            ]
        name = f"{arm}, round {number}"
        yield name, hdplan.Scene(robot=arm, name=name, start=start, limits=LIMITS, job=hdplan.Job(stages))


def at_rest(scene: hdplan.Scene) -> hdplan.Scene:
    """Return the same job, every leg of which ends at rest."""
    assert scene.job is not None
    stages = [
        replace(each, blend=0.0) if isinstance(each, hdplan.Move | hdplan.Line | hdplan.Circle | hdplan.Along) else each
        for each in scene.job.stages
    ]
    return replace(scene, job=hdplan.Job(stages))


def duration(scene: hdplan.Scene, time_limit: float) -> float | str:
    """Return the duration of a job's certified motion [s], or the reason why there is none."""
    try:
        result = hdplan.plan_job(scene, time_limit=time_limit)
    except hdplan.HdplanError as error:
        return str(error).removeprefix(f"{scene.source}: ")
    return float(result.trajectory.duration or 0.0) if result.certified else result.text


def legs(count: int, first: int, time_limit: float) -> None:
    """Plan the jobs, and print what was found as a table."""
    print("| job | its time [s] | its legs one by one [s] | share |\n| --- | --- | --- | --- |", flush=True)
    shares: list[float] = []
    shipped = ((name, hdplan.load_scene(name)) for name in SHIPPED)
    for name, scene in (*shipped, *rounds(count, first)):
        rested, blended = duration(at_rest(scene), time_limit), duration(scene, time_limit)
        if isinstance(rested, str):
            print(f"| {name} | | not planned: {rested[:160]} | |", flush=True)
            continue
        shares.append(1.0 if isinstance(blended, str) else blended / rested)
        text = f"not blended: {blended[:160]}" if isinstance(blended, str) else f"{blended:.2f}"
        print(f"| {name} | {text} | {rested:.2f} | {shares[-1]:.3f} |", flush=True)
    print(f"| **median of {len(shares)}** (least, most) | | | {statistics.median(shares):.3f} ", end="")
    print(f"({min(shares):.3f}, {max(shares):.3f}) |")
