"""Certify another planner's path: here the straight line between start and goal, written as a CSV."""

import matplotlib.pyplot as plt
import numpy as np

import hdplan

scene = hdplan.load_scene("panda_bookshelf")
robot = hdplan.load_robot(scene.robot)
start, goal = robot.configuration(scene.start), robot.configuration(scene.goal)

# What another planner wrote: joint names in the header, one configuration in a row.
path = np.linspace(start, goal, 20)
np.savetxt("theirs.csv", path, delimiter=",", header=",".join(robot.joint_names), comments="")

theirs = hdplan.Trajectory.load("theirs.csv")
verdict = hdplan.certify(scene, theirs)
print(verdict.text)
for place in verdict.failures[:3]:  # the intervals that are not proven, and with what
    print(f"  after waypoint {place.interval}: {place.link} to {place.other}, {1000 * place.distance:.1f} mm")

ours = hdplan.plan(scene)
print(ours.certificate.text)

# Single configurations are checked exactly: how deep each waypoint is in contact.
depths = [
    [max((contact.depth for contact in hdplan.check_configuration(scene, robot, q)), default=0.0) for q in motion]
    for motion in (path, ours.trajectory.positions)
]
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
for depth, name, status in zip(depths, ("straight line", "hdplan"), (verdict, ours.certificate), strict=True):
    axes.plot(np.linspace(0, 1, len(depth)), 1000 * np.array(depth), ".-", label=f"{name}: {status.status.value}")
axes.set(
    xlabel="path",
    ylabel="deepest contact [mm]",
    title="the straight line goes through the shelf, hdplan's motion around it",
)
axes.legend()
figure.savefig("check_another_planner.png", dpi=100)
