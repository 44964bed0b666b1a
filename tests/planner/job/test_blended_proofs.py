"""Laws of the proofs of curves and blends: the checker's own definition of both, and no false job that it accepts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import hdplan
from hdplan import JobResult, Scene, StageMark, Trajectory
from hdplan.planner.job.proof import prove_certified
from hdplan.scenes.yaml_format.reader import shipped_jobs
from hdplan.verify.balls import RejectedError
from hdplan.verify.checking import check_job, check_part
from hdplan.verify.curves import Blend, Leg, arc_about, arc_through
from hdplan.verify.effects import check_claim, wanted
from hdplan.verify.follow import check_follow
from hdplan.verify.job import Part, read_job
from hdplan.verify.world import World

from ..links import places_at
from .forging import Forgery, marked, on_a_shelf, shifted, tip, worlds, written

TOOL, FINGERS = "panda_hand_tcp", ["panda_leftfinger", "panda_rightfinger"]
SPEED = 0.1
Files = tuple[Path, Path, bytes]


def job(**changes: Any) -> hdplan.Job:
    """A bar is lifted, carried over an edge and round a bend without a stop, and left there; stages with changes."""
    above = hdplan.Pose([*(tip() + [0.0, 0.0, 0.1])], [1.0, 0.0, 0.0, 0.0])
    stages = {
        "take": hdplan.Grip(object="bar", link="panda_hand", touch=[["bar", [*FINGERS, "shelf"]]]),
        "lift": hdplan.Line(by=[0.0, 0.0, 0.06], link=TOOL, touch=[["bar", "shelf"]], blend=0.02),
        "over": hdplan.Line(by=[0.0, 0.1, 0.0], turn=[0.0, 0.0, 0.2], link=TOOL, tool_speed=SPEED, blend=0.02),
        "round": hdplan.Circle(by=[-0.05, 0.05, 0.0], center=[-0.05, 0.0, 0.0], link=TOOL, tool_speed=SPEED),
        "open": hdplan.Set({"valve": True}),
        "leave": hdplan.Release(object="bar"),
        "away": hdplan.Line(by=[0.0, 0.0, 0.06], link=TOOL, touch=[["bar", FINGERS]], blend=0.02),
        "home": hdplan.Move(above, blend=0.02),
        "down": hdplan.Line(by=[0.0, 0.0, -0.06], link=TOOL),
    }
    return hdplan.Job([replace(x, name=name, **changes.get(name, {})) for name, x in stages.items()])


@pytest.fixture(scope="module")
def scene() -> Scene:
    return on_a_shelf(0.0102, limits=hdplan.Limits(acceleration=5.0, jerk=500.0), job=job())


@pytest.fixture(scope="module")
def files(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Files:
    """Scene, motion and proof."""
    result = hdplan.plan_job(scene)
    path, motion = written(result, tmp_path_factory.mktemp("blended"))
    return path, motion, prove_certified(result.certificate, path, motion).data


@pytest.fixture(scope="module")
def checked(files: Files) -> Any:
    return check_job(*files)


def claimed(scene: Path, motion: Path, data: bytes) -> list[Part]:
    """The worlds of a forged job, once all that they want beside clearances is shown: with less, no proof is whole."""
    parts = read_job(scene, motion, worlds(data))
    for part in parts:
        world = World(part.reading.world, {})
        for claim in sorted(wanted(world), key=lambda x: x != "path"):
            check_claim(world, claim)
    return parts


def marks(motion: Path) -> dict[str, int]:
    return {mark.name: mark.row for mark in Trajectory.load(motion).stages}


def test_a_blended_job_is_accepted_whole(checked: Any) -> None:
    verdict, read = checked
    assert verdict.whole
    assert len(read) == 9
    assert "stage over: accepted: over the whole motion" in verdict.text
    assert verdict.text.count("goes over into the next within 0.02 m") == 4
    assert verdict.text.count("follows its curve") == 5
    assert "but within 20 mm of its end" in verdict.text
    assert f"at most {SPEED} m/s" in verdict.text


# --- no false job -----------------------------------------------------------------------------------------------------


def sets(outputs: dict[str, Any]) -> Forgery:
    def change(old: Trajectory) -> Trajectory:
        return replace(old, stages=tuple(replace(x, outputs=outputs if x.outputs else {}) for x in old.stages))

    return change


def renamed(*names: str) -> Forgery:
    def change(old: Trajectory) -> Trajectory:
        return replace(old, stages=tuple(StageMark(x, y.row) for x, y in zip(names, old.stages, strict=True)))

    return change


def faster(by: float) -> Forgery:
    def change(old: Trajectory) -> Trajectory:
        assert old.times is not None
        assert old.velocities is not None
        assert old.accelerations is not None
        return replace(
            old, times=old.times / by, velocities=old.velocities * by, accelerations=old.accelerations * by**2
        )

    return change


FORGED_MOTIONS = {
    "another order": [renamed("take", "over", "lift", "round", "open", "leave", "away", "home", "down")],
    "shifted joins of two curves": [marked(by, name) for by in (-5, 5) for name in ("over", "round")],
    "a gripper event or an output earlier or later": [
        *(marked(by, "open", "leave", "away") for by in (3, 1, -1, -3)),
        *(marked(by, "away") for by in (1, 3)),
        *(marked(by, "lift") for by in (1, 3)),
    ],
    "other outputs": [sets({"valve": False}), sets({"valve": 1.0}), sets({"valve": True, "more": 1}), sets({})],
    "the tool off its line, its arc and its blends": [
        shifted("positions", 20, "panda_joint1", 4e-3, "lift"),
        shifted("positions", 40, "panda_joint2", 4e-3, "over"),
        shifted("positions", 2, "panda_joint4", 4e-3, "over"),
        shifted("positions", 40, "panda_joint1", 4e-3, "round"),
        shifted("positions", 30, "panda_joint1", 6e-3, "down"),
    ],
    "the tool turned": [shifted("positions", 20, "panda_joint7", 0.015, name) for name in ("lift", "over", "round")],
    "a join that is off, or jumps": [
        shifted("positions", 0, "panda_joint2", 3e-3, "over"),
        shifted("velocities", 0, "panda_joint2", 0.1, "over"),
        shifted("accelerations", 0, "panda_joint2", 4.0, "home"),
        shifted("velocities", 0, "panda_joint4", 0.2, "home"),
    ],
    "limits broken where stages go over into one another": [faster(1.2), faster(1.05)],
    "a stage that ends, or begins, elsewhere": [
        shifted("positions", 0, "panda_joint2", 3e-3, "open"),
        shifted("positions", 0, "panda_joint2", 1e-4, "take"),
        shifted("positions", -1, "panda_joint2", 0.1, "down"),
    ],
}


@pytest.mark.core
@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("kind", "number"), [(kind, i) for kind, each in FORGED_MOTIONS.items() for i in range(len(each))]
)
def test_a_forged_motion_is_rejected(files: Files, tmp_path: Path, kind: str, number: int) -> None:
    scene, motion, data = files
    other = tmp_path / "other.json"
    FORGED_MOTIONS[kind][number](Trajectory.load(motion)).save(other)
    with pytest.raises(RejectedError, match="path.follow" if "tool" in kind else "."):
        claimed(scene, other, data)


FORGED_JOBS = [
    {"lift": {"blend": 0.03}},  # another radius
    {"lift": {"blend": 0.01}},
    {"lift": {"blend": 0.0}},  # to a stop
    {"home": {"blend": 0.003}},
    {"over": {"by": [0.0, 0.103, 0.0]}},
    {"over": {"turn": [0.0, 0.0, 0.23]}},
    {"over": {"turn": None}},
    {"over": {"tool_speed": 0.09}},
    {"over": {"tool_acceleration": 0.2}},
    {"over": {"position_tolerance": 1e-7}},
    {"over": {"orientation_tolerance": 1e-7}},
    {x: {"link": "panda_link5"} for x in ("lift", "over", "round")},
    {"round": {"center": [-0.05, 0.004, 0.0], "position_tolerance": 0.01}, "over": {"position_tolerance": 1e-4}},
    {"round": {"center": None, "interim": [-0.02, 0.02, 0.0]}},
    {"round": {"frame": "far", "by": [-0.05, 0.05, 0.002]}},
    {"open": {"outputs": {"valve": 1.0}}},
    {"home": {"path": hdplan.PathConstraints(upright=hdplan.Upright("panda_hand", "-z", 1e-6))}},
    {x: {"limits": hdplan.Limits(acceleration=1.0)} for x in ("away", "home", "down")},
    {"round": {"limits": hdplan.Limits(acceleration=0.2)}, "lift": {"blend": 0.0}, "over": {"blend": 0.0}},
    {"down": {"by": [0.0, 0.0, -0.063]}},
]


def other_job(scene: Scene, folder: Path, changes: dict[str, Any]) -> Path:
    """The file of the scene with changes of its job's stages."""
    other = folder / "other.yaml"
    replace(scene, goal=None, job=job(**changes)).save(other)
    return other


