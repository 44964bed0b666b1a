"""256 guesses of one problem at once, in JAX: Gauss-Newton improves all of them, and the best one is certified."""

import dataclasses
import time

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import hdplan
from hdplan import symbolic

scene = dataclasses.replace(hdplan.load_scene("planar_arm"), planner=hdplan.PlannerSettings(waypoints=12))
problem = hdplan.build(scene)
cost, robot = symbolic.jax_cost(problem), problem.robot
count = 256
drawn = robot.draw(np.random.default_rng(0), count)
guesses = np.array([problem.polyline(via[None]) for via in drawn])  # (256, N, n), each by way of another configuration


def better(motion, weight):
    """One step of Gauss-Newton, of the waypoints between the ends; and the cost before it."""
    value, slope = jax.value_and_grad(cost)(motion, weight)
    slope = slope[1:-1]
    way = jnp.linalg.solve(cost.curvature(motion, weight), slope.ravel()).reshape(slope.shape)
    way *= jnp.minimum(1.0, 0.5 / jnp.abs(way).max())  # [rad]
    return motion.at[1:-1].add(-way).clip(robot.lower, robot.upper), value


with jax.enable_x64(True):
    step = jax.jit(jax.vmap(better, in_axes=(0, None)))
    motions, costs, took = jnp.array(guesses), [], []
    for weight in (1e2, 1e3, 1e4, 1e4, 1e5, 1e5, 1e5, 1e5):  # of the penalty
        began = time.perf_counter()
        (motions, values), before = step(motions, weight), motions
        costs.append(np.array(values))  # of the motions before the step
        took.append(time.perf_counter() - began)
print(f"one step for {count} guesses: {np.median(took):.2f} s; compiled in {took[0] - took[1]:.1f} s")

for row, best in enumerate(np.argsort(costs[-1])):
    motion = hdplan.Trajectory(robot.joint_names, np.array(before[best]), robot.locked)
    certificate = hdplan.certify(scene, motion)
    if certificate.certified:
        print(f"the best but {row} is certified, cost {costs[-1][best]:.2f}: {certificate.text}")
        break
figure, axes = plt.subplots(figsize=(7, 3.5), layout="constrained")
axes.semilogy(np.array(costs), color="tab:grey", linewidth=0.5, alpha=0.5)
axes.semilogy(np.array(costs)[:, best], color="tab:red", label="the best that is certified")
axes.set(xlabel="step", ylabel="cost at each step's weight", title=f"{count} guesses, improved together")
axes.legend()
figure.savefig("many_guesses.png", dpi=100)
