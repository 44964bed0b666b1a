"""Laws of what a camera saw: the checker reads images and points itself, as hdplan does and as the definition says, and
no proof leaves out a ball that the scene does not."""

from __future__ import annotations

import hashlib
import io
import json
import shutil
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pytest
import yaml

import hdplan
from hdplan.planner.geometry.clouds import balls_in, read_cloud
from hdplan.planner.job.places import link_pose
from hdplan.planner.job.proof import prove_job
from hdplan.planner.proof.world import world_of
from hdplan.scenes.yaml_format.reader import shipped_scenes
from hdplan.verify import scene as hulls
from hdplan.verify.balls import RejectedError, rejecting
from hdplan.verify.checking import check
from hdplan.verify.compare import check_equal, plain
from hdplan.verify.images import table
from hdplan.verify.left_out import _near
from hdplan.verify.reading import read_world
from hdplan.verify.seen import balls_of
from hdplan.verify.text import Files

from ..job.forging import written
from .test_verify_meaning import MOTION, SCENE, URDF, files
from .worlds import packed, saved, unpacked

CAMERA = [40.0, 37.5, 12.0, 7.0]
SHAPE = (16, 25)


def image(rng: np.random.Generator) -> Any:
    """Walls and steps in whole millimetres, and pixels that saw nothing, each in its own way."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    slope = rng.integers(-40, 40, 2)
    found = 900.0 + slope[0] * abs(u - 12) + slope[1] * abs(v - 7) + rng.integers(0, 3, SHAPE)
    found[rng.random(SHAPE) < 0.1] += rng.integers(100, 900)
    for wrong in (0.0, np.nan, np.inf, -np.inf, -900.0, 1e-300, 99.0, 100.0, 3000.0, 3001.0, 1e300):
        found[rng.random(SHAPE) < 0.01] = wrong
    return found


def files_of(depth: Any, folder: Path) -> list[Path]:
    np.save(folder / "a.npy", depth)
    np.save(folder / "b.npy", np.asfortranarray(depth))
    np.savez(folder / "c.npz", depth=depth, color=np.zeros((3, 3)))
    np.savez_compressed(folder / "d.npz", any=depth.astype(">f8"))
    return [folder / name for name in ("a.npy", "b.npy", "c.npz", "d.npz")]


@pytest.mark.parametrize("seed", range(8))
def test_balls_are_those_of_the_planner_and_of_the_definition(seed: int, tmp_path: Path) -> None:
    depth = image(np.random.default_rng(seed))
    more = {"scale": 0.001, "range": [0.1, 3.0]} if seed % 2 else {}
    section = {"intrinsics": CAMERA, "radius": 0.002 * (seed % 3), **more}
    planned = balls_in(read_cloud(hdplan.Cloud(hdplan.DepthImage(depth, CAMERA), section["radius"]), "")).array
    for file in files_of(depth, tmp_path):
        found = balls_of("depth", {"file": file.name, **section}, "a", tmp_path, Files())
        assert found is not None
        np.testing.assert_allclose(found[0].mid, planned[:, :3], rtol=0, atol=1e-14)
        np.testing.assert_allclose(found[1], planned[:, 3], rtol=1e-11)
        assert (found[1] >= planned[:, 3] * (1 - 2e-12)).all()
        assert found[0].rad.max() < 1e-14
    with np.errstate(invalid="ignore"):
        seen = np.isfinite(depth) & (depth >= 100) & (depth <= 3000)
    assert len(planned) == seen.sum()
    for (v, u), ball in zip(np.argwhere(seen)[::7], planned[::7], strict=True):

        def place(v: int, u: int) -> Any:
            z = depth[v, u] / 1000
            return np.array([(u - CAMERA[2]) * z / CAMERA[0], (v - CAMERA[3]) * z / CAMERA[1], z])

        def way(dv: int, du: int, v: int = v, u: int = u) -> Any:
            there = v + dv, u + du
            if not (0 <= there[0] < SHAPE[0] and 0 <= there[1] < SHAPE[1] and seen[there]):
                return None
            step, width = place(*there) - place(v, u), min(depth[there], depth[v, u]) / 1000 / CAMERA[abs(dv)]
            return None if abs(step[2]) > 5 * width * (1 + 1e-9) else step

        z = depth[v, u] / 1000
        rows = [x for x in (way(0, -1), way(0, 1)) if x is not None] or [np.array([z / CAMERA[0], 0, 0])]
        columns = [x for x in (way(-1, 0), way(1, 0)) if x is not None] or [np.array([0, z / CAMERA[1], 0])]
        radius = max(np.linalg.norm(a + sign * b) for a in rows for b in columns for sign in (1, -1)) / 2
        np.testing.assert_allclose(ball[:3], place(v, u), rtol=0, atol=1e-14)
        assert ball[3] == pytest.approx(radius + 0.002 * (seed % 3), rel=1e-9)


def png(values: Any, filters: Any, **changes: Any) -> bytes:
    """An image of one channel, each of its rows by a filter of its own."""
    bits = changes.get("bits", 16)
    step, rows = bits // 8, np.ascontiguousarray(values.astype(">u2" if bits == 16 else "u1")).view(np.uint8)
    rows, above, lines = rows.reshape(len(values), -1), np.zeros(rows[0].size, int), []
    for way, row in zip(filters, rows.astype(int), strict=True):
        left, corner = (np.concatenate([np.zeros(step, int), x[:-step]]) for x in (row, above))
        p = left + above - corner
        away = np.stack([abs(p - left), abs(p - above), abs(p - corner)])
        near = np.choose(away.argmin(axis=0), [left, above, corner])
        guess = [0 * row, left, above, (left + above) // 2, near][way]
        lines.append(bytes([way]) + ((row - guess) % 256).astype("u1").tobytes())
        above = row

    def chunk(kind: bytes, content: bytes) -> bytes:
        return len(content).to_bytes(4, "big") + kind + content + zlib.crc32(kind + content).to_bytes(4, "big")

    head = struct.pack(">IIBBBBB", len(values[0]), len(values), bits, *changes.get("rest", (0, 0, 0, 0)))
    stream = zlib.compress(b"".join(lines) + changes.get("more", b""))
    chunks = [chunk(b"IHDR", head), *changes.get("chunks", []), chunk(b"tEXt", b"a\0b")]
    chunks += [chunk(b"IDAT", stream[:20]), chunk(b"IDAT", stream[20:]), chunk(b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


@pytest.mark.parametrize("bits", [8, 16])
def test_images_of_every_filter_are_read(bits: int) -> None:
    pillow = pytest.importorskip("PIL.Image")
    rng = np.random.default_rng(bits)
    values = rng.integers(0, 2**bits, (20, 13))
    data = png(values, [0, 1, 2, 3, 4] * 4, bits=bits)
    np.testing.assert_array_equal(table(Path("a.png"), data, "depth"), values)
    np.testing.assert_array_equal(np.asarray(pillow.open(io.BytesIO(data))), values)


def test_files_that_are_damaged_are_rejected(tmp_path: Path) -> None:
    """Cut anywhere, with more behind, with a byte changed, or of another kind."""
    rng = np.random.default_rng(0)
    depth = rng.integers(300, 900, SHAPE).astype("u2")
    for file in files_of(depth, tmp_path)[:3]:
        table(file, file.read_bytes(), "depth")
    wrong = {"png": [png(depth, [0] * 16), png(depth, [4] * 16)]}
    wrong |= {x: [(tmp_path / f"{y}.{x}").read_bytes()] for x, y in (("npy", "a"), ("npz", "c"))}
    for kind, whole in wrong.items():
        for data in whole:
            forged = [data[:cut] for cut in (0, 5, 10, 60, len(data) // 2, len(data) - 13, len(data) - 1)]
            forged += [data + b"0"] * (kind != "npz")
            if kind != "npy":  # whose checksums are no part of it
                forged += [data[: len(data) // 3] + b"\x55\xaa" + data[len(data) // 3 + 2 :]]
            for each in forged:
                with pytest.raises(RejectedError), rejecting():
                    table(Path(f"a.{kind}"), each, "depth")
    arrays = [np.zeros((2, 2), complex), np.array([[None]]), np.array(3.0), np.zeros((0, 3)), np.zeros((2, 2, 2))]
    arrays += [np.zeros((2, 2), bool), np.array([["a"]]), np.zeros(3, "f4,f4"), np.full((2, 2), 2**60)]
    for i, array in enumerate(arrays):
        np.save(tmp_path / f"{i}.npy", array, allow_pickle=True)
        with pytest.raises(RejectedError), rejecting():
            balls_of("depth", {"file": f"{i}.npy", "intrinsics": CAMERA}, "a", tmp_path, Files())
    heads = [{"bits": 16, "rest": rest} for rest in ((2, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))]
    for change in [*heads, {"more": b"0"}, {"chunks": [b"\0\0\0\0acTL" + zlib.crc32(b"acTL").to_bytes(4, "big")]}]:
        with pytest.raises(RejectedError), rejecting():
            table(Path("a.png"), png(depth, [0] * 16, **change), "depth")
    with pytest.raises(RejectedError), rejecting():
        table(Path("a.png"), png(depth, [5] + [0] * 15), "depth")


# --- what is left out -------------------------------------------------------------------------------------------------

TURNED = hdplan.Pose.from_rpy([0.1, -0.2, 0.05], [0.3, -0.2, 0.4])
START = [-0.5, 0.3, 0.0, -1.8, 0.0, 2.1, 0.785]


def scene_of(points: Any, folder: Path, **cloud: Any) -> tuple[Path, Path, dict[str, Any]]:
    """Files of a scene with a cloud around a Panda that holds a bar, of a motion, and the planner's world."""
    np.save(folder / "points.npy", points)
    seen = hdplan.Cloud(folder / "points.npy", 0.002, name="seen", pose=TURNED, **cloud)
    can = hdplan.Cylinder(0.05, 0.2, name="can", pose=[0.5, 0.4, 0.2])
    bar = hdplan.Attached("bar", "panda_hand", hdplan.Box([0.02, 0.3, 0.02]), [0.0, 0.0, 0.15])
    scene = hdplan.Scene(robot="panda", obstacles=[can, seen], attached=[bar], start=START, goal=START)
    *files, setup, motion = saved(scene, folder)
    return *files, json.loads(json.dumps(world_of(setup, motion), default=plain))


