"""The inverse dynamics of a robot with its loads, and its mass matrix, as a CasADi Function of the planned joints."""

from __future__ import annotations

import casadi as ca

from hdplan.planner.kinematics.inverse_dynamics import inverse_dynamics
from hdplan.planner.robot.loads import carrying
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.symbolic.kinematics import joint_values, robot_of
from hdplan.scenes.errors import naming
from hdplan.scenes.scene import Scene


def dynamics(robot: Robot | Scene) -> ca.Function:
    """Return ``(q, v, a) (n,) each -> tau (n,), mass_matrix (n, n)`` as a CasADi Function.

        τ = M(q) a + C(q, v) v + g(q)

    with the planned joints' values q [rad or m], velocities v and accelerations a in the order of ``joint_names``, and
    τ [Nm or N], the joints' required torques: with v = 0 and a = 0 those of gravity, along −z of the world.
    There is no friction. Rotors count with the inertias of the model. The mass of a held object is spread evenly over
    its shape. Where joints follow others, by E, these are the generalized forces Eᵀτ and EᵀME of the planned ones: no
    URDF describes how a joint and its followers share them. In an MX graph only the output that is used is computed.

    Args:
        robot: a robot, with the masses of its held objects; or a scene, which stands for its robot with its payload
            too.

    Raises:
        InputError: for a robot that has inertias that no body has, or joints that move no mass, and every other reason
            to refuse the scene's robot.
    """
    if isinstance(robot, Scene):
        setup = Setup.of(robot)
        with naming(robot.source):
            found, model = setup.robot, carrying(setup.robot, setup.scene.payload, setup.scene.attached, "dynamics")
    else:
        found = robot_of(robot)
        model = carrying(found, None, found.attached, "dynamics")
    q, v, a = (ca.SX.sym(name, found.n) for name in "qva")
    values, spread = (
        joint_values(found, q),
        ca.DM.eye(found.n) if found.linkage is None else ca.DM(found.linkage.matrix),
    )
    spread = ca.sparsify(spread)
    tau = spread.T @ inverse_dynamics(model, values, spread @ v, spread @ a)
    pushed = spread.T @ inverse_dynamics(model, values, ca.SX(model.nv, 1), spread @ a)
    names, rows = ["q", "v", "a"], [ca.MX.sym(name, found.n) for name in "qva"]
    torques = ca.Function("inverse_dynamics", [q, v, a], [ca.densify(tau)], names, ["tau"])
    mass = ca.Function("mass_matrix", [q], [ca.densify(ca.jacobian(pushed, a))], ["q"], ["mass_matrix"])
    outputs = [torques(*rows), mass(rows[0])]
    return ca.Function("dynamics", rows, outputs, names, ["tau", "mass_matrix"], {"always_inline": True})
