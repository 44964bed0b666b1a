"""Inverse kinematics: the configurations that bring a link to a pose, or several links each to its own; in closed form
where the arm's geometry has one (`kinematics.closed_form`), or else from many starts.

Damped least squares, dq = Jᵀ (J Jᵀ + λ² I)⁻¹ e, within the joint limits, for many starts at once (Nakamura & Hanafusa,
"Inverse kinematic solutions with singularity robustness", 1986). At first only the part of the error e beyond a share
of the tolerance counts; once that is gone, a few steps with the whole of e lead on towards the centre. Free rotations
are taken out of J and e. One seeded generator makes all random draws.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from hdplan.distance.compiled.loops import twin_of
from hdplan.planner.certificate.pose_goals import Miss, reached_by
from hdplan.planner.kinematics import inverse_loop
from hdplan.planner.kinematics.closed_form import closed_form
from hdplan.planner.kinematics.inverse import LONGEST_STEP, Aim, damped_step, self_motion
from hdplan.planner.robot.as_loaded import check_as_loaded
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.arrays import joint_numbers
from hdplan.scenes.deadline import check_time
from hdplan.scenes.errors import FieldError, naming
from hdplan.scenes.poses import AnyPose
from hdplan.scenes.scene import Scene
from hdplan.scenes.targets import AllOf, PoseTarget
from hdplan.scenes.values import boolean, checked, wrong

if TYPE_CHECKING:
    from hdplan.planner.problem.path_terms import PathTerm


STARTS = 128  # the scene's start, and random configurations
SEED_STARTS, SEED_SPREAD = 24, 1.0  # starts around a seed, and their standard deviation [rad or m]
MOST_STEPS, DECIDING_STEPS = 80, 32  # at most; after so many, starts are given up if enough of the others have arrived
ENOUGH_STARTS = 0.25  # share of the starts that are enough
CENTRING = 6  # more of them, from within the tolerance towards its centre
AIM, ENOUGH, AT_MOST = 0.5, 0.75, 0.99  # shares of a tolerance: the aim, the convergence of a start, acceptance
DRAWS, BACK = 12, 2  # steps towards the start, at most, each with some back to the pose
NEAREST_COUNT = 8  # of a redundant arm's configurations in closed form that are drawn towards the start
LEAST_DIFFERENCE = 0.6  # [rad] or [m] in some joint between two configurations that count as different


def inverse_kinematics(
    robot: Robot | Scene,
    pose: AnyPose,
    link: str | None = None,
    *,
    seed: ArrayLike | None = None,
    all_branches: bool = False,
    position_tolerance: float = PoseTarget.position_tolerance,
    orientation_tolerance: float = PoseTarget.orientation_tolerance,
    free_rotation: str = PoseTarget.free_rotation,
) -> Array:
    """Return configurations (K, n) that bring a link to a pose [rad or m]: the one nearest to `seed` (K is 1 or 0), or
    those of all branches that are found, nearest first (K may be 0). A seed that reaches the pose is itself the first.

    For each of them the certificate's own kinematics proves, up to rounding, that it lies within the joint limits and
    the link within the tolerances. Not proven is that it is free of contact (see `check_configuration`), that a motion
    leads there, or that no others exist. `hdplan robots NAME` shows the method: in closed form, to rounding,
    every branch of six turning joints whose last three axes meet in a point, or of whose axes three are parallel, and
    nearly every one where two neighbours meet; or else, and where the pose is reached within its tolerances alone, by
    search, from the seed, from 24 starts around it and, where these lead nowhere or all branches are wanted, from
    128 all over the limits, which may miss some or all. In closed form every branch is found; any two searched ones
    differ by more than 0.6 rad (or m) in some joint, whole turns aside. An arm with more joints than the pose requires
    has families of configurations in place of single ones: some of its joints are held at values around the seed's, and
    a few members of each family are returned, equally far apart. Each joint is as near to the seed as whole turns
    within its limits allow. The same arguments give the same configurations.

    Args:
        robot: a robot of load_robot; or a scene, for its robot with held objects and position limits.
        pose: of the link's frame, in the world.
        link: a link that moves, with or without geometry; by default the end effector.
        seed: a configuration (n,); by default the scene's start, or the middle of the robot's joint limits, 0 for a
            joint without limits.
        all_branches: whether to return all branches.
        position_tolerance: how far the link's origin may be away [m].
        orientation_tolerance: how far it may be rotated away, apart from free rotations [rad].
        free_rotation: "none", the axis of the link about which it may rotate freely ("x", "y", "z"), or "all".

    Raises:
        InputError: an unknown link or one that is fixed to the world, none where the robot has no one end effector, a
            robot or a start that cannot be used, or a value that is refused in a scene's goal too.
    """
    if not isinstance(robot, Robot | Scene):
        raise wrong("a Robot or a Scene", robot).within("robot")
    try:
        target = PoseTarget(link, pose, position_tolerance, orientation_tolerance, free_rotation, field="")
    except FieldError as error:  # of an argument here
        raise FieldError(error.problem, error.where) from None
    every = checked(boolean, all_branches, "all_branches")
    arm = load_scene_robot(robot) if isinstance(robot, Scene) else robot
    start = _default_seed(robot) if seed is None else joint_numbers("seed", seed, arm.joint_names)
    form, met = closed_form(arm, target), _proven(arm, target, start[None])
    if not every and not len(met) and not (form and not form.redundant):
        met = _proven(arm, target, _from_start(arm, target, start))
    if every or not len(met):
        exact = form.branches(arm, target, start) if form else met[:0]
        if form and len(exact):
            listed = _with_families(arm, target, met, exact, start) if form.redundant else _in_order(met, exact, start)
            met = _proven(arm, target, listed if every else listed[:1])
        if not len(exact) or not len(met):
            met = _searched(arm, target, met, start, every)
    check_as_loaded(arm, shapes=False)
    return met if every else met[:1]


def _in_order(met: Array, exact: Array, start: Array) -> Array:
    """Return branches nearest to `start` first; where it is `met` it stands for its own."""
    exact = exact[np.argsort(np.linalg.norm(exact - start, axis=1), kind="stable")]
    own = len(met) and np.abs(exact[0] - start).max() <= LEAST_DIFFERENCE
    return np.concatenate([met, exact[1:] if own else exact])


def _with_families(robot: Robot, target: PoseTarget, met: Array, exact: Array, start: Array) -> Array:
    """Return a few members of each branch of a redundant arm, the nearest ones drawn on towards `start`."""
    near = _drawn_near(Aim.at(robot, target), _in_order(met[:0], exact, start)[:NEAREST_COUNT], start)
    return _distinct(np.concatenate([met, near, exact]), start, _circling(robot))


def _searched(robot: Robot, target: PoseTarget, met: Array, start: Array, every: bool) -> Array:
    """Return the `met` configurations, and those of a search from many starts, each proven."""
    for look in (_near, reaching):
        if every or not len(met):
            found, _ = look(robot, target, start, np.random.default_rng(0))
            met = _distinct(np.concatenate([met, _proven(robot, target, found)]), start, _circling(robot))
    return met


def _default_seed(robot: Robot | Scene) -> Array:
    """A scene's start; the middle of a robot's limits, 0 for a joint without limits."""
    if isinstance(robot, Scene):
        with naming(robot.source):
            return load_scene_robot(robot).configuration(robot.start, robot.from_request)
    bounded = np.isfinite(robot.lower) & np.isfinite(robot.upper)
    middle = np.where(bounded, 0.5 * (np.where(bounded, robot.lower, 0.0) + np.where(bounded, robot.upper, 0.0)), 0.0)
    return np.clip(middle, robot.lower, robot.upper)


def _proven(robot: Robot, target: PoseTarget, q: Array) -> Array:
    """The rows within the limits that reach the target by the certificate's own kinematics."""
    within = q[((robot.lower <= q) & (q <= robot.upper)).all(axis=1)]
    return within[reached_by(robot, target, within)]


