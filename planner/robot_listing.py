"""Tables about robots for people: which go by name, and what one of them is made of."""

from __future__ import annotations

from typing import Any

import numpy as np

from hdplan.planner.link_bodies import fit_report
from hdplan.planner.robot import load_robot
from hdplan.planner.robot_library import robot_names
from hdplan.scenes.errors import InputError
from hdplan.scenes.model import RobotSpec

Rows = list[dict[str, Any]]


def listing() -> Rows:
    """One row for every robot that goes by name: joints planned and held, links with geometry, link pairs to be
    checked; or why it does not load."""
    rows: Rows = []
    for name in robot_names():
        try:
            robot = load_robot(RobotSpec(name=name))
        except InputError as error:
            rows.append(
                {"name": name, "planned": 0, "held": 0, "links": 0, "pairs": 0, "note": f"does not load: {error}"}
            )
            continue
        states = f"states: {', '.join(robot.named_states)}" if robot.named_states else ""
        rows.append(
            {
                "name": name,
                "planned": robot.n,
                "held": len(robot.locked),
                "links": len(robot.links),
                "pairs": len(robot.self_pairs),
                "note": states if robot.links else "no collision geometry",
            }
        )
    return rows


def describe(name: str) -> dict[str, Rows]:
    """Tables for one robot: joints, held joints, named states, and its outer bodies with how far they stick out [mm].

    Raises InputError for an unknown name.
    """
    robot = load_robot(RobotSpec(name=name))
    unit = ["m" if joint.shortname().startswith("JointModelP") else "rad" for joint in list(robot.model.joints)[1:]]
    joints: Rows = [
        {"joint": joint, "unit": unit[i], "lower": _limit(robot.lower[i]), "upper": _limit(robot.upper[i])}
        for i, joint in enumerate(robot.joint_names)
    ]
    held: Rows = [{"joint held": joint, "value": value} for joint, value in robot.locked.items()]
    states: Rows = [
        {"state": state, "values": ", ".join(f"{joint} = {value:g}" for joint, value in values.items())}
        for state, values in robot.named_states.items()
    ]
    bodies: Rows = [
        {
            "link": row.link,
            "bodies": row.bodies,
            "vertices": row.vertices,
            "volume ratio": round(row.volume_ratio, 2),
            "mean outside [mm]": round(1e3 * row.mean_outside, 1),
            "95 % outside [mm]": round(1e3 * row.p95_outside, 1),
            "contains the mesh": "yes" if row.contained else "NO",
        }
        for row in fit_report(robot)
    ]
    notes: Rows = [{"note": note} for note in robot.notes]
    return {"joints": joints, "held": held, "named states": states, "outer bodies": bodies, "notes": notes}


def _limit(value: float) -> float | str:
    return round(float(value), 5) if np.isfinite(value) else "none"
