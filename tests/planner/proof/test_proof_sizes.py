"""Laws of proofs in scenes with sizes: what is accepted holds in worlds sampled within them, by other kinematics and
distances; a world that says less, or more, is not the scene's; and the checker knows what it cannot prove."""

from __future__ import annotations

import copy
import dataclasses
import functools
import operator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import hdplan
from hdplan import InputError, Proof, Scene, Tracking, Trajectory, Uncertainty, load_scene, prove
from hdplan.planner.proof.world import world_of
from hdplan.planner.robot.setup import Setup
from hdplan.verify import RejectedError
from hdplan.verify.checking import check
from hdplan.verify.compare import check_equal
from hdplan.verify.kernel import accept, unpack
from hdplan.verify.reading import read_world

from ..certificate.test_sizes import HOMES, random_scene, sized
from ..certificate.worlds import Worlds
from .forging import put

Made = tuple[Path, Path, Scene, Trajectory, Proof]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """A motion beside a person, and its proof."""
    folder, scene = tmp_path_factory.mktemp("person"), load_scene("panda_person")
    result = hdplan.plan(scene)
    file, motion = files_of(scene, result.trajectory, folder)
    return file, motion, scene, result.trajectory, prove(file, motion)


def files_of(scene: Scene, motion: Trajectory, folder: Path) -> tuple[Path, Path]:
    scene.save(folder / "scene.yaml")
    motion.save(folder / "motion.json")
    return folder / "scene.yaml", folder / "motion.json"


def test_the_proof_is_of_every_world_within_the_sizes(made: Made) -> None:
    file, motion, scene, trajectory, proof = made
    bound = proof.certificate.clearance
    assert bound is not None
    head, _, _, _ = unpack(proof.data)
    assert bound - 1e-4 <= head["clearance"] <= bound
    verdict, _ = check(file, motion, proof.data)
    for message in (
        "in every world in which:",
        "obstacle person is up to 0 m, 0 rad about its origin and 0.3 m/s away",
        "obstacle crate is up to 0.01 m, 0.05 rad about its origin and 0 m/s away",
        "the robot's base is up to 0.002 m, 0.001 rad about its origin away",
        "joints are off by up to panda_joint1 by 0.002",
    ):
        assert message in verdict.text
    assert "person" not in next(line for line in verdict.text.splitlines() if "both stand still" in line)
    setup = Setup.of(scene)
    found = np.array(list(Worlds(setup.scene, setup.robot, trajectory).sampled(np.random.default_rng(0), 15)))
    assert (found.min(axis=0) >= [head["clearance"], head["self_clearance"]]).all()


@pytest.mark.parametrize("robot", HOMES)
def test_random_sizes_are_proven_nearly_as_they_are_certified(robot: str, tmp_path: Path) -> None:
    """Obstacles that move and turn, all shapes, a base that hangs."""
    home, more = HOMES[robot]
    done = 0
    for seed in (2, 5, 7):
        scene, motion = random_scene(seed, robot, home, **more)
        scene = scene.with_goal(motion.positions[-1].tolist())
        certificate = hdplan.certify(scene, motion)
        if not certificate.certified:
            continue
        head, *_ = unpack(prove(*files_of(scene, motion, tmp_path)).data)
        assert certificate.clearance is not None
        assert certificate.self_clearance is not None
        assert head["clearance"] >= certificate.clearance - 1e-4
        assert head["self_clearance"] >= certificate.self_clearance - 1e-4
        done += 1
    assert done


def test_other_sizes_are_another_scene(made: Made, tmp_path: Path) -> None:
    file, motion, _, _, proof = made
    verdict = check(file, motion, proof.data)[1]
    content = yaml.safe_load(file.read_text())
    places = [("robot", x, y) for x in ("tracking", "calibration") for y in content["robot"][x]]
    places += [("obstacles", i, "uncertainty", x) for i in (1, 2) for x in content["obstacles"][i]["uncertainty"]]
    assert len(places) >= 7
    other = tmp_path / "scene.yaml"
    for place in places:
        for factor in (0.5, 2.0):
            value = factor * functools.reduce(operator.getitem, place, content)
            other.write_text(yaml.safe_dump(put(content, *place, to=value)))
            with pytest.raises(RejectedError, match="the worlds differ: sizes"):
                check_equal(read_world(other, motion).world, verdict)


