"""Plan a MoveIt request: its planning scene, its request and the robot, as files."""

from pathlib import Path

import matplotlib.pyplot as plt

import hdplan

here = Path(__file__).parent
scene = hdplan.load_scene(here / "moveit_scene.yaml", request=here / "moveit_request.yaml", robot="panda")
for note in scene.notes:  # parts of the message that were widened, left out or narrowed
    print("note:", note)

result = hdplan.plan(scene)
print(result.certificate.text)
assert result.certified  # the end too: the hand's pose within the request's tolerances, by the certificate's kinematics
result.save("moveit_request.csv")

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
axes.plot(result.trajectory.positions, label=result.trajectory.joint_names)
axes.set(xlabel="waypoint", ylabel="joint position [rad]", title="a MoveIt request, planned")
figure.legend(loc="outside right upper", fontsize="small")
figure.savefig("moveit_request.png", dpi=100)
