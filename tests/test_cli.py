"""The command line as a user meets it: what it prints and writes, its exit codes, and one line for every mistake.

Most runs are in this process; a child process is started only where terminals, pipes and signals matter. The scenes
are planar_arm, whose bodies are fitted in seconds, and variations on it.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.scenes.yaml_format.reader import shipped_jobs, shipped_scenes
from tests.commands import BLOCKED, Command, Done, arm_scene, obstacle, refused

Change = Callable[[np.ndarray], np.ndarray]
KEYS = {
    "status", "scene", "robot", "joint_names", "waypoints", "clearance_m", "self_clearance_m", "worst", "time_s",
    "iterations", "seed",
}  # fmt: skip


# --- planning and checking -----------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", ["json", "csv", "npz", "joint_trajectory.yaml", "robot_trajectory.yaml", "mcap"])
def test_check_certifies_the_output_of_plan(hdplan: Command, ending: str) -> None:
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
    assert all(again[key] == result[key] for key in ("limits", "worst", "duration_s"))


def test_a_path_without_times_is_refused_where_times_matter(hdplan: Command, tmp_path: Path) -> None:
    path = Trajectory.load(planned(hdplan))
    path.save("path.csv")
    limited = arm_scene(tmp_path, limits={"velocity": 2.0, "acceleration": 5.0})
    for command in (("check", limited, "path.csv"), ("plot", limited, "path.csv", "-o", "a.png")):
        refused(hdplan(*command), "path.csv: trajectory: has no times, and the scene limits rates (limits, timing)")


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
    assert done.out.startswith("wrong ends: ")  # the verdict is shown; the picture was requested
    assert done.out.splitlines()[-1].split() == ["written", "line.pdf"]
    assert Path("line.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize("solver", ["chomp", "fatrop", "ipopt"])
def test_every_solver_plans_by_the_command(hdplan: Command, tmp_path: Path, solver: str) -> None:
    scene = arm_scene(tmp_path, obstacles=[], planner={"waypoints": 6})
    assert hdplan("plan", scene, "--solver", solver).code == 0


@pytest.mark.parametrize("waypoints", [3, 1000])
def test_few_and_many_waypoints(hdplan: Command, tmp_path: Path, waypoints: int) -> None:
    scene = arm_scene(tmp_path, goal={"joints": [-0.7, 0.3]}, planner={"waypoints": waypoints})
    assert json.loads(hdplan("plan", scene, "--json").out)["waypoints"] == waypoints


def test_a_motion_of_no_length(hdplan: Command, tmp_path: Path) -> None:
    assert hdplan("plan", arm_scene(tmp_path, goal={"state": "right"})).code == 0


def test_a_robot_without_collision_geometry_says_so_and_is_drawn(hdplan: Command, tmp_path: Path) -> None:
    scene = arm_scene(tmp_path, robot={"name": "TwoDofs"}, start={"joints": [0, 0]}, goal={"joints": [1, 1]})
    done = hdplan("plan", scene, "-o", "m.json", "--plot", "m.png", "--proof", "m.proof")
    assert (done.code, hdplan("view", scene, "m.json", "--record", "m.html").code) == (0, 0)
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


def other_planner(folder: Path, change: Change, names: tuple[str, ...]) -> Path:
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
    hdplan: Command, tmp_path: Path, change: Change, names: tuple[str, ...], code: int, words: str
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
    for given in (
        (arm_scene(tmp_path, timing={"duration": 2.0}), "path.csv"),
        ("planar_arm", "path.csv", "--plant", "mujoco"),
    ):
        refused(hdplan("simulate", *given), "hdplan: path.csv: times: missing; ")


def test_codegen_says_what_it_wrote_and_replaces_nothing(hdplan: Command, tmp_path: Path) -> None:
    done = hdplan("codegen", "planar_arm", "-o", "c", "--json")
    content = json.loads(done.out)
    assert (done.code, done.err, content["prefix"], content["joints"], content["pairs"]) == (0, "", "planar_arm", 2, 4)
    assert sorted(content["files"]) == sorted(each.name for each in Path("c").iterdir())
    refused(hdplan("codegen", "planar_arm", "-o", "c"), "exists already")
    exact = arm_scene(tmp_path, planner={"distance": "fcl"})
    refused(hdplan("codegen", exact, "-o", "d"), "planner.distance", "hdsdf", "fcl")
    assert not Path("d").exists()


# --- reading matter ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "command",
    [
        *("", "plan", "check", "prove", "verify", "simulate", "plot", "view", "explain", "robots", "batch", "sample"),
        "codegen",
    ],
)
def test_help_fits_a_terminal(hdplan: Command, command: str) -> None:
    done = hdplan(*command.split(), "--help")
    assert (done.code, done.err) == (0, "")
    assert done.out.startswith("Usage: hdplan")
    assert max(map(len, done.out.splitlines())) <= 80
    assert "..." not in re.sub(r"\[(ARGS|TRAJECTORY|SOURCE)\]\.\.\.", "", done.out)  # nothing is cut off


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
    content = json.loads((tmp_path / "m.json").read_text())
    content["positions"][5][0] += 0.3
    (tmp_path / "m.json").write_text(json.dumps(content))
    assert hdplan("prove", "planar_arm", motion, "-o", str(tmp_path / "o.proof")).code == 1
    assert not (tmp_path / "o.proof").exists()
