"""Mutated scenes, MoveIt pairs, motions, URDFs, SRDFs and meshes through every command that reads files.

What must come out: exit code 0, 1 or 2, and with 2 one line; never a traceback, a signal, an internal error, memory or
time without end.
"""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hdplan.scenes.yaml_format.reader import shipped_scenes
from sieges import command, mutations, rows, scenes
from sieges.campaign import Outcome
from sieges.machine import Machine

PLANAR = "planar_arm"
NOTE = "hdplan: note: "
LATE = "time limit of "  # what a command may say with exit code 1
INNER = ("encountered in", "empty slice", "encountered a", "deprecated", "Deprecat")  # what NumPy says to programmers
COMMANDS = ("check", "plan", "explain", "simulate", "follow", "robots")
SHARES = (0.74, 0.08, 0.06, 0.06, 0.03, 0.03)


def attack(rng: np.random.Generator, folder: Path) -> Outcome:
    """Make one case wrong and hand it to a command."""
    what = str(rng.choice(COMMANDS, p=SHARES))
    words = _planar(rng, folder, what) if what in ("plan", "explain", "follow") else _own(rng, folder, what)
    spoilt = [spoil(rng, folder) for _ in range(int(rng.choice([1, 1, 2])))]
    (folder / "command.txt").write_text(json.dumps({"arguments": words, "spoilt": spoilt}))
    return judged(folder, words)


def judged(folder: Path, words: list[str]) -> Outcome:
    """Run the command and say whether it ended as it must."""
    done = command.hdplan(*words, folder=folder)
    lines = [line for line in done.err.splitlines() if line.strip() and not line.startswith(NOTE)]
    inner = [line for line in done.err.splitlines() if line.startswith(NOTE) and any(word in line for word in INNER)]
    last = lines[-1][:240] if lines else ""
    if done.crash:
        (folder / "traceback.txt").write_text(done.crash)
        return Outcome("traceback", f"traceback ({words[0]}): {done.crash.strip().splitlines()[-1]}"[:300])
    if "Traceback" in done.err or "Traceback" in done.out:
        (folder / "traceback.txt").write_text(done.err)
        return Outcome("traceback", f"traceback printed ({words[0]}): {last}")
    if inner:
        return Outcome("lines", f"words of a library's ({words[0]}): {inner[0][:200]}")
    if done.code not in (0, 1, 2):
        return Outcome("code", f"exit code {done.code} ({words[0]}): {last}")
    if done.code == 2 and (len(lines) != 1 or not lines[0].startswith("hdplan: ")):
        return Outcome("lines", f"{len(lines)} lines with exit code 2 ({words[0]}): {last}")
    if done.code < 2 and lines and LATE not in lines[0]:
        return Outcome("lines", f"words on the error stream with exit code {done.code} ({words[0]}): {last}")
    return Outcome(f"exit code {done.code}")


def _own(rng: np.random.Generator, folder: Path, what: str) -> list[str]:
    """Write a small robot of its own with a scene, hdplan's or MoveIt's."""
    content, motion, file = scenes.random_case(rng, folder)
    names = motion.names
    if "urdf" in content["robot"]:
        _semantics(rng, folder, names, motion.positions[0].tolist())
        content["robot"]["srdf"] = "arm.srdf"
        scenes.write(folder / "scene.yaml", content)
    if what == "robots":
        return ["robots", "panda"] if rng.random() < 0.1 else ["check", "scene.yaml", file]
    if "urdf" in content["robot"] and rng.random() < 0.3:
        _moveit(rng, folder, content, names, motion)
        rows.write(folder / file, rows.Rows(names, motion.positions))
        return [what, "scene.yaml", file, "--request", "request.yaml", "--robot", "robot.yaml"]
    return [what, "scene.yaml", file, *(["--json"] if rng.random() < 0.5 else [])]


