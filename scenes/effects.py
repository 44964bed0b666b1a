"""The sections that switch an effect on: motions of obstacles, self_collision, limits, payload, path, timing.

A section that is there says something: an empty one is refused. What joints and links are called is checked when the
robot is loaded; what one section needs of another is checked here, in `check_effects`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping

import numpy as np

from hdplan.scenes.fields import Field
from hdplan.scenes.model import (
    JointValues,
    Limits,
    PathConstraints,
    Payload,
    Scene,
    SelfCollision,
    SteadyMotion,
    TimedPoses,
    Timing,
    Upright,
    Vector3,
    Within,
)
from hdplan.scenes.poses import EXACT, pose_of, read_pose, read_vector

QUANTITIES = {
    "velocity": "rad/s or m/s",
    "acceleration": "rad/s² or m/s²",
    "jerk": "rad/s³ or m/s³",
    "torque": "Nm or N",
}
"""Limits beside those of positions, with their units."""
IN_URDF = ("velocity", "torque")  # what a URDF says of its joints
MOST_CLEARANCE = 1.0  # [m]
RATES = (1.0, 1e4)  # lowest and highest [1/s]
AXES: Mapping[str, Vector3] = {
    "x": (1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0),
    "z": (0.0, 0.0, 1.0),
    "-x": (-1.0, 0.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "-z": (0.0, 0.0, -1.0),
}
ROUNDING = 1e-9  # share of the largest principal moment by which an inertia may break the laws of a body
ANYWHERE = (math.inf, math.inf, math.inf)


def read_motion(section: Field) -> SteadyMotion | TimedPoses:
    """Read how an obstacle moves: ``{velocity, spin}``, or ``{times, poses}``."""
    keys = _filled(section, ("velocity", "spin", "times", "poses"))
    if "times" not in keys and "poses" not in keys:
        velocity, spin = (
            read_vector(keys[key], unit=unit) if key in keys else (0.0, 0.0, 0.0)
            for key, unit in (("velocity", "m/s"), ("spin", "rad/s"))
        )
        return SteadyMotion(velocity, spin)
    if len(keys) != 2 or "times" not in keys or "poses" not in keys:
        raise section.error(f"must have either velocity and spin, or times and poses, found {', '.join(keys)}")
    times = tuple(time.number(low=0.0, unit="s") for time in keys["times"].items(of="times"))
    if len(times) < 2:
        raise keys["times"].error(f"must be two or more times [s], found {len(times)}")
    for before, after in itertools.pairwise(times):
        if not before < after:
            raise keys["times"].error(f"must rise from one to the next [s], found {before:g} before {after:g}")
    entries = keys["poses"].items(of="poses")
    if len(entries) != len(times):
        raise keys["poses"].error(f"must be as many as the {len(times)} times, found {len(entries)}")
    return TimedPoses(times, tuple(read_pose(pose) for pose in entries))


def read_self_collision(section: Field) -> SelfCollision:
    """Read ``true``, ``false`` or ``{clearance}``."""
    if isinstance(section.value, bool):
        return SelfCollision(checked=section.value)
    if not isinstance(section.value, dict):
        raise section.wrong("true, false or a mapping with the key clearance")
    return SelfCollision(clearance=read_clearance(_filled(section, ("clearance",))["clearance"]))


def read_clearance(entry: Field) -> float:
    """Read what is to be proven free around something [m]."""
    return entry.number(0.0, MOST_CLEARANCE, unit="m")


def read_limits(section: Field) -> Limits:
    """Read what the joints can do: ranges of positions by name, and ``velocity``, ``acceleration``, ``jerk`` and
    ``torque``, each in one of the forms of `JointValues`."""
    keys = _filled(section, ("position", *QUANTITIES))
    ranges = _filled(keys["position"]) if "position" in keys else {}
    return Limits(
        position={joint: _range(entry) for joint, entry in ranges.items()},
        **{name: _joint_values(keys[name], name) for name in QUANTITIES if name in keys},
    )


def _range(entry: Field) -> tuple[float, float]:
    low, high = entry.numbers(2, unit="rad or m")
    if not low < high:
        raise entry.error(f"must be [low, high] with low < high [rad or m], found {entry.value}")
    return low, high


def _joint_values(entry: Field, quantity: str) -> JointValues:
    unit = QUANTITIES[quantity]
    match entry.value:
        case "urdf" if quantity in IN_URDF:
            return "urdf"
        case "urdf":
            raise entry.error(f"a URDF holds no {quantity} limits: give numbers [{unit}]")
        case [_, *_]:
            return entry.numbers(above=0.0, unit=unit)
        case {**named} if named:
            return {name: value.number(above=0.0, unit=unit) for name, value in entry.mapping().items()}
        case int() | float() if not isinstance(entry.value, bool):
            return entry.number(above=0.0, unit=unit)
        case str(text) if text[:1] in "+-.0123456789":  # meant as a number: its own words say how to write it
            return entry.number(above=0.0, unit=unit)
        case _:
            urdf = "urdf, " if quantity in IN_URDF else ""
            raise entry.wrong(
                f"{urdf}a number, a list of numbers, or a mapping from joint names to numbers, all above 0 [{unit}]"
            )


def read_payload(section: Field) -> Payload:
    """Read a mass that a link carries: ``{link, mass, com, inertia}``."""
    keys = section.mapping(("link", "mass", "com", "inertia"), required=["link", "mass"])
    com = read_vector(keys["com"], unit="m") if "com" in keys else Payload.com
    inertia = _inertia(keys["inertia"]) if "inertia" in keys else Payload.inertia
    return Payload(keys["link"].text(), read_mass(keys["mass"]), com, inertia)


def read_mass(entry: Field) -> float:
    """Read a mass [kg]."""
    return entry.number(above=0.0, unit="kg")


def _inertia(entry: Field) -> tuple[float, float, float, float, float, float]:
    """Read xx, xy, xz, yy, yz, zz of a body that can exist: no principal moment is below 0, or above the sum of the
    other two."""
    xx, xy, xz, yy, yz, zz = entry.numbers(6, unit="kg m²")
    least, middle, most = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).tolist()
    moments = f"its principal moments are {least:.4g}, {middle:.4g} and {most:.4g} kg m²"
    slack = ROUNDING * max(abs(least), abs(most))
    if least < -slack:
        raise entry.error(f"(xx, xy, xz, yy, yz, zz) belongs to no body: {moments}, and none may be negative")
    if least + middle < most - slack:
        raise entry.error(
            f"(xx, xy, xz, yy, yz, zz) belongs to no body: {moments}, and none may exceed the sum of the other two"
        )
    return xx, xy, xz, yy, yz, zz


def read_path(section: Field) -> PathConstraints:
    """Read what must hold all along the way: ``upright`` and ``position``."""
    keys = _filled(section, ("upright", "position"))
    return PathConstraints(
        _upright(keys["upright"]) if "upright" in keys else None,
        _within(keys["position"]) if "position" in keys else None,
    )


def _upright(section: Field) -> Upright:
    keys = section.mapping(("link", "axis", "tolerance"), required=["link"])
    axis, tolerance = Upright.axis, Upright.tolerance
    if "axis" in keys:
        axis = _axis(keys["axis"])
    if "tolerance" in keys:
        tolerance = keys["tolerance"].number(above=0.0, high=math.pi, unit="rad")
    return Upright(keys["link"].text(), axis, tolerance)


def _axis(entry: Field) -> Vector3:
    """Read a direction by name or as a vector of any length but 0; it becomes one of length 1."""
    if isinstance(entry.value, str):
        return AXES[entry.choice(AXES)]
    if not isinstance(entry.value, list):
        raise entry.wrong(f"one of {', '.join(AXES)}, or three numbers")
    x, y, z = read_vector(entry)
    length = math.hypot(x, y, z)
    if length == 0.0:
        raise entry.wrong("a direction, which has a length above 0")
    return (x, y, z) if abs(length - 1.0) <= EXACT else (x / length, y / length, z / length)


def _within(section: Field) -> Within:
    keys = section.mapping(("link", "size", "position", "rpy", "quaternion_xyzw", "point"), required=["link", "size"])
    x, y, z = (_size(edge) for edge in keys["size"].items(3, "edge lengths"))
    if (x, y, z) == ANYWHERE:
        raise keys["size"].error("is infinite along all axes, so any place will do: leave the section out")
    point = read_vector(keys["point"], unit="m") if "point" in keys else Within.point
    return Within(keys["link"].text(), (x, y, z), pose_of(section, keys), point)


def _size(edge: Field) -> float:
    if edge.value == math.inf:
        return math.inf
    if isinstance(edge.value, float) and not math.isfinite(edge.value):
        raise edge.wrong("a number greater than 0 [m], or .inf")
    return edge.number(above=0.0, unit="m")


def read_timing(section: Field) -> Timing:
    """Read when the motion is where: ``duration`` or ``scale``, and the ``rate`` of the result."""
    keys = _filled(section, ("duration", "scale", "rate"))
    if "duration" in keys and "scale" in keys:
        raise section.error("has both 'duration' and 'scale'; a duration leaves nothing to scale: give one of them")
    values = {
        name: keys[name].number(low=low, above=above, high=high, unit=unit)
        for name, low, above, high, unit in (
            ("duration", -math.inf, 0.0, math.inf, "s"),
            ("scale", -math.inf, 0.0, 1.0, ""),
            ("rate", RATES[0], -math.inf, RATES[1], "1/s"),
        )
        if name in keys
    }
    return Timing(**values)


def check_effects(top: Field, scene: Scene) -> None:
    """Refuse what only makes sense beside a section that is missing.

    Raises:
        InputError: a payload without limits of torque; moving obstacles without a duration; a timed scene with neither
            a duration nor limits of acceleration.
    """
    if scene.payload is not None and scene.limits.torque is None:
        raise top.error("payload: counts where joint torques do: limits.torque is missing")
    duration = scene.timing.duration if scene.timing else None
    for i, obstacle in enumerate(scene.obstacles):
        if obstacle.motion is not None and duration is None:
            raise top.error(f"obstacles[{i}].motion: must be met at known times: timing.duration is missing")
    if scene.timed and duration is None and scene.limits.acceleration is None:
        raise top.error(
            f"{_timed_by(scene)}: makes the motion timed, and a URDF holds no accelerations to time it by: "
            "timing.duration or limits.acceleration is missing"
        )


def _timed_by(scene: Scene) -> str:
    given = next((name for name in QUANTITIES if getattr(scene.limits, name) is not None), None)
    return "timing" if scene.timing is not None or given is None else f"limits.{given}"


def _filled(section: Field, allowed: tuple[str, ...] | None = None) -> dict[str, Field]:
    """Return the fields of a mapping that says something."""
    keys = section.mapping(allowed)
    if not keys:
        expected = f"some of {', '.join(allowed)}" if allowed else "joints with their ranges"
        raise section.error(f"is empty: leave it out, or give {expected}")
    return keys
