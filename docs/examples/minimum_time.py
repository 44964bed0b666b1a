"""Minimum time under full torque limits, around an obstacle: by direct collocation, and by retiming a path."""

import dataclasses

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import hdplan
from hdplan import symbolic

most = np.array([18.0, 6.0])  # [Nm] of shoulder and elbow
wall = hdplan.Pose((0.0, 0.0, 0.0), (2**-0.5, 0.0, 0.0, 2**-0.5))  # on which the arm lifts itself
scene = dataclasses.replace(
    hdplan.load_scene("planar_arm"),
    robot=dataclasses.replace(hdplan.load_scene("planar_arm").robot, base=wall),
    obstacles=[hdplan.Sphere(0.12, name="ball", pose=[0.68, -0.1, 0.25])],
    start=[-0.6, 0.2],
    goal=[1.3, 0.3],
    limits=hdplan.Limits(velocity=8.0, acceleration=150.0, torque=most),
    planner=hdplan.PlannerSettings(objective="time"),
)
planned = hdplan.plan(scene).trajectory  # a path, timed as fast as these limits allow, improved by some rounds

dynamics, keep = symbolic.dynamics(scene), symbolic.clearance(scene)
program, count = ca.Opti(), 24
q, v, a = (program.variable(2, count + 1) for _ in range(3))
duration = program.variable()
h = duration / count
q0, v0, a0, a1 = q[:, :-1], v[:, :-1], a[:, :-1], a[:, 1:]  # accelerations are straight between nodes, so all is exact
program.subject_to(ca.vec(v[:, 1:] - v0 - h / 2 * (a0 + a1)) == 0)
program.subject_to(ca.vec(q[:, 1:] - q0 - h * v0 - h**2 / 6 * (2 * a0 + a1)) == 0)
for unknown, ends in ((q, planned.positions), (v, planned.velocities)):
    program.subject_to(ca.vec(unknown[:, [0, count]]) == ends[[0, -1]].ravel())
middle = q0 + h / 2 * v0 + h**2 / 48 * (5 * a0 + a1), v0 + h / 8 * (3 * a0 + a1), (a0 + a1) / 2
tau = [dynamics.map(each[0].shape[1])(*each)[0] for each in ((q, v, a), middle)]
for limit, values in ((0.99, tau[0] / most), (0.99, tau[1] / most), (7.8, v), (7.8, middle[1]), (149, a), (2.6, q)):
    program.subject_to(program.bounded(-limit, ca.vec(values), limit))
for points in (q[:, 1:-1], middle[0]):
    program.subject_to(ca.vec(keep.function.map(points.shape[1])(q=points)["distance"]) >= 0.002)  # [m]
program.minimize(duration)
ratio = np.linspace(0, 1, count + 1)
rows = np.round(ratio * (len(planned) - 1)).astype(int)  # from where the solver begins
for unknown, known in ((q, planned.positions), (v, planned.velocities), (a, planned.accelerations)):
    program.set_initial(unknown, known[rows].T)
program.set_initial(duration, planned.duration)
program.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})
found = program.solve()
times, rates = found.value(duration) * ratio, (found.value(each).T for each in (v, a))
collocated = hdplan.Trajectory(planned.joint_names, found.value(q).T, planned.locked, times, *rates)
figure, rows = plt.subplots(2, 1, figsize=(7, 4.5), sharex=True, sharey=True, layout="constrained")
for row, name, motion in zip(rows, ("a path, then its times", "all at once"), (planned, collocated), strict=True):
    print(f"{name}: {motion.duration:.3f} s, {hdplan.certify(scene, motion).text}")
    tau = dynamics.map(len(motion))(motion.positions.T, motion.velocities.T, motion.accelerations.T)[0]
    row.plot(motion.times, tau.full().T / most)
    row.set(ylabel="torque / limit", title=f"{name}: {motion.duration:.3f} s")
rows[1].set(xlabel="time [s]")
rows[0].legend(motion.joint_names)
figure.savefig("minimum_time.png", dpi=100)