@pytest.mark.sampled(4)
@pytest.mark.parametrize("changes", FORGED_JOBS, ids=str)
def test_the_motion_of_another_job_is_rejected(
    scene: Scene, files: Files, tmp_path: Path, changes: dict[str, Any]
) -> None:
    _, motion, data = files
    other = other_job(scene, tmp_path, changes)
    with pytest.raises(RejectedError):
        claimed(other, motion, data)


@pytest.mark.parametrize(
    "changes",
    [
        {"lift": {"touch": ()}},  # what may touch, in the wrong stage or none
        {"lift": {"touch": ()}, "over": {"touch": [["bar", "shelf"]]}},
        {"away": {"touch": ()}},
        {"take": {"touch": [["bar", [FINGERS[0], "shelf"]]]}},
        {"take": {"link": "panda_link0"}},
    ],
    ids=str,
)
def test_the_proof_tells_no_other_world(scene: Scene, files: Files, tmp_path: Path, changes: dict[str, Any]) -> None:
    _, motion, data = files
    other = other_job(scene, tmp_path, changes)
    with pytest.raises(RejectedError):
        check_job(other, motion, data)


def test_a_proof_tells_no_other_rates_and_no_other_curve(files: Files) -> None:
    scene, motion, data = files
    written = worlds(data)
    parts = {part.name: (part, world) for part, world in zip(read_job(scene, motion, written), written, strict=True)}
    part, world = parts["stage over"]
    (path,) = world["path"]

    def curve(**changes: Any) -> dict[str, Any]:
        return {**world, "path": [{**path, **changes}]}

    shifted = [{**x, "position": [x["position"][0] + 1e-3, *x["position"][1:]]} for x in path["poses"]]
    start, goal = world["start"][0], world["goal"][0]
    forged = [
        {**world, "start": [{**start, "velocity": [x + 1e-3 for x in start["velocity"]]}]},
        {**world, "goal": [{x: y for x, y in goal.items() if x not in ("velocity", "acceleration")}]},
        {**world, "clearances": {**world["clearances"], "obstacles": -1.0}},
        {**world, "path": []} | {"path": [{**path, "kind": "follow", "poses": path["poses"][:-5]}]},
        curve(poses=shifted),
        curve(poses=path["poses"][::-1][:10]),
        curve(speed=None),
        curve(speed=0.3),
        curve(free="z"),
        curve(link="panda_hand"),
        curve(position_tolerance=0.1),
        curve(end_tolerance=0.02),
    ]
    check_part(part, world)
    for each in forged:
        with pytest.raises(RejectedError):
            check_part(part, each)


