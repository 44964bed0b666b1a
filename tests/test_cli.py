"""The command line as a user meets it: what it prints and writes, its exit codes, and one line for every mistake.

Most runs are in this process; a child process is started only where terminals, pipes and signals matter. The scenes
are planar_arm, whose bodies are fitted in seconds, and variations on it.
"""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.scenes.yaml_format.reader import shipped_jobs, shipped_scenes
from tests.commands import Command, Done, in_process
from tests.waiting import until

ARM = Path(shipped_scenes()["planar_arm"]).parent
COMMAND = [sys.executable, "-m", "hdplan.cli"]
KEYS = {
    "status", "scene", "robot", "joint_names", "waypoints", "clearance_m", "self_clearance_m", "worst", "time_s",
    "iterations", "seed",
}  # fmt: skip
BLOCKED = {"name": "post", "shape": {"type": "sphere", "radius": 0.05}, "pose": {"position": [0.3, 0.03, 0.1]}}


@pytest.fixture
def hdplan(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Command:
    """Run `hdplan` in this process, in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    return in_process(monkeypatch, capsys)


def arm_scene(folder: Path, name: str = "scene.yaml", **changes: object) -> Path:
    """Write the planar arm's scene with some sections changed."""
    content = yaml.safe_load((ARM / "planar_arm.yaml").read_text(encoding="utf-8"))
    content["robot"] = {"urdf": str(ARM / "planar_arm.urdf"), "srdf": str(ARM / "planar_arm.srdf")}
    file = folder / name
    file.write_text(yaml.safe_dump({**content, **changes}, allow_unicode=True), encoding="utf-8")
    return file


def obstacle(shape: str, position: str = "[0, 0, 3]", name: str = "thing") -> list[object]:
    parts: list[object] = yaml.safe_load(
        f"[{{name: {json.dumps(name)}, shape: {{{shape}}}, pose: {{position: {position}}}}}]"
    )
    return parts


# --- planning and checking -----------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", ["json", "csv", "npz", "joint_trajectory.yaml", "robot_trajectory.yaml", "mcap"])
def test_what_plan_writes_check_certifies(hdplan: Command, ending: str) -> None:
    planned = hdplan("plan", "planar_arm", "-o", f"motion.{ending}")
    assert (planned.code, planned.err) == (0, "")
    assert planned.out.startswith("certified: at least ")
    assert f"motion.{ending}" in planned.out.splitlines()[-1]
    checked = hdplan("check", "planar_arm", f"motion.{ending}")
    assert (checked.code, checked.err) == (0, "")
    assert checked.out.splitlines()[0] == planned.out.splitlines()[0]


def test_json_is_one_object_with_the_promised_keys_and_the_file_holds_the_same(hdplan: Command) -> None:
    done = hdplan("plan", "planar_arm", "--json", "--seed", "3", "-o", "motion.json")
    result = json.loads(done.out)
    assert set(result) >= KEYS
    assert set(result["worst"]) >= {"parameter", "link", "obstacle"}
    assert result["worst"]["seconds"] is None  # a path without times
    assert set(result["time_s"]) == {"load", "build", "compile", "solve", "certify"}
    assert (result["status"], result["seed"], done.err) == ("certified", 3, "")
    written = json.loads(Path("motion.json").read_text(encoding="utf-8"))
    assert written.pop("verdict") == result
    assert {len(figures) for figures in written.pop("steps").values()} == {result["iterations"]}
    assert set(written) == {"hdplan_trajectory", "joint_names", "positions", "locked"}
    assert written["hdplan_trajectory"] == 1
    assert np.shape(written["positions"]) == (result["waypoints"], len(result["joint_names"]))


def test_a_timed_motion_says_what_it_takes_of_the_limits(hdplan: Command, tmp_path: Path) -> None:
    scene = arm_scene(tmp_path, limits={"velocity": 2.0, "acceleration": 5.0})
    done = hdplan("plan", scene, "--json", "-o", "motion.json")
    result = json.loads(done.out)
    motion = Trajectory.load(Path("motion.json"))
    assert motion.times is not None
    assert result["duration_s"] == motion.duration == motion.times[-1]
    assert result["worst"]["seconds"] == pytest.approx(float(motion.curve.time_of(result["worst"]["parameter"])))
    assert [use["quantity"] for use in result["limits"]] == ["velocity", "acceleration"]
    for order, use in enumerate(result["limits"], start=1):
        met = np.abs(motion.curve.over_time(order).at_parameter(np.linspace(0, 1, 5001))).max(axis=0)
        joint = motion.joint_names.index(use["joint"])
        assert met.max() / use["limit"] <= use["share"] <= 1.0
        assert met[joint] / use["limit"] == pytest.approx(use["share"], rel=0.02)
    checked = hdplan("check", scene, "motion.json")
    assert checked.code == 0
    assert f"{motion.duration:.3f} s in {len(motion)} rows" in checked.out
    for use in result["limits"]:
        assert f"at most {use['share']:.1%} of the limit, by {use['joint']}" in checked.out
    again = json.loads(hdplan("check", scene, "motion.json", "--json").out)
    assert (again["limits"], again["worst"], again["duration_s"]) == tuple(
        result[key] for key in ("limits", "worst", "duration_s")
    )


def test_a_path_without_times_is_refused_where_times_matter(hdplan: Command, tmp_path: Path) -> None:
    path = Trajectory.load(planned(hdplan))
    path.save("path.csv")
    limited = arm_scene(tmp_path, limits={"velocity": 2.0, "acceleration": 5.0})
    for command in (("check", limited, "path.csv"), ("plot", limited, "path.csv", "-o", "a.png")):
        done = hdplan(*command)
        assert (done.code, done.out) == (2, "")
        assert (
            done.err.strip()
            == "hdplan: path.csv: trajectory: has no times, and the scene limits rates (limits, timing)"
        )


def planned(hdplan: Command) -> Path:
    assert hdplan("plan", "planar_arm", "--quiet", "-o", "planned.csv").code == 0
    return Path("planned.csv")


def test_nothing_certified_is_exit_1_with_the_best_attempt_written(hdplan: Command, tmp_path: Path) -> None:
    scene = arm_scene(tmp_path, obstacles=[BLOCKED])
    done = hdplan("plan", scene, "--json", "--time-limit", "0.3", "-o", "best.json")
    result = json.loads(done.out)
    assert done.code == 1
    assert set(result) >= KEYS
    assert result["status"] != "certified"
    assert result["clearance_m"] is None
    assert json.loads(Path("best.json").read_text(encoding="utf-8"))["verdict"] == result


def test_quiet_prints_nothing(hdplan: Command) -> None:
    assert hdplan("plan", "planar_arm", "--quiet", "-o", "motion.csv") == Done(0, "", "")
    assert Path("motion.csv").is_file()


def test_plot_is_written(hdplan: Command) -> None:
    pytest.importorskip("matplotlib")
    assert hdplan("plan", "planar_arm", "--plot", "motion.png").code == 0
    assert Path("motion.png").read_bytes().startswith(b"\x89PNG")


def test_plot_draws_any_trajectory(hdplan: Command) -> None:
    pytest.importorskip("matplotlib")
    Path("line.csv").write_text("elbow,shoulder\n0.4,-0.8\n0.4,1.0\n", encoding="utf-8")
    done = hdplan("plot", "planar_arm", "line.csv", "-o", "line.pdf")
    assert (done.code, done.err) == (0, "")
    assert done.out.startswith("wrong ends: ")  # the verdict is shown; the picture was asked for
    assert done.out.splitlines()[-1].split() == ["written", "line.pdf"]
    assert Path("line.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize("solver", ["chomp", "fatrop", "ipopt"])
def test_other_solvers(hdplan: Command, tmp_path: Path, solver: str) -> None:
    scene = arm_scene(tmp_path, obstacles=[], planner={"waypoints": 6})
    assert hdplan("plan", scene, "--solver", solver).code == 0


@pytest.mark.parametrize("waypoints", [3, 1000])
def test_few_and_many_waypoints(hdplan: Command, tmp_path: Path, waypoints: int) -> None:
    scene = arm_scene(tmp_path, goal={"joints": [-0.7, 0.3]}, planner={"waypoints": waypoints})
    assert json.loads(hdplan("plan", scene, "--json").out)["waypoints"] == waypoints


def test_a_motion_of_no_length(hdplan: Command, tmp_path: Path) -> None:
    assert hdplan("plan", arm_scene(tmp_path, goal={"state": "right"})).code == 0


def test_a_robot_without_collision_geometry_says_so(hdplan: Command, tmp_path: Path) -> None:
    scene = arm_scene(tmp_path, robot={"name": "TwoDofs"}, start={"joints": [0, 0]}, goal={"joints": [1, 1]})
    done = hdplan("plan", scene)
    assert done.code == 0
    assert "no link of TwoDofs has collision geometry" in done.out
    assert "no link has collision geometry" in hdplan("explain", scene).out


@pytest.mark.parametrize("name", ["[red]", "[/]", ":smile:", "größe 箱", "a\\", "{x}"])
def test_names_are_printed_as_they_are(hdplan: Command, tmp_path: Path, name: str) -> None:
    near = obstacle("type: sphere, radius: 0.05", "[0.9, 0.6, 0.1]", name)
    scene = arm_scene(tmp_path, name="s c.yaml", obstacles=near, goal={"joints": [-0.7, 0.3]})
    planned = hdplan("plan", scene)
    assert planned.code == 0
    assert f" to {name}, " in planned.out
    assert name in hdplan("explain", scene).out
    inside = arm_scene(tmp_path, obstacles=obstacle("type: sphere, radius: 2", "[0, 0, 0]", name))
    assert f"upper_arm and {name} overlap by " in hdplan("plan", inside).err


def other_planner(folder: Path, change: Callable[[np.ndarray], np.ndarray], names: tuple[str, ...]) -> Path:
    """A plain CSV file: the planar arm's own motion, changed."""
    motion = Trajectory.load(folder / "own.csv")
    file = folder / "other.csv"
    rows = [",".join(names), *(",".join(map(repr, row)) for row in change(np.array(motion.positions)).tolist())]
    file.write_text("\n".join(rows), encoding="utf-8")
    return file


def _raised(rows: np.ndarray) -> np.ndarray:
    rows[5, 0] += 9.0
    return rows


@pytest.mark.parametrize(
    ("change", "names", "code", "words"),
    [
        (lambda rows: rows[:, ::-1], ("elbow", "shoulder"), 0, "certified: "),
        (lambda rows: rows[[0, -1]], ("shoulder", "elbow"), 1, "in contact: forearm and ball overlap by "),
        (lambda rows: rows[:-1], ("shoulder", "elbow"), 1, "wrong ends: the last waypoint has joint '"),
        (_raised, ("shoulder", "elbow"), 1, "outside limits: waypoint 5 has joint 'shoulder' at "),
    ],
    ids=["permuted", "collides", "short", "outside"],
)
def test_check_another_planners_motion(
    hdplan: Command,
    tmp_path: Path,
    change: Callable[[np.ndarray], np.ndarray],
    names: tuple[str, ...],
    code: int,
    words: str,
) -> None:
    hdplan("plan", "planar_arm", "--quiet", "-o", "own.csv")
    done = hdplan("check", "planar_arm", other_planner(tmp_path, change, names))
    assert (done.code, done.err) == (code, "")
    assert done.out.startswith(words)
    as_json = json.loads(hdplan("check", "planar_arm", tmp_path / "other.csv", "--json").out)
    assert as_json["text"] == done.out.splitlines()[0]


# --- replaying -----------------------------------------------------------------------------------------------


def test_simulate_replays_what_plan_wrote(hdplan: Command, tmp_path: Path) -> None:
    timed = arm_scene(tmp_path, limits={"velocity": 2.0, "acceleration": 4.0})
    assert hdplan("plan", timed, "--quiet", "-o", "motion.json").code == 0
    kinematic = hdplan("simulate", timed, "motion.json")
    assert (kinematic.code, kinematic.err) == (0, "")
    assert kinematic.out.startswith("replayed: kinematics only")
    assert "torque" not in kinematic.out
    strong = arm_scene(tmp_path, "strong.yaml", limits={"velocity": 2.0, "acceleration": 4.0, "torque": 20.0})
    done = hdplan("simulate", strong, "motion.json")
    assert (done.code, done.err) == (0, "")
    assert done.out.startswith("executed: simulated with dynamics, tracked within ")
    assert max(map(len, done.out.splitlines()[1:])) <= 80
    result = json.loads(hdplan("simulate", strong, "motion.json", "--json").out)
    assert (result["status"], result["dynamics"], result["failures"]) == ("succeeded", True, [])
    assert [joint["name"] for joint in result["joints"]] == ["shoulder", "elbow"]
    for joint in result["joints"]:
        assert joint["error_rms"] <= joint["error"] < 1e-3
        assert 0 < joint["torque"]["largest"] < joint["torque"]["limit"] == 20.0
    weak = arm_scene(tmp_path, "weak.yaml", limits={"velocity": 2.0, "acceleration": 4.0, "torque": 0.5})
    done = hdplan("simulate", weak, "motion.json")
    assert (done.code, done.err) == (1, "")
    assert done.out.startswith("failed: joint 'shoulder' needs a torque of ")


def test_ros_files_are_checked_simulated_and_drawn_as_ours_are(hdplan: Command, tmp_path: Path) -> None:
    scene = arm_scene(tmp_path, timing={"duration": 4.0, "rate": 7})  # rows between nanoseconds
    assert hdplan("plan", scene, "--quiet", "-o", "own.json").code == 0
    for ending in ("joint_trajectory.yaml", "robot_trajectory.yaml", "mcap"):
        Trajectory.load("own.json").save(f"ros.{ending}")
        own, ros = (hdplan("check", scene, file) for file in ("own.json", f"ros.{ending}"))
        assert (ros.code, ros.err) == (0, "")
        assert ros.out.splitlines()[0] == own.out.splitlines()[0]
    own, ros = (hdplan("simulate", scene, file) for file in ("own.json", "ros.mcap"))
    assert (ros.code, ros.out.splitlines()[0]) == (0, own.out.splitlines()[0])
    assert hdplan("plot", scene, "ros.mcap", "-o", "ros.png").code == 0


def test_simulate_needs_times_where_the_scene_asks_for_them(hdplan: Command, tmp_path: Path) -> None:
    assert hdplan("plan", "planar_arm", "--quiet", "-o", "path.csv").code == 0
    assert hdplan("simulate", "planar_arm", "path.csv").code == 0
    done = hdplan("simulate", arm_scene(tmp_path, timing={"duration": 2.0}), "path.csv")
    assert (done.code, done.out) == (2, "")
    assert done.err.startswith("hdplan: path.csv: times: missing; ")
    assert len(done.err.splitlines()) == 1


# --- a user's own robot --------------------------------------------------------------------------------------

URDF = """<robot name="mine">
 <link name="base"><collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
 <link name="rail"><collision><origin xyz="0 0 0.15"/><geometry><cylinder radius="0.04" length="0.3"/></geometry>
 </collision></link>
 <link name="arm"><collision><origin xyz="0 0 0.2"/><geometry><mesh filename="package://my_arm/bar.obj"/></geometry>
 </collision></link>
 <link name="tip"><collision><origin xyz="0 0 0.1"/><geometry><mesh filename="bar.obj" scale="1 1 0.3"/></geometry>
 </collision></link>
 <joint name="slide" type="prismatic"><parent link="base"/><child link="rail"/><axis xyz="0 0 1"/>
  <origin xyz="0 0 0.1"/><limit lower="0" upper="0.4" effort="1" velocity="1"/></joint>
 <joint name="turn" type="continuous"><parent link="rail"/><child link="arm"/><axis xyz="0 1 0"/>
  <origin xyz="0 0.12 0.3"/></joint>
 <joint name="wrist" type="revolute"><parent link="arm"/><child link="tip"/><axis xyz="1 0 0"/>
  <origin xyz="0 0 0.4"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
</robot>"""
SRDF = """<robot name="mine"><group_state name="home" group="all"><joint name="slide" value="0.1"/>
<joint name="turn" value="0"/><joint name="wrist" value="0"/></group_state>
<disable_collisions link1="base" link2="arm" reason="far"/></robot>"""


def own_robot(folder: Path, urdf: str = URDF, srdf: str = SRDF, **changes: object) -> Path:
    """Write a robot with its meshes, and a scene beside it."""
    (folder / "packages" / "my_arm").mkdir(parents=True, exist_ok=True)
    for file in (folder / "packages" / "my_arm" / "bar.obj", folder / "bar.obj"):
        trimesh.creation.box((0.1, 0.1, 0.3)).export(file)
    (folder / "mine.urdf").write_text(urdf, encoding="utf-8")
    (folder / "mine.srdf").write_text(srdf, encoding="utf-8")
    robot = {"urdf": "mine.urdf", "srdf": "mine.srdf", "package_dirs": ["packages"]}
    content = {"hdplan": 1, "robot": robot, "start": {"state": "home"}, "goal": {"joints": [0.3, 2.5, 1]}, **changes}
    file = folder / "own.yaml"
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    return file


def test_a_robot_of_ones_own(hdplan: Command, tmp_path: Path) -> None:
    done = hdplan("plan", own_robot(tmp_path), "-o", "motion.json")
    assert (done.code, done.err) == (0, "")
    assert hdplan("check", "own.yaml", "motion.json").code == 0
    explained = hdplan("explain", "own.yaml").out
    assert "turns freely" in explained
    assert "2 joints kept within limits; 1 joint without" in explained


def test_a_base_upside_down(hdplan: Command, tmp_path: Path) -> None:
    scene = own_robot(tmp_path)
    robot = {**yaml.safe_load(scene.read_text())["robot"], "base": {"position": [0, 0, 2], "rpy": [3.14159265, 0, 0]}}
    below = obstacle("type: box, size: [3, 3, 0.1]", "[0, 0, 0.2]")
    assert hdplan("plan", own_robot(tmp_path, robot=robot, obstacles=below)).code == 0
    above = obstacle("type: box, size: [3, 3, 0.1]", "[0, 0, 1.6]")
    assert "rail and thing overlap" in hdplan("plan", own_robot(tmp_path, robot=robot, obstacles=above)).err


BAD_URDF = {
    "empty": ("", ["not well-formed XML"]),
    "another document": ("<html/>", ["<html>", "expected <robot>"]),
    "no link": ('<robot name="a"/>', ["holds no <link>"]),
    "no joint": ('<robot name="a"><link name="l"/></robot>', ["no joint left to plan"]),
    "mesh missing": (URDF.replace('"bar.obj"', '"nope.obj"'), ["link 'tip': mesh ", "nope.obj: no such file"]),
    "package missing": (URDF.replace("my_arm", "no_arm"), ["package 'no_arm' is not found"]),
    "mesh a folder": (URDF.replace('"bar.obj"', '"packages"'), ["packages"]),
    "size text": (URDF.replace("0.2 0.2 0.1", "big 1 1"), ["link 'base'", "size must be 3 finite", "'big 1 1'"]),
    "size nan": (URDF.replace("0.2 0.2 0.1", "nan 1 1"), ["link 'base'", "size must be 3 finite numbers"]),
    "size negative": (URDF.replace("0.2 0.2 0.1", "1 -1 1"), ["link 'base'", "greater than 0 [m]", "'1 -1 1'"]),
    "size huge": (URDF.replace("0.2 0.2 0.1", "1e308 1 1"), ["link 'base'", "at most 1e+06"]),
    "no shape": (URDF.replace('<box size="0.2 0.2 0.1"/>', ""), ["link 'base'", "one shape, found 0"]),
    "unknown shape": (URDF.replace("<cylinder", "<cylindr"), ["link 'rail'", "'cylindr'", "'cylinder'"]),
    "origin text": (URDF.replace('xyz="0 0 0.15"', 'xyz="0 0 a"'), ["link 'rail'", "origin: xyz", "'0 0 a'"]),
    "scale zero": (URDF.replace("1 1 0.3", "1 1 0"), ["link 'tip'", "scale must not be 0"]),
    "limits turned": (URDF.replace('upper="0.4"', 'upper="-1"'), ["joint 'slide'", "lower must not exceed upper"]),
    "limit text": (URDF.replace('upper="0.4"', 'upper="a"'), ["joint 'slide'", "upper must be a finite number", "'a'"]),
    "axis zero": (URDF.replace('xyz="0 1 0"', 'xyz="0 0 0"'), ["joint 'turn'", "axis", "'0 0 0'"]),
    "link unknown": (URDF.replace('parent link="arm"', 'parent link="amr"'), ["joint 'wrist'", "'amr'", "'arm'"]),
    "circle": (URDF.replace('parent link="base"', 'parent link="tip"'), ["'rail' is not connected to the root"]),
    "joint type": (URDF.replace("continuous", "continuos"), ["turn", "continuos"]),
    "floating": (URDF.replace("continuous", "floating"), ["'turn'", "6 coordinates"]),
    "follows itself": (URDF.replace('<axis xyz="1', '<mimic joint="wrist"/><axis xyz="1'), ["'wrist'", "itself"]),
    "factor text": (
        URDF.replace('<axis xyz="1', '<mimic joint="turn" multiplier="x"/><axis xyz="1'),
        ["joint 'wrist'", "multiplier", "'x'"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_URDF)
def test_bad_urdf(hdplan: Command, tmp_path: Path, case: str) -> None:
    urdf, words = BAD_URDF[case]
    refused(hdplan("plan", own_robot(tmp_path, urdf=urdf), "-o", "motion.json"), "own.yaml: robot", *words)
    assert not Path("motion.json").exists()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "is empty"),
        ("hello", "'hello' is not known"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "is flat"),
        ("v 0 0 0\nv nan 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n", "numbers are expected"),
        ("v 0 0 0\nv 1e9 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n", "farther than 1e+06 m"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "a face has vertex 8"),
        (b"\xff\xfe\x00v 1 2 3", "mesh.obj: "),  # unreadable, or empty where a library guesses its encoding
    ],
    ids=["empty", "text", "flat", "nan", "huge", "index", "binary"],
)
def test_bad_meshes(hdplan: Command, tmp_path: Path, content: str | bytes, words: str) -> None:
    mesh = tmp_path / "mesh.obj"
    mesh.write_bytes(content if isinstance(content, bytes) else str(content).encode())
    scene = arm_scene(tmp_path, obstacles=obstacle("type: mesh, file: mesh.obj"))
    refused(hdplan("plan", scene), f"{scene}: obstacles.thing: mesh", words)
    refused(hdplan("explain", scene), f"{scene}: obstacles.thing: mesh", words)


# --- bad input: one line, exit code 2, nothing written ------------------------------------------------------------


def refused(done: Done, *words: str) -> None:
    """Assert that it was refused in one line that holds these words."""
    assert done.code == 2
    assert done.out == ""
    assert done.err.count("\n") == 1
    assert done.err.startswith("hdplan: ")
    for word in words:
        assert word in done.err


BAD_ARGUMENTS = {
    "no such command": (["pln"], ["'pln'", "'plan'"]),
    "no scene": (["plan"], ["SCENE", "hdplan plan --help"]),
    "too many": (["plan", "a", "b"], ["(b)"]),
    "no such option": (["plan", "planar_arm", "--sede", "1"], ["--sede", "--seed"]),
    "option without value": (["plan", "planar_arm", "-o"], ["-o"]),
    "no such scene": (["plan", "panda_cag"], ["panda_cag: no such file", "'panda_cage'"]),
    "no such file": (["explain", "nowhere/x.yaml"], ["nowhere/x.yaml: no such file"]),
    "a folder": (["plan", "."], ["is a directory"]),
    "a very long name": (["plan", "x" * 300], ["no such file"]),
    "a name with a line end": (["plan", "a\nb"], ["no such file"]),
    "a robot for a scene": (
        ["plan", str(ARM / "planar_arm.urdf")],
        ["planar_arm.urdf: is a robot's description, not a scene", "robot: {urdf: planar_arm.urdf}", "--robot"],
    ),
    "no such proof": (["verify", "planar_arm", __file__, "no.proof"], ["no.proof: no such file"]),
    "fewer than one": (["sample", "planar_arm", "-n", "-3", "-o", "x.csv"], ["--count", "at least 1", "'-3'"]),
    "no such robot": (["robots", "pandda"], ["'pandda'", "'panda'"]),
    "nothing like it": (["robots", "xyzzy"], ["'xyzzy'", "`hdplan robots` lists them"]),
    "robot misspelt": (["plan", "planar_arm", "--robot", "pandda"], ["--robot: ", "'pandda'", "'panda'"]),
    "no such robot file": (["plan", "planar_arm", "--robot", "no.yaml"], ["no.yaml: no such file"]),
    "request without need": (["plan", "planar_arm", "--request", "r.yaml"], ["not a MoveIt planning scene"]),
    "solver misspelt": (["plan", "planar_arm", "--solver", "ipop"], ["'ipop'", "'ipopt'"]),
    "seed negative": (["plan", "planar_arm", "--seed", "-1"], ["--seed", "at least 0", "'-1'"]),
    "seed broken": (["plan", "planar_arm", "--seed", "1.5"], ["--seed", "whole number", "'1.5'"]),
    "no time": (["plan", "planar_arm", "--time-limit", "0"], ["--time-limit", "greater than 0", "'0'"]),
    "time nan": (["plan", "planar_arm", "--time-limit", "nan"], ["--time-limit", "finite", "'nan'"]),
    "time text": (["plan", "planar_arm", "--time-limit", "soon"], ["--time-limit", "'soon'"]),
    "time underscore": (["plan", "planar_arm", "--time-limit", "1_0"], ["--time-limit", "'1_0'"]),
    "seed of other digits": (["plan", "planar_arm", "--seed", "٣"], ["--seed", "'٣'"]),
    "jitter underscore": (["sample", "planar_arm", "-o", "t.csv", "--jitter", "1_0"], ["--jitter", "'1_0'"]),
    "output ending": (["plan", "planar_arm", "-o", "x.txt"], ["x.txt", "'.txt'", ".json, .csv, .npz"]),
    "output a folder": (["plan", "planar_arm", "-o", "folder.json"], ["folder.json: is a folder"]),
    "output nowhere": (["plan", "planar_arm", "-o", "no/x.json"], ["the folder no does not exist"]),
    "output too long": (["plan", "planar_arm", "-o", f"{'x' * 250}.json"], ["cannot be written"]),
    "no picture": (["plot", "planar_arm", "x.json"], ["--output"]),
    "plot ending": (["plot", "planar_arm", "x.json", "-o", "x.jpg"], ["x.jpg", "'.jpg'", ".png, .pdf, .svg"]),
    "plot of nothing": (["plot", "planar_arm", "no.json", "-o", "x.png"], ["no.json: no such file"]),
    "picture ending": (["plan", "planar_arm", "--plot", "x.jpg"], ["x.jpg", "'.jpg'", ".png, .pdf, .svg"]),
    "no trajectory": (["check", "planar_arm", "no.json"], ["no.json: no such file"]),
    "trajectory ending": (["check", "planar_arm", "no.txt"], ["no.txt", "'.txt'", ".json, .csv, .npz"]),
    "trajectory a folder": (["check", "planar_arm", "folder.json"], ["folder.json: is a directory, not a file"]),
}


@pytest.mark.parametrize("case", BAD_ARGUMENTS)
def test_bad_arguments(hdplan: Command, case: str) -> None:
    Path("folder.json").mkdir()
    arguments, words = BAD_ARGUMENTS[case]
    refused(hdplan(*arguments), *words)
    assert [file.name for file in Path().iterdir()] == ["folder.json"]


def test_a_motion_that_its_file_cannot_hold_is_refused_before_it_is_planned(
    hdplan: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = arm_scene(tmp_path, timing={"duration": 90, "rate": 1000})
    monkeypatch.setattr("hdplan.planner.commands.plan.plan", lambda *_, **__: pytest.fail("planned"))
    refused(hdplan("plan", scene, "-o", "m.robot_trajectory.yaml"), "90001 waypoints", "write .mcap")


BAD_SCENES = {
    "syntax": ("hdplan: 1\nrobot: [\n", ["line 3", "YAML syntax"]),
    "not text": (b"\x00\xff\xfe", ["scene.yaml"]),
    "section misspelt": ({"obstacls": []}, ["'obstacls'", "'obstacles'"]),
    "robot misspelt": ({"robot": {"name": "pandda"}}, ["robot.name", "'pandda'", "'panda'"]),
    "state misspelt": ({"start": {"state": "rigth"}}, ["start", "'rigth'", "'right'"]),
    "joint misspelt": ({"start": {"joints": {"shoulder": 0, "elbw": 0}}}, ["start", "'elbw'", "'elbow'"]),
    "joint missing": ({"start": {"joints": {"shoulder": 0}}}, ["start", "no value for elbow"]),
    "too many joints": ({"goal": {"joints": [0, 0, 0]}}, ["goal", "3 joint values", "2 joints: shoulder, elbow"]),
    "outside limits": ({"goal": {"joints": [0, 2.7]}}, ["goal", "'elbow' is 2.7", "[-2.6, 2.6]"]),
    "start in collision": (
        {"obstacles": obstacle("type: sphere, radius: 0.1", "[0.35, -0.35, 0.1]")},
        ["start: in collision: upper_arm and thing overlap by ", "mm"],
    ),
    "goal in collision": (
        {"obstacles": obstacle("type: sphere, radius: 0.1", "[0.35, 0.5, 0.1]")},
        ["goal: in collision: ", "thing overlap by "],
    ),
    "a number too large": (
        {"obstacles": obstacle("type: sphere, radius: 1.0e+308")},
        ["obstacles[0].shape.radius", "at most 1e+06", "1e+308"],
    ),
    "a name of two lines": (
        {"obstacles": obstacle("type: sphere, radius: 1", name="a\nb")},
        ["obstacles[0].name", "control characters", r"'a\nb'"],
    ),
    "mesh missing": (
        {"obstacles": obstacle("type: mesh, file: no.stl")},
        ["obstacles[0].shape.file", "'no.stl' does not exist"],
    ),
    "a joint to lock misspelt": (
        {"robot": {"name": "panda", "locked": {"panda_finger_joint3": 0.0}}},
        ["robot.locked", "'panda_finger_joint3'", "'panda_finger_joint2'"],
    ),
    "a link to ignore misspelt": (
        {"robot": {"name": "panda", "ignore_pairs": [["panda_link1", "panda_lnk2"]]}},
        ["robot.ignore_pairs", "'panda_lnk2'", "'panda_link2'"],
    ),
}


@pytest.mark.parametrize("case", BAD_SCENES)
def test_bad_scenes(hdplan: Command, tmp_path: Path, case: str) -> None:
    content, words = BAD_SCENES[case]
    if isinstance(content, dict):
        arm_scene(tmp_path, **content)
    else:
        Path("scene.yaml").write_bytes(content if isinstance(content, bytes) else str(content).encode())
    refused(hdplan("plan", "scene.yaml", "-o", "motion.json"), "scene.yaml: ", *words)
    assert [file.name for file in Path().iterdir()] == ["scene.yaml"]


BAD_TRAJECTORIES = {
    "x.json": {
        "{": "not JSON",
        "[" * 100_000: "not JSON",
        "[1]": "hdplan_trajectory: 1",
        '{"hdplan_trajectory": 1, "joint_names": ["shoulder", "elbow"]}': "positions: missing",
        '{"hdplan_trajectory": 1, "joint_names": ["shoulder", "elbow"], "positions": [[0, 1], [2]]}': "each row",
        '{"hdplan_trajectory": 1, "joint_names": ["shoulder", "elbow"], "positions": [[0, "1"], [2, 3]]}': "numbers",
        f'{{"hdplan_trajectory": 1, "joint_names": ["a", "b"], "positions": [[0, {10**400}], [2, 3]]}}': "numbers",
        '{"hdplan_trajectory": 1, "joint_names": ["a"], "positions": [[0], [1]], "locked": {"b": "c"}}': "locked",
        '{"hdplan_trajectory": 1, "joint_names": ["a"], "positions": [[0], [NaN]]}': "waypoint 1, joint 'a'",
        '{"hdplan_trajectory": 1, "joint_names": ["a"], "positions": [[0], [1]], "times": [0]}': "each of the 2",
        '{"hdplan_trajectory": 1, "joint_names": ["a"], "positions": [[0], [1]], "times": 3}': "each of the 2",
        '{"hdplan_trajectory": 1, "joint_names": ["a"], "positions": [[0], [1]], "times": [1, 1]}': "must increase",
    },
    "x.csv": {
        "": "empty",
        "1,2\n3,4\n": "line 1",
        "shoulder;elbow\n0,1;0\n0;1\n": "line 1: has semicolons between its values; commas are expected",
        "shoulder,elbow\n0,0\n\n1,x\n": "line 4: 'x' is not a number",
        "shoulder,elbow\n0,0\n1\n": "line 3: 1 values",
        "shoulder,elbow\n0,0\n": "at least 2",
        "time,shoulder,elbow\n0,0,0\n-1,1,1\n": "-1 s at waypoint 1 comes after 0 s",
        "time,shoulder,elbow\n0,0,0\ninf,1,1\n": "times: inf",
        "shoulder,elbw\n0,0\n1,1\n": "joint 'elbow' of planar_arm is missing (did you mean 'elbw'?)",
        "shoulder,elbow,wrist\n0,0,0\n1,1,1\n": "joint 'wrist' is not one of planar_arm",
        "shoulder,elbow\n0,0\n1,1e308\n": "waypoint 1, joint 'elbow': 1e+308 is larger than 1e+06",
    },
    "x.npz": {"": "not an NPZ", "PK\x03\x04 rubbish": "not an NPZ"},
}


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [(name, content, words) for name, cases in BAD_TRAJECTORIES.items() for content, words in cases.items()],
    ids=[f"{name}-{i}" for name, cases in BAD_TRAJECTORIES.items() for i in range(len(cases))],
)
def test_bad_trajectories(hdplan: Command, name: str, content: str, words: str) -> None:
    Path(name).write_text(content, encoding="utf-8")
    refused(hdplan("check", "planar_arm", name), f"{name}: ", words)
    refused(hdplan("plot", "planar_arm", name, "-o", "x.png"), f"{name}: ", words)
    assert not Path("x.png").exists()


MOVEIT_BOX = {"type": "box", "dimensions": [0.1, 0.1, 0.1]}
MOVEIT_OBJECT = {"id": "box", "primitives": [MOVEIT_BOX], "pose": {"position": [0, 0, 3]}}
MOVEIT_SCENE = {"robot_model_name": "planar_arm", "world": {"collision_objects": [MOVEIT_OBJECT]}}


def moveit_request(goal: dict[str, float] | None) -> dict[str, object]:
    joints = [{"joint_name": name, "position": value} for name, value in (goal or {}).items()]
    state = {"joint_state": {"name": ["gripper", "elbow", "shoulder"], "position": [0.1, 0.3, -0.8]}}
    return {"start_state": state, **({} if goal is None else {"goal_constraints": [{"joint_constraints": joints}]})}


def write_moveit(goal: dict[str, float] | None) -> list[str]:
    Path("scene.yaml").write_text(yaml.safe_dump(MOVEIT_SCENE), encoding="utf-8")
    Path("request.yaml").write_text(yaml.safe_dump(moveit_request(goal)), encoding="utf-8")
    robot = {"urdf": str(ARM / "planar_arm.urdf"), "srdf": str(ARM / "planar_arm.srdf")}
    Path("robot.yaml").write_text(yaml.safe_dump({"robot": robot}), encoding="utf-8")
    return ["plan", "scene.yaml", "--request", "request.yaml", "--robot", "robot.yaml"]


def test_moveit_files(hdplan: Command) -> None:
    done = hdplan(*write_moveit({"elbow": 0.4, "shoulder": 1.0}))
    assert (done.code, done.err) == (0, "")
    assert "left out, as planar_arm has no such joints: gripper" in done.out


@pytest.mark.parametrize(
    ("goal", "leave_out", "words"),
    [
        (None, (), ["request.yaml", "'goal_constraints' is missing"]),
        ({}, (), ["request.yaml", "no goal"]),
        ({"elbow": 0.4}, (), ["goal (request.yaml)", "no value for shoulder"]),
        ({"elbow": 3.4, "shoulder": 1.0}, (), ["goal (request.yaml)", "'elbow' is 3.4", "[-2.6, 2.6]"]),
        ({"elbow": 0.4, "shoulder": 1.0}, ("--request", "request.yaml"), ["scene.yaml", "--request"]),
        ({"elbow": 0.4, "shoulder": 1.0}, ("--robot", "robot.yaml"), ["scene.yaml", "--robot"]),
        (
            {"elbow": 0.4, "shoulder": 1.0},
            ("--request", "request.yaml", "--robot", "robot.yaml"),
            ["scene.yaml: is a MoveIt planning scene", "--request FILE", "--robot NAME or FILE"],
        ),
        (
            {"elbow": 0.4, "shoulder": 1.0},
            ("scene.yaml", "--request", "--robot", "robot.yaml"),
            ["request.yaml: is a MoveIt motion plan request", "--request", "--robot NAME or FILE"],
        ),
        ({"elbow": 0.4, "shoulder": 1.0}, ("scene.yaml",), ["Missing argument"]),
    ],
    ids=[
        "no goal",
        "empty goal",
        "joint missing",
        "outside",
        "no request",
        "no robot",
        "neither",
        "request alone",
        "no scene",
    ],
)
def test_bad_moveit_input(
    hdplan: Command, goal: dict[str, float] | None, leave_out: tuple[str, ...], words: list[str]
) -> None:
    arguments = [argument for argument in write_moveit(goal) if argument not in leave_out]
    refused(hdplan(*arguments), *words)


def test_codegen_says_what_it_wrote_and_replaces_nothing(hdplan: Command, tmp_path: Path) -> None:
    done = hdplan("codegen", "planar_arm", "-o", "c", "--json")
    said = json.loads(done.out)
    assert (done.code, done.err, said["prefix"], said["joints"], said["pairs"]) == (0, "", "planar_arm", 2, 4)
    assert sorted(said["files"]) == sorted(each.name for each in Path("c").iterdir())
    refused(hdplan("codegen", "planar_arm", "-o", "c"), "exists already")
    exact = arm_scene(tmp_path, planner={"distance": "fcl"})
    refused(hdplan("codegen", exact, "-o", "d"), "planner.distance", "hdsdf", "fcl")
    assert not Path("d").exists()


# --- reading matter ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "command",
    [
        [],
        ["plan"],
        ["check"],
        ["prove"],
        ["verify"],
        ["simulate"],
        ["plot"],
        ["view"],
        ["explain"],
        ["robots"],
        ["batch"],
        ["sample"],
        ["codegen"],
    ],
)
def test_help_fits_a_terminal(hdplan: Command, command: list[str]) -> None:
    done = hdplan(*command, "--help")
    assert (done.code, done.err) == (0, "")
    assert done.out.startswith("Usage: hdplan")
    assert max(map(len, done.out.splitlines())) <= 80
    assert "..." not in done.out.replace("[ARGS]...", "").replace("[TRAJECTORY]...", "").replace(
        "[SOURCE]...", ""
    )  # nothing is cut off


