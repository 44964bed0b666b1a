"""Plan the problems in narrow places: a gripper that holds a cube in a cage, goals among cans, two arms under a table.

    python benchmarks/narrow.py DIR [--set cage ...] [--every K] [--from J] [--time-limit S] [--proofs]
        [--ompl RRTConnect BITstar ...] [--roboplan STEP] [--processor-time]

DIR holds cage/ (UR5), bookshelf/ (Fetch) and table/ (Baxter, both arms), meshes/ and the robots' folders, and beside it
mbm/baxter with Baxter's description. The places of our own (`narrow_places.py`) need none of it: three are planned with
ten seeds each, and of each kind of random ones there are 100, of which --every and --from choose. Prints a row per set:
how many have ends that are free, how many of these are certified and in which time, and, with --proofs, of how many a
proof was written and accepted whole; to the error stream, a line per problem.
With --ompl, planners of OMPL, which has to be installed, get the same time for any way by hdplan's own checker
(`peer_exact.py`), and what they alone solve is counted; so is what roboplan, installed as well, finds with --roboplan
by its own collision test of hulls, with edges checked every STEP [rad].
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from cells import quantiles
from narrow_places import RANDOM, places, random_place
from peer_task import Task
from processor_time import add_processor_time, set_clock
from proven import proven

import hdplan
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.studies.report import markdown_text

FETCH = "torso_lift shoulder_pan shoulder_lift upperarm_roll elbow_flex forearm_roll wrist_flex wrist_roll"
UR5 = "shoulder_pan shoulder_lift elbow wrist_1 wrist_2 wrist_3"
BAXTER = [f"{side}_{joint}" for side in ("left", "right") for joint in ("s0", "s1", "e0", "e1", "w0", "w1", "w2")]
SETS = ("cage", "bookshelf", "table")
PLACES = places()
SEEDS = 10  # of each place of our own
SCENES = 100  # of each random kind
SCENE = "scene.yaml"
BUSY = 20  # of time by the clock, at most so many times a limit of processor time
Planner = Callable[[hdplan.Scene, float], tuple[str, float]]  # scene, time limit -> status, seconds


@dataclass(frozen=True)
class Outcome:
    """One problem."""

    set: str
    number: str
    status: str  # "certified", or why not
    seconds: float = np.nan  # from the scene to the certificate
    attempts: int = 0
    proof: str = ""  # "accepted", or why not
    planner: str = "hdplan"


def scenes(folder: Path, kind: str, every: int, first: int) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the number and the scene, as a file has it, of every K-th problem of a set, from the J-th; a place of our
    own, with the seed as its number, SEEDS times."""
    if kind in PLACES:
        yield from ((str(seed), PLACES[kind]) for seed in range(SEEDS))
        return
    if kind in RANDOM:
        yield from ((str(number), random_place(kind, number)) for number in range(first, SCENES, every))
        return
    for file in sorted((folder / kind).glob("scene*.yaml"))[first::every]:
        number = file.stem.removeprefix("scene")
        placed = yaml.safe_load(file.read_text())
        task = yaml.safe_load(file.with_name(f"task{number}.yaml").read_text())
        things = [(name, place) for name, place in placed.items() if name != "cans"]
        things += [(f"can{i}", place) for i, place in enumerate(placed.get("cans", []))]
        obstacles = [
            {
                "name": name,
                "shape": {"type": "mesh", "file": str(folder / "meshes" / f"{_mesh(kind, name)}.obj")},
                "pose": {"position": place["position"], "quaternion_xyzw": _unit(place["orientation"])},
            }
            for name, place in things
        ]
        robot, joints = _robot(folder, kind)
        start, goal = (dict(zip(joints, map(float, task[end]), strict=True)) for end in ("start", "goal"))
        ends = {"start": {"joints": start}, "goal": {"joints": goal}}
        yield number, {"hdplan": 1, "robot": robot, "obstacles": obstacles, **ends}


def _mesh(kind: str, name: str) -> str:
    return "cylinder" if name.startswith("can") else "bookshelf_tall" if name == "bookshelf" else name


def _unit(quaternion: list[float]) -> list[float]:
    values = np.array(quaternion, dtype=np.float64)
    return [float(x) for x in values / np.linalg.norm(values)]


def _robot(folder: Path, kind: str) -> tuple[dict[str, Any], list[str]]:
    """Return the robot of a set, and its joints in the order of the tasks."""
    if kind == "cage":
        files = {"urdf": str(folder / "ur5/ur5.urdf"), "srdf": str(folder / "ur5/ur5.srdf")}
        base = {"position": [0.0, 0.0, 0.5]}
        return {**files, "package_dirs": [str(folder / "ur5")], "base": base}, [f"{x}_joint" for x in UR5.split()]
    if kind == "bookshelf":
        files = {"urdf": str(folder / "fetch/fetch.urdf"), "srdf": str(folder / "fetch/fetch.srdf")}
        held = {"r_gripper_finger_joint": 0.05, "l_gripper_finger_joint": 0.05}
        joints = [f"{x}_joint" for x in FETCH.split()]
        content = {**files, "package_dirs": [str(folder / "fetch")], "group": "arm_with_torso", "locked": held}
        return content, joints
    home = folder.parent / "mbm/baxter/description"
    files = {"urdf": str(home / "baxter.urdf"), "srdf": str(home / "baxter.srdf")}
    return {**files, "package_dirs": [str(home)], "base": {"position": [-0.45, 0.0, 0.1]}}, BAXTER


