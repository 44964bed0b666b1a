"""Hard constraints in place of penalties: an arm comes to rest on two obstacles, whose multipliers are the forces."""

import dataclasses

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import hdplan
from hdplan import symbolic
from hdplan.distance import ConvexBody

wall = hdplan.Pose((0.0, 0.0, 0.0), (2**-0.5, 0.0, 0.0, 2**-0.5))  # on which gravity pulls the arm down
robot = hdplan.load_robot(dataclasses.replace(hdplan.load_scene("planar_arm").robot, base=wall))
arms = {  # link -> its box, in its frame; its mass [kg]
    "upper_arm": (ConvexBody.from_points(ConvexBody.box([0.56, 0.06, 0.04]).vertices + [0.25, 0, 0]), 2.0),
    "forearm": (ConvexBody.from_points(ConvexBody.box([0.5, 0.05, 0.04]).vertices + [0.25, 0, 0]), 1.2),
}
things = (ConvexBody.sphere(0.1), ConvexBody.box([0.3, 0.2, 0.1]))
q, places, least = ca.MX.sym("q", 2), ca.MX.sym("places", 3, 2), 0.001  # [m] where D has a slope: it has none at 0
energy, distances = 0, []  # V(q) [J], and D of the upper arm from the ball and of the forearm from the shelf [m]
for k, (link, (body, mass)) in enumerate(arms.items()):
    pose = symbolic.kinematics(robot, link)(q)
    energy += 9.81 * mass * (pose @ ca.DM([0.25, 0, 0, 1]))[2]  # by its centre
    there = ca.vertcat(ca.horzcat(ca.MX.eye(3), places[:, k]), ca.DM([[0, 0, 0, 1]]))
    distances.append(symbolic.distance(body, things[k], normals="paper+edges")(pose, there))
distance, given = ca.vertcat(*distances), ca.DM([[0.32, -0.1, -0.3], [0.8, -0.1, -0.5]]).T


def at_rest(cost, guess, **bounds):
    """The arm's configuration at rest [rad], the multipliers and D there."""
    options = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-10}}
    solver = ca.nlpsol("rest", "ipopt", {"x": q, "p": places, "f": cost, "g": distance}, options)
    found = solver(x0=guess, p=given, lbx=-2.6, ubx=2.6, **bounds)
    return found["x"], -found["lam_g"].full()[:, 0], found["g"].full()[:, 0]


rest, force, _ = at_rest(energy, [0.3, 0], lbg=least)  # the arm is let down
slopes = ca.Function("slopes", [q, places], [ca.jacobian(distance, q), ca.jacobian(distance, ca.vec(places))])
by_joint, by_place = (part.full() for part in slopes(rest, given))
borne = symbolic.dynamics(robot)(rest, 0, 0)[0].full()[:, 0]  # the joints' gravity torques [Nm]
np.testing.assert_allclose(by_joint.T @ force, borne, atol=1e-6)
print(f"at rest at {rest} rad; the contacts bear the joints' {borne.round(3)} Nm")
for weight in 10.0 ** np.arange(4, 8):  # a penalty gives way like a spring
    *_, soft = at_rest(energy + weight / 2 * ca.sumsqr(ca.fmin(distance - least, 0)), rest)
    print(f"with a penalty of weight {weight:g} instead: {(1e3 * (least - soft)).round(4)} mm too deep")
figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
joints = symbolic.kinematics(robot, "forearm")(rest) @ ca.DM([[0, 0.5], [0, 0], [0, 0], [1, 1]])
axes.plot(*ca.horzcat(ca.DM(4, 1), joints).full()[[0, 2]], "o-", linewidth=8, alpha=0.5)
for patch in (plt.Circle((0.32, -0.3), 0.1, color="silver"), plt.Rectangle((0.65, -0.55), 0.3, 0.1, color="silver")):
    axes.add_patch(patch)
for k, link in enumerate(arms):
    push = -force[k] * by_place[k, 3 * k : 3 * k + 3][[0, 2]]  # a force is work by an obstacle's way [N]
    lever = force[k] * by_joint[k, 0] / (push @ push) * push[::-1] * [1, -1]  # from the shoulder to its line
    foot = lever + (given.full()[[0, 2], k] - lever) @ push / (push @ push) * push
    axes.annotate("", end := foot + 0.012 * push, foot, arrowprops={"arrowstyle": "->", "color": "tab:red"})
    axes.text(*end, f" {np.hypot(*push):.1f} N on {link}")
axes.set(xlim=(-0.1, 1.3), ylim=(-0.6, 0.1), aspect="equal", xlabel="x [m]", ylabel="z [m]")
figure.savefig("contact_forces.png", dpi=100)