def balls(world: dict[str, Any]) -> dict[str, Any]:
    (found,) = [x["shape"] for x in world["bodies"] if x["name"] == "seen"]
    return dict(found)


def without(world: dict[str, Any], rows: Any, points: Any = None) -> dict[str, Any]:
    """A world whose cloud has these of its balls alone, or these points."""
    own = balls(world)
    places = np.array(own["points"] if points is None else points)
    shape = {**own, "points": places[rows].tolist(), "sweep": np.array(own["sweep"])[rows].tolist()}
    shape["parts"] = [[i] for i in range(len(shape["points"]))]
    return {**world, "bodies": [{**x, "shape": shape} if x["name"] == "seen" else x for x in world["bodies"]]}


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "ignoring",
    [
        {"ignore_robot": 0.05},
        {"ignore": hdplan.Ignored(0.0, link="panda_hand")},
        {"ignore": [hdplan.Ignored(0.04, link="bar"), hdplan.Ignored(0.03, obstacle="can")]},
        {"ignore_robot": 0.001, "ignore": hdplan.Ignored(0.0, obstacle="can")},
    ],
)
def test_only_balls_that_the_planner_leaves_out_may_be_left_out(ignoring: dict[str, Any], tmp_path: Path) -> None:
    """Points in links and beside them, in a held box and in a cylinder; every other one is missed."""
    rng = np.random.default_rng(3)
    hand = np.linalg.inv(TURNED.matrix) @ link_pose(hdplan.load_robot("panda"), np.array(START), "panda_hand")[:, 3]
    points = rng.uniform([-0.6, -0.6, -0.2], [0.8, 0.8, 1.2], size=(3000, 3))
    points[::2] = hand[:3] + rng.uniform(-0.1, 0.1, size=(1500, 3))
    scene, motion, world = scene_of(points, tmp_path, **ignoring)
    count = len(balls(world)["points"])
    assert 0 < count < len(points)
    found = read_world(scene, motion, world)
    assert not found.taken
    assert sum(int(words.split(": ")[1].split()[0]) for words in found.passed) == len(points) - count
    check_equal(found.world, world)
    for rows in (np.arange(count) != 5, np.arange(count) != count - 1, np.arange(count)[::-1], [0], [0, 0]):
        with pytest.raises(RejectedError):
            read_world(scene, motion, without(world, rows))
    points = np.array(balls(world)["points"])
    for forged in (points + 1e-8, points * [1.0, 1.0, -1.0], points[:, :2], points * np.inf):
        with pytest.raises(RejectedError):
            read_world(scene, motion, without(world, ..., forged))
    for nothing in (None, {}, {"bodies": []}):  # nobody says what was left out
        with pytest.raises(RejectedError):
            read_world(scene, motion, nothing)


