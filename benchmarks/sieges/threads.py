"""The same things from eight threads as alone, bit for bit: checks, distances, the controller, planning."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

import hdplan
from hdplan import control
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.robot.setup import Setup
from sieges import distance, paper, scenes
from sieges.campaign import Outcome

THREADS = 8
TASKS = 16  # of a case
KINDS = ("certificate", "certificate", "certificate", "distance", "distance", "control", "nearest", "plan")


def attack(rng: np.random.Generator, folder: Path, kinds: tuple[str, ...] = KINDS) -> Outcome:
    """Do some things of these kinds alone and then from many threads at once."""
    kinds = tuple(kinds[k] for k in rng.integers(0, len(kinds), TASKS))
    tasks = [_task(str(kind), rng, folder / f"{k:02d}") for k, kind in enumerate(kinds)]
    alone = [task() for task in tasks]
    order = rng.permutation(2 * TASKS) % TASKS
    with ThreadPoolExecutor(THREADS) as pool:
        together = list(pool.map(lambda k: tasks[k](), order))
    different = [int(k) for k, found in zip(order, together, strict=True) if found != alone[k]]
    words = ", ".join(sorted({f"{kinds[k]} {k}: {alone[k][:40]}" for k in different}))
    return Outcome("things", (different and f"other in threads than alone: {words}"[:400]) or "", len(order))


def _task(kind: str, rng: np.random.Generator, folder: Path) -> Callable[[], str]:
    folder.mkdir()
    if kind == "distance":
        setting = int(rng.integers(4))
        a, b = (paper.solids()[name] for name in distance.SETTINGS[setting][:2])
        poses = distance.some_poses(rng, a, b, 200)
        word = str(rng.choice(["compiled", "reference", "function", "jax"]))
        return functools.partial(_witness, word, setting, poses)
    if kind == "control":
        return functools.partial(_steps, rng.uniform(-0.1, 0.1, (10, 7)))
    if kind == "plan":
        return functools.partial(_plan, int(rng.integers(100)))
    if kind == "nearest":
        return functools.partial(_nearest, rng.uniform(-1.0, 1.0, (5, 7)))
    _, _, file = scenes.random_case(rng, folder)
    return functools.partial(_check, folder, file)


def _digest(*arrays: Any) -> str:
    return hashlib.sha256(b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)).hexdigest()


def _witness(word: str, setting: int, poses: tuple[Any, Any]) -> str:
    value, gap = distance.WITNESSES[word](setting, *poses)
    return _digest(value, np.zeros(0) if gap is None else gap)


def _check(folder: Path, file: str) -> str:
    try:
        found = hdplan.certify(hdplan.load_scene(folder / "scene.yaml"), hdplan.Trajectory.load(folder / file))
    except hdplan.InputError as error:
        return str(error)
    return f"{found.text} {found.clearance!r} {found.self_clearance!r} {found.worst!r}"


@functools.cache
def _cage() -> Any:
    return control.Controller.of(hdplan.load_scene("panda_cage"))


def _steps(moves: Any) -> str:
    controller = _cage()
    q = controller.robot.configuration(hdplan.load_scene("panda_cage").start)
    return _digest(*(controller.step(q + move, control.standing(q - move)).velocity for move in moves))


@functools.cache
def _certifier() -> Any:
    return Certifier(Setup.of(hdplan.load_scene("panda_bookshelf")))


def _nearest(moves: Any) -> str:
    return repr([_certifier().nearest(np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785]) + move) for move in moves])


def _plan(seed: int) -> str:
    found = hdplan.plan(hdplan.load_scene("planar_arm"), seed=seed)
    return _digest(found.trajectory.positions) + found.certificate.text
