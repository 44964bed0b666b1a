"""Link bodies contain the collision geometry, stand out little from its hull, and come back from the cache."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import nnls
from scipy.spatial import ConvexHull

from hdplan.distance.compiled import cache
from hdplan.planner.collision import collision_model, link_bodies as module, separation_bounds
from hdplan.planner.collision.descent import minimized
from hdplan.planner.collision.hull_distance import distance_to_hull
from hdplan.planner.collision.link_bodies import LinkBody, contains, enclosed, fit_report, link_bodies, link_triangles
from hdplan.planner.collision.link_fit import fitted
from hdplan.planner.collision.shipped_bodies import ROBOTS
from hdplan.planner.collision.sphere_swept_fit import Swept, Target, finished, rough_fits
from hdplan.planner.collision.standing_out import outside
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.scenes.planner_settings import LINK_BODIES
from hdplan.scenes.poses import Pose
from hdplan.scenes.progress import listening
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.yaml_format.reader import load_scene
from tests.loops import needs_loops

from ..urdf import joint_text, link_text, write_robot

QUICK = ("panda", "kinova", "panda_collision")  # the others, as long each, are left to the slow run
MEAN, P95 = 0.010, 0.020  # how far Panda's bodies may stand out of its links' hulls [m]
ROUNDING = 1e-9  # [m]


@pytest.fixture(scope="module", autouse=True)
def _fitted_once(tmp_path_factory: pytest.TempPathFactory) -> object:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HDPLAN_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def panda() -> Robot:
    return load_robot(RobotSpec(name="panda"))


def _surface(item: pin.GeometryObject, count: int, random: np.random.Generator) -> np.ndarray:
    """Return corners and random points of a geometry's surface, in its joint's frame, without the fit's code."""
    shape = item.geometry
    if isinstance(shape, coal.BVHModelBase):
        vertices = np.array(shape.vertices())
        chosen = random.integers(shape.num_tris, size=count)
        faces = [shape.tri_indices(int(index)) for index in chosen]
        corners = vertices[[[face[k] for k in range(3)] for face in faces]]
        points = np.concatenate([vertices, np.einsum("nk,nkc->nc", random.dirichlet((1, 1, 1), count), corners)])
    elif isinstance(shape, coal.Box):
        corners = np.array(list(itertools.product((-1.0, 1.0), repeat=3))) * shape.halfSide
        points = np.concatenate([corners, random.dirichlet(np.ones(8), count) @ corners])
    elif isinstance(shape, coal.Cylinder):
        angle, height = random.uniform(0, 2 * np.pi, count), random.choice([-1.0, 1.0], count) * shape.halfLength
        points = np.stack([shape.radius * np.cos(angle), shape.radius * np.sin(angle), height], 1)
    else:
        assert isinstance(shape, coal.Sphere)
        points = random.normal(size=(count, 3))
        points *= shape.radius / np.linalg.norm(points, axis=1, keepdims=True)
    return points @ item.placement.rotation.T + item.placement.translation


def _inside(bodies: list[LinkBody], points: np.ndarray) -> np.ndarray:
    return np.any([distance_to_hull(points, b.body.vertices)[0] <= b.body.radius + ROUNDING for b in bodies], axis=0)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", [*ROBOTS, "panda_collision", pytest.param("talos_left_arm", marks=pytest.mark.slow)])
def test_bodies_contain_the_collision_geometry(name: str) -> None:
    robot, random = load_robot(RobotSpec(name=name)), np.random.default_rng(0)
    bodies = link_bodies(robot)
    assert {body.link for body in bodies} == set(robot.links)
    assert all(1 <= len(body.body.vertices) <= 6 and body.joint == robot.link_joint[body.link] for body in bodies)
    for link in robot.links:
        own = [body for body in bodies if body.link == link]
        for index in robot.link_geometry[link]:
            points = _surface(robot.collision.geometryObjects[index], 500, random)
            assert np.all(_inside(own, points)), link
    assert all(row.contained for row in fit_report(robot))  # the proof, triangle by triangle


