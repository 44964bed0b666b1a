"""256 guesses of one problem at once, in JAX: Gauss-Newton betters all together, and the best one is certified."""

import dataclasses
import time

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import hdplan
from hdplan import symbolic

scene = dataclasses.replace(hdplan.load_scene("planar_arm"), planner=hdplan.PlannerSettings(waypoints=16))
problem = hdplan.build(scene)
cost, robot, count = symbolic.jax_cost(problem), problem.robot, 256
drawn = robot.draw(np.random.default_rng(0), count)
guesses = np.array([problem.polyline(via[None]) for via in drawn])  # (256, N, n), each by way of another configuration


def better(motion, weight):
    """One step of Gauss-Newton, of the waypoints between the ends."""
    slope = jax.grad(cost)(motion, weight)[1:-1]
    way = jnp.linalg.solve(cost.curvature(motion, weight), slope.ravel()).reshape(slope.shape)
    way *= jnp.minimum(1.0, 0.5 / jnp.abs(way).max())  # [rad]
    return motion.at[1:-1].add(-way).clip(robot.lower, robot.upper)


with jax.enable_x64(True):
    step, value = (jax.jit(jax.vmap(each, in_axes=(0, None))) for each in (better, cost))
    motions, costs, took = jnp.array(guesses), [], []
    for weight in (1e2, 1e3, 1e4, 1e4, 1e5, 1e5, 1e5, 1e5):  # of the penalty
        began = time.perf_counter()
        motions = step(motions, weight).block_until_ready()
        took.append(time.perf_counter() - began)
        costs.append(np.array(value(motions, 1e5)))
print(f"one step for {count} guesses: {np.median(took):.2f} s; compiled in {took[0] - took[1]:.1f} s")

for row, best in enumerate(np.argsort(costs[-1])):
    motion = hdplan.Trajectory(robot.joint_names, np.array(motions[best]), robot.locked)
    certificate = hdplan.certify(scene, motion)
    if certificate.certified:
        print(f"the best but {row} is certified, cost {costs[-1][best]:.2f}: {certificate.text}")
        break
figure, axes = plt.subplots(figsize=(7, 3.5), layout="constrained")
axes.semilogy(np.array(costs), color="tab:grey", linewidth=0.5, alpha=0.5)
axes.semilogy(np.array(costs)[:, best], color="tab:red", label="the best that is certified")
axes.set(xlabel="step", ylabel="cost", title=f"{count} guesses, improved together")
axes.legend()
figure.savefig("many_guesses.png", dpi=100)
