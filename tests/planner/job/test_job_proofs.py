"""Laws of a job's proof: the checker derives every stage's world itself, so no proof can tell it another one."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pytest
import yaml

import hdplan
from hdplan import InputError, Scene, StageMark, Trajectory
from hdplan.planner.commands.verify import run_verify
from hdplan.planner.job.proof import prove_job
from hdplan.planner.terminal.declared import GivenScene
from hdplan.verify.balls import HERE, RejectedError
from hdplan.verify.bundle import parts_of
from hdplan.verify.checking import check_job, check_part
from hdplan.verify.compare import plain
from hdplan.verify.job import read_job
from hdplan.verify.reach import between
from hdplan.verify.scene import solid
from hdplan.verify.world import Piece, shape_of

from .forging import Forgery, body, change_body, judged, marked, on_a_shelf, packed, shifted, worlds, written

FINGER = "panda_finger_joint1"
HAND = ["panda_leftfinger", "panda_rightfinger"]


def job(**changes: Any) -> hdplan.Job:
    """A bar is taken from a shelf, lifted and let go in the air; stages by name, with changes."""
    stages = {
        "grip": hdplan.Grip(
            {FINGER: 0.0102},
            "bar",
            "panda_hand",
            touch=[["bar", [*HAND, "shelf"]]],
            limits=hdplan.Limits(acceleration=2.0),
        ),
        "lift": hdplan.Line(by=[0.0, 0.0, 0.04], touch=[["bar", "shelf"]]),
        "stand": hdplan.Wait(0.1),
        "let_go": hdplan.Release({FINGER: 0.02}, "bar"),
        "away": hdplan.Line(by=[0.0, 0.0, 0.03], frame="world"),
    }
    return hdplan.Job([replace(x, name=name, **changes.get(name, {})) for name, x in stages.items()])


@pytest.fixture(scope="module")
def scene() -> Scene:
    return on_a_shelf(0.02, limits=hdplan.Limits(acceleration=4.0), job=job())


@pytest.fixture(scope="module")
def files(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, bytes]:
    """Scene, motion and proof, which has a file, too."""
    path, motion = written(hdplan.plan_job(scene), tmp_path_factory.mktemp("job"))
    proof = prove_job(path, motion)
    proof.save(path.with_suffix(".proof"))
    return path, motion, proof.data


def test_the_whole_job_is_accepted(files: tuple[Path, Path, bytes], capsys: pytest.CaptureFixture[str]) -> None:
    scene, motion, data = files
    verdict, read = check_job(scene, motion, data)
    assert verdict.whole
    assert verdict.text.startswith("accepted: a job of 5 stages")
    assert len(read) == 7  # two where fingers move
    assert judged(scene, motion, data).whole  # the forger's pen writes what is read
    assert run_verify(GivenScene(str(scene)), motion, scene.with_suffix(".proof")) == 0
    assert "stage lift: accepted: over the whole motion" in capsys.readouterr().out
    with pytest.raises(InputError, match="--world: is about a single motion"):
        run_verify(GivenScene(str(scene)), motion, scene.with_suffix(".proof"), world=scene.with_name("world.json"))


def test_parts_are_those_of_the_stages(files: tuple[Path, Path, bytes]) -> None:
    """Left out, twice, exchanged, cut."""
    scene, motion, data = files
    parts = parts_of(data)
    forged = [
        *(packed([x for k, x in enumerate(parts) if k != i]) for i in range(len(parts))),
        *(packed([*parts[:i], parts[j], *parts[i + 1 :]]) for i, j in ((1, 0), (2, 6), (4, 5), (5, 1), (6, 2), (3, 2))),
        packed([*parts, parts[-1]]),
        packed(parts[::-1]),
        packed([]),
        data[:-1],
        data + b"0",
        parts[0],
    ]
    for each in forged:
        with pytest.raises(RejectedError):
            check_job(scene, motion, each)


def test_a_proof_tells_no_other_world(files: tuple[Path, Path, bytes]) -> None:
    """A hold left out, another place after release, allowed contacts in another stage, limits, joints of the hand,
    the motion: of any part."""
    scene, motion, data = files
    written = worlds(data)
    parts = read_job(scene, motion, written)

    def moved(name: str) -> Any:
        return lambda x: change_body(x, name, position=[a + 1e-6 for a in body(x, name)["position"]])

    def without(name: str) -> Any:
        return lambda x: x.update(bodies=[y for y in x["bodies"] if y["name"] != name])

    changes: list[Any] = [change(name) for change in (moved, without) for name in ("bar", "far", "shelf")]
    changes += [
        lambda x: x.update(not_compared=sorted([*x["not_compared"], ["bar", "panda_link5", "touch_links"]])),
        lambda x: x.update(not_compared=x["not_compared"][1:]),
        lambda x: change_body(x, "bar", joint=3),
        lambda x: change_body(x, "shelf", kind="held" if body(x, "shelf")["kind"] == "obstacle" else "obstacle"),
        lambda x: x.update(limits={**x["limits"], "position": x["limits"]["position"][::-1] + [[0.0, 1.0]]}),
        lambda x: x.update(held={y: at + 1e-3 for y, at in x["held"].items()}),
        lambda x: x.update(clearances={**x["clearances"], "self": -1.0}),
        lambda x: x["motion"]["positions"][1].__setitem__(0, 0.3),
    ]
    for part, world in zip(parts, written, strict=True):
        check_part(part, world)
        for change in changes:
            forged = json.loads(json.dumps(world, default=plain))
            change(forged)
            assert forged != world
            with pytest.raises(RejectedError):
                check_part(part, forged)


@pytest.mark.core
def test_a_forged_motion_is_rejected(files: tuple[Path, Path, bytes], tmp_path: Path) -> None:
    """Hashes and worlds in the proof are those of the forged files."""
    scene, motion, data = files
    old = Trajectory.load(motion)
    changes: list[Forgery] = [
        shifted("positions", 0, FINGER, 1e-3, "lift"),  # the hand is another where stages meet
        shifted("positions", 3, FINGER, 1e-3, "lift"),  # opens while it lifts
        shifted("positions", 3, "panda_joint2", 1e-3, "grip"),  # the arm moves while fingers do
        shifted("velocities", 0, "panda_joint2", 1e-2, "lift"),  # no rest
        shifted("velocities", 0, FINGER, 1e-2, "let_go"),
        shifted("positions", 0, "panda_joint4", 5e-3, "stand"),  # the line ends elsewhere
        shifted("positions", 10, "panda_joint1", 5e-3, "lift"),  # off the line
        shifted("positions", 0, "panda_joint1", 1e-4),  # another start
        shifted("positions", 1, "panda_joint1", 1e-3, "stand"),  # moves in a wait
        *(marked(by, name) for name, by in (("lift", 3), ("lift", -3), ("stand", -3), ("let_go", 3), ("away", -3))),
        lambda old: replace(old, stages=old.stages[:-1]),
        lambda old: replace(old, stages=(*old.stages[:2], *old.stages[3:])),
        lambda old: replace(old, stages=(old.stages[0], StageMark("stand", old.stages[1].row), *old.stages[3:])),
        lambda old: replace(old, times=np.array(old.times) * 0.5),
    ]
    for i, change in enumerate(changes):
        change(old).save(tmp_path / f"{i}.json")
        with pytest.raises(RejectedError):
            judged(scene, tmp_path / f"{i}.json", data)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    "changes",
    [
        {"lift": {"touch": ()}},  # what may touch, in no stage or in another one
        {"lift": {"touch": ()}, "stand": {"touch": [["bar", "shelf"]]}},
        {"grip": {"object": None, "link": None}, "let_go": {"object": None}},  # nothing is held
        {"lift": {"by": [0.0, 0.0, 0.042]}},
        {"lift": {"frame": "bar", "by": [0.04, 0.0, 0.0]}},
        {"stand": {"seconds": 0.2}},
        {"let_go": {"object": None}},  # never let go
        {"let_go": {"joints": {FINGER: 0.025}}},
        {"grip": {"link": "panda_link0"}},
        {"away": {"limits": hdplan.Limits(acceleration=0.5)}},
        {"lift": {"link": "bar", "turn": [0.0, 0.0, 0.1]}},  # of what is held
        {"lift": {"link": "shelf"}},
    ],
)
def test_the_proof_of_another_job_is_rejected(
    scene: Scene, files: tuple[Path, Path, bytes], tmp_path: Path, changes: dict[str, Any]
) -> None:
    _, motion, data = files
    other = tmp_path / "other.yaml"
    replace(scene, goal=None, job=job(**changes)).save(other)
    with pytest.raises(RejectedError):
        judged(other, motion, data)


def test_a_released_object_stays_at_its_release_pose(
    scene: Scene, files: tuple[Path, Path, bytes], tmp_path: Path
) -> None:
    """The checker's own kinematics and hdplan's agree on that."""
    path, motion, data = files
    first, last = worlds(data)[0], read_job(path, motion, worlds(data))[-1].reading.world
    before, after = (np.array(body(x, "bar")["position"]) for x in (first, last))
    np.testing.assert_allclose(after - before, [0.0, 0.0, 0.04], atol=1.1e-3)
    assert hdplan.certify_job(scene, Trajectory.load(motion)).certified
    np.testing.assert_allclose(after, body(worlds(data)[-1], "bar")["position"], atol=1e-10)


def test_an_object_out_of_reach_is_not_held(scene: Scene, files: tuple[Path, Path, bytes], tmp_path: Path) -> None:
    _, motion, data = files
    other = tmp_path / "other.yaml"
    for more in ([["bar", [*HAND, "panda_hand", "shelf"]]], [["bar", [*HAND, "panda_link7"]], ["bar", "shelf"]]):
        replace(scene, goal=None, job=job(grip={"touch": more})).save(other)
        with pytest.raises(
            RejectedError, match=r"stage grip: 'panda_(hand|link7)' is to hold 'bar', and is not within"
        ):
            judged(other, motion, data)


@pytest.mark.parametrize("seed", range(6))
def test_the_checkers_distances_of_pieces_are_those_of_coal(seed: int) -> None:
    """All pairs of shapes are compared."""
    rng = np.random.default_rng(seed)

    def rotated() -> np.ndarray:
        return np.linalg.qr(rng.normal(size=(3, 3)))[0]

    shapes = [
        (solid("box", {"size": [0.2, 0.1, 0.3]}), coal.Box(0.2, 0.1, 0.3)),
        (solid("sphere", {"radius": 0.1}), coal.Sphere(0.1)),
        (solid("cylinder", {"radius": 0.05, "length": 0.2}), coal.Cylinder(0.05, 0.2)),
        (solid("capsule", {"radius": 0.05, "length": 0.2}), coal.Capsule(0.05, 0.2)),
        (solid("ellipsoid", {"radii": [0.1, 0.2, 0.05]}), coal.Ellipsoid(0.1, 0.2, 0.05)),
    ]
    for (one, coal_one), (other, coal_other) in itertools.product(shapes, shapes):
        pieces, places = [], []
        for data in (one, other):
            turn = rotated()
            turn[:, 0] *= np.linalg.det(turn)
            at = rng.uniform(-0.3, 0.3, 3)
            points, _, sweep, off = shape_of(data, "a shape")
            pieces.append((turn, at, Piece("a", "obstacle", 0, "a", -1, HERE, points, off, sweep[0])))
            places.append(coal.Transform3s(turn, at))
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        exact = max(0.0, coal.distance(coal_one, places[0], coal_other, places[1], request, result))
        assert between(*pieces) == pytest.approx(exact, abs=2e-5)


def test_fields_that_no_job_has_are_refused_by_name(files: tuple[Path, Path, bytes], tmp_path: Path) -> None:
    path, motion, data = files
    written = path.read_text(encoding="utf-8")
    start, wait = '"panda_finger_joint2": 0.02}', '"wait": 0.1'
    at_rest = '"move": {"state": "default", "velocity": [0, 0, 0, 0, 0, 0, 0]}'
    for old, new, words in (
        (wait, '"spiral": 0.1', "does not know 'spiral' there"),
        (wait, '"wait": 0.1, "blend": 0.01', "blend: goes with move, line, circle, along"),
        ('"by": ', '"spin": 1, "by": ', "does not know 'spin' there"),
        (start, f'{start}, "velocity": {{"panda_joint1": 0.1}}', "start.velocity"),  # a job begins at rest,
        (wait, at_rest, "move.velocity"),  # and ends so
        ("job:", "self_collision: false\npath: {}\nfrom_request: true\njob:", "from_request, path, self_collision"),
    ):
        assert old in written
        other = tmp_path / "other.yaml"
        other.write_text(written.replace(old, new, 1), encoding="utf-8")
        with pytest.raises(RejectedError, match=words):
            check_job(other, motion, data)
        with pytest.raises(InputError):  # of the planner, as well
            hdplan.load_scene(other)


def test_sizes_that_no_job_knows_are_refused_by_name(files: tuple[Path, Path, bytes], tmp_path: Path) -> None:
    """An object that is held would be known exactly, and what is let go stand where it was let go; what may be touched
    stands in no place of its own; and what walks does so by the time of one motion."""
    path, motion, data = files
    unsure = {"position": 1e-7}
    places = [("obstacles", 0, "uncertainty", unsure), ("obstacles", 1, "uncertainty", unsure)]
    places += [("obstacles", 2, "uncertainty", {"speed": 1e-7})]
    for part, number, key, size in (*places, ("robot", 0, "calibration", unsure), ("robot", 0, "tracking", unsure)):
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        (content[part] if part == "robot" else content[part][number])[key] = size
        other = tmp_path / "other.yaml"
        other.write_text(json.dumps(content), encoding="utf-8")
        with pytest.raises(RejectedError, match=key):
            judged(other, motion, data)
        with pytest.raises(InputError, match=key):
            hdplan.load_scene(other)


def test_obstacles_may_be_elsewhere_by_a_known_size(scene: Scene, tmp_path: Path) -> None:
    """The size holds in every stage; a proof tells no smaller one, and is none of a scene with a larger one."""
    near, size = [0.55, 0.0, 0.95], hdplan.Uncertainty(0.02, 0.1)
    others = [each for each in scene.obstacles if each.name != "far"]

    def unsure(uncertainty: hdplan.Uncertainty | None) -> Scene:
        post = hdplan.Obstacle("post", hdplan.Box([0.05, 0.1, 0.1]), near, uncertainty=uncertainty)
        return replace(scene, goal=None, obstacles=[*others, post])

    result = hdplan.plan_job(unsure(size))
    assert result.certified, result.text
    known = hdplan.certify_job(unsure(None), result.trajectory)
    least = [
        (each.certificate.clearance or 0.0) - (other.certificate.clearance or 0.0)
        for each, other in zip(known.stages, result.certificate.stages, strict=True)
        if each.certificate.worst is not None and each.certificate.worst.other == "post"
    ]
    assert least
    assert min(least) >= 0.02
    (path, motion), other = written(result, tmp_path), tmp_path / "other.yaml"
    proof = prove_job(path, motion)
    assert proof.text.startswith("accepted: a job of 5 stages")
    assert "obstacle post is up to 0.02 m, 0.1 rad about its origin and 0 m/s away" in proof.text
    parts = worlds(proof.data)
    for part, world in zip(read_job(path, motion, parts), parts, strict=True):
        check_part(part, world)
        for forged in ({}, {"sizes": {**world["sizes"], "around": {}}}):
            with pytest.raises(RejectedError, match="sizes"):
                check_part(part, {**{key: x for key, x in world.items() if key != "sizes"}, **forged})
    unsure(hdplan.Uncertainty(0.5, 0.1)).save(other)
    with pytest.raises(RejectedError):
        judged(other, motion, proof.data)
