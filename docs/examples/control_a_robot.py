"""Steer a robot at run time, clear of obstacles, by a quadratic program with control barrier functions."""

import matplotlib.pyplot as plt
import numpy as np

import hdplan
from hdplan import control

scene = hdplan.load_scene("panda_bookshelf")
controller = control.Controller.of(scene)
robot = controller.robot
start, goal = robot.configuration(scene.start), robot.configuration(scene.goal)

# One step, which a robot's driver would call at every period.
step = controller.step(start, control.standing(goal))
print(f"{step.mode.value}, proven {1000 * step.proven:.1f} mm, velocity {np.round(step.velocity, 2)}")

# The same in simulation, for 3 s: no command lets a distance fall below its margin.
run = control.simulate(controller, start, control.standing(goal), 3.0)
print(f"nearest to a margin: {1000 * run.slacks.min():.1f} mm; proven of the whole run: {1000 * run.proven:.1f} mm")

# The motion of joints that follow smoothly, certified like any other motion.
executed = run.executed(robot.joint_names, scene.robot.locked)
print(hdplan.certify(scene, executed, robot, check_ends=False).text)

figure, (above, below) = plt.subplots(2, figsize=(7, 5), sharex=True, layout="constrained")
above.plot(run.times[:-1], run.velocities)
above.set(
    ylabel="commanded velocity [rad/s]", title="commands bring the arm to rest, no distance falls below its margin"
)
below.plot(run.times[:-1], 1000 * run.slacks)
below.set(xlabel="time [s]", ylabel="least Δ − δ [mm]")
figure.savefig("control_a_robot.png", dpi=100)
