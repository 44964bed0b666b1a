"""Assemble the problem of a scene: its bodies, the pairs that can meet, and the scene's terms.

With `planner.swept`, clearance from obstacles is measured to hulls swept between waypoints (`swept_clearance`), not at
samples.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from hdplan.planner.collision.broad_phase import BodyPairs, body_pairs
from hdplan.planner.collision.collision_model import SELF_ACTIVATION, BodyPair, CollisionModel, collision_model_of
from hdplan.planner.collision.exact import ExactPairs, as_solids
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody, enclosed_loosely, from_obstacle
from hdplan.planner.collision.hdsdf import HdsdfPairs
from hdplan.planner.collision.link_bodies import LinkBody
from hdplan.planner.collision.pair_distance import PairDistance
from hdplan.planner.collision.scene_pairs import all_pairs, pairs_of_links, pairs_within_reach, with_frames
from hdplan.planner.problem.clearance import Clearance, PairTerm
from hdplan.planner.problem.path_speed import FASTEST_JOINT, PathSpeed
from hdplan.planner.problem.problem import Problem, Terms
from hdplan.planner.problem.samples import Samples
from hdplan.planner.problem.smoothness import Smoothness
from hdplan.planner.problem.swept_clearance import SweptClearance
from hdplan.planner.problem.unknown import kept, of_robot
from hdplan.planner.robot.self_filter import self_filtered
from hdplan.planner.robot.setup import Query, Setup
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.errors import InputError, listed, naming, nearest
from hdplan.scenes.once import made_once
from hdplan.scenes.path_constraints import PathConstraints
from hdplan.scenes.planner_settings import PlannerSettings
from hdplan.scenes.scene import Scene
from hdplan.scenes.values import require_fields

SAMPLES_PER_INTERVAL = 2  # at least
PLAIN, TIMED = 0.01, 0.05  # weight of the acceleration [–]: gentle bends are taken faster, but need more room
QUICK, EVEN = 0.03, 0.1  # weights of acceleration and velocity beside the path_speed [–]

require_fields(
    Scene,
    "obstacles self_collision path limits "  # have terms
    "robot attached payload start goal from_request timing planner "  # are in the setup, the query or the samples
    "name source notes job",  # a job is no single problem: `Setup` refuses it
)


def self_margin(setup: Setup) -> float:
    """Distance of two links at which their penalty sets in [m]."""
    scene = setup.scene
    return max(scene.planner.clearance, scene.self_collision.clearance) + SELF_ACTIVATION + of_robot(setup)[1]


def assemble(setup: Setup, query: Query, deadline: float = math.inf, closely: bool = False) -> Problem:
    """Assemble the problem of a scene between two configurations. Raises InputError for errors in the scene or its
    robot.

    Optional work stops at `deadline` (time.perf_counter()): a mesh that is not split into convex pieces by then is
    enclosed by boxes around its surface, with a note. Such meshes and clouds are enclosed by large boxes, or `closely`
    by small ones.
    """
    scene, robot = setup.scene, setup.robot
    settings = scene.planner
    if scene.objective == "energy":
        _ = setup.loaded_model  # refuses a robot without masses, before any work
    if settings.swept and settings.distance != "hdsdf":
        raise InputError(f"{scene.source}: planner.swept: true needs planner.distance hdsdf, found {settings.distance}")
    model = collision_model_of(robot, settings.link_bodies, settings.normals)
    kinematics, bodies = model.kinematics, model.bodies
    with naming(scene.source):
        enclosed = [
            from_obstacle(obstacle, settings.normals, deadline - time.perf_counter(), closely)
            for obstacle in scene.standing
        ]
    halfspace_bodies = tuple(body for pieces, _ in enclosed for body in pieces)
    notes = [*setup.notes, *(word for _, words in enclosed for word in words)]

    terms = Terms()
    clearances = kept(setup)
    margins = np.array([clearances[body.name] + settings.activation for body in halfspace_bodies])
    pairs = pairs_within_reach(model, halfspace_bodies, margins)
    if len(pairs):
        assembled = body_pairs(bodies, halfspace_bodies, pairs, margins, kinematics.supports)
        distance = _distance(assembled, bodies, halfspace_bodies, settings)
        terms = replace(terms, obstacles=_clearance(assembled, distance, settings))
    if scene.moving and any(body.joint > 0 for body in bodies):
        from hdplan.planner.problem.moving_clearance import moving_clearance
        from hdplan.planner.problem.velocity_penalty import velocity_penalty

        with naming(scene.source):
            moving, drifting, words = moving_clearance(
                setup,
                bodies,
                kinematics.supports,
                lambda pairs, bodies, pieces: _distance(pairs, bodies, pieces, settings),
                deadline,
                closely,
            )
        terms = replace(terms, moving_obstacles=moving, velocity=velocity_penalty(setup))
        halfspace_bodies, notes = (*halfspace_bodies, *drifting), [*notes, *words]
    margin = self_margin(setup)
    own, apart = pairs_of_links(model, margin)
    if own:
        assembled = _between_links(model, own, margin)
        distance = _distance(assembled, bodies, model.planes, settings)
        terms = replace(terms, self_collision=Clearance("self-collision", assembled, distance))
    if scene.path != PathConstraints():
        from hdplan.planner.problem.path_terms import path_terms

        terms = replace(terms, path=path_terms(setup, kinematics.supports))
    if scene.limits.torque is not None:
        from hdplan.planner.problem.gravity_torque import static_torque

        terms = replace(terms, static_torque=static_torque(setup))

    return Problem(
        setup=setup,
        start=query.start,
        goal=query.goal,
        kinematics=kinematics,
        bodies=bodies,
        halfspace_bodies=halfspace_bodies,
        smoothness=Smoothness(settings.waypoints, TIMED if scene.timed else PLAIN),
        terms=terms,
        samples=Samples((SAMPLES_PER_INTERVAL,) * (settings.waypoints - 1)),
        unresolved=model.unresolved,
        apart=apart,
        notes=tuple(notes),
        closely=closely,
    )


def with_seen_points(problem: Problem, points: ArrayLike | Cloud, name: str | None) -> Problem:
    """See `Problem.with_cloud`."""
    scene = problem.scene
    clouds = {each.name: each.shape for each in scene.obstacles if isinstance(each.shape, Cloud)}
    if name is None and len(clouds) != 1:
        raise InputError(f"name: needed unless there is exactly one cloud; there are {len(clouds)}: {listed(clouds)}")
    name = next(iter(clouds)) if name is None else name
    if name not in clouds:
        raise InputError(f"name: no cloud is named {name!r}{nearest(str(name), clouds)}")
    shape = points if isinstance(points, Cloud) else replace(clouds[name], points=points)  # type: ignore[arg-type]
    obstacles = tuple(replace(each, shape=shape) if each.name == name else each for each in scene.obstacles)
    setup = problem.setup.changed(obstacles=obstacles)
    seen = self_filtered(setup.requested, setup.scene, problem.robot)
    setup = replace(setup, scene=seen.scene, ignored=seen.notes, filtered_points=seen.points)
    found = assemble(setup, Query(problem.start, problem.goal), closely=problem.closely)
    standing, moving, bodies = found.terms.obstacles, found.terms.moving_obstacles, found.halfspace_bodies
    terms = replace(problem.terms, obstacles=standing, moving_obstacles=moving)
    return replace(problem, setup=setup, halfspace_bodies=bodies, terms=terms, notes=found.notes)


def on_frames(problem: Problem) -> Problem:
    """Assemble the same problem with every static obstacle on a frame of its own, so that it may be moved and grow: a
    joint beyond the robot's and those of the moving ones, in the scene's order. All moving link bodies are paired with
    it, as what is proven of where it stands, and how large it is, does not hold of others."""
    scene, bodies, settings = problem.scene, problem.bodies, problem.scene.planner
    moving = problem.terms.moving_obstacles
    carried = 0 if moving is None else len(moving.motions)
    first = problem.kinematics.nj + carried
    frame = {obstacle.name: first + i for i, obstacle in enumerate(scene.standing)}
    pieces = tuple(replace(body, joint=frame[body.name]) for body in problem.halfspace_bodies if body.joint == 0)
    pairs = all_pairs(bodies, range(len(pieces)))
    if not len(pairs):
        return problem
    clearances = kept(problem.setup)
    margins = np.array([clearances[piece.name] + settings.activation for piece in pieces])
    supports = with_frames(problem.kinematics.supports, carried + len(scene.standing))
    assembled = body_pairs(bodies, pieces, pairs, margins, supports)
    obstacles = _clearance(assembled, _distance(assembled, bodies, pieces, settings), settings, pieces)
    return replace(problem, terms=replace(problem.terms, obstacles=obstacles))


@made_once(8)
def _between_links(model: CollisionModel, pairs: tuple[BodyPair, ...], margin: float) -> BodyPairs:
    return body_pairs(model.bodies, model.planes, pairs, margin, model.kinematics.supports)


def closer(problem: Problem, activation: float, quick: bool) -> Problem:
    """Assemble the same problem again for the last touches to a motion: with a penalty that sets in at another distance
    [m], and, where the motion is to be quick within limits of velocity, with `PathSpeed` in place of most of the
    smoothness. Exact distances keep the margin at which it begins: they leave nothing for what happens between the
    samples."""
    scene, limits = problem.scene, problem.setup.limits.get("velocity")
    activation = scene.planner.activation if problem.exact else activation
    setup = problem.setup.changed(planner=replace(scene.planner, activation=activation))
    assembled = _with_own(problem, assemble(setup, Query(problem.start, problem.goal), closely=problem.closely))
    if not quick or limits is None or not (limits <= FASTEST_JOINT).any():
        return assembled
    return replace(assembled, smoothness=Smoothness(problem.waypoints, QUICK, EVEN), path_speed=PathSpeed(limits))


def more_closely(problem: Problem) -> Problem:
    """Assemble the problem again with clouds, and meshes that were not split, enclosed by smaller boxes; the
    problem itself if there are none, or if this was done already."""
    if problem.closely or not any(map(enclosed_loosely, problem.scene.obstacles)):
        return problem
    query, now = Query(problem.start, problem.goal), time.perf_counter()  # nothing more is split
    return _with_own(problem, assemble(problem.setup, query, deadline=now, closely=True))


def exactly(problem: Problem) -> Problem:
    """Return the problem with the exact distances of what the bodies enclose in place of the HD-SDF of the bodies,
    from static obstacles and between links; the problem itself with another distance."""
    settings, terms = problem.scene.planner, problem.terms
    if problem.exact or settings.distance != "hdsdf" or settings.swept:
        return problem
    model = collision_model_of(problem.robot, settings.link_bodies, settings.normals)
    if (standing := terms.obstacles) is not None:
        solids = problem.halfspace_bodies[: len(standing.pairs.boxes)]
        distance = ExactPairs(standing.pairs, model.parts, solids)
        terms = replace(terms, obstacles=_clearance(standing.pairs, distance, settings))
    if (own := terms.self_collision) is not None:
        distance = ExactPairs(own.pairs, model.parts, as_solids(model.planes, model.parts))
        terms = replace(terms, self_collision=Clearance(own.name, own.pairs, distance))
    return replace(problem, terms=terms, exact=True)


def _with_own(problem: Problem, rebuilt: Problem) -> Problem:
    """Give a problem that was assembled again the user's own terms, and distances as exact."""
    rebuilt = exactly(rebuilt) if problem.exact else rebuilt
    return replace(rebuilt, terms=replace(rebuilt.terms, own=problem.terms.own, costs=problem.terms.costs))


def _clearance(
    pairs: BodyPairs, distance: PairDistance, settings: PlannerSettings, pieces: tuple[HalfspaceBody, ...] = ()
) -> PairTerm:
    """The clearance of static obstacles."""
    if settings.swept:
        return SweptClearance("obstacles", pairs, distance, settings.gamma, settings.shaping_length, pieces)
    return Clearance("obstacles", pairs, distance, pieces)


def _distance(
    pairs: BodyPairs,
    bodies: tuple[LinkBody, ...],
    halfspace_bodies: tuple[HalfspaceBody, ...],
    settings: PlannerSettings,
) -> PairDistance:
    match settings.distance:
        case "hdsdf":
            return HdsdfPairs(pairs, settings.gamma, settings.shaping_length)
        case "fcl":
            from hdplan.planner.collision.euclidean import FclPairs

            return FclPairs(pairs, bodies, halfspace_bodies)
    raise ValueError(f"unknown distance {settings.distance!r}")