@pytest.mark.parametrize("geometry", [word for word in LINK_BODIES if word not in ("fitted", "hull")])
@pytest.mark.parametrize("name", ["planar_arm", pytest.param("panda", marks=pytest.mark.slow)])
def test_every_other_geometry_contains_the_links_too(name: str, geometry: str) -> None:
    robot = load_scene_robot(load_scene("planar_arm")) if name == "planar_arm" else load_robot(RobotSpec(name=name))
    for link in robot.links:
        bodies = enclosed(robot, link, geometry)
        assert (
            sum(len(body.vertices) for body in bodies)
            == {"capsule": 2, "outer-4": 4, "outer-12": 12, "box": 8}[geometry]
        )
        assert contains(bodies, link_triangles(robot, link)), (link, geometry)


def test_the_hull_is_the_links_own(panda: Robot) -> None:
    """Every corner of the mesh lies behind the planes of the hull, and every corner of the hull is one of the mesh."""
    bodies = {body.link: body for body in link_bodies(panda, "hull")}
    random = np.random.default_rng(0)
    for link in panda.links:
        points = np.concatenate(
            [_surface(panda.collision.geometryObjects[i], 10, random) for i in panda.link_geometry[link]]
        )
        hull = bodies[link].body
        planes = ConvexHull(hull.vertices).equations
        assert np.all(planes[:, :3] @ points.T + planes[:, 3:] <= hull.radius)
        assert np.linalg.norm(hull.vertices[:, None] - points, axis=2).min(axis=1).max() < ROUNDING


def test_pandas_bodies_are_few_and_stand_out_little(panda: Robot) -> None:
    rows = fit_report(panda)
    for row in rows:
        assert row.mean_outside <= MEAN, row
        assert row.p95_outside <= P95, row
        assert row.volume_ratio >= 1.0
    assert sum(row.bodies for row in rows) <= 30


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ROBOTS)
def test_the_links_of_well_known_arms_come_fitted(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "load", None)  # neither the cache nor a fit is used
    monkeypatch.setattr(module, "_around", None)
    assert link_bodies(load_robot(RobotSpec(name=name)))


@needs_loops  # the twins search in another order, and stop at other bounds
@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ROBOTS)
def test_results_for_an_arm_are_shipped(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The shipped result is the one found now: run benchmarks/shipped_bodies.py after a change of it."""
    arm, computed = load_robot(RobotSpec(name=name)), list[object]()
    monkeypatch.setenv("HDPLAN_CACHE", str(tmp_path / "empty"))
    for room in (collision_model, separation_bounds):
        monkeypatch.setattr(room, "store", lambda kind, key, value: computed.append((kind, key)))
    make = collision_model.collision_model_of.__wrapped__  # type: ignore[attr-defined]
    shipped = make(arm, "fitted", "box")
    assert computed == []
    for room in (collision_model, separation_bounds):
        monkeypatch.setattr(room, "known_result", lambda kind, key, read: None)
    now = make(arm, "fitted", "box")
    assert (shipped.self_pairs, shipped.unresolved) == (now.self_pairs, now.unresolved)
    np.testing.assert_allclose(shipped.distances_kept, now.distances_kept, rtol=0, atol=1e-6)


def test_a_new_fit_is_as_tight_as_the_shipped_one(panda: Robot) -> None:
    """The average over the links counts, and each link's geometry is contained."""
    tightness = []
    for link in panda.links:
        triangles = link_triangles(panda, link)
        shipped, now = enclosed(panda, link), fitted(triangles)
        assert contains(now, triangles)
        corners = triangles.reshape(-1, 3)
        hull = corners[ConvexHull(corners).vertices]
        tightness.append([outside(bodies, hull, samples=2000) for bodies in (shipped, now)])
    shipped, now = np.array(tightness).mean(axis=0)
    assert np.all(now <= 1.1 * shipped), (shipped, now)


def test_bodies_move_with_locked_joints(panda: Robot) -> None:
    fingers = {"panda_finger_joint1": 0.065, "panda_finger_joint2": 0.02}
    opened = link_bodies(load_robot(RobotSpec(name="panda", locked=fingers, base=Pose((1.0, 2.0, 3.0)))))
    closed = {body.link: body.body.vertices for body in link_bodies(panda)}
    moved = {body.link: body.body.vertices for body in opened}
    for link, travel in (("panda_leftfinger", 0.064), ("panda_rightfinger", 0.019)):
        np.testing.assert_allclose(np.linalg.norm(moved[link] - closed[link], axis=1), travel, atol=1e-7)
    np.testing.assert_allclose(moved["panda_link0"], closed["panda_link0"] + [1.0, 2.0, 3.0], atol=1e-7)


def _arm(folder: Path, name: str, upper: dict[str, Any], fore: dict[str, Any]) -> Robot:
    """An arm of two links, each with a geometry."""
    links = link_text("base"), link_text("upper", at="0.2 0 0", **upper), link_text("fore", at="0.2 0 0", **fore)
    joints = (
        joint_text("upper_joint", "base", "upper", at="0.5 0 0"),
        joint_text("fore_joint", "upper", "fore", at="0.5 0 0"),
    )
    return load_robot(RobotSpec(urdf=write_robot(folder / f"{name}.urdf", *links, *joints)))


def test_of_a_robot_of_which_one_link_changed_one_link_is_fitted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HDPLAN_CACHE", str(tmp_path / "cache"))
    box, rod, ball = {"box": "0.4 0.1 0.1"}, {"cylinder": (0.05, 0.3)}, {"sphere": 0.1}
    notes: list[str] = []
    with listening(notes.append):
        first = link_bodies(_arm(tmp_path, "first", box, rod))
        assert [line.split(",")[0] for line in notes] == ["fitting bodies to upper", "fitting bodies to fore"]
        notes.clear()
        changed = link_bodies(_arm(tmp_path, "second", box, ball))
        assert notes == ["fitting bodies to fore, link 2 of 2 of second"]
        notes.clear()
        again = link_bodies(_arm(tmp_path, "third", box, rod))  # by content: whatever the robot's name
        assert notes == []
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a.body.vertices, b.body.vertices)
        assert a.body.radius == b.body.radius
    np.testing.assert_array_equal(first[0].body.vertices, changed[0].body.vertices)


