"""Sections of effects: their meaning, what they refuse and how, and that they read back the same."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hdplan.scenes.attached import Payload
from hdplan.scenes.errors import InputError
from hdplan.scenes.limits import QUANTITIES, JointValues, Limits
from hdplan.scenes.obstacles import SelfCollision, SteadyMotion, TimedPoses
from hdplan.scenes.path_constraints import PathConstraints, Relative, Upright, Within
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.timing import Timing
from hdplan.scenes.yaml_format.reader import load_scene
from hdplan.scenes.yaml_format.schema import scene_schema
from hdplan.scenes.yaml_format.writer import scene_text
from hdplan.scenes.yaml_text import flow_style

HEAD = "hdplan: 1\nrobot: {name: panda}\nstart: {state: default}\ngoal: {joints: [1, 2]}\n"
BALL = "shape: {type: sphere, radius: 1}"
TIMED = "timing: {duration: 3}\n"
SCALED = "timing: {scale: 0.5}\nlimits: {acceleration: 1}\n"


def read(folder: Path, text: str) -> Scene:
    file = folder / "scene.yaml"
    file.write_text(HEAD + text, encoding="utf-8")
    return load_scene(file)


# --- what sections mean -----------------------------------------------------------------------------------------------

SAMPLE = """
obstacles:
  - {name: still, shape: {type: sphere, radius: 0.1}, pose: {position: [1, 0, 0]}, clearance: 0.05}
  - {name: cart, shape: {type: box, size: [1, 1, 1]}, pose: {position: [2, 0, 0]}, motion: {velocity: [0, 0.5, 0], spin: [0, 0, 1]}}
  - name: door
    shape: {type: box, size: [1, 0.1, 2]}
    motion: {times: [0.5, 1, 2], poses: [{position: [3, 0, 0]}, {position: [3, 1, 0]}, {rpy: [0, 0, 3.141592653589793]}]}
