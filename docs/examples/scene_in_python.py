"""A scene made in Python: checked as a file is, planned, changed, and saved as a file."""

import matplotlib.pyplot as plt

import hdplan

scene = hdplan.Scene(
    robot="panda",
    obstacles=[
        hdplan.Box([1.2, 1.6, 0.05], name="table", pose=[0.5, 0.0, 0.05]),
        hdplan.Cylinder(radius=0.04, length=0.4, name="bottle", pose=[0.5, 0.0, 0.28]),
    ],
    start=[-0.6, 0.3, 0.0, -2.0, 0.0, 2.3, 0.785],
    goal=[0.6, 0.3, 0.0, -2.0, 0.0, 2.3, 0.785],
)
result = hdplan.plan(scene)
print(result.certificate.text)

try:  # errors in Python are the same as in files
    hdplan.Box([1.2, -1.6, 0.05])
except hdplan.InputError as error:
    print("refused:", error)

back = scene.with_start(scene.goal).with_goal(scene.start)
scene.save("table.yaml")
assert hdplan.load_scene("table.yaml") == scene

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
for each, style in ((scene, "-"), (back, ":")):
    found = hdplan.plan(each)
    axes.plot(found.trajectory.positions, style)
    axes.set_prop_cycle(None)
    print(found.certificate.status.value)
axes.set(xlabel="waypoint", ylabel="joint position [rad]", title="there (lines) and back (dots)")
figure.legend(axes.lines[:7], found.trajectory.joint_names, loc="outside right upper", fontsize="small")
figure.savefig("scene_in_python.png", dpi=100)
