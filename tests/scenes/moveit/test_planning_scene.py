"""MoveIt planning scenes with their requests: small ones written here, and the benchmark's if it is at hand."""

from __future__ import annotations

import base64
import copy
import dataclasses
import itertools
import math
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hdplan.planner.certificate.certifier import certify
from hdplan.planner.plan import plan
from hdplan.planner.robot.joint_limits import joint_limits
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.scenes.attached import Attached
from hdplan.scenes.errors import InputError
from hdplan.scenes.limits import Limits
from hdplan.scenes.poses import Pose
from hdplan.scenes.robot_files.link_pairs import link_pair
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.shapes import Box, Cylinder, Sphere
from hdplan.scenes.voxel_grids import OctoMap
from hdplan.scenes.yaml_format.reader import load_scene

MBM = Path(__file__).parents[4] / "shared" / "mbm"

STILL = {"rotation": [0, 0, 0, 1], "translation": [0, 0, 0]}
TURNED = {"rotation": [0, 0, math.sqrt(0.5), math.sqrt(0.5)], "translation": [0, 0, 0]}
MOVED = {"rotation": [0, 0, 0, 1], "translation": [0, 0, 1]}


def frame(name: str, transform: dict[str, Any]) -> dict[str, Any]:
    return {"child_frame_id": name, "transform": transform}


SCENE: dict[str, Any] = {
    "name": "",
    "robot_model_name": "panda",
    "robot_state": {
        "joint_state": {"name": ["panda_joint1", "panda_finger_joint1"], "position": [0.5, 0.02]},
        "multi_dof_joint_state": {"joint_names": ["virtual_joint"], "transforms": [STILL], "twist": [], "wrench": []},
    },
    "fixed_frame_transforms": [frame("world", STILL)],
    "allowed_collision_matrix": {
        "entry_names": ["panda_link0", "panda_link1"],
        "entry_values": [[False, True], [True, False]],
    },
    "world": {
        "collision_objects": [
            {
                "id": "can",
                "primitives": [{"type": "cylinder", "dimensions": [0.14, 0.03]}],
                "primitive_poses": [{"position": [0.5, 0, 0.2], "orientation": [0, 0, 0, 1]}],
            },
            {
                "id": "stand",
                "pose": {"position": [1, 0, 0], "orientation": TURNED["rotation"]},
                "primitives": [{"type": "box", "dimensions": [1, 2, 3]}, {"type": "sphere", "dimensions": [0.1]}],
                "primitive_poses": [
                    {"position": [0, 0, 0], "orientation": [0, 0, 0, 1]},
                    {"position": [1, 0, 2], "orientation": [0, 0, 0, 1]},
                ],
            },
        ]
    },
}
REQUEST: dict[str, Any] = {
    "group_name": "panda_arm",
    "start_state": {"joint_state": {"name": ["panda_joint2", "panda_joint1"], "position": [0.2, 0.1]}},
    "goal_constraints": [{"joint_constraints": [{"joint_name": "panda_joint1", "position": 1.0}]}],
}


def at(message: dict[str, Any], path: str) -> tuple[Any, Any]:
    """Return the container and the last key of a path such as ``world.collision_objects.0.id``."""
    *way, last = (int(step) if step.isdigit() else step for step in path.split("."))
    here: Any = message
    for step in way:
        here = here.setdefault(step, {}) if isinstance(here, dict) else here[step]
    return here, last


class Files:
    """A planning scene and a request in a folder, both of them good until one is edited."""

    def __init__(self, folder: Path) -> None:
        self.scene_file, self.request_file = folder / "scene.yaml", folder / "request.yaml"
        self.scene, self.request = copy.deepcopy(SCENE), copy.deepcopy(REQUEST)

    def edit(self, which: str, path: str, value: object) -> Files:
        container, key = at(getattr(self, which), path)
        container[key] = value
        return self

    def load(self, **options: Any) -> Any:
        self.scene_file.write_text(yaml.safe_dump(self.scene), encoding="utf-8")
        self.request_file.write_text(yaml.safe_dump(self.request), encoding="utf-8")
        chosen: dict[str, Any] = {"request": self.request_file, "robot": "panda"} | options
        return load_scene(self.scene_file, **chosen)


@pytest.fixture
def files(tmp_path: Path) -> Files:
    return Files(tmp_path)


def test_a_planning_scene_gives_its_obstacles(files: Files) -> None:
    scene = files.load()
    assert scene.robot == RobotSpec(name="panda", group="arm")
    assert scene.from_request
    assert scene.notes == ()
    assert {o.name: o.shape for o in scene.obstacles} == {
        "can": Cylinder(radius=0.03, length=0.14),
        "stand": Box((1.0, 2.0, 3.0)),
        "stand/1": Sphere(0.1),
    }