def test_the_middle_of_a_blend_excuses_no_clearance(scene: Scene, files: Files, checked: Any, tmp_path: Path) -> None:
    """An obstacle as close to the middle of a blend as planner.clearance does not allow: the proof is not whole."""
    _, motion, data = files
    assert checked[0].whole
    settings = replace(scene.planner, clearance=0.06)  # the scene's closest place is 41 mm
    other = tmp_path / "other.yaml"
    replace(scene, goal=None, planner=settings).save(other)
    with pytest.raises(RejectedError):
        check_job(other, motion, data)


# --- curves -----------------------------------------------------------------------------------------------------------


def tool_places(motion: Trajectory, first: int, last: int, each: int = 60) -> tuple[Any, Any]:
    """Times of rows and between them, and where the tool is then."""
    assert motion.times is not None
    times = np.interp(np.linspace(first, last, (last - first) * each + 1), np.arange(len(motion)), motion.times)
    return times, places_at(hdplan.load_robot("panda"), TOOL, motion, times)[0]


@pytest.mark.sampled(6)
@pytest.mark.parametrize("seed", range(6))
def test_no_peak_of_speed_between_rows_is_accepted(files: Files, tmp_path: Path, seed: int) -> None:
    """A velocity that is changed in one row of two makes a peak somewhere between them: the check misses it in no part
    of an interval. Every accepted motion is slow enough at 60 places of each interval."""
    scene, motion, data = files
    rng, rows = np.random.default_rng(seed), marks(motion)
    for i in range(2):
        made = Trajectory.load(motion)
        row = int(rng.integers(rows["over"] + 1, rows["open"] - 1))
        assert made.velocities is not None
        velocities = np.array(made.velocities)
        velocities[row, :7] *= 1 + rng.choice([1e-4, 0.02, 0.1])
        other = tmp_path / f"{i}.json"
        replace(made, velocities=velocities).save(other)
        changed = Trajectory.load(other)
        times, places = tool_places(changed, max(row - 2, rows["over"]), min(row + 2, rows["open"]))
        fastest = np.linalg.norm(np.diff(places, axis=0), axis=1).max() / np.diff(times).max()
        parts = [x for x in read_job(scene, other, worlds(data)) if x.name in ("stage over", "stage round")]
        try:
            for part in parts:
                check_follow(World(part.reading.world, {}), part.reading.world["path"][0])
        except RejectedError:
            continue
        assert fastest <= SPEED * (1 + 1e-5)


