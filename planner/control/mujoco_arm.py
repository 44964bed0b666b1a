"""An arm in MuJoCo, to execute motions without a robot: made of hdplan's robot, or of the user's model file.

The model file's joints are found by their names, and have to stand where hdplan's robot has them; each planned one
needs a position actuator of its own. MuJoCo is imported where it is used (extra `mujoco`).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from hdplan.planner.control.computed_torque import LONGEST_STEP, Execution
from hdplan.planner.control.loop import Loop
from hdplan.planner.control.mujoco_model import SEED, mujoco_xml
from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.pin_model import motion_axes
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError, listed
from hdplan.scenes.scene import Scene
from hdplan.scenes.values import checked, instance, path_of

LARGEST_ERROR = 0.5  # [rad] or [m] off its motion at which the execution ends
SAME_AXIS = 1e-3  # [m] and [rad] by which axes of a model may differ from those of the robot
COMPARED_CONFIGURATIONS = 5  # configurations at which they are held against each other


class MuJoCoArm:
    """A scene's robot in MuJoCo; an `Arm` for loops."""

    def __init__(self, setup: Setup, model: str | Path | None = None) -> None:
        """Take a scene with its robot; `of` is the usual way."""
        mujoco = _mujoco()
        self.robot = setup.robot
        self.joint_names = self.robot.joint_names
        if model is None:
            self._model = mujoco.MjModel.from_xml_string(mujoco_xml(setup))
        else:
            self._model = _read(checked(path_of, model, "model"))
        self._data = mujoco.MjData(self._model)
        where = "" if model is None else f"{model}: "
        joints = [_joint(self._model, name, where) for name in self.joint_names]
        self._q, self._v = self._model.jnt_qposadr[joints], self._model.jnt_dofadr[joints]
        self._pulls = np.array([self._model.actuator_trnid[:, 0] == joint for joint in joints], dtype=np.float64)
        drives = [
            _drives(self._model, joint, name, where) for joint, name in zip(joints, self.joint_names, strict=True)
        ]
        self._positions = [position for position, _ in drives]
        self._speeds = [speed for _, speed in drives if speed is not None]
        if model is not None:
            _same(self._model, self.robot, joints, self._q, where)
        every = max(round(LONGEST_STEP / self._model.opt.timestep), 1)
        self._steps, self.period = every, every * float(self._model.opt.timestep)
        self._commanded: list[Array] = []
        self.place(self.robot.configuration(setup.scene.start, setup.scene.from_request))

    @classmethod
    def of(cls, scene: Scene, robot: Robot | None = None, model: str | Path | None = None) -> MuJoCoArm:
        """Return the arm of a scene, at its start; for a job, without held objects.

        Args:
            scene: robot, loads and start.
            robot: the scene's robot, if it is already loaded.
            model: a MuJoCo model file (.xml) in place of hdplan's robot.

        Raises InputError if MuJoCo is not installed; for a robot without masses, or with joints that follow others; for
        a model that cannot be read, is another robot, or has no position actuators.
        """
        instance(scene, Scene, "scene")
        return cls(Setup.of(scene if scene.job is None else replace(scene, job=None), robot), model)

    def place(self, q: Array, v: Array | None = None) -> None:
        """Put the arm at positions q (n,), with velocities v (n,), by default at rest, at time 0."""
        mujoco = _mujoco()
        if self._model.nkey:
            mujoco.mj_resetDataKeyframe(self._model, self._data, 0)
        else:
            mujoco.mj_resetData(self._model, self._data)
        for name, value in self.robot.locked.items():
            joint = mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_JOINT, name)
            if joint >= 0 and _moves_along_one(self._model, joint):
                self._data.qpos[self._model.jnt_qposadr[joint]] = value
        self._data.qpos[self._q], self._data.qvel[self._v] = q, 0.0 if v is None else v
        self._data.ctrl[self._positions] = q
        if self._speeds:
            self._data.ctrl[self._speeds] = self._data.qvel[self._v]
        mujoco.mj_forward(self._model, self._data)
        self._commanded = []

    def time(self) -> float:
        """Return the time [s] of the simulation."""
        return float(self._data.time)

    def state(self) -> tuple[Array, Array]:
        """Return the joints' positions and velocities (n,); NaN once the simulation has broken down."""
        broken = self._data.warning[_mujoco().mjtWarning.mjWARN_BADQACC].number > 0
        q, v = (np.array(each) for each in (self._data.qpos[self._q], self._data.qvel[self._v]))
        return (np.full_like(q, np.nan), np.full_like(v, np.nan)) if broken else (q, v)

    def send(self, position: Array, velocity: Array) -> None:
        """Simulate one period, in which the drives move to a position (n,) with a velocity (n,)."""
        step = self.period / self._steps
        for left in range(self._steps - 1, -1, -1):  # the reference in the middle of each step
            self._data.ctrl[self._positions] = position - (left + 0.5) * step * velocity
            if self._speeds:
                self._data.ctrl[self._speeds] = velocity
            _mujoco().mj_step(self._model, self._data)
        self._commanded.append(self._data.qfrc_gravcomp[self._v] + self._pulls @ self._data.actuator_force)

    def stop(self) -> None:
        """Hold the place where the arm is."""
        self._data.ctrl[self._positions] = self._data.qpos[self._q]
        if self._speeds:
            self._data.ctrl[self._speeds] = 0.0

    @property
    def torques(self) -> Array:
        """The drives' torques (k, n) [Nm] or [N] in each period since the arm was placed, before they are clipped at
        the drives' limits."""
        return np.array(self._commanded).reshape(-1, len(self.joint_names))