@pytest.mark.parametrize(
    ("kind", "sizes", "solid"),
    [
        ("box", {"size": [0.1, 0.2, 0.3]}, coal.Box(0.1, 0.2, 0.3)),
        ("sphere", {"radius": 0.1}, coal.Sphere(0.1)),
        ("cylinder", {"radius": 0.05, "length": 0.3}, coal.Cylinder(0.05, 0.3)),
        ("capsule", {"radius": 0.05, "length": 0.3}, coal.Capsule(0.05, 0.3)),
        ("ellipsoid", {"radii": [0.05, 0.1, 0.2]}, coal.Ellipsoid(0.05, 0.1, 0.2)),
    ],
)
def test_points_near_a_solid_are_those_that_coal_finds_near(kind: str, sizes: dict[str, Any], solid: Any) -> None:
    """200,000 of them take little time, but near an ellipsoid."""
    rng, here, point = np.random.default_rng(0), coal.Transform3s.Identity(), coal.Sphere(1e-12)
    points, shape = rng.uniform(-0.2, 0.2, (200_000, 3)), hulls.solid(kind, sizes)
    some = points[: 30 if kind == "ellipsoid" else 600]
    for margin in (1e-6, 0.03):
        near = _near(some if kind == "ellipsoid" else points, shape, margin, links=False)[: len(some)]
        for row, place in enumerate(some):
            at = coal.Transform3s(np.eye(3), place)
            away = coal.distance(solid, here, point, at, coal.DistanceRequest(), coal.DistanceResult()) - margin
            assert abs(away) < 1e-5 or near[row] == (away < 0)
        assert 0 < near.sum() < len(some) / 2


