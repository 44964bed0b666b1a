"""Laws of changed proofs: what is changed so that it is not true is rejected, in words; a damaged file is rejected, and
costs nothing."""

from __future__ import annotations

import contextlib
import hashlib
import json
import re
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan.scenes.robot_files.library import description_of, library_package_dirs
from hdplan.verify import RejectedError
from hdplan.verify.kernel import MAGIC, MOST_BYTES, half
from hdplan.verify.reading import read_world

from .conftest import Proven
from .worlds import packed


def rejected(words: str, check: Callable[[], str]) -> None:
    """The check rejects with these words, in one line."""
    with pytest.raises(RejectedError, match=words) as found:
        check()
    assert str(found.value) == " ".join(str(found.value).split())


def test_other_files_are_rejected(proven: Callable[[str], Proven], tmp_path: Path) -> None:
    each = proven("panda_cage")
    for key in ("scene", "motion"):
        path = tmp_path / getattr(each, key).name
        path.write_bytes(getattr(each, key).read_bytes() + b"\n")
        rejected(f"{key}: is not the file", lambda key=key, path=path: each.verify(**{key: path}))
    head, world, rest = each.content()
    files = head["files"]
    for key in files:
        for words, other in (
            ("SHA-256", {**files, key: "0" * 64}),
            ("not among the files", {k: v for k, v in files.items() if k != key}),
            ("SHA-256", {**files, "mesh more/more.stl": "0" * 64}),
        ):
            rejected(words, lambda other=other: each.verify(packed({**head, "files": other}, world, rest)))


def moved(each: Proven, tmp_path: Path, change: Callable[[dict[str, Any]], None]) -> str:
    """Verify the proof for a changed motion, whose hash it has."""
    content = json.loads(each.motion.read_text())
    change(content)
    (tmp_path / "m.json").write_text(json.dumps(content))
    return rehashed(each, {"motion": tmp_path / "m.json"})


def rehashed(each: Proven, files: dict[str, Path]) -> str:
    """Verify the proof for other files, of which it has the hashes, in its own world or in theirs."""
    head, world, rest = each.content()
    head["files"] |= {key: hashlib.sha256(path.read_bytes()).hexdigest() for key, path in files.items()}
    other = {key: path for key, path in files.items() if key in ("scene", "motion")}
    with contextlib.suppress(RejectedError):
        return each.verify(packed(head, world, rest), **other)
    reading = read_world(other.get("scene", each.scene), other.get("motion", each.motion))
    return each.verify(packed({**head, "files": reading.hashes}, reading.world, rest), **other)


@pytest.mark.parametrize("name", ["panda_cage", "ur5_table"])
def test_other_motions_are_rejected_where_they_are_not_free(
    name: str, proven: Callable[[str], Proven], tmp_path: Path
) -> None:
    """Rows that are moved: the certificate says which of these motions keep what the proof claims."""
    each, rng = proven(name), np.random.default_rng(0)
    scene, head = hdplan.load_scene(name), each.content()[0]
    verdicts: list[str] = []
    for _ in range(15):
        row, joint = int(rng.integers(1, 31)), int(rng.integers(0, 6))
        step = float(rng.normal() * 10.0 ** rng.uniform(-4, 0.5))

        def change(content: dict[str, Any], row: int = row, joint: int = joint, step: float = step) -> None:
            content["positions"][row][joint] += step

        try:
            moved(each, tmp_path, change)
        except RejectedError as error:
            verdicts.append(str(error))
            continue
        certificate = hdplan.certify(scene, hdplan.Trajectory.load(tmp_path / "m.json"), required=0.0)
        assert certificate.certified
        assert certificate.worst.distance >= head["clearance"]
    assert len(verdicts) > 3
    assert all(re.search(r" and .*leaf \d+, from .* apart, not|leaves its limits", words) for words in verdicts)


def test_a_motion_that_says_it_is_another_curve_is_rejected(proven: Callable[[str], Proven], tmp_path: Path) -> None:
    cubic = {"interpolation": "cubic"}
    rejected("interpolation", lambda: moved(proven("panda_cage"), tmp_path, lambda content: content.update(cubic)))


