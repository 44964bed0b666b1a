"""Pairs of links that are proven always to touch do, at every configuration that is tried; what is only sampled is
checked, and named."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import coal
import numpy as np
import pytest
import trimesh

import hdplan
from hdplan import Robot, RobotSpec, Scene, load_robot
from hdplan.distance.compiled.cache import content_key
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.geometry.coal_shapes import triangle_tree
from hdplan.planner.geometry.meshes import TriangleMesh
from hdplan.planner.robot import lasting_contacts
from hdplan.planner.robot.always_touching import _balls, _distance, always_touching
from hdplan.planner.robot.self_pairs import ALWAYS_TOUCHING, LIMIT_EXCESS
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.robot_files.link_pairs import link_pair

from ..urdf import joint_text, link_text, write_robot

SHAPES = (
    "<sphere radius='{a}'/>",
    "<box size='{a} {b} {c}'/>",
    "<cylinder radius='{a}' length='{b}'/>",
    "<capsule radius='{a}' length='{b}'/>",
    "<ellipsoid radii='{a} {b} {c}'/>",
    "<mesh filename='{mesh}' scale='{a} {b} {c}'/>",
)


def random_arm(rng: np.random.Generator, folder: Path) -> Robot:
    """Fat links with short steps between them, so that many touch wherever they turn."""
    count, parts = int(rng.integers(3, 6)), []
    for i in range(count):
        a, b, c = rng.uniform(0.1, 0.5, 3)
        shape = str(rng.choice(SHAPES)).format(a=a, b=b, c=c, mesh=folder / str(rng.choice(["ball.stl", "ring.stl"])))
        x, y, z = rng.normal(size=3) * 0.05
        parts.append(
            f"<link name='l{i}'><collision><origin xyz='{x} {y} {z}'/><geometry>{shape}</geometry></collision></link>"
        )
    for i in range(1, count):
        kind = rng.choice(["revolute", "revolute", "prismatic", "continuous"])
        (x, y, z), (u, v, w) = rng.normal(size=3) * 0.06, rng.normal(size=3)
        parts.append(
            f"<joint name='j{i}' type='{kind}'><parent link='l{max(0, i - int(rng.integers(1, 3)))}'/>"
            f"<child link='l{i}'/><origin xyz='{x} {y} {z}' rpy='{u} {v} {w}'/><axis xyz='{v} {w} {u}'/>"
            f"<limit lower='-{rng.uniform(0, 0.2)}' upper='{rng.uniform(0, 0.2)}' velocity='1' effort='1'/></joint>"
        )
    (folder / "arm.urdf").write_text(f"<robot name='arm'>{''.join(parts)}</robot>")
    return load_robot(RobotSpec(urdf=folder / "arm.urdf"))


@pytest.mark.parametrize("arms", [6, pytest.param(80, marks=pytest.mark.slow)])
def test_pairs_that_are_proven_always_to_touch_do(arms: int, tmp_path: Path) -> None:
    """Random configurations and corners are tried, up to LIMIT_EXCESS beyond the limits; the rest is checked."""
    trimesh.creation.icosphere(1, 1.0).export(tmp_path / "ball.stl")
    trimesh.creation.torus(1.0, 0.4, 8, 6).export(tmp_path / "ring.stl")
    rng, seen, doubtful = np.random.default_rng(4), 0, 0
    for _ in range(arms):
        robot = random_arm(rng, tmp_path)
        always = {pair for pair, reason in robot.unchecked.items() if reason == ALWAYS_TOUCHING}
        assert set(robot.doubtful) <= set(robot.self_pairs)
        seen, doubtful = seen + len(always), doubtful + len(robot.doubtful)
        low, high = np.maximum(robot.lower, -math.pi), np.minimum(robot.upper, math.pi)
        samples = rng.uniform(low - LIMIT_EXCESS, high + LIMIT_EXCESS, (6, robot.n))
        samples[:3] = np.where(rng.uniform(size=(3, robot.n)) < 0.5, low - LIMIT_EXCESS, high + LIMIT_EXCESS)
        if not always:
            continue
        left = {pair: reason for pair, reason in robot.unchecked.items() if pair not in always}
        checked = replace(robot, self_pairs=(*robot.self_pairs, *always), unchecked=left)
        rest = np.clip(np.zeros(robot.n), robot.lower, robot.upper).tolist()
        scene = Scene(robot=RobotSpec(urdf=tmp_path / "arm.urdf"), start=rest, goal=rest)
        certifier = Certifier(Setup.of(scene, checked))
        for q in samples:
            assert always <= {link_pair(each.link, each.other) for each in certifier.contacts(q)}
    assert seen > arms / 2
    assert doubtful < seen


def test_distances_from_triangles_are_coals() -> None:
    rng = np.random.default_rng(0)
    ring = trimesh.creation.torus(1.0, 0.4, 12, 8)
    mesh = TriangleMesh.merged(ring.vertices, ring.faces)
    tree = triangle_tree(mesh)
    for point in rng.normal(size=(200, 3)):
        place, result = coal.Transform3s(np.eye(3), point), coal.DistanceResult()
        expected = coal.distance(tree, coal.Transform3s(), coal.Sphere(1e-9), place, coal.DistanceRequest(), result)
        assert _distance(point, mesh.vertices[mesh.triangles]) == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize(
    "shape",
    [coal.Box(0.2, 0.4, 1.0), coal.Sphere(0.3), coal.Ellipsoid(0.1, 0.2, 0.6), coal.Cylinder(0.2, 0.9)]
    + [coal.Capsule(0.2, 0.6)],
    ids=lambda shape: type(shape).__name__,
)
def test_balls_lie_inside(shape: coal.ShapeBase) -> None:
    """Points on their surfaces are inside the shape, as coal finds."""
    rng = np.random.default_rng(1)
    centres, radii = _balls(shape, True)
    assert len(radii) > 3
    for centre, radius in zip(centres, radii, strict=True):
        for direction in rng.normal(size=(5, 3)):
            at = centre + radius * direction / np.linalg.norm(direction)
            place, result = coal.Transform3s(np.eye(3), at), coal.CollisionResult()
            assert coal.collide(shape, coal.Transform3s(), coal.Sphere(1e-9), place, coal.CollisionRequest(), result)


def test_a_pair_that_is_only_sampled_fails_with_its_name_and_the_remedy(tmp_path: Path) -> None:
    """Two shells without an inside that always cross."""
    half = trimesh.creation.icosphere(3, 0.3)
    half.update_faces(half.triangles_center[:, 2] > 0.0)
    half.export(tmp_path / "bowl.stl")
    links = link_text("base", mesh="bowl.stl"), link_text("between"), link_text("tip", mesh="bowl.stl")
    joints = joint_text("a", "base", "between", at=".1 0 0"), joint_text("b", "between", "tip", at=".1 0 0")
    spec = RobotSpec(urdf=write_robot(tmp_path / "bowls.urdf", *links, *joints))
    robot = load_robot(spec)
    assert robot.doubtful == robot.self_pairs == (("base", "tip"),)
    assert any("each of 1000 sampled configurations, which is not a proof" in note for note in robot.notes)
    with pytest.raises(hdplan.InputError, match=r"links base and tip touch at each of 1000 .* robot\.ignore_pairs"):
        hdplan.plan(Scene(robot=spec, start=[0.0, 0.0], goal=[0.5, 0.5]))
    allowed = RobotSpec(urdf=spec.urdf, ignore_pairs=[("base", "tip")])
    assert hdplan.plan(Scene(robot=allowed, start=[0.0, 0.0], goal=[0.5, 0.5])).certificate.certified


def kept_robot(folder: Path, axis: str = "0 .6 .8") -> Robot:
    """Two links that touch always, a third that does in most places."""
    links = (link_text(f"l{i}", sphere=radius) for i, radius in enumerate((0.2, 0.01, 0.2, 0.1)))
    joints = (joint_text(f"j{i}", f"l{i - 1}", f"l{i}", axis, at=f"0.0{i} 0 0") for i in (1, 2, 3))
    return load_robot(RobotSpec(urdf=write_robot(folder / "kept.urdf", *links, *joints)))


def test_a_proven_contact_is_kept_and_a_damaged_entry_is_not_believed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whole, the entry is read instead of proven again; cut anywhere, changed, or of another structure under a checksum
    of its own, it is as if it were not there."""
    monkeypatch.setenv("HDPLAN_CACHE", str(tmp_path / "cache"))
    proofs = []

    def counted(*args: object) -> tuple[tuple[str, str], ...]:
        proofs.append(args)
        return always_touching(*args)

    monkeypatch.setattr(lasting_contacts, "always_touching", counted)
    first = kept_robot(tmp_path)
    assert ("l0", "l2") in first.unchecked
    (entry,) = (tmp_path / "cache" / "lasting_contacts").iterdir()
    whole = entry.read_bytes()
    assert len(proofs) == 1
    assert kept_robot(tmp_path).unchecked == first.unchecked
    assert len(proofs) == 1
    cut = [whole[: len(whole) // 2], whole[:-1], b"", whole.replace(b"l0", b"l1"), whole + b" "]
    others = ["[]", "5", "null", '{"a": 1}', "[[5], []]", '[[["l0"]], []]', '[[[["l0"], "l2"]], []]']
    planted = [f"{content_key('lasting_contacts', entry.stem, other)}\n{other}".encode() for other in others]
    for count, damaged in enumerate([*cut, *planted], start=2):
        entry.write_bytes(damaged)
        assert kept_robot(tmp_path).unchecked == first.unchecked
        assert len(proofs) == count
        assert entry.read_bytes() == whole


def test_an_entry_is_of_one_robot_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Everything that the result follows from enters its key: each change of it makes an entry of its own."""
    monkeypatch.setenv("HDPLAN_CACHE", str(tmp_path / "cache"))
    ring, ball = trimesh.creation.torus(1.0, 0.4, 8, 6), trimesh.creation.icosphere(1, 1.0)
    ring.export(tmp_path / "a.stl")
    kept_robot(tmp_path)
    text = (tmp_path / "kept.urdf").read_text()
    mesh = text.replace('<sphere radius="0.01"/>', '<mesh filename="a.stl" scale=".01 .01 .01"/>')
    changes = [
        text.replace('radius="0.01"', 'radius="0.02"'),
        text.replace("0.02 0 0", "0.02 0 1e-9"),
        text.replace("0 .6 .8", "0 .8 .6", 1),
        text.replace('upper="1.0"', 'upper="1.5"', 1),
        text.replace('<origin xyz="0 0 0"', '<origin xyz="0 0 1e-9"', 1),
        *[mesh] * 2,
    ]
    for count, changed in enumerate(changes, start=2):
        if count == len(changes) + 1:
            ball.export(tmp_path / "a.stl")
        (tmp_path / "kept.urdf").write_text(changed)
        load_robot(RobotSpec(urdf=tmp_path / "kept.urdf"))
        assert len([*(tmp_path / "cache" / "lasting_contacts").iterdir()]) == count, changed