def _from_start(robot: Robot, target: PoseTarget, start: Array) -> Array:
    """Return the configuration reached from `start` alone, where it hardly differs from it: most often the nearest of
    all."""
    found, _ = _reached(Aim.at(robot, target), np.empty((0, robot.n)), start)
    return found[:1] if len(found) and np.abs(found[0] - start).max() <= LEAST_DIFFERENCE else found[:0]


def _near(robot: Robot, target: PoseTarget, start: Array, rng: np.random.Generator) -> tuple[Array, tuple[Miss, ...]]:
    """Return the result of `reaching` from few starts around `start`, among which the nearest of all most often is."""
    wide = np.minimum(SEED_SPREAD, 0.5 * (robot.upper - robot.lower))
    middle = np.clip(start, robot.lower, robot.upper)
    return _reached(Aim.at(robot, target), middle + wide * rng.normal(size=(SEED_STARTS - 1, robot.n)), start)


def reaching(
    robot: Robot,
    target: PoseTarget | AllOf,
    start: Array,
    rng: np.random.Generator,
    path: tuple[PathTerm, ...] = (),
    starts: int = STARTS,
) -> tuple[Array, tuple[Miss, ...]]:
    """Return configurations (K, n) that reach a pose, or poses of several links together, LEAST_DIFFERENCE from each
    other and nearest to `start` first, and the least miss of all tries, of each link. Path constraints guide the search
    too, but do not decide the result."""
    aim, draws = Aim.at(robot, target), robot.draw(rng, starts - 1)
    if not path:  # which may be about other links: joints that are for none of these stay where they are
        draws = np.where(aim.moving, draws, start)
    return _reached(aim, draws, start, path)


