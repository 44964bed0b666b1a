"""Drive a UR by ur_rtde with the loop that drives the body in MuJoCo. NOT RUN ON HARDWARE; try it slowly, hand on the
stop button. `python ur_rtde_arm.py ADDRESS` is for a robot; without an address the motion runs in MuJoCo."""

import sys
import time

import numpy as np

import hdplan
from hdplan import control

JOINTS = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")


class UR:
    """A UR5 of the CB series, whose controller takes a position of its joints every 8 ms. An e-Series takes one every
    2 ms, and has other links: its scene needs its own robot."""

    joint_names, period = JOINTS, 0.008

    def __init__(self, address):
        """Connect to the robot's controller."""
        from rtde_control import RTDEControlInterface
        from rtde_receive import RTDEReceiveInterface

        rate = 1.0 / self.period
        self.control, self.receive = RTDEControlInterface(address, rate), RTDEReceiveInterface(address, rate)

    def time(self):
        """Return the time [s]."""
        return time.monotonic()

    def state(self):
        """Return the measured positions and velocities."""
        return np.array(self.receive.getActualQ()), np.array(self.receive.getActualQd())

    def send(self, position, velocity):
        """Send the reference for the end of this period, with the least look-ahead and a middle gain."""
        began = self.control.initPeriod()
        if not self.control.servoJ(position.tolist(), 0.0, 0.0, self.period, 0.03, 500.0):
            raise RuntimeError("the controller does not take positions")
        self.control.waitPeriod(began)

    def stop(self):
        """Come to rest."""
        self.control.servoStop()


scene = hdplan.load_scene("ur5_pallet")
motion = hdplan.plan(scene).trajectory
arm = UR(sys.argv[1]) if sys.argv[1:] and __file__ == sys.argv[0] else control.MuJoCoArm.of(scene)
done = control.Loop(arm).follow(motion)
arm.stop()
print(done.why or f"arrived; robot.tracking must be at least {done.tracking}")