def test_version_is_one_line_whatever_comes_after(hdplan: Command) -> None:
    for arguments in (["--version"], ["--version", "plan", "nowhere.yaml"]):
        assert hdplan(*arguments) == Done(0, f"hdplan {metadata.version('hdplan')}\n", "")
    refused(hdplan("plan", "--version"), "--version")


def test_help_names_every_shipped_scene(hdplan: Command) -> None:
    words = hdplan().out.replace(",", " ").replace(".", " ").split()
    assert set(shipped_scenes() | shipped_jobs()) <= set(words)


@pytest.mark.parametrize("arguments", [["explain", "planar_arm"], ["robots", "double_pendulum"]])
def test_tables_fit_eighty_columns(hdplan: Command, arguments: list[str]) -> None:
    done = hdplan(*arguments)
    assert (done.code, done.err) == (0, "")
    for line in done.out.splitlines():
        assert len(line) <= 80
        assert line == line.rstrip()
    assert isinstance(json.loads(hdplan(*arguments, "--json").out), dict)


def test_explain_says_what_is_on_and_off(hdplan: Command, tmp_path: Path) -> None:
    far = arm_scene(tmp_path, obstacles=obstacle("type: sphere, radius: 0.1", "[0, 0, 3]"))
    out = hdplan("explain", far).out
    assert "obstacles         every obstacle is out of the robot's reach" in out
    assert "sphere, radius 0.1 m; out of reach, left out" in out
    none = hdplan("explain", arm_scene(tmp_path, obstacles=[], planner={"clearance": 0.01})).out
    assert "obstacles         needs obstacles[]" in none
    assert "0.01 m (scene)" in none
    assert "32 (default)" in none


