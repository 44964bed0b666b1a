"""Laws of proofs that are read again: planes lie between the bodies, at every moment, as far as the leaf says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import hdplan
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.proof import reading
from hdplan.planner.proof.reading import ReadProof
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.yaml_format.reader import find_scene
from hdplan.verify import RejectedError

ROUNDING = 1e-9  # [m]
COAL = 1e-5  # [m] by which coal says less than the distance of round bodies
MOMENTS = 25


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ["panda_cage", "panda_carry", "panda_gate"])
def test_a_plane_separates_the_closest_pair(name: str, tmp_path: Path) -> None:
    """The proven distance is at most the gap at the plane, and that at most the exact distance: of links, of what they
    hold, of obstacles that move."""
    scene, motion = hdplan.load_scene(name), tmp_path / "motion.json"
    hdplan.plan(scene).save(motion)
    proof = hdplan.prove(name, motion)
    read = ReadProof(find_scene(name), motion, proof.data)
    certifier = Certifier(Setup.of(scene))
    curve = curve_of(certifier.robot, hdplan.Trajectory.load(motion))
    claimed = (proof.certificate.clearance, proof.certificate.self_clearance)
    seen = 0
    for parameter in np.append(np.random.default_rng(0).uniform(size=MOMENTS), [0.0, 1.0]):
        time = float(curve.time_of(parameter))
        row = read.row(curve, float(parameter))
        for near, least in zip(certifier.closest(curve.at_parameter(parameter), time), claimed, strict=True):
            if near is None or least is None:
                continue
            plane = read.closest(near.link, near.other, near.to_obstacle, row)
            assert plane.span[0] <= row <= plane.span[1]
            assert 0.0 < 0.97 * least - 1e-4 <= plane.bound <= plane.gap + ROUNDING
            assert plane.gap <= near.distance + COAL
            assert np.linalg.norm(plane.normal) == pytest.approx(1.0)
            pairs = read.pairs(near.link, near.other, near.to_obstacle)  # of pieces, with the points on one of them
            first = read.world.pieces[read.world.pairs[pairs[0], 0]].name
            sides = [1.0 if body == first else -1.0 for body in (near.link, near.other)]
            assert any(
                all(
                    side * each.normal @ (point - each.point) > 0.5 * each.gap - COAL
                    for side, point in zip(sides, near.points, strict=True)
                )
                for each in read.planes(pairs, row)
            )
            seen += 1
    assert seen >= MOMENTS


def test_bodies_that_are_not_compared_have_no_plane(tmp_path: Path) -> None:
    motion = tmp_path / "motion.json"
    hdplan.plan(hdplan.load_scene("panda_cage")).save(motion)
    read = ReadProof(find_scene("panda_cage"), motion, hdplan.prove("panda_cage", motion).data)
    assert read.closest("panda_link1", "panda_link2", False, 0.0) is None
    assert read.closest("panda_hand", "nobody", True, 0.0) is None
    assert read.closest("panda_hand", "bar3", False, 0.0) is None
    assert read.closest("panda_hand", "bar3", True, -1.0) is not None
    with pytest.raises(hdplan.InputError, match=r"not a proof of .*motion.json in .*panda_gate"):
        ReadProof(find_scene("panda_gate"), motion, hdplan.prove("panda_cage", motion).data)


def test_a_proof_s_file_is_checked_within_bounds_before_it_is_read_here(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Anybody may have written it; a process of its own takes no more than its time and memory."""

    def ended(*_: object) -> None:
        raise RejectedError("needs more time, or more memory, than it may take")

    monkeypatch.setattr(reading, "verify", ended)
    file = tmp_path / "x.proof"
    file.write_bytes(b"hdplan proof\n")
    with pytest.raises(hdplan.InputError, match=r"x.proof: is not a proof of .*: needs more time, or more memory"):
        ReadProof(find_scene("panda_cage"), tmp_path / "motion.json", file)


def test_an_obstacle_with_the_name_of_a_link_has_planes_of_its_own(tmp_path: Path) -> None:
    """Those of a link's pair with the link of that name are others."""
    scene, motion = tmp_path / "scene.yaml", tmp_path / "motion.json"
    text = find_scene("panda_cage").read_text(encoding="utf-8")
    assert text.count("name: bar3,") == 1
    scene.write_text(text.replace("name: bar3,", "name: panda_link0,"), encoding="utf-8")
    hdplan.plan(hdplan.load_scene(scene)).save(motion)
    read = ReadProof(scene, motion, hdplan.prove(scene, motion).data)
    pieces = read.world.pieces
    bar, link = (read.pairs("panda_hand", "panda_link0", to_obstacle=x) for x in (True, False))
    for pairs, kind in ((bar, "obstacle"), (link, "link")):
        assert pairs
        assert {pieces[b].kind for p in pairs for b in read.world.pairs[p]} == {kind, "link"}
    one, two = (read.closest("panda_hand", "panda_link0", x, 0.0) for x in (True, False))
    assert abs(one.gap - two.gap) > 0.05
