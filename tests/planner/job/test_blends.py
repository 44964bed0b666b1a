"""Laws of stages that go over into one another without a stop: curves blend as Pilz' transition window does, by a
simulation of its own; everything stays within its radius, and within the limits; what cannot be blended is refused."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

import hdplan
from hdplan import InputError, JobResult, StageMark
from hdplan.planner.job import blending
from hdplan.planner.job.proof import prove_certified
from hdplan.verify.balls import RejectedError
from hdplan.verify.checking import check_job

from ..links import along, place_of, pose_of
from .forging import written

TOOL, FAR, ANGLE = "panda_link8", 1e-5, 1e-4
LIMITS = hdplan.Limits(velocity="urdf", acceleration=5.0, jerk=500.0)
START = [-0.022096, -0.753529, 0.007612, -1.716165, 0.0063464, 0.962660, 0.771123]
P1, P2, P3 = np.array([0.2, 0.0, 0.8]), np.array([0.4, 0.2, 0.7]), np.array([0.2, 0.4, 0.6])
FINE: dict[str, Any] = {"link": TOOL, "position_tolerance": FAR, "orientation_tolerance": ANGLE}


LINE, UP, DOWN = "line: {to: [0.4, 0.2, 0.7]}", "line: {by: [0, 0, -0.1]}", "line: {by: [0, 0, -0.3]}"


def job_of(*stages: Any, **more: Any) -> hdplan.Scene:
    return hdplan.Scene(robot="panda", start=START, limits=LIMITS, job=hdplan.Job(stages), **more)


def driven(result: JobResult) -> tuple[Any, Any, Any]:
    return along(hdplan.load_robot("panda"), TOOL, result.trajectory)


def trapezoid(length: float, speed: float, acceleration: float, step: float) -> Any:
    """How far a tool is at every step, from rest to rest: integrated, not by formula."""
    ramp = min(speed / acceleration, math.sqrt(length / acceleration))
    top = ramp * acceleration
    whole = length / top + ramp
    time = np.arange(0.0, whole + step, step)
    pace = np.clip(np.minimum(acceleration * time, acceleration * (whole - time)), 0.0, top)
    gone = np.concatenate([[0.0], np.cumsum(0.5 * (pace[1:] + pace[:-1]) * step)])
    return gone * length / gone[-1]


def pilz(first: Any, second: Any, corner: Any, radius: float) -> Any:
    """Points of two curves, sampled in time, blended as `TrajectoryBlenderTransitionWindow` does it with samples."""
    enters = int(np.flatnonzero(np.linalg.norm(first - corner, axis=1) >= radius)[-1]) + 1
    leaves = int(np.flatnonzero(np.linalg.norm(second - corner, axis=1) >= radius)[0])
    one, other = len(first) - enters, leaves + 1
    align = len(first) - leaves - 1 if one > other else enters
    count = leaves + align - enters + 1
    k = np.arange(count)
    x1 = first[np.minimum(enters + k, len(first) - 1)]
    x2 = second[np.clip(enters + k - align, 0, len(second) - 1)]
    s = (k + 1) / count
    alpha = (6 * s**5 - 15 * s**4 + 10 * s**3)[:, None]
    return np.concatenate([first[:enters], x1 + alpha * (x2 - x1), second[leaves:]])


def apart(places: Any, curve: Any) -> float:
    """The largest distance of some places from a curve of points, straight between these: or a little more, as only the
    two ways at the nearest point count."""
    nearest, found = KDTree(curve).query(places)[1], np.full(len(places), np.inf)
    for way in (nearest - 1, nearest):
        begins = np.clip(way, 0, len(curve) - 2)
        along, off = curve[begins + 1] - curve[begins], places - curve[begins]
        share = np.clip((off * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-300), 0.0, 1.0)
        found = np.minimum(found, np.linalg.norm(off - share[:, None] * along, axis=1))
    return float(found.max())


def check_motion(result: JobResult) -> None:
    """The motion rests at both ends, moves where stages meet, within the limits, without a jump of the velocity."""
    motion = result.trajectory
    assert motion.velocities is not None
    assert np.abs(motion.velocities[[0, -1]]).max() == 0.0
    for mark in motion.stages[1:]:
        assert np.abs(motion.velocities[mark.row]).max() > 1e-3
    samples = motion.sampled(1000.0)
    robot = hdplan.load_robot("panda")
    columns = [motion.joint_names.index(joint) for joint in robot.joint_names]
    assert (np.abs(samples.velocities[:, columns]) <= robot.model.velocityLimit[: robot.n] * (1 + 1e-6)).all()
    assert np.abs(samples.accelerations).max() <= 5.0 * (1 + 1e-6)
    assert np.abs(np.diff(samples.velocities, axis=0)).max() <= 5.0 * 1e-3 * (1 + 1e-6)
    assert np.abs(np.diff(samples.accelerations, axis=0)).max() <= 500.0 * 1e-3 * (1 + 1e-6)


def line_and_arc(**tolerances: float) -> JobResult:
    """Both have speeds of their own: the blend takes as long as the slower one is in the ball."""
    found = hdplan.plan_job(
        job_of(
            hdplan.Line(to=P2, name="line", tool_speed=0.5, tool_acceleration=0.8, blend=0.1, **tolerances),
            hdplan.Circle(
                to=P3, center=[0.4, 0.4, 0.65], name="arc", tool_speed=0.3, tool_acceleration=1.5, **tolerances
            ),
        )
    )
    assert found.certified, found.text
    return found


@pytest.fixture(scope="module")
def planned() -> JobResult:
    return line_and_arc(**FINE)


@pytest.fixture(scope="module")
def coarse() -> JobResult:
    """The same with fewer rows."""
    return line_and_arc()


def test_curves_blend_as_pilz_does_it(planned: JobResult) -> None:
    """A simulation in steps of 0.2 ms says the same at 1,000 random places."""
    step = 2e-4
    _, places, _ = driven(planned)
    first = P1 + trapezoid(0.3, 0.5, 0.8, step)[:, None] / 0.3 * (P2 - P1)
    arc = planned.scene.job.stages[1]
    center = np.array(arc.center)
    one, other = P2 - center, P3 - center
    normal = np.cross(one, other) / np.linalg.norm(np.cross(one, other))
    angle = math.acos(one @ other / np.linalg.norm(one) / np.linalg.norm(other))
    gone = trapezoid(angle * float(np.linalg.norm(one)), 0.3, 1.5, step)
    second = center + Rotation.from_rotvec(np.outer(gone / gone[-1] * angle, normal)).apply(one)
    curve = pilz(first, second, P2, 0.1)
    chosen = np.random.default_rng(0).choice(len(places), 1000)
    assert apart(places[chosen], curve) <= FAR + 2e-6  # rounded by the steps of the simulation
    assert apart(curve[::200], places) <= FAR + 2e-5  # and none of it is left out; a millisecond is about 0.5 mm
    near = np.linalg.norm(places - P2, axis=1).min()
    assert 0.01 < near < 0.1
    check_motion(planned)


def test_without_speeds_both_brake_and_accelerate_evenly() -> None:
    """The curve has a closed form, and it takes less time than the two lines one by one."""
    rotation = place_of(hdplan.load_robot("panda"), TOOL, START).rotation
    turned = Rotation.from_rotvec([0.2, -0.1, 0.3]) * Rotation.from_matrix(rotation)
    stages = [hdplan.Line(to=P2, blend=0.12, **FINE), hdplan.Line(to=P3, rpy=turned.as_euler("xyz"), **FINE)]
    result = hdplan.plan_job(job_of(*stages))
    assert result.certified, result.text
    _, places, turns = driven(result)
    s = np.linspace(0.0, 1.0, 20001)[:, None]
    alpha = 6 * s**5 - 15 * s**4 + 10 * s**3
    one, other = (P1 - P2) / np.linalg.norm(P1 - P2), (P3 - P2) / np.linalg.norm(P3 - P2)
    inner = P2 + 0.12 * ((1 - alpha) * (1 - s) ** 2 * one + alpha * s**2 * other)
    curve = np.concatenate([[P1], inner, [P3]])
    assert apart(places, curve) <= FAR + 1e-7
    share = 0.4 * s[:, 0] ** 2  # of the second line, along which the link turns evenly
    wanted = Rotation.from_rotvec(np.outer(alpha[:, 0] * share, [0.2, -0.1, 0.3])) * Rotation.from_matrix(rotation)
    for place, turn in list(zip(places, turns, strict=True))[:: len(places) // 50]:
        near = int(np.linalg.norm(inner - place, axis=1).argmin())
        if 0 < near < len(inner) - 1:
            assert (wanted[near].inv() * turn).magnitude() <= ANGLE + 2e-5
    check_motion(result)
    rested = hdplan.plan_job(job_of(*(replace(stage, blend=0.0) for stage in stages)))
    assert result.trajectory.duration < 0.95 * rested.trajectory.duration  # type: ignore[operator]


def test_curves_of_different_speeds_keep_each_to_its_own_and_are_quicker_than_with_stops() -> None:
    slow, fast = (
        hdplan.Line(by=by, blend=blend, tool_speed=speed, tool_acceleration=1.0)
        for by, blend, speed in (([0, 0.12, 0], 0.03, 0.05), ([0.12, 0, 0], 0.0, 0.2))
    )
    result = hdplan.plan_job(job_of(slow, fast))
    rested = hdplan.plan_job(job_of(replace(slow, blend=0.0), fast))
    assert result.certified
    assert rested.certified
    assert result.trajectory.duration < rested.trajectory.duration  # type: ignore[operator]
    first, second = result.certificate.stages
    assert second.ends - second.begins < 0.6 * (first.ends - first.begins)


def test_the_tool_has_a_speed_before_a_corner_at_which_the_motion_rests_and_none_behind_it() -> None:
    poses = [hdplan.Pose(place) for place in ([0, 0, 0], [0.1, 0, 0], [0.1, 0, 0.1])]
    seam = hdplan.Line(by=[0, 0.06, 0], link=TOOL, blend=0.04, tool_speed=0.02)
    result = hdplan.plan_job(job_of(seam, hdplan.Along(poses=poses, frame="tool", link=TOOL)))
    assert result.certified, result.text
    assert "1 of them blended" in result.text
    times, places, _ = driven(result)
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(times)
    begins = result.certificate.stages[1].begins
    assert speeds[times[1:] < begins].max() <= 0.02 * (1.0 + 1e-6)
    assert speeds[times[1:] > begins].max() > 0.1


def test_a_file_that_is_driven_otherwise_is_not_certified(coarse: JobResult) -> None:
    """The motion to the corner and through it; a mark elsewhere; another radius; the same motion with stops."""
    scene, motion = coarse.scene, coarse.trajectory
    stages = scene.job.stages
    for changed in ({"blend": 0.09}, {"tool_speed": 0.2}):
        other = job_of(replace(stages[0], **changed), stages[1])
        assert not hdplan.certify_job(other, motion).certified
    marks = (motion.stages[0], StageMark("arc", motion.stages[1].row - 3))
    assert not hdplan.certify_job(scene, replace(motion, stages=marks)).certified
    rested = hdplan.plan_job(job_of(replace(stages[0], blend=0.0), stages[1])).trajectory
    stopped = hdplan.certify_job(scene, rested)  # as one that stops, and says so
    assert stopped.certified
    assert "each from rest to rest" in stopped.text
    assert any("line: stops at its end" in note for note in stopped.notes)
    assert rested.velocities is not None
    for row in (stages_end := rested.stages[1].row, stages_end - 1):
        creeps, marks = rested.velocities.copy(), (rested.stages[0], StageMark("arc", row))
        creeps[stages_end] += 1e-9 * (row == stages_end)
        assert not hdplan.certify_job(scene, replace(rested, velocities=creeps, stages=marks)).certified


def test_moves_blend_within_the_radius() -> None:
    """A move into a line, and a line into a move: on the line but within the radius of its ends, by forward kinematics;
    a motion that leaves the line earlier is not certified."""
    down = hdplan.PoseTarget(TOOL, hdplan.Pose.from_rpy([0.4, 0.1, 0.6], [math.pi, 0, 0]), free_rotation="z")
    up = hdplan.PoseTarget(TOOL, hdplan.Pose.from_rpy([0.3, 0.35, 0.6], [math.pi, 0, 0]), free_rotation="z")
    line = hdplan.Line(by=[0.0, 0.0, -0.2], link=TOOL, name="line", blend=0.05)
    stages = [
        hdplan.Move(down, name="there", blend=0.06),
        line,
        hdplan.Move(up, name="away"),
    ]
    result = hdplan.plan_job(job_of(*stages))
    assert result.certified, result.text
    times, places, turns = driven(result)
    check_motion(result)
    begin, end = np.array([0.4, 0.1, 0.6]), np.array([0.4, 0.1, 0.4])
    marks = [float(result.trajectory.times[mark.row]) for mark in result.trajectory.stages]  # type: ignore[index]
    inside = (times >= marks[1]) & (times <= marks[2])
    along = np.clip((end - places) @ [0.0, 0.0, 5.0] * -1.0, 0.0, 1.0)
    off = np.linalg.norm(places - (end + along[:, None] * (begin - end)), axis=1)
    near = (np.linalg.norm(places - begin, axis=1) <= 0.06) | (np.linalg.norm(places - end, axis=1) <= 0.05)
    assert (off[inside & ~near] <= 1e-3).all()
    assert (inside & ~near).sum() > 50
    assert np.ptp((turns[inside & ~near] * turns[inside & ~near][0].inv()).magnitude()) <= 0.02
    assert off[inside].max() > 2e-3  # it does leave the line
    off_line, half = inside & (off > 1.1e-3), times < 0.5 * (marks[1] + marks[2])
    comes = 0.9 * float(np.linalg.norm(places - begin, axis=1)[off_line & half].max())
    assert not _certified(job_of(replace(stages[0], blend=comes), *stages[1:]), result)
    assert not _certified(job_of(stages[0], replace(line, link="panda_hand_tcp"), stages[2]), result)
    rested = hdplan.plan_job(job_of(*(replace(stage, blend=0.0) for stage in stages)))
    assert result.trajectory.duration < rested.trajectory.duration  # type: ignore[operator]


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("by", "turn", "free"),
    [
        ([0.05, 0.03, 0.1], [0.3, 0.0, 0.0], "z"),
        ([-0.02, -0.08, 0.03], None, "z"),
        ([0.0, 0.0, 0.12], [0.0, 0.0, 0.5], "none"),
    ],
)
def test_a_line_in_the_tools_frame_goes_where_the_tool_has_turned(
    by: Any, turn: Any, free: str, tmp_path: Path
) -> None:
    """The move before it leaves open how the tool is turned about its axis, and the line, blended with it, too: it ends
    where it leads from the turn that the tool has, by forward kinematics, and the proof is accepted."""
    corner = np.array([0.35, 0.08, 0.56])
    goal = hdplan.PoseTarget(TOOL, hdplan.Pose.from_rpy(corner, [3.4, -0.2, -0.1]), free_rotation="z")
    line = hdplan.Line(by=by, turn=turn, frame="tool", link=TOOL, free_rotation=free, name="last")
    stages = [
        hdplan.Line(by=[0.09, 0.03, 0.11], link=TOOL, blend=0.05, name="first"),
        hdplan.Move(goal, blend=0.04, name="open"),
        line,
    ]
    scene = job_of(*stages)
    result = hdplan.plan_job(scene)
    assert result.certified, result.text
    _, places, turns = driven(result)
    turned = turns[-1].as_matrix()
    if turn is not None:
        turned = turned @ Rotation.from_euler("xyz", turn).as_matrix().T
    assert np.linalg.norm(places[-1] - corner - turned @ np.array(by)) <= 1e-3
    for factor in (0.97, 1.03, -1.0):
        other = tuple(factor * np.array(by))
        assert not _certified(job_of(*stages[:2], replace(line, by=other)), result)
    proof = prove_certified(result.certificate, *written(result, tmp_path))
    assert proof.text.startswith("accepted: a job of 3 stages")


def test_the_middle_of_a_blend_excuses_no_lesser_clearance(planned: JobResult) -> None:
    """Start and goal of a scene do, where they are close; but where stages meet the motion itself says."""
    times, places, _ = driven(planned)
    motion = planned.trajectory
    middle = places[np.searchsorted(times, motion.times[motion.stages[1].row])]  # type: ignore[index]
    way = (P2 - middle) / np.linalg.norm(P2 - middle)
    for far in np.arange(0.10, 0.4, 0.02):
        ball = hdplan.Obstacle("ball", hdplan.Sphere(0.01), middle + far * way)
        scene = replace(planned.scene, obstacles=[ball])
        if (found := hdplan.certify_job(scene, motion)).certified:
            break
    assert found.certified
    assert found.clearance is not None
    for share in (0.9, 1.2):
        requested = replace(scene, planner=hdplan.PlannerSettings(clearance=share * found.clearance))
        assert hdplan.certify_job(requested, motion).certified is (share < 1.0)


@pytest.mark.parametrize("seed", range(2))
def test_one_slow_stage_makes_no_job_slower_than_with_stops(seed: int) -> None:
    """The stage is slow itself, and nothing else is; finer steps make no motion slower."""
    rng = np.random.default_rng(seed)
    line = hdplan.Line(by=[0.05, 0.12, 0.0], link=TOOL, blend=0.03, speed=1.0)
    round_ = hdplan.Circle(by=[0.1, 0.1, 0.0], interim=[0.03, 0.07, 0.0], link=TOOL, blend=0.03)
    stages = [line, round_, hdplan.Line(by=[0.1, -0.05, 0.0], link=TOOL)]
    slow = int(rng.integers(3))
    speed = float(rng.choice([0.2, 0.4]))
    stages[slow] = replace(stages[slow], speed=speed)
    result = hdplan.plan_job(job_of(*stages))
    rested = hdplan.plan_job(job_of(*(replace(stage, blend=0.0) for stage in stages)))
    assert result.certified, result.text
    assert "2 of them blended" in result.text
    assert result.trajectory.duration < rested.trajectory.duration  # type: ignore[operator]
    motion, most = result.trajectory, hdplan.load_robot("panda").model.velocityLimit[:7]
    rows = [*(mark.row for mark in motion.stages), len(motion) - 1]
    assert motion.velocities is not None
    for k in range(3):  # but for where it goes over into another
        inner = slice(rows[k] + (rows[k + 1] - rows[k]) // 4, rows[k + 1] - (rows[k + 1] - rows[k]) // 4)
        shares = np.abs(motion.velocities[inner, :7]) / most
        assert shares.max() <= (speed if k == slow else 1.0) * (1.0 + 1e-6)


def test_finer_steps_make_no_slower_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    """A line into an arc: kinks between chords, and between steps to poses, were jerk; it took four times as long."""
    fine = {"link": TOOL, "position_tolerance": 1e-3}
    line = hdplan.Line(by=[0.1, 0.02, -0.05], blend=0.03, **fine)
    stages = [line, hdplan.Circle(by=[0.1, 0.1, 0.0], interim=[0.03, 0.07, 0.0], **fine)]
    took = []
    for finer in (1, 4, 12):
        monkeypatch.setattr("hdplan.planner.job.blending.DENSITY_FACTORS", (finer,))
        result = hdplan.plan_job(job_of(*stages))
        assert "1 of them blended" in result.text
        took.append(result.trajectory.duration)
    assert max(took) <= 1.05 * min(took)  # type: ignore[operator, type-var]


def test_a_blend_in_which_the_motion_rests_is_a_stop_at_the_end() -> None:
    """Exactly back: such a blend is a cusp, at which a motion rests before it gets to the corner."""
    there = hdplan.Line(by=[0.0, 0.1, 0.0], name="there", blend=0.02, free_rotation="z", link=TOOL)
    result = hdplan.plan_job(job_of(there, replace(there, by=[0.0, -0.1, 0.0], name="back", blend=0.0)))
    assert result.certified, result.text
    assert "each from rest to rest" in result.text
    _, places, _ = driven(result)
    assert abs(np.ptp(places[:, 1]) - 0.1) <= 2e-3


def test_a_blend_that_would_be_slower_is_a_stop(tmp_path: Path) -> None:
    """Almost back along the same line: the curve of such a blend is a cusp. What is driven is certified, proven, and
    says that it stops."""
    there = hdplan.Line(by=[0.0, 0.1, 0.0], name="there", blend=0.02, **FINE)
    scene = job_of(there, hdplan.Line(by=[0.0, -0.1, 0.002], name="back", **FINE))
    result = hdplan.plan_job(scene)
    assert result.certified
    assert "each from rest to rest" in result.text
    notes = [note for note in result.notes if note.startswith("there: ")]
    assert any("stops at its end, where the job blends it into 'back'" in note for note in notes)
    assert any("not blended into 'back': it would take" in note for note in notes)
    assert hdplan.certify_job(scene, result.trajectory).text == result.text
    proof = prove_certified(result.certificate, *written(result, tmp_path))
    assert proof.text.startswith("accepted: a job of 2 stages")
    assert "stops, where the job blends it into the next" in proof.text
    notes = json.loads((tmp_path / "job.json").read_text())
    row = notes["stages"][1]["row"]
    for mark, creeps in ((row, 1e-9), (row - 1, 0.0), (row + 1, 0.0)):
        notes["stages"][1]["row"], notes["velocities"][row][0] = mark, creeps
        (tmp_path / "job.json").write_text(json.dumps(notes))
        with pytest.raises(RejectedError):
            check_job(tmp_path / "scene.yaml", tmp_path / "job.json", proof.data)


@pytest.mark.parametrize("pressed", [True, False])
def test_an_end_while_blending_leaves_stops(monkeypatch: pytest.MonkeyPatch, pressed: bool) -> None:
    """Ctrl-C in the first group of stages, or a request to end there: the planned stages are kept, and certified."""
    begun: list[int] = []

    def begin(*given: Any, **more: Any) -> Any:
        begun.append(1)
        if pressed:
            raise KeyboardInterrupt
        return worlds(*given, **more)

    worlds = blending._worlds
    monkeypatch.setattr(blending, "_worlds", begin)
    lines = [hdplan.Line(by=by, blend=0.02 * (k % 2 == 0), link=TOOL) for k, by in enumerate(
        ([0.0, 0.08, 0.0], [0.08, 0.0, 0.0], [0.0, 0.0, -0.08], [-0.08, 0.0, 0.0])
    )]  # fmt: skip
    result = hdplan.plan_job(job_of(*lines), stop=lambda: bool(begun))
    assert result.certified
    assert not result.failure
    left = [note for note in result.notes if "not blended" in note]
    assert [note.partition(":")[0] for note in left] == ["line 0", "line 2"]
    assert all("interrupted before that was tried" in note for note in left)


def test_moves_to_several_goals_blend_into_moves() -> None:
    """One of several goals is enough, of poses together each counts."""
    first, last = np.array(START) + [0.5, 0.2, 0.1, 0.2, 0, 0.1, 0], np.array(START) + [0.2, -0.6, 0, 0.1, 0, 0, 0]
    robot = hdplan.load_robot("panda")
    near, elbow = (hdplan.PoseTarget(link, pose_of(robot, link, first)) for link in (TOOL, "panda_link4"))
    both = hdplan.AllOf([near, elbow])
    result = hdplan.plan_job(job_of(hdplan.Move(both, name="there", blend=0.06), hdplan.Move(last)))
    assert result.certified, result.text
    off = replace(elbow, pose=hdplan.Pose(np.array(elbow.pose.position) + [0.0, 0.0, 0.2]))
    for goal, certified in (
        ([off, near], True),
        ([off, first.tolist()], True),
        (hdplan.AllOf([near, off]), False),
        (off, False),
    ):
        other = job_of(hdplan.Move(goal, name="there", blend=0.06), hdplan.Move(last))
        assert _certified(other, result) is certified


def _certified(scene: hdplan.Scene, result: JobResult) -> bool:
    try:
        return hdplan.certify_job(scene, result.trajectory).certified
    except InputError:
        return False


@pytest.mark.parametrize(
    ("stages", "words"),
    [
        ([f"{LINE}, blend: 0.35", "line: {to: [0.2, 0.4, 0.6]}"], "first.*larger than the stage its"),
        ([f"{LINE}, blend: 0.25", UP], "first.*larger than the stage that"),
        ([f"{LINE}, blend: 0.2", "line: {to: [0.2, 0.4, 0.6]}, blend: 0.2", DOWN], "second.*overlap"),
        (["line: {to: [0.4, 0.2, 0.7], free_rotation: z}, blend: 0.1", UP], "free_rotation"),
        ([f"{LINE}, blend: 0.1"], "first.*there is no next stage"),
        ([f"{LINE}, blend: 0.1", "wait: 1.0"], "first.*stands still"),
        ([f"{LINE}, blend: -0.1", UP], "blend"),
        ([f"{LINE}, blend: .nan", UP], "blend"),
        ([f"{LINE}, blend: 0.05, limits: {{acceleration: 3}}", UP], "first.*limits"),
        ([LINE, "wait: 1.0, blend: 0.1"], "blend.*goes with 'move', 'line', 'circle', 'along'"),
        (["line: {by: [0, 0, 0.1], link: panda_hand}, blend: 0.05", DOWN], "panda_hand"),
    ],
)  # fmt: skip
def test_an_impossible_blend_is_one_line(tmp_path: Path, stages: list[str], words: str) -> None:
    names = ("first", "second", "third")
    listed = "".join(f"  - {{name: {name}, {stage}}}\n" for name, stage in zip(names, stages, strict=False))
    file = tmp_path / "job.yaml"
    head = f"hdplan: 1\nrobot: {{name: panda}}\nobstacles: []\nstart: {{joints: {START}}}\n"
    file.write_text(f"{head}limits: {{velocity: urdf, acceleration: 5, jerk: 500}}\njob:\n{listed}")
    with pytest.raises(InputError, match=words) as refused:
        hdplan.plan_job(hdplan.load_scene(file))
    assert "\n" not in str(refused.value)


def test_blends_are_written_and_read_again(tmp_path: Path, coarse: JobResult) -> None:
    scene, motion = written(coarse, tmp_path)
    again = hdplan.load_scene(scene)
    assert again.job == coarse.scene.job
    assert hdplan.certify_job(again, hdplan.Trajectory.load(motion)).certified


def test_a_blend_by_laws_of_the_tool_has_a_proof(tmp_path: Path, coarse: JobResult) -> None:
    """The checker's own definition is that of Pilz, too: what it accepts is within a hundredth of a millimetre."""
    scene, motion = written(coarse, tmp_path)
    proof = prove_certified(coarse.certificate, scene, motion)
    assert proof.text.startswith("accepted: a job of 2 stages")
    assert "rad, at most 0.3 m/s, at most 1.5 m/s^2" in proof.text
    other = tmp_path / "other.yaml"
    other.write_text(scene.read_text(encoding="utf-8").replace("0.8", "0.7"), encoding="utf-8")
    with pytest.raises(RejectedError):
        check_job(other, motion, proof.data)