def test_robots_of_one_name(hdplan: Command) -> None:
    out = hdplan("robots", "double_pendulum").out
    for words in ("joints\n", "lower", "upper", "outer bodies\n", "p95 mm"):
        assert words in out


# --- terminals, pipes, signals: child processes -------------------------------------------------------------------


def wrong(errors: str) -> list[str]:
    """What the error stream holds beside the steps that took long, as they may on a slow machine."""
    return [line for line in errors.splitlines() if not (line.startswith("hdplan: ") and line.endswith(" ..."))]


def test_a_pipe_gets_plain_text_and_may_close_early() -> None:
    whole = subprocess.run([*COMMAND, "plan", "planar_arm"], capture_output=True, text=True)
    assert (whole.returncode, wrong(whole.stderr)) == (0, [])
    assert "\x1b" not in whole.stdout
    assert whole.stdout.splitlines()[0].endswith("over the whole motion")  # not wrapped
    child = subprocess.Popen(
        [*COMMAND, "plan", "planar_arm"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert child.stdout is not None
    assert child.stderr is not None
    child.stdout.close()
    assert (wrong(child.stderr.read()), child.wait()) == ([], 0)
    child.stderr.close()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
@pytest.mark.parametrize("words", [["explain", "planar_arm"], ["plan", "--help"]])
def test_a_full_disk_is_one_line(words: list[str]) -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run([*COMMAND, *words], stdout=full, stderr=subprocess.PIPE, text=True)
    refused(Done(done.returncode, "", "\n".join([*wrong(done.stderr), ""])), "the output cannot be written")


def test_a_terminal_sees_progress() -> None:
    ours, theirs = pty.openpty()
    child = subprocess.Popen([*COMMAND, "plan", "planar_arm"], stdout=subprocess.PIPE, stderr=theirs, text=True)
    os.close(theirs)
    out, _ = child.communicate()
    shown = os.read(ours, 1 << 16).decode()
    os.close(ours)
    assert child.returncode == 0
    assert "\x1b" not in out
    assert "building the problem" in shown or "iteration" in shown  # whichever is on when the line is drawn


@pytest.mark.usefixtures("ctrl_c_is_heard")
@pytest.mark.sampled(2)
@pytest.mark.parametrize("solver", ["gauss_newton", "chomp", "fatrop", "ipopt"])
def test_ctrl_c_ends_with_the_best_so_far(tmp_path: Path, solver: str) -> None:
    scene, best = arm_scene(tmp_path, obstacles=[BLOCKED]), tmp_path / "best.json"
    ours, theirs = pty.openpty()
    command = [*COMMAND, "plan", str(scene), "--time-limit", "60", "--solver", solver, "-o", str(best)]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=theirs, text=True)
    os.close(theirs)
    shown = ""
    while "iteration" not in shown:  # the solver is at work
        shown += os.read(ours, 1 << 12).decode()
    child.send_signal(signal.SIGINT)
    out, _ = child.communicate(timeout=20)
    os.close(ours)
    assert child.returncode == 1
    assert out.startswith("in contact: ")
    assert json.loads(best.read_text(encoding="utf-8"))["verdict"]["status"] == "in_contact"


def caught(status: str) -> int:
    """The signals that a process has handlers for, by its /proc/PID/status, as bits."""
    return int(status.split("SigCgt:")[1].split()[0], 16)


@pytest.mark.usefixtures("ctrl_c_is_heard")
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="processes are listed elsewhere")
def test_ctrl_c_ends_the_checker_of_proofs_without_its_traceback(tmp_path: Path) -> None:
    """A terminal sends it to both processes."""
    (tmp_path / "any.json").write_text("{}", encoding="utf-8")
    command = [*COMMAND, "verify", "planar_arm", str(tmp_path / "any.json"), str(tmp_path / "any.json")]
    child = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    children = Path(f"/proc/{child.pid}/task/{child.pid}/children")
    until(children.read_text, "the checker begins")
    status = Path(f"/proc/{children.read_text().split()[0]}/status")
    until(lambda: caught(status.read_text()) >> (signal.SIGINT - 1) & 1, "Python hears Ctrl-C, and imports libraries")
    os.killpg(child.pid, signal.SIGINT)
    _, said = child.communicate(timeout=20)
    assert said == "hdplan: interrupted before anything was found\n"


