"""TrajOpt, as Tesseract has it, for `peers`: STEPS equal steps from a straight line, between them swept convex hulls.

The settings are those of the Python package's own examples (`create_trajopt_default_profiles`): contacts forbidden and
a cost from 1 cm on, by Bullet's casts of each hull between configurations at most `segment` [rad] apart; velocities,
accelerations and jerks weighted alike. `margin` [m] is added to both distances. What is swept is the hull of a body's
two poses, which a turning body leaves by a little.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

from peer_server import serve
from tesseract_robotics.tesseract_collision import CollisionEvaluatorType
from tesseract_robotics.tesseract_command_language import (
    CartesianWaypoint,
    CartesianWaypointPoly_wrap_CartesianWaypoint,
    CompositeInstruction,
    InstructionPoly_as_MoveInstructionPoly,
    MoveInstruction,
    MoveInstructionPoly_wrap_MoveInstruction,
    MoveInstructionType_FREESPACE,
    ProfileDictionary,
    StateWaypoint,
    StateWaypointPoly_wrap_StateWaypoint,
    WaypointPoly_as_StateWaypointPoly,
)
from tesseract_robotics.tesseract_common import GeneralResourceLocator, Isometry3d, ManipulatorInfo
from tesseract_robotics.tesseract_environment import Environment
from tesseract_robotics.tesseract_motion_planners import PlannerRequest
from tesseract_robotics.tesseract_motion_planners_simple import generateInterpolatedProgram
from tesseract_robotics.tesseract_motion_planners_trajopt import (
    ProfileDictionary_addTrajOptCompositeProfile,
    ProfileDictionary_addTrajOptPlanProfile,
    ProfileDictionary_addTrajOptSolverProfile,
    TrajOptDefaultCompositeProfile,
    TrajOptDefaultPlanProfile,
    TrajOptMotionPlanner,
    TrajOptOSQPSolverProfile,
)

import numpy as np  # isort: skip  (after Tesseract, which brings a C++ runtime newer than some systems')

STEPS = 10
ITERATIONS = 200
FORBIDDEN, COSTLY = (0.005, 10.0), (0.01, 50.0)  # [m] below which contacts count; weight
TASK, PROFILE = "TrajOptMotionPlannerTask", "DEFAULT"
COARSE = 100.0  # [rad] or [m]: so that STEPS alone says how finely the line is cut
CONTACTS = """
contact_manager_plugins:
  search_libraries: [tesseract_collision_bullet_factories]
  discrete_plugins:
    default: BulletDiscreteBVHManager
    plugins: {BulletDiscreteBVHManager: {class: BulletDiscreteBVHManagerFactory}}
  continuous_plugins:
    default: BulletCastBVHManager
    plugins: {BulletCastBVHManager: {class: BulletCastBVHManagerFactory}}
"""
KINEMATICS = """
kinematic_plugins:
  search_libraries: [tesseract_kinematics_kdl_factories]
  fwd_kin_plugins:
    GROUP:
      default: KDL
      plugins: {KDL: {class: KDLFwdKinChainFactory, config: {base_link: BASE, tip_link: TIP}}}
  inv_kin_plugins:
    GROUP:
      default: KDL
      plugins: {KDL: {class: KDLInvKinChainLMAFactory, config: {base_link: BASE, tip_link: TIP}}}
"""


def solve(request: dict[str, Any]) -> dict[str, Any]:
    """Plan one task."""
    began = time.process_time()
    world = _environment(request)
    program = CompositeInstruction(PROFILE)
    arm = ManipulatorInfo()
    arm.manipulator, arm.tcp_frame, arm.working_frame = request["group"], request["tip"], request["base"]
    program.setManipulatorInfo(arm)
    for at in (_state(request, "start"), _pose(request) if "pose" in request else _state(request, "goal")):
        move = MoveInstruction(at, MoveInstructionType_FREESPACE, PROFILE)
        program.appendMoveInstruction(MoveInstructionPoly_wrap_MoveInstruction(move))
    query = PlannerRequest()
    query.env, query.profiles = world, _profiles(request)
    ready = time.process_time()
    query.instructions = generateInterpolatedProgram(program, world, COARSE, COARSE, COARSE, STEPS)
    result = TrajOptMotionPlanner(TASK).solve(query)
    done = time.process_time()
    path = [_joints(item) for item in result.results.getInstructions()] if result.successful else None
    return {"path": path, "setup": ready - began, "seconds": done - ready}


def _state(request: dict[str, Any], end: str) -> object:
    return StateWaypointPoly_wrap_StateWaypoint(StateWaypoint(request["joints"], np.array(request[end])))


def _pose(request: dict[str, Any]) -> object:
    return CartesianWaypointPoly_wrap_CartesianWaypoint(CartesianWaypoint(Isometry3d(np.array(request["pose"]))))


def _joints(instruction: object) -> list[float]:
    move = InstructionPoly_as_MoveInstructionPoly(instruction)
    position = WaypointPoly_as_StateWaypointPoly(move.getWaypoint()).getPosition()
    return [float(value) for value in position.ravel()]


def _environment(request: dict[str, Any]) -> Environment:
    """Robot and obstacles, with the plug-ins that it needs."""
    world = Environment()
    with tempfile.TemporaryDirectory() as folder:
        kinematics = KINEMATICS.replace("GROUP", request["group"])
        kinematics = kinematics.replace("BASE", request["base"]).replace("TIP", request["tip"])
        plugins = ""
        for element, text in (("kinematics", kinematics), ("contact_managers", CONTACTS)):
            file = Path(folder) / f"{element}.yaml"
            file.write_text(text)
            plugins += f'<{element}_plugin_config filename="file://{file}"/>'
        srdf = request["srdf"].replace("<group ", f"{plugins}<group ", 1)
        if not world.initFromUrdfSrdf(request["urdf"], srdf, GeneralResourceLocator()):
            raise RuntimeError("Tesseract does not take the description")
    world.setState(request["joints"], np.array(request["start"]))
    return world


def _profiles(request: dict[str, Any]) -> ProfileDictionary:
    """Costs, constraints and the solver's limits."""
    whole, ends, solver = TrajOptDefaultCompositeProfile(), TrajOptDefaultPlanProfile(), TrajOptOSQPSolverProfile()
    ones = np.ones(len(request["joints"]))
    whole.velocity_coeff = whole.acceleration_coeff = whole.jerk_coeff = ones
    contacts = (whole.collision_constraint_config, FORBIDDEN), (whole.collision_cost_config, COSTLY)
    for contact, (reach, weight) in contacts:
        contact.collision_margin_buffer = reach
        contact.contact_manager_config.default_margin = request["margin"]
        contact.collision_check_config.type = CollisionEvaluatorType.LVS_CONTINUOUS
        contact.collision_check_config.longest_valid_segment_length = request["segment"]
        contact.collision_coeff_data.setDefaultCollisionCoeff(weight)
    ends.joint_cost_config.enabled, ends.joint_constraint_config.enabled = False, True
    solver.opt_params.max_iter, solver.opt_params.max_time = ITERATIONS, request["time_limit"]
    profiles = ProfileDictionary()
    ProfileDictionary_addTrajOptCompositeProfile(profiles, TASK, PROFILE, whole)
    ProfileDictionary_addTrajOptPlanProfile(profiles, TASK, PROFILE, ends)
    ProfileDictionary_addTrajOptSolverProfile(profiles, TASK, PROFILE, solver)
    return profiles


if __name__ == "__main__":
    serve(solve)
