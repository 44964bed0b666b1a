"""Model predictive control with hard clearances, 20 stages ahead: an arm gives way to a ball that passes."""

import shutil
import subprocess
import time

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import hdplan
from hdplan import symbolic

scene = hdplan.load_scene("planar_arm")
keep, dynamics = symbolic.clearance(scene, movable=["ball"]), symbolic.dynamics(scene)
n, stages, period = 2, 20, 0.05  # [s]
most, least, goal = 6.0, 0.005, np.array([0.3, 0.6])  # of every torque [Nm], of every D [m]; where to be [rad]

# At one stage: what is bounded, distances and torques, with derivatives.
q, v, a, place = (ca.MX.sym(name, size) for name, size in (("q", n), ("v", n), ("a", n), ("place", 3)))
distance = keep.function(q, ca.vertcat(ca.horzcat(ca.MX.eye(3), place), ca.DM([[0, 0, 0, 1]])))
bounded = ca.vertcat(distance, dynamics(q=q, v=v, a=a)["tau"])
stage = ca.Function("stage", [q, v, a, place], [bounded, *(ca.jacobian(bounded, x) for x in (q, v, a))])
# At all stages: with accelerations u that are constant within each, positions and velocities at their ends are linear.
now, u, places = ca.MX.sym("now", n, 2), ca.MX.sym("u", n * stages), ca.MX.sym("places", 3, stages)
late, every = np.tril(np.arange(stages)[:, None] - np.arange(stages) + 0.5), np.tril(np.ones((stages, stages)))
by_u = [ca.DM(np.kron(matrix, np.eye(n))) for matrix in (period**2 * late, period * every, np.eye(stages))]
free = [now[:, [0] * stages] + now[:, 1] @ (period * np.arange(1, stages + 1)[None]), now[:, [1] * stages], 0]
at = (ca.reshape(B @ u, n, stages) + x for B, x in zip(by_u, free, strict=True))
values, *slopes = stage.map(stages)(*at, places)
slope = sum(ca.diagcat(*ca.horzsplit(part, n)) @ by for part, by in zip(slopes, by_u, strict=True))
pull = by_u[0].T @ ca.vec(free[0] - goal) + 0.05 * by_u[1].T @ ca.vec(free[1])
linear = ca.Function("linear", [now, u, places], [pull, slope, ca.vec(values) - slope @ u])
if compiler := shutil.which("cc"):
    linear.generate("linear.c")
    subprocess.run([compiler, "-O2", "-shared", "-fPIC", "linear.c", "-o", "./linear.so", "-lm"], check=True)
    linear = ca.external("linear", "./linear.so")
weight = by_u[0].T @ by_u[0] + 0.05 * by_u[1].T @ by_u[1] + 1e-4 * by_u[2]
low, high = (np.tile(np.repeat(ends, (len(keep.pairs), n)), stages) for ends in ((least, -most), (np.inf, most)))
quadratic = ca.conic("quadratic", "daqp", {"h": weight.sparsity(), "a": slope.sparsity()})
state, plan, log = np.c_[goal, [0, 0]], ca.DM(n * stages, 1), []
for k in range(70):  # one step of sequential quadratic programming each, from the last plan
    ball = np.array([[0.86, 0.9 - 0.4 * period * (k + j), 0.1] for j in range(1, stages + 1)]).T
    began = time.perf_counter()
    g, rows, rest = linear(state, ca.vertcat(plan[n:], plan[-n:]), ball)
    plan = quadratic(h=weight, g=g, a=rows, lba=low - rest, uba=high - rest)["x"]
    took, push = time.perf_counter() - began, plan[:n].full()[:, 0]
    state = state @ [[1, 0], [period, 1]] + np.c_[period**2 / 2 * push, period * push]
    pose = np.vstack([np.c_[np.eye(3), ball[:, 0]], [0, 0, 0, 1]])
    log.append([1e3 * took, 1e3 * keep.function(state[:, 0], pose).full().min(), *state[:, 0]])
times, nearest, *joints = np.array(log).T
print(f"a plan takes {np.median(times):.2f} ms, at most {times.max():.2f}; the least D is {nearest.min():.2f} mm")
figure, axes = plt.subplots(2, 1, figsize=(7, 4.5), sharex=True, layout="constrained")
axes[0].plot(period * np.arange(len(log)), np.array(joints).T, label="joints [rad]")
axes[1].plot(period * np.arange(len(log)), nearest, label="least D [mm]")
for row in axes:
    row.legend()
figure.savefig("predictive_control.png", dpi=100)