@pytest.mark.usefixtures("ctrl_c_is_heard")
@pytest.mark.parametrize("command", ["plan", "check", "follow", "simulate", "plot", "explain", "view", "robots"])
def test_ctrl_c_that_python_drops_ends_every_command(
    hdplan: Command, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    """As an exception in a destructor is; the command would run to its end."""

    class Last:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGINT)

    def endless(*_: object, **__: object) -> None:
        Last()
        end = time.monotonic() + 20.0
        while time.monotonic() < end:
            sum(range(100))

    Path("motion.csv").write_text("elbow,shoulder\n0.4,-0.8\n0.4,1.0\n", encoding="utf-8")
    work = {
        "plan": "plan", "check": "Certifier", "follow": "follow", "simulate": "replay", "plot": "plot",
        "explain": "problem_of", "view": "load_scene_robot", "robots": "listing",
    }  # fmt: skip
    motion = ["planar_arm", "motion.csv"]
    given = {"plan": motion[:1], "explain": motion[:1], "robots": [], "plot": [*motion, "-o", "motion.png"]}
    monkeypatch.setattr(f"hdplan.planner.commands.{command}.{work[command]}", endless)
    done = hdplan(command, *given.get(command, motion))
    assert (done.code, done.out) == (130, "")
    assert done.err.strip() == "hdplan: interrupted before anything was found"
    assert os.listdir() == ["motion.csv"]