def execute_in_mujoco(setup: Setup, curve: Curve, model: str | Path | None = None) -> Execution:
    """Execute a curve of the robot's planned joints, with times, from a place and a speed on it.

    Raises InputError for the reasons of `MuJoCoArm.of`.
    """
    assert curve.times is not None
    arm = MuJoCoArm(setup, model)
    first = float(curve.times[0])
    arm.place(curve.at_time(np.array([first]))[0], curve.at_time(np.array([first]), 1)[0])
    done = Loop(arm, LARGEST_ERROR).along(curve)
    return Execution(first + done.times, done.positions, done.errors, arm.torques, bool(done.why), done.velocity_errors)


def _mujoco() -> Any:
    """Return the library. Raises InputError if it is not installed."""
    try:
        import mujoco
    except ImportError:
        raise InputError("bodies in MuJoCo need mujoco, which is not installed: pip install mujoco") from None
    return mujoco


def _read(path: Path) -> Any:
    """Return the model of a file. Raises InputError for one that MuJoCo does not read."""
    if not path.is_file():
        raise InputError(f"{path}: no such file; a MuJoCo model file (.xml) is needed")
    try:
        return _mujoco().MjModel.from_xml_path(str(path))
    except (ValueError, _mujoco().FatalError) as error:
        raise InputError(f"{path}: is not a model that MuJoCo can read: {' '.join(str(error).split())}") from None


def _joint(model: Any, name: str, where: str) -> int:
    """Return the joint of a model with a name, or the only one whose name ends the robot's, as `joint1` does
    `panda_joint1`. Raises InputError if there is none, or one that neither turns nor slides."""
    names = [model.joint(i).name for i in range(model.njnt)]
    fitting = [i for i, other in enumerate(names) if other == name] or [
        i for i, other in enumerate(names) if other and (name.endswith(f"_{other}") or other.endswith(f"/{name}"))
    ]
    if len(fitting) != 1:
        raise InputError(f"{where}joint: no joint '{name}' is there; it has {listed(names)}")
    if not _moves_along_one(model, fitting[0]):
        raise InputError(f"{where}joint: '{name}' must be a hinge or a slide")
    return fitting[0]


def _moves_along_one(model: Any, joint: int) -> bool:
    """Return whether a joint has one coordinate: it turns about an axis, or slides along one."""
    kinds = _mujoco().mjtJoint
    return int(model.jnt_type[joint]) in (int(kinds.mjJNT_HINGE), int(kinds.mjJNT_SLIDE))


def _drives(model: Any, joint: int, name: str, where: str) -> tuple[int, int | None]:
    """Return the actuators of a joint that take positions, and velocities, if any does. Raises InputError for a joint
    without a position actuator of its own, or with another one."""
    own = [
        i
        for i in range(model.nu)
        if int(model.actuator_trntype[i]) == int(_mujoco().mjtTrn.mjTRN_JOINT) and model.actuator_trnid[i, 0] == joint
    ]
    positions, speeds = [], []
    for i in own:
        gain, bias = float(model.actuator_gainprm[i, 0]), model.actuator_biasprm[i]
        if gain > 0.0 and bias[1] == -gain and model.actuator_gear[i, 0] == 1.0:
            positions.append(i)
        elif gain > 0.0 and bias[1] == 0.0 and bias[2] == -gain and model.actuator_gear[i, 0] == 1.0:
            speeds.append(i)
    if len(positions) != 1 or len(positions) + len(speeds) != len(own) or len(speeds) > 1:
        raise InputError(
            f"{where}actuator: joint '{name}' needs one position actuator with a gear of 1, has {len(positions)} "
            f"of {len(own)} actuators"
        )
    return positions[0], speeds[0] if speeds else None


def _same(model: Any, robot: Robot, joints: list[int], places: Array, where: str) -> None:
    """Refuse a model of which a joint does not stand and turn where the robot's does."""
    mujoco, data, own = _mujoco(), _mujoco().MjData(model), robot.model.createData()
    for q in robot.draw(np.random.default_rng(SEED), COMPARED_CONFIGURATIONS):
        data.qpos[places] = q
        mujoco.mj_kinematics(model, data)
        pin.forwardKinematics(robot.model, own, robot.pin_q(q))
        for i, (joint, name) in enumerate(zip(joints, robot.joint_names, strict=True), 1):
            linear, angular = motion_axes(robot.model.joints[i])
            turns = bool(np.any(angular))
            if turns != (int(model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_HINGE)):
                raise InputError(f"{where}joint: '{name}' must {'turn' if turns else 'slide'}, as the robot's does")
            axis = own.oMi[i].rotation @ (angular if turns else linear)
            off = data.xanchor[joint] - own.oMi[i].translation
            away = np.linalg.norm(off - axis * (axis @ off)) if turns else 0.0
            turned = np.linalg.norm(data.xaxis[joint] - axis)
            if max(away, turned) > SAME_AXIS:
                raise InputError(
                    f"{where}joint: the axis of '{name}' is {1e3 * away:.3g} mm and {turned:.3g} rad from where the "
                    f"scene's robot has it, at most {1e3 * SAME_AXIS:g} mm and {SAME_AXIS:g} rad are allowed"
                )
