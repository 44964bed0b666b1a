"""Laws of held objects: they move with their link, collide with all that moves against it, and absent means absent."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from numpy.typing import NDArray

from hdplan import Attached, InputError, Obstacle, Pose, Scene, build, load_scene, plan
from hdplan.planner.certificate.certifier import Certifier, certify, check_configuration
from hdplan.planner.certificate.exact_proximity import link_pieces, obstacle_pieces
from hdplan.planner.collision.link_bodies import link_bodies
from hdplan.planner.geometry.opened import with_content
from hdplan.planner.pictures.scene import Picture
from hdplan.planner.problem.clearance import PairTerm
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.terminal.explain import explain
from hdplan.planner.view.drawing.skins import HELD, visual_skins
from hdplan.scenes.shapes import Box, Capsule, Cylinder, Ellipsoid, Mesh, Points, Shape, Sphere

FINGERS = ("panda_leftfinger", "panda_rightfinger")
HALF = 0.5**0.5
TURNED = Pose((0.03, -0.02, 0.11), (HALF, 0.0, 0.0, HALF))
SHAPES: list[Shape] = [Box((0.05, 0.1, 0.3)), Sphere(0.05), Cylinder(0.03, 0.2), Capsule(0.03, 0.2)]
SHAPES += [Ellipsoid((0.03, 0.05, 0.1)), Points(((0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.3)))]
SHAPES += [Mesh(Path("bent.obj"), (2.0, 1.0, 1.0))]


@pytest.fixture(scope="module")
def carry() -> Scene:
    return load_scene("panda_carry")


def holding(scene: Scene, shape: Shape, folder: Path, **changed: object) -> Scene:
    if isinstance(shape, Mesh):
        bent = [trimesh.creation.box((0.1, 0.02, 0.02)), trimesh.creation.box((0.02, 0.02, 0.1))]
        bent[1].apply_translation((0.04, 0.0, 0.06))
        trimesh.util.concatenate(bent).export(folder / shape.file.name)
        shape = replace(shape, file=folder / shape.file.name)
    held = replace(Attached("thing", "panda_hand", shape, TURNED), **changed)
    return replace(scene, attached=(held,))


def support(pieces: object, pose: NDArray[np.float64], directions: NDArray[np.float64]) -> NDArray[np.float64]:
    heights = [piece.support(directions @ pose[:3, :3]) for piece in pieces]  # type: ignore[attr-defined]
    return np.asarray(np.max(heights, axis=0) + directions @ pose[:3, 3])


def test_a_plan_without_the_held_object_is_wrong(carry: Scene) -> None:
    alone = replace(carry, attached=())
    careless = plan(alone)
    assert careless.certificate.certified
    verdict = certify(carry, careless.trajectory)
    assert not verdict.certified
    assert (verdict.worst.link, verdict.worst.other) == ("bottle", "wall")
    assert verdict.worst.distance < -0.02
    careful = plan(carry)
    assert careful.certificate.certified
    assert certify(carry, careful.trajectory).certified
    assert certify(alone, careful.trajectory).certified


def test_absent_means_absent(carry: Scene) -> None:
    """A scene that attaches nothing has the very robot, problem and words that it has had before."""
    alone = replace(carry, attached=())
    bare, robot = load_scene_robot(alone), load_scene_robot(carry)
    assert bare.attached == ()
    assert load_scene_robot(replace(alone, attached=())) is bare
    assert load_scene_robot(carry) is robot
    assert len(bare.collision.geometryObjects) == len(robot.collision.geometryObjects) - 1
    assert bare.links == robot.links[:-1]
    assert bare.self_pairs == robot.self_pairs[: len(bare.self_pairs)]
    problem = build(alone)
    assert all(body.link != "bottle" for body in problem.bodies)
    rows = explain(problem)
    assert set(explain(build(carry))) - set(rows) == {"held objects"}
    assert dict(rows.pop("off"))["held objects"] == "needs attached[]"
    assert "held object" not in str(rows)
    assert "bottle" not in str(explain(problem))
    with_it = build(carry)
    assert [term.name for term in with_it.terms] == [term.name for term in problem.terms]
    for term, without in zip(with_it.terms, problem.terms, strict=True):
        assert isinstance(term, PairTerm)
        assert isinstance(without, PairTerm)
        assert len(term.pairs) > len(without.pairs)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_any_shape_is_held_where_its_pose_in_the_link_says(carry: Scene, shape: Shape, tmp_path: Path) -> None:
    """Certificate and planner against Pinocchio's frame of the link and the shape as an obstacle, at random places."""
    scene = holding(carry, shape, tmp_path)
    (held,) = scene.attached
    robot = load_scene_robot(scene)
    joint, (index,) = robot.link_joint["thing"], robot.link_geometry["thing"]
    item = robot.collision.geometryObjects[index]
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(50, 3))
    data = robot.model.createData()
    inner = link_pieces(item.geometry, item.name)
    outer = [body.body for body in link_bodies(robot) if body.link == "thing"]
    for q in robot.draw(rng, 5):
        pin.framesForwardKinematics(robot.model, data, robot.pin_q(q))
        place = data.oMf[robot.model.getFrameId("panda_hand", pin.FrameType.BODY)].homogeneous @ held.pose.matrix
        true = support(obstacle_pieces(with_content(Obstacle("thing", held.shape), "obstacles")), place, directions)
        carried = data.oMi[joint].homogeneous
        seen = support(inner, carried @ item.placement.homogeneous, directions)
        np.testing.assert_allclose(seen, true, rtol=0, atol=1e-9)
        local = directions @ carried[:3, :3]
        length = np.linalg.norm(local, axis=1)
        around = np.max([(local @ body.vertices.T).max(1) + body.radius * length for body in outer], 0)
        assert (around + directions @ carried[:3, 3] >= true - 1e-9).all()


