"""One planning problem: scene + robot → waypoints to choose, a cost made of terms, its exact derivatives.

`build` only lays things out and gives a `Problem` to look at; solvers only evaluate it. The cost of waypoints q_0 …
q_{N−1} with both ends fixed is

    smoothness(q) + w Σ_samples w_s Σ_pairs ½ min(D, 0)²

(CHOMP, Ratliff et al. 2009, with the HD-SDF in place of a distance field; the exact distance may stand in for it).
With `planner.swept` obstacles are kept from hulls between waypoints (`swept_clearance`) instead of at samples. Only the
terms that the scene calls for exist.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hdplan.distance.compiled import RowFunction
from hdplan.planner.fcl_pairs import FclPairs
from hdplan.planner.hdsdf_pairs import HdsdfPairs
from hdplan.planner.kinematics import Kinematics
from hdplan.planner.link_bodies import LinkBody
from hdplan.planner.outline import SELF_ACTIVATION, outline_of
from hdplan.planner.pairs import BodyPairs, body_pairs
from hdplan.planner.plane_bodies import PlaneBody, from_obstacle, plane_counts
from hdplan.planner.robot import Robot
from hdplan.planner.samples import Samples
from hdplan.planner.scene_robot import load_scene_robot, resolve_query
from hdplan.planner.swept_clearance import SweptClearance
from hdplan.planner.terms import Clearance, MotionTerm, PairDistance, Smoothness, Term
from hdplan.scenes.errors import InputError, naming, nearest
from hdplan.scenes.model import JointTarget, PathConstraints, PlannerSettings, Scene
from hdplan.scenes.values import instance

if TYPE_CHECKING:
    from hdplan.planner.path_terms import PathTerm

Floats = NDArray[np.float64]

DISTANCES = ("hdsdf", "fcl")
SAMPLES_PER_INTERVAL = 2  # at least
SPACING = 0.03  # [m] farthest that a body's centre may move between two samples


@dataclass(frozen=True)
class Evaluation:
    """The cost at some waypoints, with derivatives with respect to the interior ones (M = N − 2 of them)."""

    cost: float
    smoothness: float
    penalty: float  # without its weight
    depth: Floats  # (B,) how far the worst pair at each sample may be inside its margin [m]
    gradient: Floats  # (M, n)
    diagonal: Floats  # (M, n, n) penalty curvature of each waypoint
    coupling: Floats  # (M − 1, n, n) penalty curvature between neighbours


@dataclass(frozen=True, eq=False)
class Problem:
    """What is to be solved. Nothing in it changes; `refined` gives another one."""

    scene: Scene
    robot: Robot
    start: Floats  # (n,)
    goal: Floats  # (n,)
    kinematics: Kinematics
    bodies: tuple[LinkBody, ...]  # the links' outer bodies
    plane_bodies: tuple[PlaneBody, ...]  # the obstacles' convex pieces, those last that move
    smoothness: Smoothness
    terms: tuple[Term | MotionTerm, ...]  # what the scene calls for: obstacles, self-collision, …
    samples: Samples
    unresolved: tuple[tuple[str, str], ...]  # link pairs left to the certificate, as their outer bodies overlap anyway
    apart: tuple[tuple[int, int], ...]  # pairs of bodies left out, as they keep their margin within all limits
    notes: tuple[str, ...]  # words for the user
    compile_seconds: float  # spent on compiling the distance, or on finding it in the cache

    @property
    def waypoints(self) -> int:
        """N, both ends included."""
        return self.scene.planner.waypoints

    @property
    def pair_terms(self) -> tuple[Clearance, ...]:
        """The terms that keep pairs of bodies apart."""
        return tuple(term for term in self.terms if isinstance(term, Clearance))

    @property
    def path_terms(self) -> tuple[PathTerm, ...]:
        """The terms that hold the scene's path constraints."""
        if self.scene.path == PathConstraints():
            return ()
        from hdplan.planner.path_terms import PathTerm

        return tuple(term for term in self.terms if isinstance(term, PathTerm))

    def clip(self, positions: Floats) -> Floats:
        """Move interior waypoints into the joint limits and set the ends."""
        result = np.clip(positions, self.robot.lower, self.robot.upper)
        result[0], result[-1] = self.start, self.goal
        return result

    def evaluate(self, positions: Floats, weight: float) -> Evaluation:
        """Cost and derivatives at waypoints (N, n) with penalty weight w [1/m²]."""
        smoothness, gradient = self.smoothness.value(positions)
        kinematics = self.kinematics.evaluate(self.samples.configurations(positions))
        sampled = [term for term in self.terms if not isinstance(term, MotionTerm)]
        penalties = [term.value(kinematics, self.samples) for term in sampled]
        n, batch = positions.shape[1], len(self.samples.weight)
        total = sum((p.gradient for p in penalties), np.zeros((batch, n)))
        curvature = sum((p.curvature for p in penalties), np.zeros((batch, n, n)))
        diagonal, coupling = self.samples.curvature_to_waypoints(curvature)
        slope = self.samples.to_waypoints(total)
        penalty = sum(p.cost for p in penalties)
        depth = np.max([np.zeros(batch), *(p.depth for p in penalties)], axis=0)
        for term in self.terms:
            if isinstance(term, MotionTerm):
                found = term.over_motion(positions, self.kinematics.evaluate(positions))
                penalty, slope = penalty + found.cost, slope + found.gradient
                diagonal, coupling = diagonal + found.diagonal, coupling + found.coupling
                depth = np.maximum(depth, found.depth[self.samples.interval])
        return Evaluation(
            cost=smoothness + weight * penalty,
            smoothness=smoothness,
            penalty=penalty,
            depth=depth,
            gradient=(gradient + weight * slope)[1:-1],
            diagonal=weight * diagonal[1:-1],
            coupling=weight * coupling[1:-1],
        )

    def depth(self, configurations: Floats, time: Floats | None = None) -> Floats:
        """How far the worst term is inside its margin at single configurations (B, n) -> (B,) [m]; of no particular
        time, or at path parameters `time` (B,)."""
        kinematics = self.kinematics.evaluate(configurations)
        depths = [term.depth(kinematics, time) for term in self.terms]
        result: Floats = np.max([np.zeros(len(configurations)), *depths], axis=0)
        return result

    def refined(self, intervals: list[int]) -> Problem:
        """The same problem, sampled twice as densely on the given intervals."""
        counts = np.array(self.samples.counts)
        counts[intervals] *= 2
        return replace(self, samples=self.samples.raised(counts))

    def resampled(self, positions: Floats) -> Problem:
        """The same problem, sampled densely enough for a motion (N, n): no body's centre moves farther than SPACING
        from one sample to the next."""
        kinematics = self.kinematics.evaluate(positions)
        joints = [body.joint for body in self.bodies]
        centres = np.array([body.body.vertices.mean(axis=0) for body in self.bodies]).reshape(-1, 3)
        places = (
            np.einsum("kbij,bj->kbi", kinematics.rotations[:, joints], centres) + kinematics.translations[:, joints]
        )
        moved = np.linalg.norm(np.diff(places, axis=0), axis=2).max(axis=1, initial=0.0)
        return replace(self, samples=self.samples.raised(np.ceil(moved / SPACING).astype(np.int64)))