def test_a_proof_is_written_and_checked(hdplan: Command, tmp_path: Path) -> None:
    motion, proof = str(tmp_path / "m.json"), str(tmp_path / "m.proof")
    planned = hdplan("plan", "planar_arm", "-o", motion, "--proof", proof)
    assert planned.code == 0
    assert hdplan("prove", "planar_arm", motion, "-o", str(tmp_path / "n.proof")).code == 0
    assert (tmp_path / "n.proof").read_bytes() == (tmp_path / "m.proof").read_bytes()
    world = tmp_path / "w.json"
    accepted = hdplan("verify", "--world", str(world), "planar_arm", motion, proof)
    assert (accepted.code, accepted.out.split(":")[0]) == (0, "accepted")
    kernel = [sys.executable, "-m", "hdplan.verify.kernel", str(world), proof]
    done = subprocess.run(kernel, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.splitlines()[0]) == (0, accepted.out.splitlines()[0])
    refused(hdplan("verify", "--world", str(tmp_path / "w.txt"), "planar_arm", motion, proof), ".json")
    other = hdplan("verify", "empty", motion, proof)
    assert (other.code, other.out.split(":")[0]) == (1, "rejected")
    refused(hdplan("plan", "planar_arm", "--proof", proof), "--proof", "-o FILE")
    refused(hdplan("prove", "planar_arm", motion, "-o", str(tmp_path / "m.txt")), ".proof")
    said = json.loads((tmp_path / "m.json").read_text())
    said["positions"][5][0] += 0.3
    (tmp_path / "m.json").write_text(json.dumps(said))
    assert hdplan("prove", "planar_arm", motion, "-o", str(tmp_path / "o.proof")).code == 1
    assert not (tmp_path / "o.proof").exists()


