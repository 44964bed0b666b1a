"""The CasADi program with your own cost and constraint, solved by Ipopt and by fatrop, and proven."""

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import hdplan

scene = hdplan.load_scene("panda_corridor")
problem = hdplan.build(scene)
plain = problem.casadi()  # min f(x, p) subject to lbx ≤ x ≤ ubx, lbg ≤ g(x) ≤ ubg; p weighs the penalty of contacts
base, elbow = (problem.robot.joint_names.index(f"panda_joint{number}") for number in (1, 4))

most = 0.038  # [rad] that joint 1 may move from one waypoint to the next
own = plain.with_cost(0.5 * ca.sumsqr(plain.waypoints[elbow, :] + 2.2))  # waypoints (n, N) are expressions of x
own = own.with_constraint(lambda q, step: step[base], -most, most)  # at every waypoint that is to be found


def solve(program, plugin):
    """One solver for all weights: low ones move the motion as a whole, high ones push it out of the obstacles."""
    options = {"print_level": 0, "max_iter": 30, "mu_init": 1e-4}  # each begins near the last one's solution
    stages = program.stages if plugin == "fatrop" else {}  # fatrop wants to know which rows are equations
    solver = ca.nlpsol("solver", plugin, program.nlp, {plugin: options, "print_time": False, **stages})
    x = program.guess(problem.polyline())
    for weight in 6e3 * 6.0 ** np.arange(5):
        x = solver(x0=x, p=weight, **program.bounds)["x"]
    return hdplan.Trajectory(problem.robot.joint_names, program.positions(x), problem.robot.locked)


figure, rows = plt.subplots(2, 1, figsize=(7, 4.5), sharex=True, layout="constrained")
for program, plugin, style in ((plain, "ipopt", "-"), (own, "ipopt", "-"), (own, "fatrop", "--")):
    trajectory = solve(program, plugin)
    certificate = hdplan.certify(scene, trajectory)  # the proof does not depend on additions to the program
    name = f"{'as it is' if program is plain else 'with cost and bound'}, {plugin}: {certificate.status.value}"
    print(name, f"largest step of joint 1: {np.abs(np.diff(trajectory.positions[1:, base])).max():.4f} rad")
    rows[0].plot(trajectory.positions[:, elbow], style, label=name)
    rows[1].plot(np.abs(np.diff(trajectory.positions[:, base])), style)
rows[0].axhline(-2.2, color="grey", linestyle=":")
rows[1].axhline(most, color="grey", linestyle=":")
rows[0].set(ylabel="panda_joint4 [rad]", title="joint 4 drawn towards −2.2 rad, steps of joint 1 bounded")
rows[1].set(xlabel="waypoint", ylabel="step of panda_joint1 [rad]")
rows[0].legend()
figure.savefig("casadi_program.png", dpi=100)
