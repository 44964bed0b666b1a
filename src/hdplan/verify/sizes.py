"""The sizes of what a scene does not know, as a world has them: of obstacles, of the robot's joints and of its base."""

from __future__ import annotations

from typing import Any

from . import scene as scenes
from .balls import need
from .text import listing, mapping, values

AROUND = {"shift": "position", "turn": "orientation", "speed": "speed"}


def sizes(top: dict[str, Any], joints: Any) -> dict[str, Any]:
    """The key `sizes` of a world; nothing where all is known. `joints`: of the robot, with its section."""
    spec, around = joints.spec, dict[str, Any]()
    for i, entry in enumerate(listing(top.get("obstacles"), "obstacles")):
        if entry.get("uncertainty") is not None:
            what = f"obstacles[{i}].uncertainty"
            section = mapping(entry["uncertainty"], what, " ".join(AROUND.values()))
            found = {key: scenes.one(section.get(word, 0.0), what) for key, word in AROUND.items()}
            if any(found.values()):
                around[entry.get("name", f"obstacle{i}")] = found
    tracking = mapping(spec.get("tracking") or {}, "robot.tracking", "position velocity")
    lags = [lag(tracking.get(key, 0.0), joints.lead, f"robot.tracking.{key}") for key in ("position", "velocity")]
    section = mapping(spec.get("calibration") or {}, "robot.calibration", "position orientation")
    base = {key: scenes.one(section.get(AROUND[key], 0.0), "robot.calibration") for key in ("shift", "turn")}
    if not (around or any(map(any, lags)) or any(base.values())):
        return {}
    about = values((spec.get("base") or {}).get("position", [0.0] * 3), 3, "robot.base").tolist()
    stands = {**base, "about": about} if any(base.values()) else None
    return {"sizes": {"around": around, "base": stands, "joints": lags[0], "rates": lags[1]}}


def lag(given: Any, lead: list[str], what: str) -> list[float]:
    """Greatest deviation of each joint that leads: one number for all, one each, or by name."""
    if isinstance(given, list):
        return [float(x) for x in values(given, len(lead), what)]
    if isinstance(given, dict):
        need({*given} <= {*lead}, f"{what}: of a joint that does not lead")
        return [scenes.one(given.get(x, 0.0), what) for x in lead]
    return [scenes.one(given, what)] * len(lead)