def test_object_pose_multiplies_primitive_pose(files: Files) -> None:
    can, stand, ball = files.load().obstacles
    assert can.pose == Pose((0.5, 0.0, 0.2))
    np.testing.assert_allclose(stand.pose.matrix, [[0, -1, 0, 1], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], atol=1e-15)
    np.testing.assert_allclose(ball.pose.position, [1, 1, 2], atol=1e-15)


def test_coordinates_left_out_are_zero_as_in_ros(files: Files) -> None:
    pose = files.scene["world"]["collision_objects"][0]["primitive_poses"][0]
    for position, orientation, meant in (
        ({}, {"w": 1.0}, Pose()),
        ({"z": 0.5}, {"x": 1, "w": 0}, Pose((0.0, 0.0, 0.5), (1.0, 0.0, 0.0, 0.0))),
        ({"x": 1, "y": 2}, {"z": -0.6, "w": 0.8}, Pose((1.0, 2.0, 0.0), (0.0, 0.0, -0.6, 0.8))),
    ):
        pose |= {"position": position, "orientation": orientation}
        assert files.load().obstacles[0].pose == meant
    pose["orientation"] = {"x": 1.0}  # half a turn in ROS 1; in ROS 2, whose w is then 1, a quarter
    with pytest.raises(InputError, match=r"primitive_poses\[0\].orientation: the key 'w' is missing"):
        files.load()


def test_object_pose_alone_is_enough(files: Files) -> None:
    del files.scene["world"]["collision_objects"][1]["primitive_poses"]
    _, stand, ball = files.load().obstacles
    assert stand.pose == ball.pose
    assert ball.pose.position == (1.0, 0.0, 0.0)


def test_start_lies_over_the_scene_state(files: Files) -> None:
    scene = files.load()
    assert scene.start.by_name == {"panda_joint1": 0.1, "panda_joint2": 0.2, "panda_finger_joint1": 0.02}
    assert scene.goal.by_name == {"panda_joint1": 1.0}


def test_scene_state_is_the_start_where_the_request_has_none(files: Files) -> None:
    del files.request["start_state"]
    assert files.load().start.by_name == {"panda_joint1": 0.5, "panda_finger_joint1": 0.02}


def test_an_empty_world_is_fine(files: Files) -> None:
    del files.scene["world"]
    assert files.load().obstacles == ()


def test_numbers_of_the_ros_messages_name_primitives(files: Files) -> None:
    scene = files.edit("scene", "world.collision_objects.0.primitives.0.type", 3).load()
    assert scene.obstacles[0].shape == Cylinder(radius=0.03, length=0.14)


def test_numbers_that_yaml_takes_for_text_are_numbers(files: Files) -> None:
    scene = files.edit("scene", "world.collision_objects.0.primitive_poses.0.position", [0, "1e-05", "-2E3"]).load()
    assert scene.obstacles[0].pose.position == (0.0, 1e-5, -2000.0)


def test_objects_without_id_are_counted(files: Files) -> None:
    files.edit("scene", "world.collision_objects.0.id", "")
    del files.scene["world"]["collision_objects"][1]["id"]
    assert [o.name for o in files.load().obstacles] == ["obstacle0", "obstacle1", "obstacle1/1"]


def test_empty_messages_are_no_constraints(files: Files) -> None:
    nothing = {"name": "", "joint_constraints": [], "position_constraints": []}
    files.edit("request", "path_constraints", nothing).edit("request", "goal_constraints.0.position_constraints", [])
    files.edit("scene", "world.octomap", {"header": {"frame_id": ""}, "octomap": {"id": "", "data": []}})
    assert files.load().notes == ()


@pytest.mark.parametrize("form", ["signed", "unsigned", "base64", "binary"])
def test_an_octomap_is_an_obstacle(files: Files, form: str) -> None:
    """A map of one occupied corner of eight, as octomap_msgs has it, 0.4 m to each side."""
    data = bytes([0xFE, 0xFF])
    forms = {"signed": [-2, -1], "unsigned": [254, 255], "base64": base64.b64encode(data).decode(), "binary": data}
    octomap = {"binary": True, "id": "OcTree", "resolution": 0.1, "data": forms[form]}
    origin = {"position": {"x": 1.0, "y": 0.0, "z": 0.5}, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
    files.edit("scene", "world.octomap", {"header": {"frame_id": ""}, "origin": origin, "octomap": octomap})
    found = files.load().obstacles[-1]
    assert (found.name, found.pose.position) == ("<octomap>", (1.0, 0.0, 0.5))
    assert isinstance(found.shape, OctoMap)
    assert isinstance(found.shape.source, bytes)
    assert found.shape.source.endswith(data)
    assert b"res 0.1\n" in found.shape.source


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("id", "ColorOcTree", "must be OcTree"),
        ("resolution", 0.0, "octomap.resolution: must be a finite number greater than 0"),
        ("data", [300], "octomap.data: must be a list of bytes"),
        ("data", "%%%", "octomap.data: must be a list of bytes"),
        ("data", 7, "octomap.data: must be a list of bytes"),
        ("header", {"frame_id": "nowhere"}, "octomap.header.frame_id: unknown frame 'nowhere'"),
        ("header", {"frame_id": "shelf"}, "octomap.header.frame_id: is another frame"),
    ],
)
def test_bad_octomaps_are_refused(files: Files, key: str, value: Any, words: str) -> None:
    octomap = {"binary": True, "id": "OcTree", "resolution": 0.1, "data": [1, 2], key: value}
    files.edit("scene", FRAMES, [frame("shelf", MOVED)])
    with pytest.raises(InputError, match=words):
        files.edit("scene", "world.octomap", {"octomap": octomap}).load()