def test_a_proof_of_moveits_files(hdplan: Command) -> None:
    """The same from plan, prove and verify, for which a request is as much as its scene."""
    _, scene, *beside = write_moveit({"elbow": 0.4, "shoulder": 1.0})
    assert hdplan("plan", scene, *beside, "-o", "m.json", "--proof", "m.proof").code == 0
    assert hdplan("prove", scene, "m.json", *beside, "-o", "n.proof").code == 0
    assert Path("m.proof").read_bytes() == Path("n.proof").read_bytes()
    accepted = hdplan("verify", scene, "m.json", "m.proof", *beside)
    assert (accepted.code, accepted.out.split(":")[0]) == (0, "accepted")
    refused(hdplan("verify", scene, "m.json", "m.proof", *beside[:2], "--robot", "no.yaml"), "no.yaml: no such file")
    refused(hdplan("verify", scene, "m.json", "m.proof", "--request", "no", *beside[2:]), "no: no such file")
    refused(hdplan("prove", scene, "m.json", "-o", "n.proof"), "--request FILE", "--robot NAME or FILE")
    Path("a.xacro").write_text("<robot/>", encoding="utf-8")
    with_argument = ("--robot", "a.xacro", "--xacro-arg", "a:=1")
    refused(hdplan("plan", scene, *beside[:2], *with_argument, "-o", "m.json", "--proof", "m.proof"), "--xacro-arg")
    write_moveit({"elbow": 0.5, "shoulder": 1.0})
    other = hdplan("verify", scene, "m.json", "m.proof", *beside)
    assert (other.code, other.out.split(":")[1]) == (1, " request")