def test_a_curve_is_followed_to_its_end_and_never_back(files: Files) -> None:
    """The same line in other rows: forth is accepted, and neither what turns round, nor what is cut short."""
    scene, motion, data = files
    (part,) = [x for x in read_job(scene, motion, worlds(data)) if x.name == "stage down"]
    rows = part.reading.world["motion"]["positions"]
    (path,) = part.reading.world["path"]

    def follows(chosen: list[int], **changes: Any) -> None:
        motion_data = {"rule": "linear", "times": None, "positions": [rows[i] for i in chosen]}
        world = {
            **part.reading.world,
            "motion": motion_data,
            "limits": {"position": part.reading.world["limits"]["position"]},
        }
        check_follow(World(world, {}), {**path, **changes})

    last = len(rows) - 1
    follows([*range(last + 1)])
    follows([*range(0, last, 2), last])
    for chosen in (
        [*range(last - 4)],  # cut short
        [*range(last - 5), *range(last - 5, last // 2, -1), *range(last // 2, last + 1)],  # back, and again
        [*range(last + 1)][::-1],
        [0, last],
    ):
        with pytest.raises(RejectedError):
            follows(chosen)
    with pytest.raises(RejectedError):
        follows([*range(last + 1)], begin_tolerance=0.002)
    with pytest.raises(RejectedError):
        follows([*range(last + 1)], begin_tolerance=None)


@pytest.mark.parametrize("seed", range(5))
def test_chords_are_as_near_as_they_say(seed: int) -> None:
    """Random arcs and lines, blended, turned and free, at equal shares."""
    rng = np.random.default_rng(seed)

    def rotation(size: float) -> Any:
        return pin.exp3(rng.normal(size=3) * size)

    corner, turn = rng.normal(size=3), rotation(1.0)
    one, other = corner + rng.normal(size=3), corner + rng.normal(size=3)
    free = ("none", "x", "y", "z")[seed % 4]
    laws = ((0.3, 1.0), (0.2, 2.0)) if seed % 2 else ((None, None), (None, None))
    arc = arc_through(corner, corner + rng.normal(size=3), other)
    np.testing.assert_allclose(arc[0] + np.cos(arc[3]) * arc[1] + np.sin(arc[3]) * arc[2], other, atol=1e-9)
    first = Leg(np.stack([one, corner]), np.stack([turn @ rotation(0.2), turn]), free, laws[0])
    second = Leg(np.stack([corner, other]), np.stack([turn, rotation(0.2) @ turn]), free, laws[1], arc)
    blend = Blend(first, second, 0.1)
    for half in (0, 1):
        s, far, angle = blend.chords(half, 1e-3, 1e-2)
        assert far <= 2e-5
        assert angle <= 5.01e-4
        assert (s[0], s[-1]) == (0.5 * half, 0.5 * half + 0.5)
        ends, turns = blend.poses(s)
        for share in rng.uniform(size=5):
            between = s[:-1] + share * np.diff(s)
            places, turned = blend.poses(between)
            straight = ends[:-1] + share * np.diff(ends, axis=0)
            assert np.linalg.norm(places - straight, axis=1).max() <= far + 1e-12
            axes = slice(None) if free == "none" else ["xyz".index(free)]
            near = np.minimum(*(np.linalg.norm((turned - x)[:, :, axes], axis=(1, 2)) for x in (turns[:-1], turns[1:])))
            assert near.max() <= 1.5 * angle + 1e-9
    shares, far = second.chords(0.1, 0.9, 1e-3)
    ends, _ = second.poses(shares)
    places, _ = second.poses(shares[:-1] + 0.5 * np.diff(shares))
    assert np.linalg.norm(places - 0.5 * (ends[1:] + ends[:-1]), axis=1).max() <= far + 1e-12 <= 2e-5 + 1e-12


@pytest.mark.parametrize("seed", range(4))
def test_arcs_are_circles(seed: int) -> None:
    """All points are equally far from the centre, and the given ones are on it."""
    rng = np.random.default_rng(seed)
    begins, point, ends = rng.normal(size=(3, 3))
    through = arc_through(begins, point, ends)
    centre = through[0]
    about = arc_about(begins, centre + 1e-9, ends, 1e-3)
    np.testing.assert_allclose(about[0], centre, atol=1e-8)
    assert about[3] <= np.pi + 1e-9
    leg = Leg(np.stack([begins, ends]), np.stack([np.eye(3)] * 2), "none", arc=through)
    places, _ = leg.poses(np.linspace(0.0, 1.0, 20_001))
    np.testing.assert_allclose(np.linalg.norm(places - centre, axis=1), np.linalg.norm(begins - centre), atol=1e-9)
    np.testing.assert_allclose(places[[0, -1]], [begins, ends], atol=1e-9)
    assert np.linalg.norm(places - point, axis=1).min() <= 1e-3 * leg.length
    np.testing.assert_allclose(leg.backwards.poses(np.array([0.2]))[0], leg.poses(np.array([0.8]))[0], atol=1e-9)
    radius = 0.3 * float(np.linalg.norm(begins - ends))
    off = np.linalg.norm(leg.poses(np.array([leg.leaves(radius)]))[0][0] - begins)
    assert off == pytest.approx(radius, abs=1e-9)


QUICKLY = "panda_pick_place"  # which is planned anyway


@pytest.mark.parametrize("name", [pytest.param(x, marks=[pytest.mark.slow] * (x != QUICKLY)) for x in shipped_jobs()])
def test_shipped_jobs_have_proofs(name: str, planned: JobResult, tmp_path: Path) -> None:
    """The proofs of `hdplan plan NAME -o job.json --proof job.proof`, on a machine that may be busy."""
    result = planned if name == QUICKLY else hdplan.plan_job(hdplan.load_scene(name), time_limit=600.0)
    assert result.certified, result.text
    result.save(tmp_path / "job.json")
    proof = prove_certified(result.certificate, name, tmp_path / "job.json")
    assert proof.text.startswith(f"accepted: a job of {len(result.certificate.stages)} stages")