MATRIX = "allowed_collision_matrix"


def matrix(names: list[str], allowed: Collection[tuple[str, str]], **more: Any) -> dict[str, Any]:
    pairs = {frozenset(pair) for pair in allowed}
    return {"entry_names": names, "entry_values": [[frozenset((a, b)) in pairs for b in names] for a in names], **more}


def defaults(names: list[str], allowed: list[bool]) -> dict[str, Any]:
    return {"default_entry_names": names, "default_entry_values": allowed}


def test_contact_that_a_matrix_allows_is_named_where_it_is_still_avoided(files: Files) -> None:
    names = ["panda_hand", "panda_link3", "can", "stand", "panda_leftfinger", "panda_link0", "panda_link1", "cup"]
    cup = held("cup", "panda_hand") | {"link_name": "panda_hand", "touch_links": ["panda_leftfinger"], "weight": 0.0}
    files.edit("scene", HELD, [cup]).edit("request", "start_state.is_diff", True)
    kept = [  # by the SRDF, by touch_links, or because obstacles are not checked against each other
        ("panda_link0", "panda_link1"),
        ("cup", "panda_leftfinger"),
        ("cup", "panda_hand"),
        ("can", "stand"),
        ("panda_link3", "panda_link3"),
    ]
    assert files.edit("scene", MATRIX, matrix(names, kept)).load().notes == ()
    left_out = load_robot("panda").unchecked
    assert not all(link_pair(a, b) in left_out for a, b in itertools.combinations(SOLID, 2))
    for pair in itertools.combinations(names, 2):
        (*notes,) = files.edit("scene", MATRIX, matrix(names, [*kept, pair])).load().notes
        quiet = pair in kept or pair[::-1] in kept or link_pair(*pair) in left_out
        assert len(notes) == (not quiet), (pair, notes)
        assert all("still avoids, of" in note and all(name in note for name in pair) for note in notes)
    ros2 = matrix(names, [*kept, ("can", "panda_link3")])
    ros2["entry_values"] = [{"enabled": row} for row in ros2["entry_values"]]
    (note,) = files.edit("scene", MATRIX, ros2).load().notes
    assert note.endswith("hdplan still avoids, of can with panda_link3")
    every = matrix(names, list(itertools.combinations(names, 2)))
    (note,) = files.edit("scene", MATRIX, every).load().notes
    assert all(name in note for name in names)


@pytest.mark.parametrize("name", ["can", "panda_link3"])
def test_a_body_that_may_touch_anything_is_named(files: Files, name: str) -> None:
    (note,) = files.edit("scene", MATRIX, defaults([name], [True])).load().notes
    assert note.endswith(f"hdplan still avoids, of {name} with anything")
    assert files.edit("scene", MATRIX, defaults([name], [False])).load().notes == ()


def test_names_in_a_matrix_that_nothing_has_are_named(files: Files) -> None:
    names = ["cann", "panda_link0", "panda_hand_sensor", "<octomap>", "panda_link8"]  # which has no geometry
    (note,) = files.edit("scene", MATRIX, matrix(names, [("cann", "panda_link0")])).load().notes
    assert note.endswith("names unknown links or objects, which changes nothing: cann, panda_hand_sensor")
    (note,) = files.edit("scene", MATRIX, defaults(["panda_lnk0"], [False])).load().notes
    assert note.endswith("changes nothing: panda_lnk0")


