"""Drive a Franka arm by franky with the loop that drives the body in MuJoCo. NOT RUN ON HARDWARE; try it slowly, hand
on the stop button. `python franky_arm.py ADDRESS` is for a robot; without an address the motion runs in MuJoCo."""

import dataclasses
import sys
import time

import hdplan
from hdplan import control


class Franka:
    """A Franka arm under franky's joint impedance, which takes references at any rate; its own loop runs at 1 kHz."""

    joint_names, period = tuple(f"panda_joint{i}" for i in range(1, 8)), 0.005

    def __init__(self, address):
        """Connect to the robot, and hold it where it is."""
        import franky

        self.franky, self.robot = franky, franky.Robot(address)
        stiffness = [600.0, 600.0, 600.0, 600.0, 250.0, 150.0, 50.0]
        self.motion = franky.JointImpedanceTrackingMotion(stiffness=stiffness)
        self.motion.set_reference(franky.JointReference(q=self.robot.current_joint_state.position))
        self.robot.move(self.motion, asynchronous=True)
        self.next = time.monotonic()

    def time(self):
        """Return the time [s]."""
        return time.monotonic()

    def state(self):
        """Return the measured positions and velocities."""
        measured = self.robot.current_joint_state
        return measured.position, measured.velocity

    def send(self, position, velocity):
        """Send the reference for the end of this period."""
        if not self.robot.is_in_control:
            raise RuntimeError("the robot is not in control any more")
        self.motion.set_reference(self.franky.JointReference(q=position, dq=velocity))
        self.next = max(self.next + self.period, time.monotonic())
        time.sleep(self.next - time.monotonic() if self.next > time.monotonic() else 0.0)

    def stop(self):
        """Come to rest."""
        self.robot.move(self.franky.TorqueStopMotion())


limits = hdplan.Limits(velocity=0.5, acceleration=2, jerk=100)
scene = dataclasses.replace(hdplan.load_scene("panda_cage"), limits=limits)
motion = hdplan.plan(scene).trajectory
arm = Franka(sys.argv[1]) if sys.argv[1:] and __file__ == sys.argv[0] else control.MuJoCoArm.of(scene)
done = control.Loop(arm).follow(motion)
arm.stop()
print(done.why or f"arrived; robot.tracking must be at least {done.tracking}")