def test_the_kernel_takes_what_is_unknown_off_its_bounds(made: Made) -> None:
    """A proof is accepted in its own world, with smaller sizes too; with larger ones of each kind it is not."""
    file, motion, _, _, proof = made
    world = read_world(file, motion).world
    assert accept(world, proof.data)[1]

    def with_sizes(change: Any) -> dict[str, Any]:
        other = copy.deepcopy(world)
        change(other["sizes"])
        return other

    def smaller(sizes: Any) -> None:
        sizes["around"]["crate"] = {"shift": 0.0, "turn": 0.0, "speed": 0.0}
        sizes["joints"] = [0.0] * 7

    assert accept(with_sizes(smaller), proof.data)[1]
    larger = (
        lambda sizes: sizes["around"]["crate"].update(shift=0.05),
        lambda sizes: sizes["around"]["crate"].update(turn=0.5),
        lambda sizes: sizes["around"].update(floor={"shift": 0.5, "turn": 0.0, "speed": 0.0}),
        lambda sizes: sizes["around"]["person"].update(speed=0.8),
        lambda sizes: sizes["around"]["crate"].update(speed=0.1),
        lambda sizes: sizes.update(joints=[0.05] * 7),
        lambda sizes: sizes["base"].update(shift=0.1),
        lambda sizes: sizes["base"].update(turn=0.2),
        lambda sizes: sizes.update(rates=[2.0] * 7),
    )
    wrong = (
        lambda sizes: sizes["around"].update(nobody={"shift": 0.1, "turn": 0.0, "speed": 0.0}),
        lambda sizes: sizes["around"]["crate"].update(shift=-0.1),
        lambda sizes: sizes["around"]["crate"].update(turn=4.0),
        lambda sizes: sizes["around"]["crate"].update(shift=float("nan")),
        lambda sizes: sizes["around"]["crate"].update(more=0.0),
        lambda sizes: sizes.update(joints=[0.0] * 6),
        lambda sizes: sizes.update(joints=[-1.0] * 7),
        lambda sizes: sizes.update(base={"shift": 0.0, "turn": 0.0}),
        lambda sizes: sizes.pop("rates"),
    )
    for change in (*larger, *wrong):
        with pytest.raises(RejectedError):
            accept(with_sizes(change), proof.data)
    path = [{"kind": "upright", "link": "panda_hand", "axis": [0, 0, 1.0], "off": 0.0, "tolerance": 3.0}]
    with pytest.raises(RejectedError, match="sizes: of a robot with constraints or torques"):
        accept({**world, "path": path}, proof.data)


def test_sizes_of_zero_leave_the_world_as_it_is() -> None:
    scene = load_scene("panda_cage")
    motion = hdplan.plan(scene).trajectory
    none = sized(scene, Uncertainty(), tracking=Tracking([0.0] * 7))
    one, other = (world_of(Setup.of(each), motion) for each in (scene, none))
    assert "sizes" not in one
    assert repr(one) == repr(other)


def test_joints_that_follow_lag_as_what_they_follow(tmp_path: Path) -> None:
    """Every link of a parallel linkage is off by what moves it, in certificate, proof and sampled worlds alike."""
    from ..linkage import linkage_urdf

    robot = hdplan.RobotSpec(urdf=linkage_urdf(tmp_path), tracking=Tracking({"lift": 0.01, "elbow": 0.005}))
    ball = hdplan.Obstacle("ball", hdplan.Sphere(0.2), [1.5, 0.9, 1.0], uncertainty=Uncertainty(0.01))
    rows = np.array([[0.0, 0.1, 0.2, 0.0, 0.1], [0.05, 0.15, 0.1, 0.1, 0.1]])
    scene = Scene(robot=robot, obstacles=[ball], start=rows[0], goal=rows[1])
    setup = Setup.of(scene)
    motion = Trajectory(setup.robot.joint_names, rows)
    certificate = hdplan.certify(scene, motion)
    assert certificate.certified, certificate.text
    found = np.array(list(Worlds(setup.scene, setup.robot, motion).sampled(np.random.default_rng(0), 10)))
    assert certificate.clearance is not None
    assert certificate.self_clearance is not None
    assert (found.min(axis=0) >= [certificate.clearance, certificate.self_clearance]).all()
    head, *_ = unpack(prove(*files_of(scene, motion, tmp_path)).data)
    assert head["clearance"] >= certificate.clearance - 1e-4


def test_sizes_beside_an_upright_path_are_refused_by_name() -> None:
    scene = load_scene("panda_cup")
    with pytest.raises(InputError, match=r"robot.tracking: is given, and no proof of path.upright covers it"):
        dataclasses.replace(scene, robot=dataclasses.replace(scene.robot, tracking=Tracking(0.001)))
