"""Drake's KinematicTrajectoryOptimization for `peers`.

A clamped cubic B-spline of CONTROL_POINTS control points over unit time, from a straight line: least path energy, ends
fixed, control points within the joint limits, and at `samples` equally spaced times
MinimumDistanceLowerBoundConstraint (the task's margin, INFLUENCE beyond it) between all pairs; SNOPT, which Drake picks
itself (IPOPT and the cost of path length did worse on a few problems). The robot is built joint by joint from
hdplan's model; bodies are Drake's own boxes, cylinders, spheres, capsules and convex hulls.
"""

from __future__ import annotations

import time

import coal
import numpy as np
from peer_task import Answer, Body, Task
from pydrake.geometry import (
    Box,
    Capsule,
    CollisionFilterDeclaration,
    Convex,
    Cylinder,
    GeometrySet,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.inverse_kinematics import MinimumDistanceLowerBoundConstraint
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, PrismaticJoint, RevoluteJoint, SpatialInertia
from pydrake.planning import KinematicTrajectoryOptimization
from pydrake.solvers import SnoptSolver
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.trajectories import BsplineTrajectory

from hdplan.scenes.array_types import Array

CONTROL_POINTS = 10  # as in Drake's own example
INFLUENCE = 0.01  # [m] beyond the margin from which on a pair counts: Drake's default
DENSE = 257  # configurations taken from the spline: between them it is straight to much less than a millimetre


def solve(task: Task, samples: int, time_limit: float) -> Answer:
    """Optimize one trajectory with collisions looked at in `samples` configurations."""
    margin = task.margin
    began = time.process_time()
    plant, diagram = _world(task)
    context = diagram.CreateDefaultContext()
    apart = MinimumDistanceLowerBoundConstraint(
        plant, margin, plant.GetMyMutableContextFromRoot(context), influence_distance_offset=INFLUENCE
    )
    problem = KinematicTrajectoryOptimization(task.robot.n, CONTROL_POINTS)
    knots = np.linspace(0.0, 1.0, CONTROL_POINTS)[:, None]
    line = (1.0 - knots) * task.start + knots * task.goal
    problem.SetInitialGuess(BsplineTrajectory(problem.basis(), [row[:, None] for row in line]))
    problem.AddDurationConstraint(1.0, 1.0)
    problem.AddPathEnergyCost(1.0)
    problem.AddPositionBounds(task.lower, task.upper)
    problem.AddPathPositionConstraint(task.start, task.start, 0.0)
    problem.AddPathPositionConstraint(task.goal, task.goal, 1.0)
    for s in np.linspace(0.0, 1.0, samples):
        problem.AddPathPositionConstraint(apart, s)
    ready = time.process_time()
    clock = _Clock(ready + time_limit)
    problem.get_mutable_prog().AddVisualizationCallback(clock, problem.control_points().ravel())
    try:
        result = SnoptSolver().Solve(problem.prog())
    except RuntimeError:
        if not clock.rung:
            raise
        return Answer(None, ready - began, time.process_time() - ready)
    done = time.process_time()
    path = _path(problem.ReconstructTrajectory(result), task) if result.is_success() else None
    return Answer(path, ready - began, done - ready)


class _Clock:
    """Ends SNOPT, whose own time limit does not, by an exception at an evaluation."""

    def __init__(self, deadline: float) -> None:
        self.deadline, self.rung = deadline, False

    def __call__(self, _: Array) -> None:
        if time.process_time() > self.deadline:
            self.rung = True
            raise TimeoutError


def _path(spline: BsplineTrajectory, task: Task) -> Array:
    """Sample the spline; the solver's tolerance at ends and limits (1e-6) is taken off it."""
    path = spline.vector_values(np.linspace(spline.start_time(), spline.end_time(), DENSE)).T
    path = np.clip(path, task.robot.lower, task.robot.upper)
    path[0], path[-1] = task.start, task.goal
    return np.asarray(path)


def _world(task: Task) -> tuple[MultibodyPlant, Diagram]:
    """Build robot and obstacles, with the task's pairs alone."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    plant.set_adjacent_bodies_collision_filters(False)
    model = task.robot.model
    carriers = [plant.world_body()]
    for index in range(1, model.njoints):
        body = plant.AddRigidBody(model.names[index], SpatialInertia.SolidSphereWithMass(1.0, 0.1))
        placement = RigidTransform(model.jointPlacements[index].homogeneous)
        parent = carriers[model.parents[index]].body_frame()
        frame = plant.AddFrame(FixedOffsetFrame(f"{model.names[index]}_at", parent, placement))
        linear, angular = np.split(np.asarray(model.joints[index].createData().S).ravel(), 2)
        kind, axis = (RevoluteJoint, angular) if angular.any() else (PrismaticJoint, linear)
        plant.AddJoint(kind(model.names[index], frame, body.body_frame(), axis))
        carriers.append(body)
    shapes = [
        plant.RegisterCollisionGeometry(
            carriers[body.joint], RigidTransform(body.pose), _shape(body), body.name, CoulombFriction()
        )
        for body in task.bodies
    ]
    plant.Finalize()
    left_out = CollisionFilterDeclaration()
    for a, b in task.excused:  # those fixed to one body Drake leaves out itself
        left_out.ExcludeBetween(GeometrySet(shapes[a]), GeometrySet(shapes[b]))
    scene_graph.collision_filter_manager().Apply(left_out)
    return plant, builder.Build()


def _shape(body: Body) -> Shape:
    match body.piece.shape:
        case coal.Box() as box:
            return Box(*(2.0 * box.halfSide))
        case coal.Sphere() as sphere:
            return Sphere(sphere.radius)
        case coal.Cylinder() as cylinder:
            return Cylinder(cylinder.radius, 2.0 * cylinder.halfLength)
        case coal.Capsule() as capsule:
            return Capsule(capsule.radius, 2.0 * capsule.halfLength)
    return Convex(body.piece.vertices.T, body.name)
