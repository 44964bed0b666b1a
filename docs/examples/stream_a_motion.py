"""Stream a motion to a Panda at 1 kHz, as libfranka's joint position interface requires."""

import dataclasses
import itertools
from pathlib import Path

import numpy as np

import hdplan

RATE = 1000.0  # samples per second

scene = hdplan.load_scene("panda_cage")
limits = hdplan.Limits(velocity="urdf", acceleration=7.5, jerk=500.0)
result = hdplan.plan(dataclasses.replace(scene, limits=limits))
assert result.certified, result.certificate.text  # within these limits, at every instant
motion = result.trajectory

stream = motion.sampled(RATE)  # exact, from the certified curve
steps = np.abs(np.diff(stream.positions, axis=0)) * RATE
changes = np.abs(np.diff(stream.velocities, axis=0)) * RATE
fastest = np.array([2.175] * 4 + [2.61] * 3)  # the Panda's [rad/s]
assert (steps <= fastest).all()  # follows from the certificate: a step is the mean of a velocity that is proven
assert (changes <= 7.5).all()  # and this is that of an acceleration
print(f"{len(stream)} samples in {motion.duration:.3f} s, up to {(steps / fastest).max():.0%} of the velocities")

robot = hdplan.load_robot(scene.robot)
places = stream.poses(robot)[:, :3, 3]  # of the end effector
print(f"the hand passes {np.linalg.norm(np.diff(places, axis=0), axis=1).sum():.3f} m")

# One row a millisecond; a callback of libfranka returns the next one at each call: franka::JointPositions(row).
Path("panda_cage.csv").write_text("\n".join(",".join(map(repr, row)) for row in stream.positions.tolist()))

# Your own loop can read the motion at any time.
for tick in itertools.count():
    now = tick / RATE
    if now > motion.duration:
        break
    setpoint = motion.at_time(now)
    assert np.array_equal(setpoint.positions, stream.positions[tick])
