"""Limits of speed in a MoveIt request.

The factors multiply the limits of velocity and acceleration, and count from above 0 to 1; 0 is a factor that is not
set, and means 1 (moveit_msgs/MotionPlanRequest). A factor of 1 requires nothing: the motion is a path without times,
which any controller may follow within the robot's limits. A smaller one gives it times, within limits that the
certificate checks.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from hdplan.scenes.fields import Field
from hdplan.scenes.limits import Limits
from hdplan.scenes.number_text import read_number
from hdplan.scenes.robot_files.description import Semantics, Tree
from hdplan.scenes.robot_spec import RobotSpec

KEYS = ("max_velocity_scaling_factor", "max_acceleration_scaling_factor")
ACCELERATION = 1.0
"""[rad/s²] or [m/s²], as URDFs hold no limit: what MoveIt's IterativeParabolicTimeParameterization takes for a joint
without one (DEFAULT_ACCEL_MAX); newer versions refuse such joints, whose limits are then in joint_limits.yaml."""


def read_speed(
    keys: Mapping[str, Field], tree: Tree, semantics: Semantics, robot: RobotSpec, moving: Field | None = None
) -> Limits:
    """Return the limits that the factors of a request mean, none if both are 0 or 1 and the robot does not begin with
    a velocity, in a state that is `moving`; velocities of the joints of the robot's group, or of all if it has none,
    and of those that follow them.

    Raises:
        InputError: a factor beyond 0 to 1, or a velocity limit of the URDF that is no number.
    """
    given = {key: keys[key].number(low=0.0, high=1.0) for key in KEYS if key in keys}
    of_velocity, of_acceleration = (given.get(key) or 1.0 for key in KEYS)
    asking = [keys[key] for key in KEYS if given.get(key, 0.0) not in (0.0, 1.0)] + ([moving] if moving else [])
    if not asking:
        return Limits()
    asking[0].note(
        f"velocities stay within {of_velocity:g} of the URDF's limits, accelerations within "
        f"{of_acceleration * ACCELERATION:g} rad/s² or m/s²: {of_acceleration:g} of the {ACCELERATION:g} assumed, as a "
        "URDF has no acceleration limits"
    )
    members = semantics.groups.get(robot.group) if isinstance(robot.group, str) else robot.group
    held = {*robot.locked, *semantics.passive, *(tree.parent[link][1] for link in tree.fixed)}
    velocities: dict[str, float] = {}
    for joint, word in tree.velocities.items():
        try:
            limit = read_number(word.strip() or "0")
        except ValueError:
            raise asking[0].error(f"the URDF gives joint '{joint}' the velocity limit {word!r}, not a number") from None
        factor = 1.0
        while joint in tree.mimics:
            joint, more, _ = tree.mimics[joint]
            factor *= abs(more)
        if limit > 0.0 < factor and joint not in held and (members is None or joint in members):
            velocities[joint] = min(velocities.get(joint, math.inf), of_velocity * limit / factor)
    return asking[0].make(Limits, velocity=velocities or "urdf", acceleration=of_acceleration * ACCELERATION)