def test_a_pair_that_the_srdf_leaves_out_and_the_matrix_checks_is_checked(files: Files) -> None:
    """An entry or the defaults of its links decide; a pair that the matrix allows or omits is not checked."""
    names = ["panda_link0", "panda_link1", "panda_link5", "panda_link7"]  # the SRDF disables 0-1 and 5-7, and not 0-5
    some, others = [("panda_link0", "panda_link1")], [("panda_link5", "panda_link7")]
    for allowed, checked in (([], some + others), (some, others), (some + others, [])):
        scene = files.edit("scene", MATRIX, matrix(names, allowed)).load()
        assert scene.notes == ()
        assert scene.robot.check_pairs == tuple(checked)
        robot = load_scene_robot(dataclasses.replace(scene, start="default", goal="default"))
        assert set(checked) <= set(robot.self_pairs)
        assert not set(checked) & set(robot.unchecked)
    uneven = matrix(names, [])
    uneven["entry_values"][0][1] = True
    for strict in (uneven, defaults(names[:2], [False, True]), defaults([names[0]] * 2, [False, True])):
        assert some[0] in files.edit("scene", MATRIX, strict).load().robot.check_pairs
    assert files.edit("scene", MATRIX, defaults(names[:2], [True, True])).load().robot.check_pairs == ()


def test_pairs_that_the_matrix_of_another_robot_checks_are_named_not_checked(files: Files) -> None:
    """Its links have other shapes; whichever pairs the matrix names, kept are those of the SRDF."""
    names = ["panda_link0", "panda_link1", "panda_link5", "panda_link7"]
    files.edit("scene", MATRIX, matrix(names, [("panda_link5", "panda_link7")]))
    own = files.load()
    other = files.edit("scene", "robot_model_name", "panda_with_another_hand").load()
    assert own.robot.check_pairs == (("panda_link0", "panda_link1"),)
    assert other.robot.check_pairs == ()
    named, why = other.notes
    assert "panda_with_another_hand" in named
    assert why.endswith("pairs that it checks and this robot's description does not: panda_link0-panda_link1")


def test_pairs_ignored_by_the_robots_file_stay_ignored_and_are_named(files: Files) -> None:
    own = files.scene_file.with_name("robot.yaml")
    own.write_text("robot: {name: panda, ignore_pairs: [[panda_link7, panda_link5]]}")
    files.edit("scene", MATRIX, matrix(["panda_link5", "panda_link7"], []))
    scene = files.load(robot=own)
    assert scene.robot.check_pairs == ()
    assert [note.rpartition(": ")[2] for note in scene.notes] == ["panda_link5-panda_link7"]


# Paddings and speeds


def padding(**links: float) -> list[dict[str, Any]]:
    return [{"link_name": link, "padding": value} for link, value in links.items()]


SOLID = ["panda_hand", "panda_leftfinger", "panda_rightfinger", *(f"panda_link{i}" for i in range(8))]


def test_one_padding_for_all_links_is_a_clearance_to_every_obstacle(files: Files) -> None:
    files.edit("scene", "link_padding", padding(**dict.fromkeys([*SOLID, "panda_link8"], 0.02)))
    scene = files.load()
    assert set(scene.clearances.values()) == {0.02}
    assert {obstacle.clearance for obstacle in scene.obstacles} == {0.02}  # so that no end may be closer
    assert [note for note in scene.notes if "link_padding: kept as a clearance of 0.02 m" in note] == list(scene.notes)
    for none in ([], padding(**dict.fromkeys([*SOLID, "somewhere_else"], 0.0))):
        scene = files.edit("scene", "link_padding", none).load()
        assert set(scene.clearances.values()) == {0.0}
        assert scene.notes == ()


UNEVEN = padding(**dict.fromkeys(SOLID, 0.02)) + padding(panda_link3=0.01)


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        (padding(panda_hand=0.02), r"link_padding: must be the same for every .*0.02 m for 'panda_hand' and 0 m for"),
        (padding(**dict.fromkeys(SOLID, 0.02) | {"panda_link3": 0.03}), "0.03 m for 'panda_link3' and 0.02 m for"),
        (UNEVEN, r"link_padding\[11\]: 'panda_link3' has another padding already"),
        (padding(panda_link3=-0.01), r"link_padding\[0\].padding: .* 0 to 1"),
        (padding(panda_lnk3=0.01), r"link_padding\[0\].link_name: unknown link 'panda_lnk3' .*'panda_link3'"),
        ([{"link_name": "panda_link3"}], r"link_padding\[0\]: the key 'padding' is missing"),
    ],
)
def test_other_paddings_are_refused_by_name(files: Files, entries: list[dict[str, Any]], words: str) -> None:
    with pytest.raises(InputError, match=words):
        files.edit("scene", "link_padding", entries).load()


def test_scaled_links_are_refused_by_name(files: Files) -> None:
    files.edit("scene", "link_scale", [{"link_name": link, "scale": 1.0} for link in SOLID])
    assert files.load().notes == ()
    for scale in (1.1, 0.9, 0.0, -1.0):
        files.edit("scene", "link_scale.3.scale", scale)
        with pytest.raises(InputError, match=r"link_scale\[3\].scale: must be 1, as scaled links are not supported"):
            files.load()


VELOCITY, ACCELERATION = "max_velocity_scaling_factor", "max_acceleration_scaling_factor"


