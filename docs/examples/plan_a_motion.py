"""Plan a motion, look at its proof, save it and draw it."""

import matplotlib.pyplot as plt
import numpy as np

import hdplan

scene = hdplan.load_scene("panda_cage")  # a path, or a shipped scene's name
result = hdplan.plan(scene, seed=0, time_limit=10.0)
certificate = result.certificate

print(certificate.text)
if not result.certified:  # the best attempt is returned all the same, with its failures
    raise SystemExit(certificate.status.remedy)
print(f"closest: {certificate.worst.link} to {certificate.worst.other}, {1000 * certificate.worst.distance:.1f} mm")

result.save("plan_a_motion.json")  # with its verdict; .csv and .npz hold the numbers alone
again = hdplan.Trajectory.load("plan_a_motion.json")
assert hdplan.certify(scene, again).certified

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
axes.plot(np.linspace(0, 1, len(again)), again.positions, label=again.joint_names)
axes.set(xlabel="path", ylabel="joint position [rad]", title=f"{scene.name}: {certificate.status.value}")
figure.legend(loc="outside right upper", fontsize="small")
figure.savefig("plan_a_motion.png", dpi=100)
