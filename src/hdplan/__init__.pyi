"""Public names of hdplan and their homes: this list is read by type checkers, and at run time."""

from hdplan import control as control, distance as distance, symbolic as symbolic
from hdplan.distance.bodies import ConvexBody as ConvexBody
from hdplan.planner.batch.many import plan_many as plan_many
from hdplan.planner.batch.outcome import Outcome as Outcome
from hdplan.planner.build import build as build
from hdplan.planner.certificate.certifier import certify as certify, check_configuration as check_configuration
from hdplan.planner.certificate.verdict import Certificate as Certificate
from hdplan.planner.job.certify import (
    JobCertificate as JobCertificate,
    StageCertificate as StageCertificate,
    certify_job as certify_job,
)
from hdplan.planner.job.planning import plan_job as plan_job
from hdplan.planner.job.result import JobResult as JobResult
from hdplan.planner.motion.samples import Samples as Samples
from hdplan.planner.motion.trajectory import StageMark as StageMark, Trajectory as Trajectory
from hdplan.planner.plan import plan as plan
from hdplan.planner.problem.own_term import OwnTerm as OwnTerm
from hdplan.planner.problem.problem import Problem as Problem
from hdplan.planner.proof.proof import Proof as Proof, prove as prove
from hdplan.planner.replanning.command import Command as Command
from hdplan.planner.replanning.replanner import Replanner as Replanner
from hdplan.planner.result import PlanResult as PlanResult
from hdplan.planner.robot.loading import load_robot as load_robot
from hdplan.planner.robot.robot import Robot as Robot
from hdplan.planner.search.inverse_kinematics import inverse_kinematics as inverse_kinematics
from hdplan.planner.search.search import Event as Event
from hdplan.planner.solvers import solve as solve
from hdplan.planner.solvers.solution import Budget as Budget, Solution as Solution
from hdplan.scenes.attached import Attached as Attached, Payload as Payload
from hdplan.scenes.clouds import Cloud as Cloud, Ignored as Ignored
from hdplan.scenes.curve_stages import Along as Along, Circle as Circle, Line as Line
from hdplan.scenes.depth_images import DepthImage as DepthImage
from hdplan.scenes.errors import (
    HdplanError as HdplanError,
    InputError as InputError,
    NotProvenError as NotProvenError,
    TimeLimitError as TimeLimitError,
    UnsolvableError as UnsolvableError,
)
from hdplan.scenes.job import Grip as Grip, Job as Job, Move as Move, Release as Release, Set as Set, Wait as Wait
from hdplan.scenes.limits import Limits as Limits
from hdplan.scenes.obstacles import (
    Obstacle as Obstacle,
    SelfCollision as SelfCollision,
    SteadyMotion as SteadyMotion,
    TimedPoses as TimedPoses,
)
from hdplan.scenes.path_constraints import (
    Follow as Follow,
    PathConstraints as PathConstraints,
    Relative as Relative,
    Upright as Upright,
    Within as Within,
)
from hdplan.scenes.planner_settings import PlannerSettings as PlannerSettings
from hdplan.scenes.poses import Pose as Pose
from hdplan.scenes.robot_spec import PlanarBase as PlanarBase, RobotSpec as RobotSpec
from hdplan.scenes.scene import Scene as Scene
from hdplan.scenes.shapes import (
    Box as Box,
    Capsule as Capsule,
    Cylinder as Cylinder,
    Ellipsoid as Ellipsoid,
    Mesh as Mesh,
    Points as Points,
    Sphere as Sphere,
)
from hdplan.scenes.sizes import Calibration as Calibration, Tracking as Tracking, Uncertainty as Uncertainty
from hdplan.scenes.targets import AllOf as AllOf, PoseTarget as PoseTarget, State as State
from hdplan.scenes.timing import Timing as Timing
from hdplan.scenes.voxel_grids import OctoMap as OctoMap, Voxels as Voxels
from hdplan.scenes.yaml_format.reader import load_scene as load_scene

__version__: str
