"""Points that a depth image saw are covered by its balls, without holes, and by little more."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan import Cloud, DepthImage, InputError, Scene, load_scene
from hdplan.planner.geometry.clouds import balls_in, read_cloud
from hdplan.scenes.array_types import Array
from hdplan.scenes.fixed_array import FixedArray

CAMERA = (120.0, 110.0, 39.5, 29.5)
SHAPE = (60, 80)


def rays() -> Array:
    """The way (h, w, 3) along each pixel, at depth 1."""
    fx, fy, cx, cy = CAMERA
    u, v = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    return np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(SHAPE)], axis=2)


def plane(normal: Array, distance: float) -> Array:
    """The depths at which rays meet a plane."""
    with np.errstate(divide="ignore"):
        depth = distance / (rays() @ normal)
    return np.where((depth > 0.1) & (depth < 3.0), depth, 0.0)


def balls(image: Array, **more: Any) -> Array:
    return balls_in(read_cloud(Cloud(DepthImage(image, CAMERA, scale=1.0, **more)), "obstacles.view")).array


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", range(12))
def test_a_plane_is_covered_without_holes_whatever_its_inclination(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn, tilt = rng.uniform(0.0, 2.0 * np.pi), np.radians(rng.uniform(0.0, 75.0))
    normal = np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
    image = plane(normal, 1.0 * np.cos(tilt))
    seen = image > 0.0
    found = balls(image)
    fx, fy, cx, cy = CAMERA
    u, v = rng.uniform(0.0, SHAPE[1] - 1.0, 2000), rng.uniform(0.0, SHAPE[0] - 1.0, 2000)  # between pixels too
    column, row = np.floor(u).astype(int), np.floor(v).astype(int)
    inside = seen[row, column] & seen[row + 1, column] & seen[row, column + 1] & seen[row + 1, column + 1]
    corners = np.stack([image[row + i, column + j] for i in (0, 1) for j in (0, 1)])
    inside &= np.ptp(corners, axis=0) < 4.0 * corners.min(axis=0) / max(fx, fy)  # seen at a grazing angle: an edge
    way = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(len(u))], axis=1)[inside]
    points = way * (np.cos(tilt) / (way @ normal))[:, None]
    away = np.linalg.norm(points[:, None] - found[:, :3], axis=2) - found[:, 3]
    assert len(points) > 100
    assert (away.min(axis=1) <= 1e-3 * points[:, 2]).all()  # perspective bends the parallelograms a little


def test_neighbours_are_of_one_surface_up_to_an_inclination_against_the_ray() -> None:
    """The law holds at the picture's edge, too, where the ray is far from the picture's axis."""
    rng, focal = np.random.default_rng(79), 500.0
    for i in range(400):
        s, t = rng.uniform(-0.9, 0.9, 2)
        ray = np.array([s, t, 1.0]) / np.linalg.norm([s, t, 1.0])
        across = np.cross(ray, rng.normal(size=3))
        tilt = np.radians(rng.uniform(70.0, 78.3))  # a pixel's own width is up to 0.1°
        normal = np.cos(tilt) * ray + np.sin(tilt) * across / np.linalg.norm(across)
        rays = np.array([[s, t, 1.0], [s, t, 1.0]])
        rays[1, i % 2] += 1.0 / focal
        depth = (normal @ ray) / (rays @ normal)
        camera = (focal, focal, -s * focal, -t * focal)
        image = depth[None] if i % 2 == 0 else depth[:, None]
        found = balls_in(read_cloud(Cloud(DepthImage(image, camera, scale=1.0)), "")).array
        apart = np.linalg.norm(found[0, :3] - found[1, :3])
        assert apart <= found[:, 3].sum() * (1.0 + 1e-9), (s, t, np.degrees(tilt))


def test_facing_the_camera_a_ball_is_the_pixel_and_no_more() -> None:
    image = np.full(SHAPE, 2.0)
    found = balls(image)
    np.testing.assert_allclose(found[:, :3].reshape(*SHAPE, 3), 2.0 * rays())
    np.testing.assert_allclose(found[:, 3], np.hypot(1.0 / CAMERA[0], 1.0 / CAMERA[1]))


def test_across_an_edge_nothing_is_seen() -> None:
    image = np.full(SHAPE, 1.0)
    image[:, 40:] = 2.0
    found = balls(image)
    assert found[:, 3].max() <= 1.01 * np.hypot(1.0 / CAMERA[0], 1.0 / CAMERA[1])
    assert not ((found[:, 2] > 1.05) & (found[:, 2] < 1.95)).any()


def test_an_unseen_pixel_is_no_obstacle_and_the_range_is_kept() -> None:
    image = np.full(SHAPE, 1.0)
    image[0], image[1], image[2], image[3] = 0.0, np.nan, 5.0, 0.05
    assert len(balls(image)) == 56 * 80
    assert len(balls(image, range=(0.01, 10.0))) == 58 * 80


def test_radius_is_added_and_files_are_read_alike(tmp_path: Path) -> None:
    image = np.round(1000.0 * plane(np.array([0.3, 0.2, 0.9]), 1.0))
    expected = balls_in(read_cloud(Cloud(DepthImage(image, CAMERA)), ""))
    more = balls_in(read_cloud(Cloud(DepthImage(image, CAMERA), 0.01), ""))
    np.testing.assert_allclose(more.array, expected.array + [0.0, 0.0, 0.0, 0.01])
    np.savez(tmp_path / "view.npz", depth=image.astype(np.uint16), color=np.zeros((3, 3)))
    np.save(tmp_path / "view.npy", image.astype(np.float32))
    pillow = pytest.importorskip("PIL.Image")
    pillow.fromarray(image.astype(np.uint16)).save(tmp_path / "view.png")
    for name in ("view.npz", "view.npy", "view.png"):
        assert balls_in(read_cloud(Cloud(DepthImage(tmp_path / name, CAMERA)), "")) == expected
    data = (tmp_path / "view.png").read_bytes()
    cuts = [(data[:cut], "it is cut short") for cut in (0, 10, len(data) // 2, len(data) - 13)]
    for damaged, words in (*cuts, (data[1:], r"its content is .* \(cannot identify image file\)$")):  # no addresses
        (tmp_path / "cut.png").write_bytes(damaged)
        with pytest.raises(InputError, match=f"obstacles.view.depth: .*cut.png: cannot be read, {words}"):
            balls_in(read_cloud(Cloud(DepthImage(tmp_path / "cut.png", CAMERA)), "obstacles.view"))
    pillow.new("RGB", (4, 4)).save(tmp_path / "color.png")
    with pytest.raises(InputError, match="picture of mode RGB; a depth image has one channel"):
        balls_in(read_cloud(Cloud(DepthImage(tmp_path / "color.png", CAMERA)), "obstacles.view"))


def test_a_depth_image_goes_into_a_scene_file_and_back(tmp_path: Path) -> None:
    np.save(tmp_path / "view.npy", np.full((2, 3), 1000, np.uint16))
    file = tmp_path / "scene.yaml"
    depth = "{file: view.npy, intrinsics: [100, 100, 1, 0.5], scale: 0.002, range: [0.2, 4], voxel: 0.1}"
    ends = "start: {state: default}\ngoal: {state: default}\n"
    file.write_text(f"hdplan: 1\nrobot: {{name: panda}}\nobstacles: [{{name: view, depth: {depth}}}]\n{ends}")
    scene = load_scene(file)
    read = DepthImage(tmp_path / "view.npy", (100, 100, 1, 0.5), 0.002, (0.2, 4.0))
    assert scene.obstacles[0].shape == Cloud(read, voxel=0.1)
    view = Cloud(DepthImage([[1.0, 2.0]], CAMERA), 0.01, name="view")
    held = Scene(robot="panda", obstacles=[view], start="default", goal="default")
    for each in (scene, held):
        each.save(tmp_path / "saved.yaml")
        assert load_scene(tmp_path / "saved.yaml") == each


def test_a_wall_that_a_camera_sees_is_planned_around() -> None:
    """The camera hangs above the robot's goal and looks down on a table."""
    looking_down = [0.5, 0.0, 1.2], [1.0, 0.0, 0.0, 0.0]
    image = np.full((120, 160), 1.1)
    seen = DepthImage(image, (150.0, 150.0, 79.5, 59.5), scale=1.0)
    view = Cloud(seen, name="view", pose=hdplan.Pose(*looking_down), ignore_robot=0.02)
    scene = Scene(robot="panda", obstacles=[view], start="default", goal=[0.5, 0.2, 0.0, -2.0, 0.0, 2.2, 0.8])
    result = hdplan.plan(scene)
    assert result.certified
    table = hdplan.Box([1.0, 0.8, 0.002], pose=[0.5, 0.0, 0.099])
    solid = Scene(robot="panda", obstacles=[table], start="default", goal=scene.goal)
    assert hdplan.certify(solid, result.trajectory, required=0.0).certified


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"intrinsics": (0.0, 1.0, 1.0, 1.0)}, "DepthImage.intrinsics: fx must be greater than 0"),
        ({"intrinsics": (1.0, 1.0, 1.0)}, "DepthImage.intrinsics: must be a list of 4 numbers"),
        ({"range": (2.0, 1.0)}, "DepthImage.range: must be two depths .m., the first smaller, found 2 and 1"),
        ({"scale": 0.0}, "DepthImage.scale"),
        ({"image": [1.0, 2.0]}, "DepthImage.image: must be a file, or an image"),
        ({"image": np.zeros((0, 3))}, "DepthImage.image"),
        ({"image": np.zeros((2, 3, 3))}, "DepthImage.image"),
    ],
)
def test_refused_in_one_clear_line(arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        DepthImage(**{"image": [[1.0]], "intrinsics": CAMERA, **arguments})
    assert "\n" not in str(caught.value)


def test_an_image_of_nothing_is_refused() -> None:
    with pytest.raises(InputError, match=r"obstacles.view.depth: .*has no pixel from 0.1 to 3 m: is its scale 0.001 m"):
        balls_in(read_cloud(Cloud(DepthImage(np.full((3, 3), 1.0), CAMERA)), "obstacles.view"))
    with pytest.raises(InputError, match=r"Cloud.radius: must be one number"):
        Cloud(DepthImage([[1.0]], CAMERA), [0.1])
    assert isinstance(Cloud(DepthImage([[1.0]], CAMERA)).points, DepthImage)
    assert FixedArray(np.ones((1, 1))) == DepthImage([[1.0]], CAMERA).image
