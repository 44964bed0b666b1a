"""Your own cost and constraint, written in CasADi alone: keep the elbow near a posture, and steps small."""

import matplotlib.pyplot as plt
import numpy as np

import hdplan

scene = hdplan.load_scene("panda_corridor")
base, elbow = (hdplan.load_robot("panda").joint_names.index(f"panda_joint{number}") for number in (1, 4))
most = 0.034  # [rad] that joint 1 may move from one waypoint to the next

posture = hdplan.OwnTerm("posture", lambda q, step: 5 * (q[elbow] + 2.2) ** 2)
steps = hdplan.OwnTerm("steps", lambda q, step: step[base], "constraint", -most, most, scale=0.5)

figure, rows = plt.subplots(2, 1, figsize=(7, 4.5), sharex=True, layout="constrained")
for terms, name in (([], "as it is"), ([posture, steps], "with both terms")):
    result = hdplan.plan(scene, terms=terms)  # a term changes the search, not the proof
    path = result.trajectory.positions
    print(f"{name}: {result.certificate.text}")
    rows[0].plot(path[:, elbow], label=f"{name}: {result.certificate.status.value}")
    rows[1].plot(np.abs(np.diff(path[1:, base])))
rows[0].axhline(-2.2, color="grey", linestyle=":")
rows[1].axhline(most, color="grey", linestyle=":")
rows[0].set(ylabel="panda_joint4 [rad]", title="joint 4 drawn towards −2.2 rad, steps of joint 1 bounded")
rows[1].set(xlabel="waypoint", ylabel="step of panda_joint1 [rad]")
rows[0].legend()
figure.savefig("own_term.png", dpi=100)
