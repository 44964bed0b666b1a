"""Write a motion as a program for a UR controller: a line of URScript for every step of its 500 Hz loop."""

from pathlib import Path

import numpy as np

import hdplan

STEP = 0.002  # [s] of an e-Series controller; 0.008 of a CB3

scene = hdplan.load_scene("ur5_pallet")
result = hdplan.plan(scene)
assert result.certified, result.certificate.text
stream = result.trajectory.sampled(1.0 / STEP)

arm = ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint"]
rows = stream.positions[:, [stream.joint_names.index(joint) for joint in arm]]  # in the controller's order
lines = [f"  servoj([{', '.join(f'{value:.6f}' for value in row)}], t={STEP}, lookahead_time=0.03)" for row in rows]
start = ", ".join(f"{value:.6f}" for value in rows[0])
script = ["def hdplan_motion():", f"  movej([{start}])", *lines, "  stopj(2)", "end", "hdplan_motion()"]
Path("ur5_pallet.script").write_text("\n".join(script) + "\n")

fastest = np.abs(np.diff(rows, axis=0)).max() / STEP
print(f"{len(lines)} lines, {result.trajectory.duration:.3f} s, at most {fastest:.2f} rad/s between two of them")