@pytest.mark.parametrize("open_", [False, True])
def test_a_point_that_a_mesh_surrounds_counts_as_in_it(open_: bool, tmp_path: Path) -> None:
    """A closed box holds what is far from its sides; an open one that is an obstacle only what is near them."""
    corners = [f"v {x} {y} {z}" for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    faces = ["1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"][: 5 if open_ else 6]
    (tmp_path / "box.obj").write_text("\n".join([*corners, *(f"f {x}" for x in faces), ""]))
    box = hdplan.Obstacle("box", hdplan.Mesh(tmp_path / "box.obj"), [1.0, 0.0, 0.0])
    inside, beside = [1.5, 0.5, 0.5], [1.5, 0.5, -0.05]
    seen = hdplan.Cloud([inside, beside, [3.0, 0, 0]], 0.01, name="seen", ignore=hdplan.Ignored(0.1, obstacle="box"))
    scene = hdplan.Scene(robot="panda", obstacles=[box, seen], start=START, goal=START)
    file, held, setup, motion = saved(scene, tmp_path)
    world = world_of(setup, motion)
    assert len(balls(world)["points"]) == (2 if open_ else 1)
    check_equal(read_world(file, held, world).world, world)
    if open_:
        with pytest.raises(RejectedError):
            read_world(file, held, without(world, [1]))


# --- forged scenes and images -----------------------------------------------------------------------------------------

Files3 = tuple[Path, Path, bytes]
TURN = [0.766662, 0.424921, -0.23333, -0.420986]  # of the shipped camera


@pytest.fixture(scope="module")
def proven(tmp_path_factory: pytest.TempPathFactory) -> Files3:
    """The shipped scene with a camera, its motion and its proof."""
    folder = tmp_path_factory.mktemp("seen")
    shipped = shipped_scenes()["panda_camera"]
    for file in (shipped, shipped.with_suffix(".npz")):
        shutil.copy(file, folder / file.name)
    result = hdplan.plan(hdplan.load_scene(folder / shipped.name), time_limit=120)
    assert result.certified
    result.save(folder / "motion.json")
    proof = hdplan.prove(folder / shipped.name, folder / "motion.json")
    return folder / shipped.name, folder / "motion.json", proof.data


def signed(proven: Files3, folder: Path, depth: dict[str, Any], view: dict[str, Any], change: Any = None) -> Files3:
    """The proof with the hashes of another scene and another image, of the same name."""
    scene, motion, data = proven
    content = yaml.safe_load(scene.read_text(encoding="utf-8"))
    image = np.load(scene.with_suffix(".npz"))["depth"]
    np.savez(folder / scene.with_suffix(".npz").name, depth=image if change is None else change(image))
    content["obstacles"][0] = {**content["obstacles"][0], **view}
    content["obstacles"][0]["depth"] |= depth
    (folder / scene.name).write_text(json.dumps(content), encoding="utf-8")
    head, world, rest = unpacked(data)
    for key, name in (("scene", scene.name), ("depth panda_camera.npz", scene.with_suffix(".npz").name)):
        head["files"][key] = hashlib.sha256((folder / name).read_bytes()).hexdigest()
    return folder / scene.name, motion, packed(head, world, rest)


def pixel(value: float) -> Callable[[Any], Any]:
    def change(image: Any) -> Any:
        found = image.astype(np.float64)
        v, u = np.argwhere((image > 300) & (image < 3000))[-100]
        found[v, u] = value
        return found

    return change


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("depth", "view", "change"),
    [
        ({}, {}, lambda x: x),
        ({"scale": 1.0}, {}, lambda x: x / 1000.0),  # metres
        ({}, {}, lambda x: np.where(x == 0, np.nan, x).astype(np.float32)),
        ({}, {}, lambda x: np.where(x == 0, -np.inf, x)),
        ({"voxel": 0.05}, {}, None),  # which is the planner's
    ],
)
def test_the_same_image_in_other_words_is_accepted(
    proven: Files3, tmp_path: Path, depth: dict[str, Any], view: dict[str, Any], change: Any
) -> None:
    verdict, _ = check(*signed(proven, tmp_path, depth, view, change))
    assert verdict.whole
    assert "1238 within 20 mm of the robot at the start" in verdict.text


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("depth", "view", "change"),
    [
        ({"scale": 0.00100001}, {}, None),
        ({"scale": 0.0001}, {}, lambda x: x.astype(np.int32) * 10),  # which has other bits
        ({"scale": 1.0}, {}, None),
        ({"scale": 1.0}, {}, lambda x: x / 1000.0 + 1e-6),
        ({"intrinsics": [138, 138.0001, 79.5, 59.5]}, {}, None),
        ({"intrinsics": [138, 138, 59.5, 79.5]}, {}, None),
        ({"radius": 0.002}, {}, None),
        ({"radius": 0.0}, {}, None),
        ({"range": [0.3, 1.5]}, {}, None),
        ({"range": [1.5, 3.0]}, {}, None),
        ({"range": [0.0, 1e6]}, {}, lambda x: np.where(x == 0, 1e-300, x)),
        ({"ignore_robot": 0.001}, {}, None),
        ({"ignore_robot": 0.0}, {}, None),
        ({"ignore_robot": 0.0, "ignore": {"link": "panda_hand", "margin": 0.02}}, {}, None),
        ({"drop_nan": True}, {}, None),
        ({"unseen": "free"}, {}, None),
        ({}, {"pose": {"position": [1.55, -0.75, 1.1501]}}, None),
        ({}, {"pose": {"position": [1.25, -0.75, 1.15], "quaternion_xyzw": TURN}}, None),
        ({}, {"pose": {"position": [1.55, -0.75, 1.151], "quaternion_xyzw": TURN}}, None),
        ({}, {"clearance": 0.02}, None),
        *(({}, {}, pixel(x)) for x in (0.0, np.nan, np.inf, 301.0, 2999.0)),
        ({}, {}, lambda x: x[:, ::-1]),
        ({}, {}, lambda x: x.T),
        ({}, {}, lambda x: x[:60]),
        ({}, {}, lambda x: x[None]),
    ],
)  # fmt: skip
def test_the_proof_of_another_image_is_rejected(
    proven: Files3, tmp_path: Path, depth: dict[str, Any], view: dict[str, Any], change: Any
) -> None:
    """Another camera, another place of it, other pixels, or less of the robot's image left out."""
    with pytest.raises(RejectedError):
        check(*signed(proven, tmp_path, depth, view, change))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("part", range(2))
