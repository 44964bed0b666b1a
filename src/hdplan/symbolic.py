"""Robots and scenes as CasADi Functions, for optimal control of one's own; and whole problems in JAX.

    from hdplan import symbolic
    scene = hdplan.load_scene("panda_cage")
    pose = symbolic.kinematics(scene)                 # q -> pose of the end effector
    tau = symbolic.dynamics(scene)                    # q, v, a -> tau, mass_matrix
    keep = symbolic.clearance(scene)                  # keep.function: q, poses -> distance of every pair of bodies
    distance = symbolic.distance(body_a, body_b)      # pose_a, pose_b -> distance of two bodies

    cost = symbolic.jax_cost(hdplan.build(scene))     # waypoints (..., N, n) and a weight -> cost, in JAX
    cost = symbolic.jax_cost(problems)                # of R problems at once: (..., R, N, n) -> (..., R)

CasADi's are graphs without callbacks: they can be differentiated twice, mapped, saved, and written to C. `distance` is
`hdplan.distance.hdsdf_function`. Each is loaded, with CasADi or JAX, on first use.
"""

from __future__ import annotations

from hdplan.scenes.lazy_imports import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