def test_many_leaves_and_rows_are_checked_in_parts(proven: Callable[[str], Proven], tmp_path: Path) -> None:
    """The largest proofs that are allowed take little memory; they are rejected for what they say."""
    each = proven("planar_arm")
    content, motion = json.loads(each.motion.read_text()), tmp_path / "m.json"
    ends = (np.array(content["positions"][i]) for i in (0, -1))
    motion.write_text(json.dumps({**content, "positions": np.linspace(*ends, 20_000).tolist()}))
    head, _, _ = each.content()
    head["files"]["motion"] = hashlib.sha256(motion.read_bytes()).hexdigest()
    counts = np.zeros(head["pairs"], "<u4")
    tree = _depths(20_000)
    counts[0], counts[1:] = len(tree), 1
    depths = np.concatenate([tree, np.zeros(head["pairs"] - 1)]).astype("<u1")
    normals = np.full((len(depths), 3), 1000, "<i4")
    arrays = b"".join(x.tobytes() for x in (counts, depths, normals))
    data = packed({**head, "leaves": len(depths)}, read_world(each.scene, motion).world, arrays)
    rejected(r" and .*: leaf \d+, from .* its plane keeps them", lambda: each.verify(data, motion=motion))


def _depths(rows: int) -> np.ndarray[Any, Any]:
    """The depths of the tree whose leaves are single rows."""
    found, waiting = [], [(0.0, float(rows), 0)]
    while waiting:
        a, b, depth = waiting.pop()
        if b - a <= 1:
            found.append(depth)
        else:
            middle = half(a, b)
            waiting += [(middle, b, depth + 1), (a, middle, depth + 1)]
    return np.array(found)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("0.012, length: 0.95}, pose: {position: [0.436, 0.1", "0.05, length: 0.95}, pose: {position: [0.436, 0.1"),
        ("[0.436, 0.147, 0.475]", "[0.40, 0.147, 0.475]"),
        ("[0.436, 0.147, 0.475]", "[.nan, 0.147, 0.475]"),
        ("type: capsule", "type: cylinder, size: [1, 1, 1]"),
        ("name: panda\n", "name: panda\n  base: {position: [0.05, 0, 0]}\n"),
        ("panda_finger_joint1: 0.04", "panda_finger_joint1: 0.01"),
        ("goal: {joints: [0.648", "goal: {joints: [0.647"),
        ("hdplan: 1", "hdplan: 2"),
        ("hdplan: 1", "hdplan: 1\nfloor: 3"),
        ("hdplan: 1", "hdplan: 1\nobstacles: []"),
        ("radius: 0.012, length", "radius: 0.012, radius: 0.001, length"),
        ("hdplan: 1", "hdplan: 1\ntiming: " + "[" * 100_000 + "]" * 100_000),
        ("hdplan: 1", "hdplan: 1\nlimits: {position: {panda_joint1: [-0.01, 0.01]}}"),
    ],
)  # fmt: skip
def test_other_scenes_are_rejected(before: str, after: str, proven: Callable[[str], Proven], tmp_path: Path) -> None:
    each, path = proven("panda_cage"), tmp_path / "scene.yaml"
    assert before in each.scene.read_text()
    path.write_text(each.scene.read_text().replace(before, after))
    rejected(".", lambda: rehashed(each, {"scene": path}))


def changed_urdf(each: Proven, folder: Path, change: Callable[[str], str]) -> str:
    """Verify against a changed robot description: the scene then names it by its file."""
    _, urdf, srdf, _ = description_of(hdplan.load_scene(each.scene).robot)
    new = change(urdf.read_text())
    assert new != urdf.read_text()
    (folder / "robot.urdf").write_text(new)
    dirs = ", ".join(map(str, library_package_dirs()))
    robot = f"urdf: robot.urdf\n  srdf: {srdf}\n  package_dirs: [{dirs}]\n"
    (folder / "scene.yaml").write_text(each.scene.read_text().replace("name: panda\n", robot))
    return rehashed(each, {"scene": folder / "scene.yaml", "urdf": folder / "robot.urdf"})