def test_the_balls_of_an_image_by_their_digest(proven: Files3, part: int) -> None:
    """A proof names the rows that are left out; it may have the numbers in their place, and no other rows."""
    scene, motion, data = proven
    head, world, rest = unpacked(data)
    (number,) = [i for i, x in enumerate(world["bodies"]) if x["kind"] == "obstacle" and "sha256" in x["shape"]]
    section = world["bodies"][number]["shape"]
    rows = section["left_out"]
    assert len(rows) == 1238

    def proof(shape: Any) -> bytes:
        bodies = [{**x, "shape": shape} if i == number else x for i, x in enumerate(world["bodies"])]
        return packed(head, {**world, "bodies": bodies}, rest)

    verdict, read = check(scene, motion, data)
    assert verdict.whole
    numbers = json.loads(json.dumps(read["bodies"][number]["shape"], default=plain))
    assert check(scene, motion, proof(numbers))[0].text == verdict.text
    far = max({*range(rows[-1])} - {*rows})  # of an image from its upper left, which sees no robot there
    wrong: list[Any] = [[], rows[1:], [*rows, far], [*rows[:-1], far], [*rows, -1], [*rows, 10**6], [*rows, True]]
    wrong += [[*rows[:-1], float(rows[-1])], {}, None, "", [rows], [*rows[:-1], str(rows[-1])]]
    forged = [{**section, "left_out": x} for x in wrong]
    forged += [{"sha256": section["sha256"]}, {**section, "off": 0.0}, {**numbers, "left_out": rows[1:]}]
    for shape in forged[part::2]:
        with pytest.raises(RejectedError):
            check(scene, motion, proof(shape))


