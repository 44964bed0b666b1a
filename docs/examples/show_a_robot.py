"""A robot beside its plan in the viewer: reported joint values are drawn as they arrive.

Here the reports are the plan's own, a little late and off, as a robot's are. With MuJoCo, report
`data.qpos[:n]` after each step; with ROS, the positions of a JointState by their names.
"""

import time

import numpy as np

import hdplan
from hdplan.planner.view.server import open_viewer

RATE, LATE, OFF = 50.0, 0.05, 0.01  # [1/s], [s], [rad]

scene = hdplan.load_scene("ur5_table")
result = hdplan.plan(scene)
assert result.certified, result.certificate.text
motion = result.trajectory
duration = motion.duration or 1.0  # a path without times is driven in a second
rng = np.random.default_rng(0)

viewer = open_viewer(scene, [("planned", motion)])
try:
    print(f"{scene.name} at {viewer.address()}")
    for tick in range(int(RATE * duration)):
        share = max(tick / RATE - LATE, 0.0) / duration
        q = motion.at(share) + OFF * rng.normal(size=len(motion.joint_names))
        viewer.state(dict(zip(motion.joint_names, q, strict=True)))  # returns at once; the newest is drawn
        time.sleep(1.0 / RATE)
    viewer.state(None)  # no more reports of the robot
finally:
    viewer.close()