def _planar(rng: np.random.Generator, folder: Path, what: str) -> list[str]:
    """Write the shipped planar arm's scene: its bodies are fitted once."""
    source = shipped_scenes()[PLANAR]
    content = yaml.safe_load(source.read_text())
    robot = content["robot"]
    for key in ("urdf", "srdf"):
        if key in robot:
            robot[key] = str((source.parent / robot[key]).resolve())
    if rng.random() < 0.5:
        content["timing"] = {"duration": 2.0}
        content["obstacles"][0]["motion"] = {"velocity": [0.01, 0, 0]}
    if rng.random() < 0.3:
        content["limits"] = {"velocity": 2.0, "acceleration": 8.0}
    if rng.random() < 0.3:
        thing = {"name": "m", "shape": scenes.mesh(rng, folder, "m", 0.1), "pose": {"position": [0.6, 0.4, 0.3]}}
        content["obstacles"].append(thing)
    scenes.write(folder / "scene.yaml", content)
    if what == "plan":
        return ["plan", "scene.yaml", "--time-limit", "0.5", "-o", "out.json"]
    if what == "explain":
        return ["explain", "scene.yaml"]
    content["start"] = {"joints": [1.0, 0.4]}
    content["goal"] = {"joints": [1.05, 0.35]}
    scenes.write(folder / "scene.yaml", content)
    names = tuple(joint.name for joint in Machine(source.parent / "planar_arm.urdf").joints if joint.kind == "revolute")
    rows.write(folder / "m.json", rows.Rows(names, np.array([[1.0, 0.4], [1.05, 0.35]])))
    return ["follow", "scene.yaml", "m.json"]


def _semantics(rng: np.random.Generator, folder: Path, names: tuple[str, ...], q: list[float]) -> None:
    joints = "".join(f'<joint name="{name}"/>' for name in names)
    values = "".join(f'<joint name="{name}" value="{value!r}"/>' for name, value in zip(names, q, strict=True))
    pairs = '<disable_collisions link1="base" link2="link1" reason="Adjacent"/>' * int(rng.random() < 0.7)
    (folder / "arm.srdf").write_text(
        f'<robot name="arm"><group name="arm">{joints}</group><group_state name="ready" group="arm">{values}'
        f"</group_state>{pairs}</robot>\n"
    )


def _moveit(
    rng: np.random.Generator, folder: Path, content: dict[str, Any], names: tuple[str, ...], motion: rows.Rows
) -> None:
    """Write the same as MoveIt's messages: boxes and balls for obstacles."""
    robot = {key: value for key, value in content["robot"].items() if key != "base"}
    scenes.write(folder / "robot.yaml", {"robot": robot})
    placed = [item for item in content["obstacles"] if "motion" not in item]
    things = [
        {
            "id": item["name"],
            "pose": {"position": [0, 0, 0], "orientation": [0, 0, 0, 1]},
            "primitives": [{"type": "box", "dimensions": rng.uniform(0.01, 0.2, 3).tolist()}],
            "primitive_poses": [{"position": item["pose"]["position"], "orientation": [0, 0, 0, 1]}],
        }
        for item in placed
    ]
    state = {"joint_state": {"name": list(names), "position": motion.positions[0].tolist()}}
    message = {
        "name": "s",
        "robot_model_name": "arm",
        "robot_state": state,
        "fixed_frame_transforms": [],
        "allowed_collision_matrix": {"entry_names": ["base", "link1"], "entry_values": [[False, True], [True, False]]},
        "link_padding": [{"link_name": "base", "padding": 0.0}],
        "world": {"collision_objects": things},
        "is_diff": False,
    }
    goal = [{"joint_name": n, "position": v} for n, v in zip(names, motion.positions[-1].tolist(), strict=True)]
    request = {"group_name": "arm", "start_state": state, "goal_constraints": [{"joint_constraints": goal}]}
    scenes.write(folder / "scene.yaml", message)
    scenes.write(folder / "request.yaml", request)


def spoil(rng: np.random.Generator, folder: Path) -> str:
    """Make one of the folder's files wrong; return its name."""
    files = sorted(path for path in folder.iterdir() if path.is_file() and path.name not in ("command.txt",))
    weights = np.array([3.0 if path.suffix == ".yaml" else 1.0 + path.name.startswith("m.") for path in files])
    path = files[int(rng.choice(len(files), p=weights / weights.sum()))]
    how = rng.random()
    if path.suffix == ".yaml" and how < 0.75:
        loaded = None
        with contextlib.suppress(yaml.YAMLError, ValueError, RecursionError):
            loaded = yaml.safe_load(path.read_text(errors="replace"))
        if loaded is not None:
            with contextlib.suppress(RecursionError):
                text = yaml.safe_dump(mutations.of_tree(rng, loaded), sort_keys=False, allow_unicode=True)
                path.write_text(text, errors="replace")
                return path.name
    if path.suffix == ".json" and how < 0.6 and path.read_text(errors="replace").startswith("{"):
        with contextlib.suppress(ValueError, RecursionError):  # it may be spoilt already
            path.write_text(json.dumps(mutations.of_tree(rng, json.loads(path.read_text(errors="replace")))))
    elif path.suffix in (".npz", ".stl") or how > 0.85:
        path.write_bytes(mutations.of_bytes(rng, path.read_bytes()))
    else:
        path.write_text(mutations.of_text(rng, path.read_text(errors="replace")), errors="replace")
    return path.name