def test_a_held_object_is_kept_from_all_that_moves_against_it_but_touch_links(carry: Scene, tmp_path: Path) -> None:
    robot = load_scene_robot(holding(carry, Sphere(0.05), tmp_path))
    moving = {link for link in robot.links if robot.link_joint[link] != robot.link_joint["thing"]}
    assert {"panda_hand", *FINGERS} & moving == set()
    assert {link for pair in robot.self_pairs if "thing" in pair for link in pair} == {*moving, "thing"}
    touching = load_scene_robot(holding(carry, Sphere(0.05), tmp_path, touch_links=("panda_link6", "panda_hand")))
    assert set(robot.self_pairs) - set(touching.self_pairs) == {("panda_link6", "thing")}


def test_two_objects_meet_each_other_and_the_robot(tmp_path: Path) -> None:
    scene = replace(load_scene("planar_arm"), obstacles=())
    bare = load_scene_robot(scene)
    tip, base = bare.links[-1], bare.links[0]
    rod = Attached("rod", tip, Box((3.0, 0.01, 0.01)))
    scene = replace(scene, attached=(rod, Attached("lump", base, Box((0.1, 0.1, 3.0)))))
    robot = load_scene_robot(scene)
    assert ("lump", "rod") in robot.self_pairs
    q = np.zeros(robot.n)
    assert {"lump", "rod"} in [{hit.link, hit.other} for hit in check_configuration(scene, robot, q)]
    apart = replace(scene, attached=(replace(rod, touch_links=("lump",)), scene.attached[1]))
    hits = check_configuration(apart, load_scene_robot(apart), q)
    assert {"lump", "rod"} not in [{hit.link, hit.other} for hit in hits]


def test_a_robot_that_does_not_hold_it_proves_nothing(carry: Scene) -> None:
    alone = replace(carry, attached=())
    with pytest.raises(InputError, match="does not hold what the scene attaches"):
        Certifier(Setup.of(carry, load_scene_robot(alone)))
    with pytest.raises(InputError, match="does not hold what the scene attaches"):
        Certifier(Setup.of(alone, load_scene_robot(carry)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"link": "panda_hnad"}, r"attached\.thing\.link: unknown link 'panda_hnad' \(did you mean 'panda_hand'"),
        ({"touch_links": ("finger",)}, r"attached\.thing\.touch_links: unknown link 'finger'"),
        ({"name": "panda_link3"}, r"attached\.panda_link3: the name 'panda_link3' is taken by a link of panda"),
        ({"shape": Points(np.diag([1, 1, 1e-8, 0])[:, :3])}, r"attached\.thing\.shape\.points: are flat"),
        ({"shape": Mesh(Path("flat.stl"))}, r"attached\.thing: mesh .*flat\.stl: "),
    ],
)
def test_bad_input_is_refused_by_name(carry: Scene, change: dict[str, object], message: str) -> None:
    held = replace(Attached("thing", "panda_hand", Sphere(0.1)), **change)
    scene = replace(carry, attached=(held,))
    with pytest.raises(InputError, match=message) as caught:
        load_scene_robot(scene)
    assert str(caught.value).startswith("the scene made from panda_carry: ")
    assert "\n" not in str(caught.value)


def test_a_changed_mesh_is_read_again(carry: Scene, tmp_path: Path) -> None:
    scene = holding(carry, SHAPES[-1], tmp_path)
    first = load_scene_robot(scene)
    assert load_scene_robot(scene) is first
    trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / "bent.obj")
    assert load_scene_robot(scene) is not first


def test_a_held_object_is_explained_and_drawn(carry: Scene) -> None:

    problem = build(carry)
    ((name, text),) = explain(problem)["held objects"]
    assert name == "bottle"
    assert text.startswith("cylinder, radius 0.03 m, length 0.26 m, held by panda_hand, may touch panda_leftfinger")
    assert "1 held object" in dict(explain(problem)["scene"])["outer bodies"]
    robot = load_scene_robot(carry)
    (skin,) = (skin for skin in visual_skins(robot, carry.robot)[0] if skin.link == "bottle")
    assert (skin.joint, skin.color) == (robot.link_joint["bottle"], HELD)
    motion = plan(carry).trajectory
    shown, without = (Picture.of(Setup.of(each), motion) for each in (carry, replace(carry, attached=())))
    assert shown.tip_link == "bottle"
    assert len(shown.solids) - len(without.solids) == 5, "at start, at goal and three times between"
