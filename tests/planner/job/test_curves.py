"""Laws of stages that follow a curve: what is certified is there, by formulas of their own; what nobody can follow, or
that is none, is refused in one line."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import hdplan
from hdplan import HdplanError, InputError, JobResult, UnsolvableError
from hdplan.planner.timing.retiming import Retimer

from ..links import along

TOOL, DOWN, PLACE = "panda_hand_tcp", [math.pi, 0.0, 0.0], [0.45, 0.1, 0.35]
FAR, ANGLE = 1e-4, math.radians(0.1)
FINE: dict[str, Any] = {"link": TOOL, "position_tolerance": FAR, "orientation_tolerance": ANGLE}
LIMITS = hdplan.Limits(velocity="urdf", acceleration=7.5, jerk=500.0)
THERE = hdplan.PoseTarget(TOOL, hdplan.Pose.from_rpy(PLACE, DOWN))
EIGHT = [
    hdplan.Pose.from_rpy([0.06 * math.sin(a), 0.06 * math.sin(2 * a), 0.0], [0.0, 0.0, math.sin(a) / 4])
    for a in np.linspace(0, 2 * math.pi, 91)
]


def job_of(*stages: Any, **more: Any) -> hdplan.Scene:
    job = hdplan.Job([hdplan.Move(THERE, name="there"), *stages])
    return hdplan.Scene(robot="panda", start="default", limits=LIMITS, job=job, **more)


@pytest.fixture(scope="module")
def planned() -> JobResult:
    found = hdplan.plan_job(
        job_of(
            hdplan.Line(by=[0.05, 0.1, 0], turn=[0.3, 0, 0.4], frame="tool", name="turning", **FINE),
            hdplan.Circle(by=[0, 0.2, 0], interim=[0.1, 0.1, 0.03], name="through", **FINE),
            hdplan.Circle(
                by=[-0.05, -0.05, 0],
                center=[0, -0.05, 0],
                name="around",
                tool_speed=0.05,
                tool_acceleration=0.5,
                **FINE,
            ),
            hdplan.Along(EIGHT, frame="tool", name="eight", **FINE),
            hdplan.Line(by=[0.0, -0.1, 0], free_rotation="z", name="free", tool_speed=0.1, **FINE),
            hdplan.Line(by=[0, 0, 0], turn=[0, 0, 1.2], name="on the spot", **FINE),
        )
    )
    assert found.certified, found.text
    return found


def tool_at(stage: hdplan.StageCertificate, step: float = 1e-3) -> tuple[Any, Any, Any]:
    return along(hdplan.load_robot("panda"), TOOL, stage.trajectory, step)


def stage_named(planned: JobResult, name: str) -> hdplan.StageCertificate:
    (found,) = [each for each in planned.certificate.stages if each.name == name]
    return found


def test_a_turning_line(planned: JobResult) -> None:
    """The tool stays on the line, turned by the share of the way that is done."""
    _, places, turns = tool_at(stage_named(planned, "turning"))
    way = turns[0].apply([0.05, 0.1, 0.0])
    length = np.linalg.norm(way)
    share = (places - places[0]) @ way / length**2
    assert np.linalg.norm(places - places[0] - np.outer(share, way), axis=1).max() <= FAR
    assert abs(share[-1] - 1.0) * length <= FAR
    whole = Rotation.from_euler("xyz", [0.3, 0.0, 0.4]).as_rotvec()  # in the tool's frame
    wanted = turns[0] * Rotation.from_rotvec(np.outer(np.clip(share, 0, 1), whole))
    slack = FAR / length * np.linalg.norm(whole)  # the share is known as well as the place
    assert (wanted.inv() * turns).magnitude().max() <= ANGLE + slack


@pytest.mark.parametrize(
    ("name", "center", "radius", "angle"),
    [("through", None, None, None), ("around", [0.0, -0.05, 0.0], 0.05, math.pi / 2)],
)
def test_arcs(planned: JobResult, name: str, center: Any, radius: Any, angle: Any) -> None:
    _, places, turns = tool_at(stage_named(planned, name))
    off = places - places[0]
    if center is None:  # by the equations of a circle through three points
        a, b = np.array([0.1, 0.1, 0.03]), np.array([0.0, 0.2, 0.0])
        rows = np.array([a, b, np.cross(a, b)])
        center = np.linalg.solve(rows, [a @ a / 2, b @ b / 2, 0.0])
        radius = np.linalg.norm(center)
        assert np.linalg.norm(off - a, axis=1).min() <= FAR + 2e-4  # within a millisecond
        assert np.linalg.norm(off[-1] - b) <= FAR
        normal = rows[2] / np.linalg.norm(rows[2])
    else:
        normal = np.array([0.0, 0.0, 1.0])
        assert np.linalg.norm(off[-1] - [-0.05, -0.05, 0.0]) <= FAR
        assert off[:, 0].min() >= -0.05 - FAR
        assert off[:, 1].max() <= FAR  # the shorter way
    arm = off - center
    assert np.hypot(np.linalg.norm(arm - np.outer(arm @ normal, normal), axis=1) - radius, arm @ normal).max() <= FAR
    assert (turns[0].inv() * turns).magnitude().max() <= 2 * ANGLE


def test_poses_of_a_list(planned: JobResult) -> None:
    """Near its polyline, and past each of its poses in order."""
    stage = stage_named(planned, "eight")
    _, places, turns = tool_at(stage)
    begins = np.eye(4)
    begins[:3, :3], begins[:3, 3] = turns[0].as_matrix(), places[0]
    wanted = begins @ np.array([pose.matrix for pose in EIGHT])
    passed = 0
    for pose in wanted:
        near = np.linalg.norm(places[passed:] - pose[:3, 3], axis=1)
        turned = (Rotation.from_matrix(pose[:3, :3]).inv() * turns[passed:]).magnitude()
        there = np.flatnonzero((near <= FAR + 3e-4) & (turned <= ANGLE + 3e-3))
        assert len(there)
        passed += int(there[0])
    a, b = wanted[:-1, :3, 3], np.diff(wanted[:, :3, 3], axis=0)
    share = np.clip(((places[:, None] - a) * b).sum(axis=2) / (b * b).sum(axis=1), 0, 1)
    assert np.linalg.norm(places[:, None] - a - share[..., None] * b, axis=2).min(axis=1).max() <= FAR


def test_speeds_of_the_tool(planned: JobResult) -> None:
    for name, speed, acceleration in (("around", 0.05, 0.5), ("free", 0.1, np.inf)):
        times, places, _ = tool_at(stage_named(planned, name), 5e-4)
        v = np.gradient(places[:-1], times[:-1], axis=0)
        assert np.linalg.norm(v, axis=1).max() <= speed * (1 + 1e-4)
        assert np.linalg.norm(v, axis=1).max() >= 0.9 * speed
        assert np.linalg.norm(np.gradient(v, times[:-1], axis=0)[2:-2], axis=1).max() <= acceleration * (1 + 1e-3)


def test_a_free_axis_turns_about_itself_alone(planned: JobResult) -> None:
    _, places, turns = tool_at(stage_named(planned, "free"))
    axes = turns.apply([0.0, 0.0, 1.0])
    assert np.linalg.norm(np.cross(axes, axes[0]), axis=1).max() <= ANGLE
    assert np.linalg.norm((places - places[0])[:, [0, 2]], axis=1).max() <= FAR
    _, places, turns = tool_at(stage_named(planned, "on the spot"))
    assert np.linalg.norm(places - places[0], axis=1).max() <= FAR
    assert abs((turns[0].inv() * turns[-1]).magnitude() - 1.2) <= ANGLE


def test_files_are_certified_again_and_faster_ones_are_not(planned: JobResult, tmp_path: Path) -> None:
    planned.save(tmp_path / "job.json")
    planned.scene.save(tmp_path / "scene.yaml")
    scene, motion = hdplan.load_scene(tmp_path / "scene.yaml"), hdplan.Trajectory.load(tmp_path / "job.json")
    assert hdplan.certify_job(scene, motion).certified
    (first, *rest) = scene.job.stages
    for number, change in (
        (2, {"tool_speed": 0.049}),
        (1, {"position_tolerance": 1e-6}),
        (1, {"interim": (0.1, 0.1, 0.031)}),
    ):
        stages = [first, *rest]
        stages[number + 1] = replace(stages[number + 1], **change)
        found = hdplan.certify_job(replace(scene, goal=None, job=hdplan.Job(stages)), motion)
        assert not found.certified


def test_tables_of_poses(tmp_path: Path) -> None:
    table = tmp_path / "poses.csv"
    lines = ["time,x,y,z,qw,qx,qy,qz", "0,0,0,0,1,0,0,0", "1,0.1,0,0,1,0,0,0"]
    table.write_text("\n".join(lines))
    assert hdplan.Along.read(table) == (hdplan.Pose(), hdplan.Pose([0.1, 0, 0]))
    table.write_bytes(b"\xef\xbb\xbf" + "\r\n".join(lines).encode())  # as spreadsheets write it
    assert hdplan.Along.read(table) == (hdplan.Pose(), hdplan.Pose([0.1, 0, 0]))
    for number, line, words in (
        (0, "time,x,y,z,qw,qx,qy", "must have the columns x, y, z, qx, qy, qz, qw in its first line"),
        (0, "speed,x,y,z,qw,qx,qy,qz", "must have the columns"),
        (2, "1,0.1,0,0,1,0,0", "line 3: has 7 values, 8 are expected"),
        (2, "1,0.1,0,1e999,1,0,0,0", "line 3: z: must be a finite number"),
        (2, "1,0.1,0,nan,1,0,0,0", "line 3: z: must be a finite number"),
        (2, "1,0.1,0,2mm,1,0,0,0", "line 3: z: must be a finite number, found '2mm'"),
        (2, "1,0.1,0,1_0,1,0,0,0", "line 3: z: must be a finite number, found '1_0'"),
        (2, "\n\n1,0.1,0,,1,0,0,0", "line 5: z: must be a finite number, found ''"),
        (2, "1,0.1,0," + "0" * 200_000 + ",1,0,0,0", "line 3: not CSV"),
        (2, "", "must have two poses or more below its first line, found 1"),
        (2, "1,0.1,0,0,1,1,0,0", "line 3: Pose.quaternion_xyzw: must be a unit quaternion"),
    ):
        changed = [line if i == number else each for i, each in enumerate(lines)]
        table.write_text("\n".join(changed))
        with pytest.raises(InputError, match=words):
            hdplan.Along.read(table)


def test_a_scene_names_a_table_of_poses(tmp_path: Path) -> None:
    """Quaternions of either sign and poses given twice are one curve, which is planned and proven."""
    rows = ["0,0,0,0,0,0,1", "0,0,0,0,0,0,-1", "0,0.03,0,0,0,0,-1", "0,0.05,0,0,0,0,1", "0,0.05,0,0,0,0,-1"]
    (tmp_path / "poses.csv").write_text("\n".join(["x,y,z,qx,qy,qz,qw", *rows]))
    text = """
        hdplan: 1
        robot: {name: panda}
        start: {state: default}
        limits: {acceleration: 7.5}
        job: [{along: {file: poses.csv, frame: tool, tool_speed: 0.1}}]
    """
    (tmp_path / "scene.yaml").write_text(text)
    result = hdplan.plan_job(hdplan.load_scene(tmp_path / "scene.yaml"))
    assert result.certified, result.text
    times, places, turns = tool_at(result.certificate.stages[0])
    off = turns[0].inv().apply(places - places[0])
    assert np.abs(off[:, [0, 2]]).max() <= 1e-3
    assert off[-1, 1] == pytest.approx(0.05, abs=1e-3)
    assert (turns[0].inv() * turns).magnitude().max() <= 0.01
    assert (np.linalg.norm(np.diff(places, axis=0), axis=1) <= 0.1 * np.diff(times) + 1e-9).all()


@pytest.mark.parametrize(
    ("stage", "words"),
    [
        (lambda: hdplan.Circle(by=[0, 0.1, 0], interim=[0, 0.05, 0]), "circle.interim: lies on one line"),
        (lambda: hdplan.Circle(by=[0, 0.1, 0], center=[0, 0.05, 0]), "circle.center: lies between the two ends"),
        (lambda: hdplan.Circle(by=[0, 0.1, 0], center=[0, 0.03, 0]), "is 30 mm from where the circle begins and 70 mm"),
        (lambda: hdplan.Circle(by=[0, 0.1, 0]), "must have either 'interim' or 'center', found neither"),
        (lambda: hdplan.Line(by=[0, 0.1, 0], frame="tol"), "line.frame: unknown 'tol' .did you mean 'tool'"),
        (lambda: hdplan.Line(by=[0, 0, 0]), "has no length"),
        (lambda: hdplan.Line(to=[0, 0, 0], turn=[1, 0, 0]), "goes with 'by'"),
        (lambda: hdplan.Line(by=[0, 0, 0.1], rpy=[1, 0, 0]), "goes with 'to'"),
        (
            lambda: hdplan.Circle(by=[0, 0.1, 0], interim=[0.05, 0.05, 0], position_tolerance=1e-17),
            "circle.position_tolerance: 1e-17 m on an arc of radius 0.05 m takes more than 20000 chords",
        ),
        (
            lambda: hdplan.Circle(by=[0, 0.1, 0], interim=[0.05, 0.05, 0], turn=[0, 0, math.pi]),
            "circle.turn: turns by 3.14 rad from the beginning; at most 3 are allowed",
        ),
        (lambda: hdplan.Line(by=[0, 0.1, 0], turn=[0, 0, 4]), r"Line.turn\[2\]: must be .* -3.14159 to 3.14159 .rad.,"),
        (lambda: hdplan.Along([hdplan.Pose([0, 0, 0])] * 2, frame="tool"), "along: has no length"),
        (
            lambda: hdplan.Line(by=[0, 0, 0], turn=[0, 0, 0.5], frame="tool", free_rotation="z"),
            "line: has no length: the link is to stay",
        ),
        (lambda: hdplan.Along(EIGHT, frame="tool", link="panda_link0"), "along.link: no planned joint moves 'panda_l"),
        (lambda: hdplan.Along(EIGHT), r"stage|along.poses: the first is .* away from where the link is"),
    ],
)
def test_invalid_curves_are_refused_in_one_line(stage: Any, words: str) -> None:
    with pytest.raises(InputError, match=words) as error:
        hdplan.plan_job(job_of(stage()))
    assert "\n" not in str(error.value)


def test_a_curve_that_cannot_be_followed_names_its_stage() -> None:
    with pytest.raises(
        UnsolvableError, match="'far away' cannot follow it from wherever it begins: no joint values were found for"
    ):
        hdplan.plan_job(job_of(hdplan.Line(by=[0.6, 0, 0], name="far away", **FINE)))


def test_a_curve_without_a_time_law_names_the_stage(monkeypatch: pytest.MonkeyPatch) -> None:
    def none(*_: Any) -> None:
        raise HdplanError("no time law was found")

    monkeypatch.setattr(Retimer, "_time_optimal", none)
    line = hdplan.Line(by=[0, 0.05, 0], name="crawl", **FINE)
    scene = hdplan.Scene(robot="panda", start="default", limits=LIMITS, job=hdplan.Job([line]))
    with pytest.raises(UnsolvableError, match=r"job\[0\] \(crawl\): no time law was found"):
        hdplan.plan_job(scene)


def test_a_line_that_is_driven_there_and_back_and_there_is_not_certified() -> None:
    """A plain one, too: all of it is within the tolerance of the line, and its ends are where they are to be."""
    limits = hdplan.Limits(acceleration=5.0)

    def scene(*stages: hdplan.Line) -> hdplan.Scene:
        return hdplan.Scene(robot="panda", start="default", limits=limits, job=hdplan.Job(stages))

    there, back = hdplan.Line(by=[0.05, 0.0, 0.0]), hdplan.Line(by=[-0.05, 0.0, 0.0])
    assert hdplan.plan_job(once := scene(replace(there, name="once"))).certified
    motion = hdplan.plan_job(scene(there, back, there)).trajectory
    thrice = replace(motion, stages=(replace(motion.stages[0], name="once"),))
    assert "off path" in hdplan.certify_job(once, thrice).text