def test_a_job_leaves_out_what_is_near_where_it_begins(tmp_path: Path) -> None:
    """A ball where the arm comes by later stays in every stage."""
    robot = hdplan.load_robot("panda")
    default = [robot.named_states["default"][x] for x in robot.joint_names]
    tip = link_pose(robot, np.array(default), "panda_hand_tcp")[:3, 3]
    points = np.array([tip, tip + [0.0, 0.0, 0.02], tip + [0.3, 0.0, 0.0]])
    seen = hdplan.Cloud(points, 0.005, name="seen", ignore_robot=0.03)
    job = hdplan.Job([hdplan.Line(by=[0.0, 0.0, 0.05]), hdplan.Wait(0.1)])
    limits = hdplan.Limits(acceleration=4.0)
    scene = hdplan.Scene(robot="panda", start="default", limits=limits, obstacles=[seen], job=job)
    result = hdplan.plan_job(scene)
    proof = prove_job(*written(result, tmp_path))
    assert proof.text.startswith("accepted: a job of 2 stages")
    assert proof.text.count("left out, of 3 balls of seen: 2 within 30 mm of the robot at the start") == 1


@pytest.mark.parametrize("margin", [0.0, 0.1])
def test_the_proof_says_which_points_are_the_image_of_a_robot_that_is_not_read(margin: float, tmp_path: Path) -> None:
    """The verdict says so; points without a margin are read all the same."""
    cloud = {"points": [[0.0, 0.0, 0.0], [9.0, 9.0, 9.0]][0 if margin else 1 :], "radius": 0.01, "ignore_robot": margin}
    content = {"robot": {**SCENE["robot"], "urdf": "r.urdf.xacro"}, "obstacles": [{"name": "seen", "cloud": cloud}]}
    scene, motion = files(tmp_path, content, MOTION, URDF, "r.urdf.xacro")
    taken = hdplan.prove(scene, motion).text.splitlines()[0]
    assert taken.startswith("accepted in part; NOT read by the checker")
    assert ("seen (cloud)" in taken) == (margin > 0)