@pytest.mark.parametrize("other", [None, 0, 0.0, 1, 1.0])
def test_factors_of_0_and_1_ask_for_nothing(files: Files, other: float | None) -> None:
    plain = files.load()
    for key in (VELOCITY, ACCELERATION):
        files.edit("request", key, other)
    assert files.load() == plain
    assert not files.load().timed
    assert files.load().notes == ()


def test_factors_scale_the_limits(files: Files) -> None:
    full = {f"panda_joint{i}": 2.175 if i < 5 else 2.61 for i in range(1, 8)}  # of its URDF [rad/s]
    for velocity, acceleration in ((0.25, 1.0), (0.25, 0.0), (1.0, 0.5), (0.25, 0.5), (1e-3, None)):
        scene = files.edit("request", VELOCITY, velocity).edit("request", ACCELERATION, acceleration).load()
        assert {joint: scene.limits.velocity[joint] for joint in full} == pytest.approx(
            {joint: (velocity or 1.0) * limit for joint, limit in full.items()}
        )
        assert scene.limits.acceleration == (acceleration or 1.0) * 1.0
        assert [note for note in scene.notes if "1 assumed, as a URDF has no acceleration" in note] == [*scene.notes]
        robot = load_scene_robot(dataclasses.replace(scene, start="default", goal="default"))
        found = joint_limits(scene, robot)["velocity"]  # fingers are held, which keeps their limits
        np.testing.assert_allclose(found, [scene.limits.velocity[joint] for joint in robot.joint_names])
        scene.save(files.scene_file.with_name("again.yaml"))
        assert load_scene(files.scene_file.with_name("again.yaml")).limits == scene.limits


def test_a_scaled_request_is_planned_with_times_that_keep_its_limits(tmp_path: Path) -> None:
    examples = Path(__file__).parents[3] / "docs" / "examples"
    request = yaml.safe_load((examples / "moveit_request.yaml").read_text()) | {VELOCITY: 0.2, ACCELERATION: 0.5}
    (tmp_path / "request.yaml").write_text(yaml.safe_dump(request) + "---\n")
    scene = load_scene(examples / "moveit_scene.yaml", tmp_path / "request.yaml", "panda")
    result = plan(scene)
    motion = result.trajectory
    assert result.certified
    assert motion.velocities is not None
    assert motion.accelerations is not None
    assert np.all(np.abs(motion.velocities) <= [0.2 * 2.175] * 4 + [0.2 * 2.61] * 3)
    assert np.all(np.abs(motion.accelerations) <= 0.5)
    assert {use.quantity for use in result.certificate.uses} == {"velocity", "acceleration"}
    assert all(0.5 < use.share <= 1.0 for use in result.certificate.uses)
    fast = dataclasses.replace(scene, limits=Limits(acceleration=5.0))
    assert not certify(scene, plan(fast).trajectory).certified


@pytest.mark.parametrize("factor", [-0.1, 1.0001, 7, "fast", [0.5], True, float("nan")])
@pytest.mark.parametrize("key", [VELOCITY, ACCELERATION])
def test_other_factors_are_refused_by_name(files: Files, key: str, factor: object) -> None:
    with pytest.raises(InputError, match=rf"request.yaml: {key}: must be a finite number 0 to 1, found"):
        files.edit("request", key, factor).load()


def test_velocities_of_the_start_are_read_and_zeros_are_rest(files: Files) -> None:
    """The request's state takes the place of the scene's, joint by joint; a robot that moves gets limits."""
    rest = files.load()
    for which, key in (("scene", "robot_state"), ("request", "start_state")):
        state = f"{key}.joint_state.velocity"
        still = files.edit(which, state, [0.0, -0.0]).load()
        assert still == rest
        assert still.notes == ()
        moving = files.edit(which, state, [0.0, 1e-4]).load()
        names = getattr(files, which)[key]["joint_state"]["name"]
        assert moving.start.moves
        assert moving.start.velocity[names[1]] == 1e-4
        assert moving.start.velocity.keys() == moving.start.by_name.keys()
        assert moving.limits.acceleration == 1.0
        assert "1 assumed, as a URDF has no acceleration limits" in moving.notes[0]
        with pytest.raises(InputError, match=rf"{key}.joint_state: must have as many velocities as names, found 1"):
            files.edit(which, state, [0.1]).load()
        with pytest.raises(InputError, match=rf"{key}.joint_state.velocity\[0\]: must be a finite number"):
            files.edit(which, state, [float("nan"), 0.0]).load()
        files.edit(which, state, [])
        twist = f"{key}.multi_dof_joint_state.twist"
        still, turning = ({"linear": {"x": 0.0}, "angular": {"x": 0.0, "z": value}} for value in (0.0, 0.1))
        assert files.edit(which, twist, [still]).load().notes == ()
        with pytest.raises(InputError, match=f"{twist}: is not 0: a base that moves"):
            files.edit(which, twist, [still, turning]).load()
        files.edit(which, twist, [])