def run(kind: str, number: str, content: dict[str, Any], folder: Path, time_limit: float, proofs: bool) -> Outcome:
    """Plan one problem, and prove it."""
    file, motion = folder / SCENE, folder / "motion.json"
    file.write_text(yaml.safe_dump(content, sort_keys=False))
    seed = int(number) if kind in PLACES else 0
    began = time.perf_counter()
    try:
        result = hdplan.plan(hdplan.load_scene(file), seed=seed, time_limit=time_limit)
    except hdplan.UnsolvableError as error:
        return Outcome(kind, number, f"ends: {str(error).partition(': ')[2]}")
    seconds = time.perf_counter() - began
    if not result.certified:
        return Outcome(kind, number, f"not certified: {result.certificate.text}", seconds, result.attempts)
    result.save(motion)
    proof = proven(file, motion) if proofs else ""
    return Outcome(kind, number, "certified", seconds, result.attempts, proof)


def by_ompl(planner: str) -> Planner:
    """Return a planner of OMPL. Raises ImportError without it."""
    from peer_exact import solve

    return lambda scene, time_limit: solve(scene, planner, 1, time_limit)


def by_roboplan(step: float, processor_time: bool) -> Planner:
    """Return roboplan, which checks edges every `step` [rad]. Raises ImportError without it."""
    from peer_process import Peer

    peer = Peer("peer_roboplan.py")

    def solve(scene: hdplan.Scene, time_limit: float) -> tuple[str, float]:
        task = Task.of(scene)
        try:
            limits = (BUSY * time_limit, time_limit) if processor_time else (time_limit, 0.0)
            answer = peer.plan(task, limits[0], step=step, of_processor=limits[1])
        except RuntimeError as error:
            return f"refused: {error}", np.nan
        if answer.path is None:
            return "no way", time_limit
        certificate = task.certifier.certify(Trajectory(task.robot.joint_names, answer.path, task.robot.locked))
        return "certified" if certificate.certified else f"not certified: {certificate.text}", answer.seconds

    return solve


def compared(outcomes: list[Outcome]) -> str:
    """Markdown: one row per set and planner."""
    solved = {(each.planner, each.set, each.number) for each in outcomes if each.status == "certified"}
    rows = []
    for kind, planner in dict.fromkeys((each.set, each.planner) for each in outcomes):
        group = [each for each in outcomes if (each.set, each.planner) == (kind, planner)]
        mine = [each for each in group if (planner, kind, each.number) in solved]
        row = {
            "set": kind,
            "planner": planner,
            "ends are free": sum(not each.status.startswith("ends") for each in group),
            "certified": len(mine),
            "time median / worst [s]": quantiles([each.seconds for each in mine], (0.5, 1.0), 2),
            "hdplan does not": sum(("hdplan", kind, each.number) not in solved for each in mine),
        }
        rows.append(row)
    return markdown_text(rows)


def table(outcomes: list[Outcome], proofs: bool) -> str:
    """Markdown: one row per set."""
    rows = []
    for kind in dict.fromkeys(outcome.set for outcome in outcomes):
        group = [each for each in outcomes if each.set == kind and not each.status.startswith("ends")]
        good = [each for each in group if each.status == "certified"]
        row = {
            "set": kind,
            "problems": sum(each.set == kind for each in outcomes),
            "ends are free": len(group),
            "certified": len(good),
            "time median / 90 % / worst [s]": quantiles([each.seconds for each in good], (0.5, 0.9, 1.0), 2),
            "guesses median / worst": quantiles([each.attempts for each in good], (0.5, 1.0)),
        }
        if proofs:
            row["proofs accepted"] = sum(each.proof == "accepted" for each in good)
        rows.append(row)
    return markdown_text(rows)


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--set", nargs="+", choices=(*SETS, *PLACES, *RANDOM), default=SETS)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--from", type=int, default=0, dest="first", help="the first problem of a set")
    parser.add_argument("--ompl", nargs="+", default=[], metavar="PLANNER", help="planners of OMPL beside hdplan")
    parser.add_argument(
        "--roboplan", type=float, metavar="STEP", help="roboplan beside hdplan, edges checked every STEP"
    )
    parser.add_argument("--time-limit", type=float, default=10.0)
    add_processor_time(parser)
    parser.add_argument("--proofs", action="store_true")
    options = parser.parse_args()
    set_clock(options)
    others = {planner: by_ompl(planner) for planner in options.ompl}
    if options.roboplan:
        others[f"roboplan, every {options.roboplan:g} rad"] = by_roboplan(options.roboplan, options.processor_time)
    outcomes = []
    with tempfile.TemporaryDirectory() as folder:
        for kind in options.set:
            for number, content in scenes(options.folder.absolute(), kind, options.every, options.first):
                done = [run(kind, number, content, Path(folder), options.time_limit, options.proofs)]
                for planner, solve in others.items() if not done[0].status.startswith("ends") else ():
                    status, seconds = solve(hdplan.load_scene(Path(folder) / SCENE), options.time_limit)
                    done.append(Outcome(kind, number, status, seconds, planner=planner))
                print(*done, sep="\n", file=sys.stderr, flush=True)
                outcomes += done
    print(compared(outcomes) if others else table(outcomes, options.proofs))


if __name__ == "__main__":
    main()
