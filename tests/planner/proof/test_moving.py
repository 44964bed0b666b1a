"""Laws of moving obstacles and of shapes in worlds: two programs agree on them, and the kernel takes nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import hdplan
from hdplan.planner.proof.world_tracks import tracks_of
from hdplan.verify import RejectedError
from hdplan.verify.compare import check_equal
from hdplan.verify.moving import joints_of
from hdplan.verify.reading import read_world
from hdplan.verify.scene import frame, motion, pose_of
from hdplan.verify.world import OFF, World

from .forging import files, put

ROWS = np.array([0.25, 1.0, 2.5])
MOVING = {"name": "p", "shape": {"type": "box", "size": [0.1] * 3}, "motion": {"velocity": [0.0, 0.0, 0.01]}}
SEEN = {"name": "m", "shape": {"type": "points", "points": np.eye(4, 3).tolist()}, "pose": {"position": [3, 0, 0]}}


def both(content: dict[str, Any], pose: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Joints and place of an obstacle, as the checker reads them and as hdplan writes them."""
    carriers, place = joints_of(motion(content, pose_of(pose, "o"), "o"), ROWS.tolist(), "o")
    read = {"tracks": carriers, "joint": len(carriers) - 1, **frame(place)}
    if "times" in content:
        poses = tuple(hdplan.Pose(**x) for x in content["poses"])
        obstacle = hdplan.Obstacle("o", hdplan.Sphere(0.1), motion=hdplan.TimedPoses(tuple(content["times"]), poses))
    else:
        own = hdplan.SteadyMotion(tuple(content["velocity"]), tuple(content["spin"]))
        obstacle = hdplan.Obstacle("o", hdplan.Sphere(0.1), hdplan.Pose(**pose), motion=own)
    tracks, place_ = tracks_of(obstacle, 0, ROWS)
    return read, {"tracks": tracks, **place_}


def placed(rng: np.random.Generator, turn: Rotation) -> dict[str, Any]:
    return {"position": rng.uniform(-2, 2, 3).tolist(), "quaternion_xyzw": turn.as_quat().tolist()}


def test_two_programs_carry_an_obstacle_by_the_same_joints() -> None:
    """Turns from far below what counts as one to nearly half a turn, rests, and steady motions."""
    rng, turning = np.random.default_rng(11), 0
    for _ in range(150):
        turns = [Rotation.random(rng=rng)]
        for power in rng.choice([-np.inf, -14.0, -8.0, -6.0, -4.0, -1.0, 0.4], 4):
            axis = rng.normal(size=3)
            turns.append(Rotation.from_rotvec(10.0**power * axis / np.linalg.norm(axis)) * turns[-1])
        times = np.cumsum(rng.uniform(0.1, 1.0, 5)).tolist()
        read, expected = both({"times": times, "poses": [placed(rng, x) for x in turns]}, {})
        check_equal(read, expected)
        turning += sum(x["kind"] == "revolute" for x in read["tracks"])
        assert all(x["off"] <= OFF for x in (*read["tracks"], *expected["tracks"]))
        spin = (rng.normal(size=3) * rng.integers(2)).tolist()
        check_equal(*both({"velocity": rng.normal(size=3).tolist(), "spin": spin}, placed(rng, turns[0])))
    assert turning > 200
    half = [placed(rng, Rotation.from_rotvec([0, 0, angle])) for angle in (0.0, np.pi)]
    with pytest.raises(RejectedError, match="turns by half a turn"):
        both({"times": [0.0, 1.0], "poses": half}, {})


BAD: dict[str, tuple[tuple[Any, ...], Any, str]] = {
    "carried by the robot": (("bodies", -2, "joint"), 0, "no joint that may carry it"),
    "a link on a track": (("bodies", 0, "joint"), -1.5, "joint: is of another kind"),
    "a link that follows the time": (("bodies", 0, "joint"), 4, "no joint that may carry it"),
    "a track on the robot": (("tracks", 0, "parent"), 0, "kind or parent"),
    "a track on itself": (("tracks", 1, "parent"), 3, "kind or parent"),
    "no way": (("tracks", 0, "way"), [0.0, 0.0, 0.0], "a direction or rotation must have a length"),
    "one time": (("tracks", 0, "times"), [0.0], "finite numbers"),
    "times that stand": (("tracks", 0, "times"), [1.0, 1.0], "times must increase"),
    "values beside times": (("tracks", 0, "values"), [0.0, 0.0, 0.0], "finite numbers"),
    "a point that is not there": (("bodies", -1, "shape", "parts"), [[0, 1, 4]], "a point that is not there"),
    "the last point, backwards": (("bodies", -1, "shape", "parts"), [[0, 1, -1]], "a point that is not there"),
    "half a point": (("bodies", -1, "shape", "parts"), [[0, 1, 1.5]], "a point that is not there"),
    "no parts": (("bodies", -1, "shape", "parts"), [], "finite numbers"),
    "parts of several sizes": (("bodies", -1, "shape", "parts"), [[0, 1, 2], [0, 1]], "finite numbers"),
    "no points": (("bodies", -1, "shape", "points"), [], "finite numbers"),
    "no ellipsoid": (("bodies", -1, "shape", "sweep"), [], "finite numbers"),
    "a size below 0": (("bodies", -1, "shape", "sweep"), [[0.1, -0.1, 0.1]], "sizes for all"),
    "two sizes of one part": (("bodies", -1, "shape", "sweep"), [[0.1] * 3] * 2, "sizes for all"),
    "triangles that are swept": (
        ("bodies", -1, "shape"),
        {"points": np.eye(4, 3).tolist(), "parts": [[0, 1, 2]], "sweep": [[0.1] * 3], "off": 0.0},
        "triangles are not swept",
    ),
    "an error that is not small": (("bodies", -1, "shape", "off"), 1e-5, "off: between 0 and"),
}


@pytest.mark.parametrize("what", BAD)
def test_the_kernel_takes_no_other_shapes_and_joints(what: str, tmp_path: Path) -> None:
    timed = {"positions": [[0.0, 0.0], [0.1, 0.5]], "times": [0.0, 5.0]}
    world = read_world(*files(tmp_path, {"obstacles": [MOVING, SEEN], "timing": {"duration": 5}}, timed)).world
    assert len(World(world, {}).tracks) == 3
    way, value, words = BAD[what]
    with pytest.raises(RejectedError, match=words):
        World(put(world, *way, to=value), {})