CUBE = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))


def hull(points: np.ndarray) -> np.ndarray:
    return points[ConvexHull(points).simplices]


def _shapes(random: np.random.Generator) -> dict[str, np.ndarray]:
    """Triangles (T, 3, 3) of what links can look like."""
    ball = random.normal(size=(300, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)

    bent = np.concatenate([hull(CUBE * [0.3, 0.04, 0.04]), hull(CUBE * [0.04, 0.2, 0.04] + [0.3, 0.2, 0.0])])
    return {
        "plate": hull(CUBE * [0.3, 0.2, 0.002]),
        "needle": hull(CUBE * [0.5, 0.001, 0.001]),
        "tower": hull(CUBE * [0.2, 0.2, 1.5]),
        "pebble": hull(0.003 * ball),
        "egg": hull(ball * [0.1, 0.1, 0.2] + 5.0),
        "elbow": bent,
        "apart": np.concatenate([hull(0.05 * ball), hull(0.05 * ball + [0.6, 0.1, 0.0])]),
        "open": hull(0.2 * ball)[:150],
        "soup": random.uniform(-0.2, 0.2, (60, 3, 3)),
    }


def test_bodies_contain_whatever_a_link_looks_like_and_are_the_same_again() -> None:
    for name, triangles in _shapes(np.random.default_rng(0)).items():
        bodies = fitted(triangles)
        assert contains(bodies, triangles), name
        assert all(len(body.vertices) <= 6 for body in bodies)
        assert len(bodies) <= 3
    for body, other in zip(bodies, fitted(triangles), strict=True):  # of the last one
        np.testing.assert_array_equal(body.vertices, other.vertices)


IN_PARTS = {
    "tetrahedron": hull(0.3 * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])),
    "far apart": np.concatenate([hull(CUBE * 0.1 + [x, 0.0, 0.0]) for x in (-0.9, 0.9)]),
    "at a cut": np.concatenate([hull(CUBE * [0.1, 0.2, 0.2]), hull(CUBE * [0.05, 0.2, 0.2] + [0.45, 0.0, 0.0])]),
    "sheets": np.concatenate([hull(0.05 * CUBE), 0.1 * hull(CUBE)[:2] + [0.5, 0.0, 0.0]]),
}


