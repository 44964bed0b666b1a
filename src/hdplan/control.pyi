"""Public names of hdplan.control and their homes."""

from hdplan.planner.control.arm import Arm as Arm
from hdplan.planner.control.barrier_settings import BarrierSettings as BarrierSettings
from hdplan.planner.control.barriers import (
    Barriers as Barriers,
    scene_barriers as scene_barriers,
)
from hdplan.planner.control.braking import Command as Command
from hdplan.planner.control.controller import Controller as Controller, Step as Step
from hdplan.planner.control.look_ahead import Mode as Mode
from hdplan.planner.control.loop import Executed as Executed, Loop as Loop
from hdplan.planner.control.mujoco_arm import MuJoCoArm as MuJoCoArm
from hdplan.planner.control.rollout import Run as Run, simulate as simulate
from hdplan.planner.control.settings import ControlSettings as ControlSettings
from hdplan.planner.control.tasks import (
    Damping as Damping,
    PoseTask as PoseTask,
    Ranked as Ranked,
    Task as Task,
    TrackTask as TrackTask,
    standing as standing,
)