@pytest.mark.parametrize("planner", ["LIN", "CIRC", "ptp", "pilz_industrial_motion_planner"])
def test_planners_that_prescribe_the_motions_shape_are_refused(files: Files, planner: str) -> None:
    key = "pipeline_id" if planner.startswith("pilz") else "planner_id"
    with pytest.raises(InputError, match=f"request.yaml: {key}: '{planner}' prescribes the shape of the motion"):
        files.edit("request", key, planner).load()
    (note,) = files.edit("request", key, "LINear_RRTConnectkConfigDefault").load().notes
    assert "configures MoveIt's planners" in note


def test_bounds_of_a_base_that_moves_are_refused(files: Files) -> None:
    corners = {"min_corner": [-1, -1, 0], "max_corner": [1, 1, 1]}
    (note,) = files.edit("request", "workspace_parameters", corners).load().notes
    assert "the base is fixed" in note
    own = files.scene_file.with_name("robot.yaml")
    own.write_text("robot: {name: panda, base_joints: {x: [-2, 2], y: [-2, 2], yaw: [-3, 3]}}")
    with pytest.raises(InputError, match=r"request.yaml: workspace_parameters: bounds the mobile base"):
        files.load(robot=own)


def test_another_robots_name_is_reported(files: Files) -> None:
    (note,) = files.edit("scene", "robot_model_name", "fr3").load().notes
    assert note == "scene.yaml: robot_model_name: names the robot 'fr3', not panda"
    assert files.edit("scene", "robot_model_name", "").load().notes == ()


def test_differences_from_an_unknown_state_are_reported(files: Files) -> None:
    (note,) = files.edit("scene", "robot_state.is_diff", True).load().notes
    assert "robot_state: is_diff is true" in note
    files.edit("scene", "robot_state.is_diff", False).edit("scene", HELD, [{**held("cup"), "weight": 0.0}])
    (note,) = files.load().notes
    assert "start_state: is_diff is not true, but objects attached in the scene's state stay attached" in note
    assert files.edit("request", "start_state.is_diff", True).load().notes == ()


def held(name: str, frame: str = "hand") -> dict[str, Any]:
    thing = {"id": name, "header": {"frame_id": frame}, "pose": {"position": [0, 0, 0.1]}}
    primitives = [{"type": "box", "dimensions": [1, 2, 3]}, {"type": "sphere", "dimensions": [0.1]}]
    poses = [{"position": [0, 0, 0]}, {"position": [0, 1, 0]}]
    thing |= {"primitives": primitives, "primitive_poses": poses}
    return {"link_name": "hand", "object": thing, "touch_links": ["finger"], "weight": 0.2}


def test_attached_objects_are_held(files: Files) -> None:
    """The request's object takes the place of the scene's of that name."""
    files.edit("scene", HELD, [held("cup"), held("lid")])
    first, knob, *lid = files.load().attached
    assert first == Attached("cup", "hand", Box((1, 2, 3)), Pose((0, 0, 0.1)), ("finger",))
    assert knob == Attached("cup/1", "hand", Sphere(0.1), Pose((0, 1, 0.1)), ("finger",))
    assert [part.name for part in lid] == ["lid", "lid/1"]
    bare = {**held("cup"), "touch_links": []}
    found = files.edit("request", "start_state.attached_collision_objects", [bare]).load().attached
    expected = {"cup": (), "cup/1": (), "lid": ("finger",), "lid/1": ("finger",)}
    assert {part.name: part.touch_links for part in found} == expected


def test_an_attached_object_takes_the_place_of_another_whole(files: Files) -> None:
    """No part of the earlier one stays, be the later one of fewer parts, or of more."""
    whole, one = held("cup"), held("cup")
    one["object"] |= {"primitives": one["object"]["primitives"][:1], "primitive_poses": []}
    for state, start, names in (([whole], [one], ["cup"]), ([one], [whole], ["cup", "cup/1"])):
        files.edit("scene", HELD, state).edit("request", "start_state.attached_collision_objects", start)
        assert [part.name for part in files.load().attached] == names


def test_attached_objects_without_a_name_do_not_replace_each_other(files: Files) -> None:
    files.edit("scene", HELD, [held("")]).edit("request", "start_state.attached_collision_objects", [held("")])
    names = [part.name for part in files.load().attached]
    objects = "attached_collision_objects[0]"
    assert names == [f"{state}.{objects}{part}" for state in ("robot_state", "start_state") for part in ("", "/1")]