def test_other_robots_are_rejected(proven: Callable[[str], Proven], tmp_path: Path) -> None:
    each = proven("panda_cage")
    assert changed_urdf(each, tmp_path, lambda text: text + "\n<!-- the same -->").startswith("accepted")
    place = 'xyz="0.0825 0 0"'
    for change in (
        lambda text: text.replace(place, place.replace("0.0825", "0.12"), 1),
        lambda text: text.replace('axis xyz="0 0 1"', 'axis xyz="0 1 0"', 1),
        lambda text: re.sub(r'lower="-?[\d.]+"', 'lower="-0.01"', text),
        lambda text: text.replace("collision/link5.stl", "collision/link0.stl"),
        lambda text: text.replace('type="revolute"', 'type="planar"', 1),
        lambda text: text[: len(text) // 2],
    ):
        rejected(".", lambda change=change: changed_urdf(each, tmp_path, change))


def test_a_claim_that_is_not_proven_is_rejected(proven: Callable[[str], Proven]) -> None:
    each = proven("panda_cage")
    head, world, rest = each.content()
    for change in (
        {"clearance": head["clearance"] + 0.002},
        {"self_clearance": 0.13},
        {"clearance": None},
        {"self_clearance": None},
        {"clearance": float("nan")},
        {"clearance": float("inf")},
        {"clearance": -1.0},
        {"clearance": "1"},
        {"held": {"panda_finger_joint1": 0.01}},
        {"version": 1},
        {"pairs": head["pairs"] - 1},
        {"leaves": 10**15},
        {"leaves": -1},
        {"rays": 1},
        {"cuts": {"5": 10**9}},
        {"cuts": []},
        {"files": None},
        {"claims": {"limits": 1}},
        {"more": 1},
    ):
        rejected(".", lambda change=change: each.verify(packed({**head, **change}, world, rest)))


@pytest.mark.parametrize("name", ["panda_cage", "ur5_table"])
def test_trees_with_gaps_are_rejected(name: str, proven: Callable[[str], Proven]) -> None:
    """A leaf dropped, twice, or of another depth, with all counts as they should be."""
    each, rng = proven(name), np.random.default_rng(1)
    head, world, rest = each.content()
    skip = 2 * sum(head["cuts"].values())
    counts = np.frombuffer(rest, "<u4", head["pairs"], skip)
    depths = np.frombuffer(rest, "<u1", head["leaves"], skip + counts.nbytes)
    normals = np.frombuffer(rest, "<i4", 3 * head["leaves"], skip + counts.nbytes + depths.nbytes).reshape(-1, 3)
    tail = rest[skip + counts.nbytes + depths.nbytes + normals.nbytes :]
    for _ in range(6):
        leaf = int(rng.integers(len(depths)))
        pair = int(np.searchsorted(np.cumsum(counts), leaf, side="right"))
        less, more, other = counts.copy(), counts.copy(), depths.copy()
        less[pair] -= 1
        more[pair] += 1
        other[leaf] += 1
        for c, d, n in (
            (less, np.delete(depths, leaf), np.delete(normals, leaf, axis=0)),
            (more, np.insert(depths, leaf, depths[leaf]), np.insert(normals, leaf, normals[leaf], axis=0)),
            (counts, other, normals),
        ):
            arrays = rest[:skip] + c.tobytes() + d.tobytes() + n.tobytes() + tail
            data = packed({**head, "leaves": len(d)}, world, arrays)
            rejected(" and .*(leaf|leaves|depths)", lambda data=data: each.verify(data))


@pytest.mark.core
def test_damaged_files_are_rejected(proven: Callable[[str], Proven]) -> None:
    """Cut short, bytes changed before and after compression: never another error, and nothing false is accepted."""
    each, rng = proven("panda_cage"), np.random.default_rng(2)
    data, (head, world, rest) = each.proof.data, each.content()
    for length in rng.integers(0, len(data), 20).tolist():
        rejected(".", lambda length=length: each.verify(data[:length]))
    rejected(".", lambda: each.verify(data + b"x"))
    rejected(".", lambda: each.verify(MAGIC + zlib.compress(b"0" * (MOST_BYTES + 1), 9)))
    content = json.dumps(head).encode() + b"\n" + json.dumps(world).encode() + b"\n" + rest
    accepted = 0
    for _ in range(50):
        broken = bytearray(data if rng.random() < 0.4 else content)
        for _ in range(int(rng.integers(1, 4))):
            broken[int(rng.integers(len(broken)))] = int(rng.integers(256))
        whole = bytes(broken) if broken[:13] == MAGIC else MAGIC + zlib.compress(bytes(broken), 1)
        try:
            text = each.verify(whole)
        except RejectedError:
            continue
        accepted += 1  # another direction that does as well, or a lower claim
        least = float(re.search(r"at least ([\d.]+) mm from every", text)[1])  # type: ignore[index]
        assert least <= 1e3 * each.certificate.worst.distance
    assert accepted < 25