def check_distance(name: str) -> None:
    """Raise InputError for an unknown distance."""
    if name not in DISTANCES:
        raise InputError(f"distance: unknown '{name}'{nearest(name, DISTANCES)}")


def self_margin(scene: Scene) -> float:
    """How close two links come before their penalty sets in [m]."""
    return max(scene.planner.clearance, scene.self_collision.clearance) + SELF_ACTIVATION


def build(scene: Scene, robot: Robot | None = None, deadline: float = math.inf) -> Problem:
    """Lay out the problem of a scene. Raises InputError for what the scene or its robot gets wrong.

    What can be done without waits no longer than `deadline` (time.perf_counter()): meshes that are not split into
    convex pieces by then are planned around as their hulls, with a note.
    """
    instance(scene, Scene, "scene")
    with naming(scene.source):
        scene.check_effects()
    robot = load_scene_robot(scene) if robot is None else robot
    instance(robot, Robot, "robot")
    query = resolve_query(robot, _settled(scene, robot))
    settings = scene.planner
    if settings.swept and settings.distance != "hdsdf":
        raise InputError(f"{scene.source}: planner.swept: true needs planner.distance hdsdf, found {settings.distance}")
    compiled_before = RowFunction.spent.seconds
    outline = outline_of(robot, settings.link_bodies, settings.normals)
    kinematics, bodies = outline.kinematics, outline.bodies
    with naming(scene.source):
        enclosed = [
            from_obstacle(obstacle, settings.normals, deadline - time.perf_counter()) for obstacle in scene.standing
        ]
    plane_bodies = tuple(body for pieces, _ in enclosed for body in pieces)
    notes = [*scene.notes, *robot.notes, *query.notes, *(word for _, words in enclosed for word in words)]

    terms: list[Term | MotionTerm] = []
    clearances = scene.clearances
    margins = np.array([clearances[body.name] + settings.activation for body in plane_bodies])
    pairs = [
        (a, b)
        for a, body in enumerate(bodies)
        if body.joint > 0
        for b in np.flatnonzero(outline.reach[a].meets(plane_bodies, margins)).tolist()
    ]
    if pairs:
        # room for every body and kernels for every shape: other obstacles then need nothing new compiled
        slots = max(len(body.body.vertices) for body in bodies if body.joint > 0)
        laid_out = body_pairs(bodies, plane_bodies, pairs, margins, kinematics.supports, slots)
        distance = _distance(laid_out, bodies, plane_bodies, settings, plane_counts(settings.normals))
        terms.append(
            SweptClearance("obstacles", laid_out, distance, settings.gamma, settings.shaping_length)
            if settings.swept
            else Clearance("obstacles", laid_out, distance)
        )
    if scene.moving and any(body.joint > 0 for body in bodies):
        from hdplan.planner.moving_clearance import moving_clearance
        from hdplan.planner.pace import pace

        with naming(scene.source):
            term, drifting, words = moving_clearance(
                scene,
                bodies,
                kinematics.supports,
                lambda pairs, bodies, pieces: _distance(
                    pairs, bodies, pieces, settings, plane_counts(settings.normals)
                ),
                deadline,
            )
        terms += [term, pace(scene, robot)]
        plane_bodies, notes = (*plane_bodies, *drifting), [*notes, *words]
    margin = self_margin(scene)
    kept = [(pair, kept > margin) for pair, kept in zip(outline.self_pairs, outline.distances_kept, strict=True)]
    own = [pair for pair, proven in kept if not proven]
    if own:
        laid_out = body_pairs(bodies, outline.planes, own, margin, kinematics.supports)
        distance = _distance(laid_out, bodies, outline.planes, settings)
        terms.append(Clearance("self-collision", laid_out, distance))
    if scene.path != PathConstraints():
        from hdplan.planner.path_terms import path_terms

        terms.extend(path_terms(scene, robot, kinematics.supports))
    if scene.limits.torque is not None:
        from hdplan.planner.static_torque import static_torque

        terms.extend(static_torque(scene, robot))

    return Problem(
        scene=scene,
        robot=robot,
        start=query.start,
        goal=query.goal,
        kinematics=kinematics,
        bodies=bodies,
        plane_bodies=plane_bodies,
        smoothness=Smoothness(settings.waypoints),
        terms=tuple(terms),
        samples=Samples((SAMPLES_PER_INTERVAL,) * (settings.waypoints - 1)),
        unresolved=outline.unresolved,
        apart=tuple(pair for pair, proven in kept if proven),
        notes=tuple(notes),
        compile_seconds=RowFunction.spent.seconds - compiled_before,
    )


def _settled(scene: Scene, robot: Robot) -> Scene:
    """Return the scene with one configuration as its goal."""
    if isinstance(scene.goal, JointTarget):
        return scene
    from hdplan.planner.goal_search import settled

    return settled(scene, robot)


def _distance(
    pairs: BodyPairs,
    bodies: tuple[LinkBody, ...],
    plane_bodies: tuple[PlaneBody, ...],
    settings: PlannerSettings,
    counts: tuple[int, ...] = (),
) -> PairDistance:
    if settings.distance == "fcl":
        return FclPairs(pairs, bodies, plane_bodies)
    return HdsdfPairs(pairs, settings.gamma, settings.shaping_length, counts)