HELD = "robot_state.attached_collision_objects"
FRAMES = "fixed_frame_transforms"
BASE = "robot_state.multi_dof_joint_state"
GOAL = "goal_constraints.0"
OBJECT = "world.collision_objects.1"
REFUSED = [
    ("scene", "worlds", {}, "unknown key 'worlds'", "'world'"),
    ("scene", "world.octomap.octomap.data", [1, 2], "world.octomap", "must be OcTree"),
    ("scene", f"{OBJECT}.primitves", [], "collision_objects[1]: ", "'primitves'", "'primitives'"),
    ("scene", f"{OBJECT}.meshes", [{"vertices": [[0, 0, 0]], "triangles": [[0, 0, 0]]}], ".meshes: ", "not supported"),
    ("scene", f"{OBJECT}.planes", [{"coef": [0, 0, 1, 0]}], "collision_objects[1].planes: ", "not supported"),
    ("scene", f"{OBJECT}.primitives.0.type", "cone", "primitives[0].type: ", "'cone'", "box, cylinder and sphere"),
    ("scene", f"{OBJECT}.primitives.0.type", 4, "primitives[0].type: ", "'cone'"),
    ("scene", f"{OBJECT}.primitives.0.type", "bax", "primitives[0].type: ", "box, cylinder or sphere", "'bax'"),
    ("scene", f"{OBJECT}.primitives.0.dimensions", [1, 2], "dimensions: ", "list of 3 numbers", "list of 2"),
    ("scene", f"{OBJECT}.primitives.0.dimensions", [1, 2, 0], "dimensions[2]: ", "greater than 0 [m]", "found 0"),
    ("scene", f"{OBJECT}.primitives", [], "collision_objects[1]: ", "'stand'", "no primitives"),
    ("scene", f"{OBJECT}.primitive_poses", [{}], "primitive_poses: ", "as many as the 2", "found 1"),
    ("scene", f"{OBJECT}.pose.orientation", [0, 0, 0, 0], "pose.orientation: ", "unit quaternion", "length 0"),
    ("scene", f"{OBJECT}.pose.position", [0, float("nan"), 0], "pose.position[1]: ", "finite", "nan"),
    ("scene", f"{OBJECT}.id", "can", "collision_objects[1]: ", "'can'", "differ"),
    ("scene", f"{OBJECT}.header.frame_id", "panda_hand", "header.frame_id: ", "world frame", "'panda_hand' moves"),
    ("scene", f"{OBJECT}.header.frame_id", "panda_lik0", "header.frame_id: ", "'panda_lik0'", "'panda_link0'"),
    ("scene", f"{OBJECT}.primitives.0.type", True, "primitives[0].type: ", "box, cylinder or sphere", "true"),
    ("scene", f"{OBJECT}.meshes", "box.stl", "collision_objects[1].meshes: ", "not supported"),
    ("scene", "world.octomap.octomap.data", b"\x01\x02", "world.octomap", "must be OcTree"),
    ("scene", "world.octomap.octomap.data", "AQI=", "world.octomap", "must be OcTree"),
    ("scene", "is_diff", True, "is_diff: ", "whole scene"),
    ("scene", f"{MATRIX}.entry_values.0", [True], "entry_values[0]: ", "list of 2", "list of 1"),
    ("scene", f"{MATRIX}.entry_values", [], "entry_values", "list of 0"),
    ("scene", f"{MATRIX}.default_entry_names", ["a"], "default_entry_values", "found 0 and 1"),
    ("scene", f"{OBJECT}.operation", 1, "operation: ", "0 (ADD)", "found 1"),
    ("scene", FRAMES, [{"transform": MOVED}], "fixed_frame_transforms[0].transform: ", "fixed frame"),
    ("scene", FRAMES, [frame("panda_link0", MOVED)], "[0].transform: ", "'panda_link0' has another pose"),
    ("scene", FRAMES, [frame("panda_hand", STILL)], "[0].child_frame_id: ", "'panda_hand' moves"),
    ("scene", f"{BASE}.header.frame_id", "odom", f"{BASE}.header.frame_id: ", "unknown frame 'odom'"),
    ("scene", f"{BASE}.transforms", [TURNED], "transforms[0]: ", "moves the robot's base"),
    ("scene", HELD, [{"link_name": "a"}], "attached_collision_objects[0]: ", "'object' is missing"),
    ("scene", HELD, [{"link_name": "a", "object": {}}], "objects[0].object: ", "frame of its link 'a'", "found ''"),
    ("scene", HELD, [held("cup", "world")], "object.header.frame_id: ", "frame of its link 'hand'", "'world'"),
    ("scene", HELD, [held("can")], "collision_objects[0]: ", "'can'", "differ"),
    ("scene", HELD, [held("cup"), held("cup")], "attached_collision_objects[1]: ", "'cup'", "differ"),
    ("scene", HELD, [{**held("cup"), "touch_links": "hand"}], "touch_links: ", "list"),
    ("scene", HELD, [{**held("cup"), "object": {"meshes": [{"triangles": [1]}]}}], ".meshes: ", "not supported"),
    ("scene", f"{MATRIX}.entry_values", [[True]], "entry_values: ", "list of 2", "list of 1"),
    ("request", "start_state.multi_dof_joint_state.transforms", [MOVED], "start_state.multi_dof_joint_state", "moves"),
    ("request", "start_state.attached_collision_objects", [{"link_name": "a"}], "start_state.attached", "'object'"),
    ("request", "start_state.joint_state.position", [1], "start_state.joint_state: ", "found 1 and 2"),
    ("request", "start_state.joint_state.name", ["a", "a"], "joint_state.name: ", "twice", "'a'"),
    ("request", "start_state.joint_state.position", [1, float("inf")], "joint_state.position[1]: ", "finite", "inf"),
    ("request", "goal_constraints", [], "goal_constraints: ", "one goal", "found 0"),
    ("request", "goal_constraints", [{}, {}], "goal_constraints: ", "one goal", "found 2"),
    ("request", f"{GOAL}.joint_constraints", [], "goal_constraints[0]: ", "no joint_constraints"),
    ("request", f"{GOAL}.position_constraints", [{"link_name": "a"}], "_constraints: ", "beside joint_constraints"),
    ("request", "trajectory_constraints.constraints", [{"name": "a"}], "trajectory_constraints: ", "not supported"),
    ("request", f"{GOAL}.joint_constraints.0", {"joint_name": "a"}, "'position' is missing"),
    ("request", "group_name", "panda_am", "group_name: ", "unknown group 'panda_am'", "'arm'"),
    ("request", "start_state.joint_state.velocty", [], "unknown key 'velocty'", "'velocity'"),
    ("request", "goal_constrants", [], "unknown key 'goal_constrants'", "'goal_constraints'"),
]


