"""A Panda in MuJoCo executes a plan; its tracking error becomes the tube in which the next plan is proven."""

import dataclasses

import numpy as np

import hdplan
from hdplan import control

scene = dataclasses.replace(
    hdplan.load_scene("panda_cage"), limits=hdplan.Limits(velocity="urdf", acceleration=5, jerk=300)
)
arm = control.MuJoCoArm.of(scene)
loop = control.Loop(arm)

first = loop.follow(hdplan.plan(scene).trajectory)
print(f"off by {1e3 * np.abs(first.errors).max():.1f} mrad")

# Twice the measured errors become the arm's tolerance; the motion is proven for all of them.
known = dataclasses.replace(scene, robot=hdplan.RobotSpec("panda", tracking=first.tracking.times(2)))
planned = hdplan.plan(known)
print(planned.certificate.text)

arm.place(planned.trajectory.positions[0])
done = loop.follow(planned.trajectory)
tube = np.array(known.robot.tracking.position)
print("within the tube:", bool((np.abs(done.errors) <= tube).all()))
