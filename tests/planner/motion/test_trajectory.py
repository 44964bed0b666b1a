"""Laws of the trajectory files: what is saved reads back bit for bit; what is wrong is named."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hdplan import InputError, Trajectory


def awkward_trajectory() -> Trajectory:
    rng = np.random.default_rng(1)
    positions = rng.normal(size=(7, 3)) * 10.0 ** rng.integers(-300, 300, size=(7, 3))
    positions[0] = [0.1, -0.0, 1 / 3]
    return Trajectory(("a", "b joint", "ç"), positions, {"finger": 0.1 + 0.2})


@pytest.mark.parametrize("ending", [".json", ".csv", ".npz"])
@pytest.mark.parametrize("times", [None, np.cumsum(np.geomspace(1e-9, 1e3, 7)) / 3])
def test_round_trip_keeps_every_bit(tmp_path: Path, ending: str, times: np.ndarray | None) -> None:
    before = replace(awkward_trajectory(), times=times)
    before.save(tmp_path / f"path{ending}", {"status": "certified"})
    after = Trajectory.load(tmp_path / f"path{ending}")
    assert after.joint_names == before.joint_names
    assert after.positions.tobytes() == before.positions.tobytes()
    assert (after.times is None) if times is None else (after.times.tobytes() == times.tobytes())
    if ending != ".csv":  # CSV holds the planned joints alone
        assert after.locked == before.locked
    assert [file.name for file in tmp_path.iterdir()] == [f"path{ending}"]


def test_json_carries_the_verdict(tmp_path: Path) -> None:
    awkward_trajectory().save(tmp_path / "path.json", {"status": "certified", "clearance_m": 0.01})
    content = json.loads((tmp_path / "path.json").read_text())
    assert content["hdplan_trajectory"] == 1
    assert content["verdict"] == {"status": "certified", "clearance_m": 0.01}


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "path.json"
    awkward_trajectory().save(path)
    before = path.read_bytes()
    with pytest.raises(ValueError, match="JSON"):
        awkward_trajectory().save(path, {"clearance_m": float("nan")})
    assert path.read_bytes() == before


def test_time_runs_along_straight_lines() -> None:
    path = Trajectory(("a",), np.array([[0.0], [1.0], [3.0]]))
    np.testing.assert_array_equal(path.at([0.0, 0.25, 0.5, 0.75, 1.0])[:, 0], [0.0, 0.5, 1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("positions", "words"),
    [
        ([[1.0, 2.0]], "at least 2"),
        ([[1.0, 2.0], [1.0, np.nan]], "waypoint 1, joint 'b': nan"),
        ([[1.0, 2.0], [np.inf, 1.0]], "waypoint 1, joint 'a': inf"),
        ([[1.0], [2.0]], "2 values"),
        ([[1.0, 2.0], [3.0]], "the same number of them in each row"),
    ],
)
def test_bad_positions_are_named(positions: list[list[float]], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Trajectory(("a", "b"), positions)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("x.json", b"{", "not JSON"),
        ("x.json", b'{"positions": [[1], [2]]}', "hdplan_trajectory: 1"),
        ("x.json", b'{"hdplan_trajectory": 1, "positions": [[1], [2]]}', "joint_names: missing"),
        ("x.json", b'{"hdplan_trajectory": 1, "joint_names": ["a", "a"], "positions": [[1, 1], [2, 2]]}', "twice"),
        ("x.json", b'{"hdplan_trajectory": 1, "joint_names": ["a"], "positions": [[NaN], [2]]}', "not a finite"),
        ("x.json", b'{"hdplan_trajectory": 1, "joint_names": [1], "positions": [[1], [2]]}', "must be a text"),
        ("x.csv", b"", "empty"),
        ("x.csv", b"1,2\n3,4\n", "header must hold"),
        ("x.csv", b"a,b\n1,2\n3\n", "line 3: 1 values"),
        ("x.csv", b"a,b\n1,2\n3,x\n", "'x' is not a number"),
        ("x.csv", b"a,b\n1,2\n", "at least 2"),
        ("x.csv", b"\xff\xfe", "not CSV"),
        ("x.npz", b"PK rubbish", "not an NPZ"),
        ("x.txt", b"", "ends with one of"),
    ],
)
def test_bad_files_are_named(tmp_path: Path, name: str, content: bytes, words: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=words) as caught:
        Trajectory.load(tmp_path / name)
    assert str(tmp_path / name) in str(caught.value)


def test_npz_of_one_array_or_without_the_keys(tmp_path: Path) -> None:
    with (tmp_path / "x.npz").open("wb") as file:
        np.save(file, np.zeros(3))
    with pytest.raises(InputError, match="not an NPZ"):
        Trajectory.load(tmp_path / "x.npz")
    np.savez(tmp_path / "y.npz", q=np.zeros((2, 2)))
    with pytest.raises(InputError, match="joint_names: missing"):
        Trajectory.load(tmp_path / "y.npz")


def test_missing_and_unwritable_paths(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        Trajectory.load(tmp_path / "none.json")
    with pytest.raises(InputError, match="cannot be written"):
        awkward_trajectory().save(tmp_path / "no" / "such" / "folder.json")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        awkward_trajectory().save(tmp_path / "folder.csv")