@pytest.mark.parametrize("name", IN_PARTS)
def test_a_slab_may_hold_nothing_or_fewer_corners_than_a_body_has(name: str) -> None:
    triangles = IN_PARTS[name]
    assert contains(fitted(triangles, ((3, 6),)), triangles)


# --- the parts --------------------------------------------------------------------------------------------------------


def _distance_by_least_squares(point: np.ndarray, vertices: np.ndarray) -> float:
    heavy = 1e6  # weight on the sum of the shares being 1
    system = np.vstack([vertices.T, heavy * np.ones(len(vertices))])
    share = nnls(system, np.append(point, heavy))[0]
    return float(np.linalg.norm(share / share.sum() @ vertices - point))


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 6])
def test_distance_to_a_small_hull(count: int) -> None:
    random = np.random.default_rng(count)
    vertices, points = random.normal(size=(count, 3)), 2 * random.normal(size=(40, 3))
    distance, weights = distance_to_hull(points, vertices)
    np.testing.assert_allclose(weights.sum(1), 1.0, atol=1e-12)
    assert np.all(weights >= 0)
    np.testing.assert_allclose(np.linalg.norm(weights @ vertices - points, axis=1), distance, atol=1e-12)
    expected = [_distance_by_least_squares(point, vertices) for point in points]
    np.testing.assert_allclose(distance, expected, atol=1e-5)
    np.testing.assert_allclose(distance_to_hull(vertices, vertices)[0], 0.0, atol=1e-9)


def test_flat_and_repeated_vertices_do_no_harm() -> None:
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0], [0.5, 0.5, 0]])
    points = np.array([[0.5, 0.25, 0.3], [2.0, 0.5, 0.0], [-3.0, -4.0, 0.0]])
    np.testing.assert_allclose(distance_to_hull(points, flat)[0], [0.3, 1.0, 5.0], atol=1e-9)


@pytest.mark.parametrize("count", [2, 4, 6])
def test_distances_to_many_hulls_at_once_are_those_one_by_one(count: int) -> None:
    random = np.random.default_rng(count)
    vertices, points = random.normal(size=(5, count, 3)), 2 * random.normal(size=(5, 400, 3))
    distance, weights = distance_to_hull(points, vertices)
    for row in range(5):
        alone = distance_to_hull(points[row], vertices[row])
        np.testing.assert_allclose(distance[row], alone[0], atol=1e-12)
        np.testing.assert_allclose(weights[row], alone[1], atol=1e-9)


