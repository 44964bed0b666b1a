"""The distance and its gradients in your own program: in a CasADi graph, and in JAX. Prints how they compare with the
exact distance, and draws them over the angle of a rod that turns above a cube: distance_in_your_program.png."""

import casadi as ca
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

from hdplan.distance import ConvexBody, hdsdf, hdsdf_batch, hdsdf_function, signed_distance

rod, cube = ConvexBody.capsule(0.05, 0.8), ConvexBody.box([0.4, 0.4, 0.4])
settings = {"gamma": 2, "shaping_length": 1e-3, "normals": "paper"}


def rod_pose(turn, rows, cos, sin):
    """The rod at (0.35, 0, 0.3), turned about y, as a matrix of whichever library."""
    c, s = cos(turn), sin(turn)
    return rows([[c, 0, s, 0.35], [0, 1, 0, 0.0], [-s, 0, c, 0.3], [0, 0, 0, 1]])


# CasADi: a Function for any graph, with exact derivatives to the second order.
turn = ca.MX.sym("turn")
pose = rod_pose(turn, lambda rows: ca.vertcat(*(ca.horzcat(*row) for row in rows)), ca.cos, ca.sin)
distance = hdsdf_function(rod, cube, **settings)(pose, np.eye(4))
casadi_gradient = ca.Function("gradient", [turn], [distance, ca.jacobian(distance, turn)])

# JAX: the same for whole batches, inside grad, jit and vmap.
batch = hdsdf_batch(rod, cube, **settings)


def of_turn(turn):
    """D as a function of the turn alone."""
    return batch.value(rod_pose(turn, jnp.array, jnp.cos, jnp.sin), jnp.eye(4))[0]


turns = np.linspace(-np.pi, np.pi, 181)
with jax.enable_x64(True):
    values, slopes = jax.jit(jax.vmap(jax.value_and_grad(of_turn)))(jnp.asarray(turns))
poses = np.stack([rod_pose(t, np.array, np.cos, np.sin) for t in turns])
np.testing.assert_allclose(values, hdsdf(rod, poses, cube, np.eye(4), **settings), rtol=1e-9, atol=1e-12)
np.testing.assert_allclose(slopes[::30], [float(casadi_gradient(t)[1]) for t in turns[::30]], rtol=1e-7, atol=1e-9)

exact = [signed_distance(rod, p, cube, np.eye(4)).distance for p in poses]
figure, (above, below) = plt.subplots(2, figsize=(7, 5), sharex=True, layout="constrained")
above.plot(turns, exact, label="exact")
above.plot(turns, values, label="HD-SDF")
above.set(ylabel="distance [m]", title="a rod turns above a cube")
above.legend()
below.plot(turns, np.gradient(np.array(exact), turns), turns, slopes)
below.set(xlabel="turn [rad]", ylabel="derivative [m/rad]")
figure.savefig("distance_in_your_program.png", dpi=100)

apart = np.array(exact) > 0.0
short = 1e3 * (np.array(exact) - np.asarray(values))[apart]
print(f"distance and slope of a rod that turns above a cube, at {len(turns)} angles: CasADi and JAX agree")
print(f"where the bodies are apart, the HD-SDF is {short.min():.2f} to {short.max():.2f} mm below the exact distance")
