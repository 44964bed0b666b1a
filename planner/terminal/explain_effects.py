"""The effects that a problem has or could have: what each does here, or what would enable it.

In: a built `Problem`. Out: `Effect`s in reading order.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple, assert_never

import numpy as np

from hdplan.planner.problem.assemble import self_margin
from hdplan.planner.problem.problem import Problem
from hdplan.planner.robot.joint_limits import DERIVATIVES, requested_limits
from hdplan.scenes.limits import QUANTITIES, JointValues
from hdplan.scenes.path_constraints import Follow, PathConstraint, Relative, Upright, Within
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene, unknown_in
from hdplan.scenes.targets import AllOf, Goals, JointTarget
from hdplan.scenes.timing import Timing
from hdplan.scenes.values import require_fields

require_fields(
    Scene,
    "obstacles self_collision attached payload start goal robot path timing limits "  # are effects
    "planner from_request name source notes job",  # are shown in other parts of the explanation
)


class Effect(NamedTuple):
    """One effect."""

    name: str
    on: str  # what it does here; empty where it is off
    off: str = ""  # what would switch it on, or why it has nothing to do; empty where it cannot be off


def effects(problem: Problem) -> tuple[Effect, ...]:
    """Return all effects of hdplan."""
    return (
        Effect("smoothness", "always: squared velocity and acceleration over the motion"),
        *_joint_limits(problem),
        _standing(problem),
        _moving(problem),
        _unknown(problem),
        _self_collision(problem),
        *_carried(problem),
        *_ends(problem.scene),
        _moving_ends(problem),
        *_on_the_way(problem.scene),
        *_timed(problem),
    )


def counted(number: int, thing: str) -> str:
    """Return a number of things as text: ``1 joint``, ``2 joints``."""
    return f"{number} {thing}" + "s" * (number != 1)


def _joint_limits(problem: Problem) -> tuple[Effect, ...]:
    robot, narrowed = problem.robot, problem.scene.limits.position
    bounded = int(np.isfinite(robot.lower).sum())
    free = f"; {counted(robot.n - bounded, 'joint')} without" if bounded < robot.n else ""
    kept = f"{counted(bounded, 'joint')} kept within limits{free}" if bounded else ""
    narrow = f"{', '.join(narrowed)} kept within less than the URDF's range" if narrowed else ""
    return (
        Effect("joint limits", kept, "no joint has limits"),
        Effect("narrower ranges", narrow, "needs limits.position"),
    )


def _standing(problem: Problem) -> Effect:
    scene, settings = problem.scene, problem.scene.planner
    standing = scene.standing
    if problem.terms.obstacles is None:
        if not problem.bodies:
            return Effect("obstacles", "", "no link has collision geometry")
        why = "every obstacle is out of the robot's reach" if standing else "needs obstacles[]"
        return Effect("obstacles", "", why)
    reach = settings.clearance + settings.activation
    words = f"{len(standing)}; penalty where a moving link comes within {reach:g} m of one"
    if own := sum(obstacle.clearance is not None for obstacle in standing):
        words += f", or within its own clearance + {settings.activation:g} m ({own} of {len(standing)})"
    return Effect("obstacles", words + ", swept from waypoint to waypoint" * settings.swept)


def _moving(problem: Problem) -> Effect:
    count = len(problem.scene.moving)
    words = f"{count}; each sample of the motion uses their poses at its time"
    return Effect(
        "moving obstacles",
        words if problem.terms.moving_obstacles else "",
        "no link has collision geometry" if count else "needs obstacles[].motion, with timing.duration",
    )


def _unknown(problem: Problem) -> Effect:
    found = (re.sub(r"\[\d+\]", "[]", field) for field in unknown_in(problem.scene))
    fields = ", ".join(dict.fromkeys(found))
    words = f"{fields}: planned and proven for every world within these sizes"
    needs = "needs obstacles[].uncertainty, robot.tracking or robot.calibration"
    return Effect("unknown", words if fields else "", needs)


def _self_collision(problem: Problem) -> Effect:
    if problem.terms.self_collision:
        held = " or held objects" if problem.robot.attached else ""
        clearance = problem.scene.self_collision.clearance
        why = f"clearance {clearance:g} m" if clearance else "by default"
        words = f"{why}; penalty where two links{held} come within {self_margin(problem.setup):g} m"
        return Effect("self-collision", words)
    if not problem.bodies:
        why = "no link has collision geometry"
    elif not problem.scene.self_collision.checked:
        why = "needs self_collision: true"
    elif problem.apart:
        why = "every pair of links is proven to keep apart within the joint limits"
    elif problem.unresolved:
        why = "the outer bodies of all pairs of links overlap anyway: left to the certificate"
    else:
        why = "no pair of links can meet, or all are disabled"
    return Effect("self-collision", "", why)


def _carried(problem: Problem) -> tuple[Effect, ...]:
    scene = problem.scene
    held, payload = len(scene.attached), scene.payload
    counts = scene.limits.torque is not None or scene.objective == "energy"
    loads = [f"{payload.mass:g} kg on {payload.link}"] if payload else []
    loads += [f"{each.mass:g} kg of {each.name}" for each in scene.attached if each.mass is not None and counts]
    return (
        Effect(
            "held objects", f"{counted(held, 'object')}: collide as the links do" if held else "", "needs attached[]"
        ),
        Effect(
            "loads",
            ", ".join(loads),
            "needs payload or attached[].mass, with limits.torque or planner.objective energy",
        ),
    )


def _ends(scene: Scene) -> tuple[Effect, ...]:
    targets = scene.goal.targets if isinstance(scene.goal, Goals) else ()
    if targets and isinstance(targets[0], AllOf):
        choice = (
            f"{len(targets[0].poses)} poses together: of the configurations that reach them the best certified wins"
        )
    else:
        of = {type(target) for target in targets}
        kind = "goal" if len(of) > 1 else "configuration" if of == {JointTarget} else "pose"
        reaching = " of the configurations that reach it" * (kind != "configuration")
        choice = f"{counted(len(targets), kind)}:{reaching} the best certified wins"
    kinds = "goal.pose, goal.poses[], goal.all[], goal.any[] or several goal.joints[]"
    base = scene.robot.base
    x, y, z = base.position
    upside = ", upside down" * bool(base.matrix[2, 2] < 0.0)
    return (
        Effect("choice of goals", choice if targets else "", f"needs {kinds}"),
        Effect("base", f"stands at ({x:g}, {y:g}, {z:g}){upside}" if base != Pose() else "", "needs robot.base"),
    )


def _on_the_way(scene: Scene) -> tuple[Effect, ...]:
    values = {name: _kept_all_along(each) for name, each in scene.path.given.items()}
    kinds = (each.name for each in dataclasses.fields(scene.path) if each.name != "follow")  # which jobs alone have
    names = (f"path.{kind}" for kind in kinds)
    return tuple(Effect(name, values.get(name, ""), f"needs {name}") for name in names)


def _moving_ends(problem: Problem) -> Effect:
    """Rates of the robot at its start and goal."""
    fastest = (
        f"{each.field} at up to {np.abs(each.velocity).max():.3g} rad/s or m/s" for each in problem.setup.moving_ends
    )
    words = ", ".join(fastest)
    why = "; the path leads from where the robot would stand, and its motion is joined to braking"
    return Effect("moving ends", words + why * bool(words), "needs start.velocity or goal.velocity")


def _kept_all_along(constraint: PathConstraint) -> str:
    match constraint:
        case Upright(link, axis, tolerance):
            return f"axis {_numbers(axis)} of {link} points up all the way, tilted by {tolerance:g} rad at most"
        case Within(link, size, pose, point):
            box = f"the box of size {_numbers(size)} m around {_numbers(pose.position)}"
            return f"point {_numbers(point)} of {link} stays in {box}"
        case Relative(link, to):
            allowed = f"{constraint.position_tolerance * 1e3:g} mm and {constraint.orientation_tolerance:g} rad"
            return f"{link} keeps its pose at {to}, within {allowed}"
        case Follow(link, poses):
            allowed = f"{constraint.position_tolerance * 1e3:g} mm and {constraint.orientation_tolerance:g} rad"
            return f"{link} follows a curve of {len(poses)} poses, within {allowed}"
        case _:
            assert_never(constraint)


def _numbers(vector: Sequence[float]) -> str:
    return f"({', '.join(f'{part:g}' for part in vector)})"


def _timed(problem: Problem) -> tuple[Effect, ...]:
    scene = problem.scene
    timing = scene.timing or Timing()
    rows = f"{timing.rate:g} rows per second"
    if not scene.timed:
        law = ""
    elif timing.duration is not None:
        law = f"minimum jerk in {timing.duration:g} s, {rows}"
    else:
        share = f" × {timing.scale:g}" if timing.scale < 1.0 else ""
        law = f"the fastest within the limits (TOPP-RA, smoothed){share}, {rows}"
    limits = requested_limits(scene)
    kept = [f"{quantity} ({_origin(limits[quantity])})" for quantity in DERIVATIVES if quantity in limits]
    sought = "; the time law is fixed, so speeds close to the velocity limit are penalized" * bool(scene.moving)
    others = [quantity for quantity in QUANTITIES if quantity not in DERIVATIVES]
    return (
        Effect("times", law, "needs timing.duration, or limits.acceleration"),
        Effect("limits of rates", ", ".join(kept) + sought, f"needs {_either(DERIVATIVES)}"),
        *(
            Effect(f"limits of {name}", _driven(problem, name, limits.get(name)), f"needs limits.{name}")
            for name in others
        ),
    )


def _either(quantities: Iterable[str]) -> str:
    *others, last = (f"limits.{quantity}" for quantity in quantities)
    return f"{', '.join(others)} or {last}"


def _driven(problem: Problem, quantity: str, limits: JointValues | None) -> str:
    """Return the parts, in words, that keep a limit: the timing, and a term on the path where gravity may overload a
    joint."""
    if limits is None:
        return ""
    if quantity != "torque":
        return f"{_origin(limits)}: kept by the timing"
    from hdplan.planner.problem.gravity_torque import ARM
    from hdplan.planner.problem.hinge import BAND
    from hdplan.planner.robot.loads import moved_mass

    mass = moved_mass(problem.setup.loaded_model)
    words = f"{_origin(limits)}, moving {mass:.3g} kg: kept by the timing"
    if term := problem.terms.static_torque:
        joints = ", ".join(problem.robot.joint_names[i] for i in term.measure.joints.tolist())
        return f"{words}; penalty where gravity alone takes {1 - BAND / ARM:.0%} of the limit of {joints}"
    return f"{words}; no term, as gravity alone overloads no joint"


def _origin(values: JointValues) -> str:
    if values == "urdf":
        return "the URDF's"
    return "by joint" if isinstance(values, Mapping) else "the scene's"