def test_many_bowls_are_descended_side_by_side() -> None:
    random = np.random.default_rng(0)
    low, bent = random.normal(size=(7, 4)), random.uniform(0.1, 30.0, (7, 4))
    calls = []

    def bowls(x: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        calls.append(len(rows))
        away = x - low[rows]
        return (bent[rows] * away**2).sum(1) + 1.0, 2 * bent[rows] * away

    start = random.normal(size=(7, 4))
    ends = minimized(bowls, start, 100)
    everyone = np.arange(7)
    assert np.all(bowls(ends, everyone)[0] <= 1.03)
    assert min(calls) < 7  # who has arrived waits for nobody
    alone = minimized(lambda x, rows: bowls(x, everyone[3:4]), start[3:4], 100)
    np.testing.assert_allclose(alone[0], ends[3], atol=1e-9)


def test_a_capsule_is_found_again() -> None:
    random = np.random.default_rng(0)
    directions = random.normal(size=(400, 3))
    directions *= 0.05 / np.linalg.norm(directions, axis=1, keepdims=True)
    points = directions + random.choice([-0.1, 0.1], 400)[:, None] * [0.6, 0.0, 0.8]
    target = Target.of(points, points)
    (body,) = finished([target], rough_fits([target], 2))
    assert np.all(distance_to_hull(points, body.vertices)[0] <= body.radius)
    assert body.radius == pytest.approx(0.05, abs=1e-3)
    assert np.linalg.norm(body.vertices[0] - body.vertices[1]) == pytest.approx(0.2, abs=5e-3)


def test_the_measure_of_a_sphere_that_stands_out_of_a_cube() -> None:
    sphere = Swept(np.zeros((1, 3)), np.sqrt(3.0))
    mean, p95 = outside((sphere,), CUBE, samples=20000)
    random = np.random.default_rng(1)
    points = random.normal(size=(200000, 3))
    points *= np.sqrt(3.0) / np.linalg.norm(points, axis=1, keepdims=True)
    expected = np.linalg.norm(np.maximum(np.abs(points) - 1.0, 0.0), axis=1)
    assert mean == pytest.approx(expected.mean(), rel=0.01)
    assert p95 == pytest.approx(np.quantile(expected, 0.95), rel=0.01)


def test_containment_is_refused_where_a_corner_or_a_middle_sticks_out() -> None:
    triangles = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    ends = [Swept(np.array([point]), 0.4) for point in triangles[0]]
    assert not contains(tuple(ends), triangles)
    assert not contains((Swept(triangles[0][:2], 0.9),), triangles)
    assert contains((Swept(triangles[0][:2], 1.0),), triangles)
    assert contains(
        (Swept(np.array([[0.0, 0, 0], [0.6, 0, 0]]), 0.61), Swept(np.array([[0.0, 0.5, 0]]), 0.75)), triangles
    )


def test_a_kept_result_of_another_kind_is_computed_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A right checksum makes no difference."""
    monkeypatch.setenv("HDPLAN_CACHE", str(tmp_path / "cache"))
    links = link_text("base", box="0.3 0.3 0.3"), link_text("upper", at="0.2 0 0", box="0.4 0.1 0.1")
    joints = joint_text("first", "base", "upper", at="0.5 0 0"), joint_text("second", "upper", "fore", at="0.5 0 0")
    arm = write_robot(tmp_path / "arm.urdf", *links, link_text("fore", at="0.2 0 0", sphere=0.1), *joints)
    robot, make = load_robot(RobotSpec(urdf=arm)), collision_model.collision_model_of.__wrapped__  # type: ignore[attr-defined]
    first = make(robot, "fitted", "box")
    kept = {file: file.read_text() for file in (tmp_path / "cache").glob("*/*.json")}
    kinds = {file.parent.name: file for file in kept}
    assert {"overlaps", "separation", "link_bodies", "link_parts", "convex_bodies"} <= kinds.keys()
    for own, other in itertools.permutations(kinds.values(), 2):
        content = kept[other].partition("\n")[2]
        if content == "[]":  # parts, too, may be none
            continue
        own.write_text(f"{cache.content_key(own.parent.name, own.stem, content)}\n{content}")
        again = make(robot, "fitted", "box")
        assert (again.self_pairs, again.distances_kept) == (first.self_pairs, first.distances_kept)
        for one, two in zip((*again.bodies, *again.parts), (*first.bodies, *first.parts), strict=True):
            np.testing.assert_array_equal(one.body.vertices, two.body.vertices)
        assert own.read_text() == kept[own]


def test_a_cache_that_is_damaged_or_cannot_be_written_is_no_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HDPLAN_CACHE", str(tmp_path / "cache"))
    key = cache.content_key("a", b"b")
    assert key != cache.content_key("ab", b"")
    assert cache.load("kind", key, lambda value: value) is None
    cache.store("kind", key, [0.1, {"x": None}])
    assert cache.load("kind", key, lambda value: value) == [0.1, {"x": None}]
    (file,) = (tmp_path / "cache" / "kind").iterdir()
    file.with_name("other.json").write_text(file.read_text())
    assert cache.load("kind", "other", lambda value: value) is None
    file.write_text(file.read_text().replace("0.1", "0.2"))
    assert cache.load("kind", key, lambda value: value) is None
    file.write_bytes(b"\xff\xfe")
    assert cache.load("kind", key, lambda value: value) is None
    for planted in ("[null]", "[NaN]", "1" + 400 * "0", 10**5 * "["):  # under a checksum of its own
        file.write_text(f"{cache.content_key('kind', key, planted)}\n{planted}")
        assert cache.load("kind", key, cache.finite) is None
    monkeypatch.setenv("HDPLAN_CACHE", str(file))  # a file where a folder should be
    with pytest.warns(UserWarning, match=f"the cache {file} cannot be written"):
        cache.store("kind", key, 1)
    cache.store("kind", key, 1)  # one warning
    assert cache.load("kind", key, lambda value: value) is None