def every_branch(robot: Robot, target: PoseTarget | AllOf, start: Array) -> tuple[Array, tuple[Miss, ...]]:
    """Return the result of `reaching` without a search: for an arm whose every branch has a closed form, each as near
    to `start` as the tolerances allow. No configuration, and no miss, for other arms and families, and for a pose that
    is out of reach but for its tolerances."""
    form = closed_form(robot, target) if isinstance(target, PoseTarget) else None
    if not isinstance(target, PoseTarget) or form is None or form.redundant:
        return np.empty((0, robot.n)), ()
    exact = form.branches(robot, target, start)
    if not len(exact):
        return exact, ()
    near = _drawn_near(Aim.at(robot, target), exact, start)
    return _distinct(np.vstack([near, exact]), start), (Miss(0.0, 0.0),)


def _reached(aim: Aim, draws: Array, start: Array, path: tuple[PathTerm, ...] = ()) -> tuple[Array, tuple[Miss, ...]]:
    """Configurations that reach the target from `start` and from random draws (B, n), and the least misses."""
    check_time("looking for configurations that reach the goal")
    robot = aim.robot
    q = _approached(aim, np.clip(np.vstack([start, draws]), robot.lower, robot.upper), path)
    error, _ = aim.linearized(q)
    sizes = aim.sizes(error)
    best = sizes[int(np.argmin((sizes / aim.tolerances).max(axis=(1, 2))))]
    least = tuple(Miss(position, angle) for position, angle in best.tolist())
    met = _centred(aim, q[aim.within(error, AT_MOST)])
    met = _distinct(_fewest_turns(robot, met, start), start)
    if not path:
        met = _distinct(np.vstack([_drawn_near(aim, met, start), met]), start)
    return met, least


def _approached(aim: Aim, q: Array, path: tuple[PathTerm, ...]) -> Array:
    """Move starts (B, n) towards the aim and the path constraints, until all that can be hoped for have arrived."""
    if aim.loops and not path:
        return aim.loops.approach(q, MOST_STEPS, DECIDING_STEPS, (1.0 - ENOUGH_STARTS) * len(q), AIM, ENOUGH)
    going = np.arange(len(q))
    if path:
        from hdplan.planner.problem.path_terms import to_path
    for step in range(MOST_STEPS):
        check_time("looking for configurations that reach the goal")
        error, jacobian = aim.linearized(q[going])
        missing, far = aim.beyond(error, AIM), ~aim.within(error, ENOUGH)
        if path:
            astray, slope = to_path(path, aim.arm.evaluate(aim.robot.expand(q[going])))
            slope = aim.robot.fold(slope)
            missing, jacobian = np.concatenate([missing, astray], axis=1), np.concatenate([jacobian, slope], axis=1)
            far |= astray.any(axis=1)
        going, missing, jacobian = going[far], missing[far], jacobian[far]
        if len(going) <= (1.0 - ENOUGH_STARTS if step >= DECIDING_STEPS else 0.0) * len(q):
            break
        q[going] = damped_step(aim.robot, q[going], missing, jacobian)
    return q