@pytest.mark.parametrize("case", REFUSED, ids=lambda case: f"{case[0]}-{case[1]}")
def test_refused_by_name(files: Files, case: tuple[Any, ...]) -> None:
    which, path, value, *fragments = case
    with pytest.raises(InputError) as caught:
        files.edit(which, path, value).load()
    message = str(caught.value)
    assert message.startswith(f"{getattr(files, which + '_file')}: ")
    assert "\n" not in message
    for fragment in fragments:
        assert fragment in message


def test_a_joint_has_one_goal(files: Files) -> None:
    files.request["goal_constraints"][0]["joint_constraints"] *= 2
    with pytest.raises(InputError, match=r"joint_constraints\[1\]: the joint 'panda_joint1' has a goal already"):
        files.load()


def test_no_start_anywhere(files: Files) -> None:
    del files.request["start_state"], files.scene["robot_state"]
    with pytest.raises(InputError, match="there is no start"):
        files.load()


def test_missing_flags_are_named(files: Files) -> None:
    with pytest.raises(InputError, match=r"has no goal.*--request"):
        files.load(request=None)
    with pytest.raises(InputError, match=r"does not say where its robot is found.*--robot"):
        files.load(robot=None)
    with pytest.raises(InputError, match=r"no goal and does not say .*--request FILE.* and --robot NAME or FILE"):
        files.load(request=None, robot=None)


def test_swapped_files_are_reported(files: Files) -> None:
    files.load()
    with pytest.raises(InputError, match="is a MoveIt motion plan request; name the planning scene first"):
        load_scene(files.request_file, files.scene_file, "panda")
    with pytest.raises(InputError, match="a motion plan request is needed"):
        load_scene(files.scene_file, files.scene_file, "panda")
    with pytest.raises(InputError, match="no such file"):
        load_scene(files.scene_file, files.scene_file.with_name("none.yaml"), "panda")


@pytest.mark.skipif(not MBM.is_dir(), reason="the MotionBenchMaker problems are not beside this repository")
@pytest.mark.parametrize(
    ("arm", "group"), [("panda", "arm"), ("ur5", "manipulator"), ("fetch", "arm_with_torso"), ("baxter", "both_arms")]
)
def test_every_benchmark_problem_loads(arm: str, group: str) -> None:
    files = sorted((MBM / arm).glob("*/scene*.yaml"))
    assert files
    for file in files[::5]:
        scene = load_scene(file, file.with_name(file.name.replace("scene", "request")), MBM / arm / "robot.yaml")
        assert scene.obstacles
        assert scene.robot.group == (group if arm != "ur5" else None)  # whose SRDF has no groups
        assert any(f"group_name: is {group!r}, whose joints no SRDF lists" in note for note in scene.notes) == (
            arm == "ur5"
        )
        assert sum("names the robot 'ur5_robotiq85', not ur5" in note for note in scene.notes) == (arm == "ur5")
        assert set(scene.goal.by_name or {}) <= set(scene.start.by_name or {})
