"""Tables about robots: which are known by name, and what one of them is made of."""

from __future__ import annotations

from typing import Any

import numpy as np

from hdplan.planner.collision.link_bodies import fit_report
from hdplan.planner.robot.robot import load_robot
from hdplan.scenes.errors import InputError
from hdplan.scenes.robot_files.library import robot_names
from hdplan.scenes.robot_spec import RobotSpec

Rows = list[dict[str, Any]]


def listing() -> dict[str, Rows]:
    """Return tables of the robots that are known by name: joints planned and held fixed, links with collision geometry,
    pairs of links to check, named states; and of those that do not load, with the reason."""
    robots: Rows = []
    unusable: Rows = []
    for name in robot_names():
        try:
            robot = load_robot(RobotSpec(name=name))
        except InputError as error:
            unusable.append({"name": name, "reason": str(error)})
            continue
        robots.append(
            {
                "name": name,
                "joints": robot.n,
                "held": len(robot.locked),
                "links": len(robot.links),
                "pairs": len(robot.self_pairs),
                "named_states": ", ".join(robot.named_states),
            }
        )
    return {"robots": robots, "not_usable": unusable}


def describe(name: str) -> dict[str, Rows]:
    """Return tables for one robot: joints, joints held fixed, named states, and outer bodies: their volume over that of
    the link's hull, and how far they stick out of it [mm].

    Raises InputError for an unknown name.
    """
    robot = load_robot(RobotSpec(name=name))
    unit = ["m" if joint.shortname().startswith("JointModelP") else "rad" for joint in list(robot.model.joints)[1:]]
    joints: Rows = [
        {"joint": joint, "unit": unit[i], "lower": _limit(robot.lower[i]), "upper": _limit(robot.upper[i])}
        for i, joint in enumerate(robot.joint_names)
    ]
    held: Rows = [{"joint": joint, "at": round(value, 6)} for joint, value in robot.locked.items()]
    states: Rows = [
        {"state": state, "values": ", ".join(f"{joint} = {value:.4g}" for joint, value in values.items())}
        for state, values in robot.named_states.items()
    ]
    bodies: Rows = [
        {
            "link": row.link,
            "bodies": row.bodies,
            "vertices": row.vertices,
            "volume": round(row.volume_ratio, 2),
            "mean_mm": round(1e3 * row.mean_outside, 1),
            "p95_mm": round(1e3 * row.p95_outside, 1),
            "hold_the_mesh": "yes" if row.contained else "NO",
        }
        for row in fit_report(robot)
    ]
    notes = list(robot.notes)
    if bodies:
        notes.append(
            "outer bodies: their volume over that of the link's hull; how far their surface lies outside it, on "
            "average and at the 95th percentile"
        )
    else:
        notes.append("no link has collision geometry: every motion of this robot is collision-free")
    return {
        "joints": joints,
        "joints_held": held,
        "named_states": states,
        "outer_bodies": bodies,
        "notes": [{"note": note} for note in notes],
    }


def _limit(value: float) -> float | str:
    return round(float(value), 5) if np.isfinite(value) else "none"