def child(*arguments: str, **within: str) -> Done:
    """Run `hdplan` as a program of its own."""
    done = subprocess.run([*COMMAND, *arguments], capture_output=True, env={**os.environ, **within}, check=False)
    return Done(done.returncode, done.stdout.decode(), done.stderr.decode())


@pytest.mark.usefixtures("ctrl_c_is_heard")
@pytest.mark.parametrize("after", ["typer.main", "rich.text", "numpy.linalg"])
def test_ctrl_c_while_it_starts_is_one_line(after: str) -> None:
    """While libraries are imported, some of which make errors of their own of it."""
    telling = [sys.executable, "-X", "importtime", *COMMAND[1:], "plan", "panda_cage"]
    with subprocess.Popen(telling, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as started:
        assert started.stderr is not None
        while not started.stderr.readline().rstrip().endswith(after):
            assert started.poll() is None
        started.send_signal(signal.SIGINT)
        out, err = started.communicate(timeout=60)
    said = [line for line in err.splitlines() if not line.startswith("import time:")]
    assert (out, said) == ("", ["hdplan: interrupted before anything was found"])
    assert started.returncode in (130, -signal.SIGINT)


def test_characters_that_the_output_lacks_are_written_out(tmp_path: Path) -> None:
    scene = arm_scene(tmp_path, obstacles=obstacle("type: sphere, radius: 0.1", "[0, 0, 3]", name="Kübel"))
    done = child("plan", str(scene), PYTHONIOENCODING="ascii")
    assert done.code == 0
    assert "rad^2" in done.out
    assert "forearm to K\\xfcbel, about" in done.out or "to K\\xfcbel, about" in done.out
    assert done.out.isascii()


def test_a_cache_that_cannot_be_written_is_one_warning(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = child("plan", "planar_arm", HDPLAN_CACHE=str(tmp_path / "file" / "cache"))
    assert done.code == 0
    told = [line for line in done.err.splitlines() if "cache" in line]
    (line,) = told
    assert line.startswith(f"hdplan: note: the cache {tmp_path}/file/cache cannot be written (Not a directory), so ")
    assert "HDPLAN_CACHE" in line


def test_an_internal_error_is_shown_whole_where_that_is_asked_for(
    hdplan: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("planted")

    monkeypatch.setattr("hdplan.planner.commands.plan.plan", broken)
    monkeypatch.delenv("HDPLAN_DEBUG", raising=False)
    done = hdplan("plan", "planar_arm", "--quiet")
    assert (done.code, done.out, done.err.count("\n")) == (3, "", 1)
    assert done.err.endswith("; HDPLAN_DEBUG=1 shows it whole\n")
    monkeypatch.setenv("HDPLAN_DEBUG", "1")
    done = hdplan("plan", "planar_arm", "--quiet")
    assert done.code == 3
    assert done.err.startswith("Traceback (most recent call last):\n")
    assert "in broken" in done.err
    assert "hdplan: internal error" in done.err.splitlines()[-1]