def _centred(aim: Aim, q: Array) -> Array:
    """Move configurations that reach the aim on towards its centre, as long as no error grows."""
    if aim.loops:
        return aim.loops.centre(q, CENTRING)
    error, jacobian = aim.linearized(q)
    for _ in range(CENTRING):
        moved = damped_step(aim.robot, q, error, jacobian)
        error_moved, jacobian_moved = aim.linearized(moved)
        better = np.all(aim.sizes(error_moved) <= aim.sizes(error), axis=(1, 2))[:, None]
        q, error = np.where(better, moved, q), np.where(better, error_moved, error)
        jacobian = np.where(better[..., None], jacobian_moved, jacobian)
    return q


def _drawn_near(aim: Aim, q: Array, start: Array) -> Array:
    """Move configurations (B, n) that reach the aim towards `start` as far as they continue reaching it: along the
    arm's self-motion and its free rotations, the part of the way that moves no link that counts."""
    if aim.loops:
        return aim.loops.draw_near(q, start, DRAWS, BACK, ENOUGH)
    error, jacobian = aim.linearized(q)
    for _ in range(DRAWS):
        way = start - q
        step = self_motion(way, jacobian)
        step *= np.minimum(1.0, LONGEST_STEP / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-12))
        moved = np.clip(q + step, aim.robot.lower, aim.robot.upper)
        for _ in range(BACK):
            error_moved, jacobian_moved = aim.linearized(moved)
            moved = damped_step(aim.robot, moved, error_moved, jacobian_moved)
        error_moved, jacobian_moved = aim.linearized(moved)
        nearer = np.linalg.norm(start - moved, axis=1) < np.linalg.norm(way, axis=1)
        better = (aim.within(error_moved, ENOUGH) & nearer)[:, None]
        if not better.any():
            break
        q, error = np.where(better, moved, q), np.where(better, error_moved, error)
        jacobian = np.where(better[..., None], jacobian_moved, jacobian)
    return q


def _fewest_turns(robot: Robot, q: Array, start: Array) -> Array:
    """The placements (B, n), with whole turns of the joints undone towards `start` as far as the limits allow."""
    nearer = q - 2 * math.pi * np.round((q - start) / (2 * math.pi))
    return np.where(_circling(robot) & (nearer >= robot.lower) & (nearer <= robot.upper), nearer, q)


def _circling(robot: Robot) -> Mask:
    """The joints (n,) a whole turn of which changes no placement."""
    return np.asarray(robot.turning & ~robot.followed)


def _distinct(q: Array, start: Array, circling: Mask | None = None) -> Array:
    """The rows nearest to `start` first, those that are LEAST_DIFFERENCE from all before them, apart from whole turns
    of joints without limits."""
    nearest = q[np.argsort(np.linalg.norm(q - start, axis=1), kind="stable")]
    return _apart(nearest, np.zeros(q.shape[1], dtype=bool) if circling is None else circling, LEAST_DIFFERENCE)


@twin_of(inverse_loop.distinct)
def _apart(q: Array, circling: Mask, apart: float) -> Array:
    """Return the rows of q (B, n) that are `apart` from all before them in some joint, whole turns of joints that
    circle (n,) not counted."""
    left, kept = q, []
    while len(left):
        kept.append(left[0])
        way = left - left[0]
        way = np.where(circling, way - 2 * math.pi * np.round(way / (2 * math.pi)), way)
        left = left[np.abs(way).max(axis=1) > apart]
    return np.array(kept).reshape(-1, q.shape[1])