attached: [{name: cup, link: hand, shape: {type: sphere, radius: 0.1}, mass: 0.5}]
self_collision: {clearance: 0.01}
limits: {position: {j1: [-1, 1]}, velocity: urdf, acceleration: 1.5, jerk: [10, 20], torque: {j1: 9, j2: 8}}
payload: {link: hand, mass: 2, com: [0, 0, 0.1], inertia: [0.01, 0, 0, 0.02, 0, 0.03]}
path: {upright: {link: hand, axis: -z, tolerance: 0.2}, position: {link: hand, size: [.inf, 1, 0.5], position: [0, 0, 1], point: [0, 0, 0.1]}}
timing: {duration: 3, rate: 250}
"""  # noqa: E501


@pytest.mark.core
def test_every_section_says_what_its_author_meant(tmp_path: Path) -> None:
    scene = read(tmp_path, SAMPLE)
    still, cart, door = scene.obstacles
    assert (still.clearance, still.motion) == (0.05, None)
    assert cart.motion == SteadyMotion((0.0, 0.5, 0.0), (0.0, 0.0, 1.0))
    assert isinstance(door.motion, TimedPoses)
    assert door.motion.times == (0.5, 1.0, 2.0)
    assert [pose.position for pose in door.motion.poses] == [(3.0, 0.0, 0.0), (3.0, 1.0, 0.0), (0.0, 0.0, 0.0)]
    assert door.pose == door.motion.poses[0]
    np.testing.assert_allclose(door.motion.poses[2].matrix[:2, :2], -np.eye(2), atol=1e-15)
    assert scene.attached[0].mass == 0.5
    assert scene.self_collision == SelfCollision(clearance=0.01)
    assert scene.limits == Limits({"j1": (-1.0, 1.0)}, "urdf", 1.5, (10.0, 20.0), {"j1": 9.0, "j2": 8.0})
    assert scene.payload == Payload("hand", 2.0, (0.0, 0.0, 0.1), (0.01, 0.0, 0.0, 0.02, 0.0, 0.03))
    assert scene.path == PathConstraints(
        Upright("hand", (0.0, 0.0, -1.0), 0.2),
        Within("hand", (math.inf, 1.0, 0.5), Pose((0.0, 0.0, 1.0)), (0.0, 0.0, 0.1)),
    )
    assert scene.timing == Timing(duration=3.0, rate=250.0)


@pytest.mark.parametrize("rate", QUANTITIES)
@pytest.mark.parametrize("value", [1.5, (1.0, 2.0), {"j1": 3.0}])
def test_every_rate_is_written_read_and_known_to_editors(tmp_path: Path, rate: str, value: JointValues) -> None:
    """A new limit of rate is an entry of QUANTITIES and a field of Limits, and nothing else in files."""
    limits = Limits(**{rate: value})
    assert limits != Limits()
    scene = replace(read(tmp_path, TIMED), limits=limits)
    assert scene.timed
    again = tmp_path / "again.yaml"
    again.write_text(scene_text(scene), encoding="utf-8")
    assert load_scene(again).limits == limits
    assert rate in scene_schema()["properties"]["limits"]["properties"]


def test_a_section_that_is_left_out_keeps_its_default(tmp_path: Path) -> None:
    plain = read(tmp_path, "")
    assert not plain.timed
    assert (plain.self_collision, plain.limits, plain.path) == (SelfCollision(), Limits(), PathConstraints())
    assert (plain.payload, plain.timing) == (None, None)
    assert read(tmp_path, "self_collision: true\nlimits:\n") == plain
    assert read(tmp_path, "self_collision: false\n").self_collision == SelfCollision(checked=False)
    assert read(tmp_path, "path: {upright: {link: hand}}\n").path.upright == Upright("hand")
    held = read(tmp_path, "path: {relative: {link: hand, to: other, pose: {position: [0, 0, 1]}}}\n").path.relative
    assert held == Relative("hand", "other", Pose((0.0, 0.0, 1.0)))
    assert read(tmp_path, "path: {relative: {link: hand, to: other}}\n").path.relative == Relative("hand", "other")
    assert not read(tmp_path, "limits: {position: {j1: [0, 1]}}\n").timed
    scene = read(tmp_path, "limits: {acceleration: 2}\ntiming: {scale: 0.5}\n")
    assert scene.timing == Timing(scale=0.5)
    scene = read(tmp_path, f"attached: [{{link: hand, {BALL}}}]\nlimits: {{torque: urdf}}\n{TIMED}")
    assert scene.attached[0].mass is None


def test_an_axis_is_of_length_one(tmp_path: Path) -> None:
    for written in ([3, 4, 0], [0.001, 0, -0.001], [0, 200000, 0]):
        upright = read(tmp_path, f"path: {{upright: {{link: hand, axis: {written}}}}}\n").path.upright
        assert upright is not None
        np.testing.assert_allclose(upright.axis, np.array(written) / math.hypot(*written), rtol=1e-15)


# --- what they refuse -------------------------------------------------------------------------------------------------


def moving(text: str, rest: str = TIMED, placed: str = "") -> str:
    return f"obstacles: [{{{BALL}{placed}, motion: {{{text}}}}}]\n{rest}"


def limits(text: str) -> str:
    return f"limits: {{{text}}}\n{TIMED}"


def payload(text: str) -> str:
    return f"payload: {{link: hand, {text}}}\nlimits: {{torque: urdf}}\n{TIMED}"


def inertia(*moments: float) -> str:
    return payload(f"mass: 1, inertia: {list(moments)}")


def relative(text: str) -> str:
    return f"path: {{relative: {{link: a, {text}}}}}\n"


CASES = {
    # obstacles
    "clearance too large": (f"obstacles: [{{{BALL}, clearance: 2}}]\n", "obstacles[0].clearance: ", "0 to 1 [m]"),
    "clearance negative": (f"obstacles: [{{{BALL}, clearance: -1}}]\n", "obstacles[0].clearance: ", "found -1"),
    "clearance misspelt": (f"obstacles: [{{{BALL}, clearence: 1}}]\n", "'clearence'", "did you mean 'clearance'"),
    "motion empty": (moving(""), "obstacles[0].motion: is empty", "velocity, spin, times, poses"),
    "motion misspelt": (moving("velocty: [0, 0, 0]"), "motion: unknown key 'velocty'", "'velocity'"),
    "motion of two kinds": (moving("velocity: [0, 0, 0], times: [0, 1]"), "motion: must have either velocity", "times"),
    "times without poses": (moving("times: [0, 1]"), "motion: must have either", "found times"),
    "velocity of two": (moving("velocity: [0, 0]"), "motion.velocity: ", "list of 3", "list of 2"),
    "spin a text": (moving("spin: [0, 0, fast]"), "motion.spin[2]: ", "number [rad/s]", "'fast'"),
    "one time": (moving("times: [0], poses: [{}]"), "motion.times: ", "two or more", "found 1"),
    "times that fall": (moving("times: [0, 2, 1], poses: [{}, {}, {}]"), "motion.times: ", "increase", "2 before 1"),
    "times that stand": (moving("times: [1, 1], poses: [{}, {}]"), "motion.times: ", "1 before 1"),
    "time before 0": (moving("times: [-1, 1], poses: [{}, {}]"), "motion.times[0]: ", "at least 0", "found -1"),
    "a pose too few": (moving("times: [0, 1, 2], poses: [{}, {}]"), "motion.poses: ", "as many as the 3", "found 2"),
    "placed twice": (moving("times: [0, 1], poses: [{}, {}]", placed=", pose: {}"), "[0].pose: ", "leave it out"),
    "motion without a duration": (moving("velocity: [0, 0, 1]", ""), "[0].motion: ", "timing.duration is missing"),
    "motion with a scale": (moving("velocity: [0, 0, 1]", SCALED), "timing.duration is missing"),
    # held objects, links
    "mass zero": (f"attached: [{{link: a, {BALL}, mass: 0}}]\n", "attached[0].mass: ", "greater than 0 [kg]"),
    "self_collision a text": ("self_collision: maybe\n", "self_collision: must be true, false or a mapping", "'maybe'"),
    "self_collision empty": ("self_collision: {}\n", "self_collision: is empty", "clearance"),
    "self_collision misspelt": ("self_collision: {clear: 1}\n", "self_collision: unknown key 'clear'", "'clearance'"),
    "self_collision too large": ("self_collision: {clearance: 1.5}\n", "self_collision.clearance: ", "0 to 1"),
    # limits
    "limits empty": ("limits: {}\n", "limits: is empty", "position, velocity, acceleration, jerk, torque"),
    "limits misspelt": (limits("velocities: 1"), "limits: unknown key 'velocities'", "did you mean 'velocity'"),
    "no position": ("limits: {position: {}}\n", "limits.position: is empty"),
    "position of one": (limits("position: {j1: [1]}"), "limits.position.j1: ", "list of 2", "list of 1"),
    "position reversed": (limits("position: {j1: [1, -1]}"), "limits.position.j1: ", "low < high", "[1, -1]"),
    "position infinite": (limits("position: {j1: [0, .inf]}"), "limits.position.j1[1]: ", "finite", "inf"),
    "velocity zero": (limits("velocity: 0"), "limits.velocity: ", "greater than 0 [rad/s or m/s]", "found 0"),
    "velocity infinite": (limits("velocity: .inf"), "limits.velocity: ", "finite", "inf"),
    "velocity misspelt": (limits("velocity: urfd"), "limits.velocity: must be urdf, a number", "'urfd'"),
    "velocity as text": (limits("velocity: 1e-3"), "limits.velocity: ", "write 1.0e-3"),
    "velocity true": (limits("velocity: true"), "limits.velocity: must be urdf, a number", "true"),
    "no velocities": (limits("velocity: []"), "limits.velocity: must be urdf, a number", "list of 0"),
    "a velocity negative": (limits("velocity: [1, -1]"), "limits.velocity[1]: ", "greater than 0", "found -1"),
    "a velocity by name": (limits("velocity: {j1: fast}"), "limits.velocity.j1: ", "number", "'fast'"),
    "acceleration of a URDF": (limits("acceleration: urdf"), "limits.acceleration: a URDF holds no acceleration"),
    "jerk of a URDF": (limits("jerk: urdf"), "limits.jerk: a URDF holds no jerk limits", "[rad/s³ or m/s³]"),
    "jerk a mapping of nothing": (limits("jerk: {}"), "limits.jerk: must be a number, a list", "mapping"),
    "torque negative": (limits("torque: {j1: -3}"), "limits.torque.j1: ", "greater than 0 [Nm or N]", "found -3"),
    # payload
    "payload without torque": (f"payload: {{link: a, mass: 1}}\n{TIMED}", "payload: only matters for joint torques"),
    "payload empty": (f"payload: {{}}\n{TIMED}", "payload: the key 'link' is missing"),
    "payload without mass": (payload("com: [0, 0, 0]"), "payload: the key 'mass' is missing"),
    "payload weightless": (payload("mass: 0"), "payload.mass: ", "greater than 0 [kg]", "found 0"),
    "payload misspelt": (payload("mass: 1, inertias: []"), "unknown key 'inertias'", "did you mean 'inertia'"),
    "inertia as a matrix": (payload("mass: 1, inertia: [[1, 0, 0]]"), "payload.inertia: ", "list of 6", "list of 1"),
    "inertia negative": (inertia(1, 0, 0, -0.5, 0, 1), "moments are -0.5, 1 and 1 kg m²", "none may be negative"),
    "inertia indefinite": (inertia(1, 2, 0, 1, 0, 1), "payload.inertia: ", "negative"),
    "inertia of no body": (inertia(1, 0, 0, 1, 0, 2.1), "1, 1 and 2.1", "exceed the sum of the other two"),
    # path
    "path empty": ("path: {}\n", "path: is empty", "upright, position"),
    "path misspelt": ("path: {uprigth: {}}\n", "path: unknown key 'uprigth'", "did you mean 'upright'"),
    "relative without to": ("path: {relative: {link: a}}\n", "path.relative: the key 'to' is missing"),
    "relative to itself": (relative("to: a"), "path.relative.to: must be another link", "'a'"),
    "relative within nothing": (relative("to: b, position_tolerance: 0"), ".position_tolerance: ", "greater than 0"),
    "relative beyond a half turn": (relative("to: b, orientation_tolerance: 3.2"), ".orientation_tolerance: ", "3.14"),
    "relative, half a pose": (relative("to: b, pose: {rpy: [0, 0]}"), "path.relative.pose.rpy: "),
    "upright without link": ("path: {upright: {axis: z}}\n", "path.upright: the key 'link' is missing"),
    "axis unknown": ("path: {upright: {link: a, axis: w}}\n", "path.upright.axis: unknown value 'w'", "-x, -y, -z"),
    "axis of no length": ("path: {upright: {link: a, axis: [0, 0, 0]}}\n", "path.upright.axis: ", "length above 0"),
    "axis a number": ("path: {upright: {link: a, axis: 3}}\n", "path.upright.axis: ", "or three numbers", "found 3"),
    "tolerance zero": ("path: {upright: {link: a, tolerance: 0}}\n", "path.upright.tolerance: ", "greater than 0"),
    "tolerance beyond a half turn": ("path: {upright: {link: a, tolerance: 3.2}}\n", "upright.tolerance: ", "3.14159"),
    "no size": ("path: {position: {link: a}}\n", "path.position: the key 'size' is missing"),
    "size of two": ("path: {position: {link: a, size: [1, 2]}}\n", "path.position.size: ", "list of 3 edge lengths"),
    "size zero": ("path: {position: {link: a, size: [1, 0, 1]}}\n", "path.position.size[1]: ", "greater than 0 [m]"),
    "size negative infinite": ("path: {position: {link: a, size: [1, -.inf, 1]}}\n", "size[1]: ", "or .inf", "-inf"),
    "size everywhere": ("path: {position: {link: a, size: [.inf, .inf, .inf]}}\n", "size: is infinite", "leave the"),
    # timing
    "timing empty": ("timing: {}\n", "timing: is empty", "duration, scale, rate"),
    "duration and scale": ("timing: {duration: 1, scale: 1}\n", "timing: has both 'duration' and 'scale'"),
    "duration zero": ("timing: {duration: 0}\n", "timing.duration: ", "greater than 0 [s]", "found 0"),
    "scale above 1": ("timing: {scale: 1.5}\n", "timing.scale: ", "greater than 0 and at most 1, ", "found 1.5"),
    "scale zero": ("timing: {scale: 0}\n", "timing.scale: ", "greater than 0", "found 0"),
    "rate too low": (f"{TIMED[:-2]}, rate: 0.5}}\n", "timing.rate: ", "1 to 10000 [1/s]", "found 0.5"),
    "rate too high": (f"{TIMED[:-2]}, rate: 20000}}\n", "timing.rate: ", "1 to 10000 [1/s]", "found 20000"),
    "no time law": ("timing: {scale: 0.5}\n", "timing: makes the motion timed", "timing.duration or limits.accel"),
    "no time law for speeds": ("limits: {velocity: urdf}\n", "limits.velocity: makes the motion timed"),
    "no time law for torques": ("limits: {torque: 3}\n", "limits.torque: makes the motion timed"),
}


@pytest.mark.parametrize("case", CASES)
def test_refused_in_one_clear_line(tmp_path: Path, case: str) -> None:
    text, *fragments = CASES[case]
    with pytest.raises(InputError) as caught:
        read(tmp_path, text)
    message = str(caught.value).removeprefix(f"{tmp_path / 'scene.yaml'}: ")
    assert "\n" not in message
    assert len(message) < 250
    for fragment in fragments:
        assert fragment in message


def test_inertias_of_real_bodies_are_taken(tmp_path: Path) -> None:
    """Points, rods, discs and clouds, turned at random: on the border of what is possible, to rounding."""
    rng = np.random.default_rng(0)
    for shape in ((0, 0, 0), (0, 0, 1), (1, 1, 0), (1, 2, 3)):
        points = rng.normal(size=(5, 3)) * shape @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
        inertia = sum((p @ p) * np.eye(3) - np.outer(p, p) for p in points)
        given = [float(inertia[i, j]) for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))]
        assert read(tmp_path, payload(f"mass: 1, inertia: {flow_style(given)}")).payload.inertia == tuple(given)
