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
`hdplan.distance.hdsdf_function`. Each is loaded, with CasADi or JAX, when it is asked for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hdplan.scenes.lazy_imports import lazy_imports

if TYPE_CHECKING:
    from hdplan.distance.symbolic.graph_distance import hdsdf_function as distance
    from hdplan.planner.symbolic.clearance import SceneClearance, clearance
    from hdplan.planner.symbolic.dynamics import dynamics
    from hdplan.planner.symbolic.kinematics import kinematics
    from hdplan.planner.traced.cost import JaxCost, jax_cost

__all__ = ["JaxCost", "SceneClearance", "clearance", "distance", "dynamics", "jax_cost", "kinematics"]

_find = lazy_imports(
    "hdplan",
    {
        "JaxCost": "planner.traced.cost",
        "SceneClearance": "planner.symbolic.clearance",
        "clearance": "planner.symbolic.clearance",
        "dynamics": "planner.symbolic.dynamics",
        "hdsdf_function": "distance.symbolic.graph_distance",
        "jax_cost": "planner.traced.cost",
        "kinematics": "planner.symbolic.kinematics",
    },
)


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return _find("hdsdf_function" if name == "distance" else name)


def __dir__() -> list[str]:
    """Public names."""
    return sorted(__all__)
