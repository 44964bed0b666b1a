"""The controller among random obstacles: what it promises, held to the judge's own distances.

A case is one robot in one scene from one start, for `STEPS` periods: toward a configuration or after one that moves,
among obstacles that stand and some that come. Promised: no number that is not one, speeds within their limits, joints
within theirs once they are, and, of obstacles that stand, the clearance that each step says is proven.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hdplan import control
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.yaml_format.reader import load_scene
from sieges import judge, rows, scenes
from sieges.arms import random_arm
from sieges.campaign import Outcome
from sieges.world import World

STEPS = 250
SLACK = 1e-9
APART = 0.05  # [m] by which bodies must be apart at the start for a contact to be the controller's fault
ARMS = 12  # robots of its own that take part: their bodies are fitted once


def attack(rng: np.random.Generator, folder: Path, steps: int = STEPS) -> Outcome:
    """Steer one robot; return what was broken."""
    content, names, world = _scene(rng, folder)
    low, high = world.machine.reach(names, 2.8)
    q = rng.uniform(low, high)
    content["start"] = content["goal"] = {"joints": dict(zip(names, q.tolist(), strict=True))}
    scenes.write(folder / "scene.yaml", content)
    try:
        controller = control.Controller.of(load_scene(folder / "scene.yaml"), _settings(rng))
    except InputError:
        return Outcome("refused", "", 0)
    order = [names.index(name) for name in controller.robot.joint_names]
    here, target = q[order], rng.uniform(low, high)[order]
    task = control.standing(target)
    period, rates, last = controller.settings.period, controller.rates, control.Command(0.0 * here, 0.0 * here)
    limit_low, limit_high = controller.robot.lower, controller.robot.upper
    path, proven, modes, wrong = [here], [], [], []
    time = 0.0
    for k in range(steps):
        if k % 100 == 60 and rng.random() < 0.5:
            task = control.standing(rng.uniform(low, high)[order])
        step = controller.step(here, task, time, last)
        u = step.velocity
        if not np.isfinite(u).all():
            wrong.append(f"step {k}: the command is {u.tolist()}")
            break
        push, jerk = (u - last.velocity) / period, ((u - last.velocity) / period - last.acceleration) / period
        limits = rates.velocity, rates.acceleration, rates.jerk
        for what, value, most in zip(("speed", "push", "jerk"), (u, push, jerk), limits, strict=True):
            if (np.abs(value) > most * (1 + 1e-6) + SLACK / period**2 * 1e-3).any():
                wrong.append(f"step {k}: {what} {(np.abs(value) / most).max():.9g} of its limit")
        last = step.command
        then = here + period * u
        out = np.maximum(limit_low - then, then - limit_high)
        was = np.maximum(limit_low - here, here - limit_high)
        if (out > np.maximum(was, 0.0) + SLACK).any():
            wrong.append(f"step {k}: joint {int(np.argmax(out))} {out.max():.3g} beyond its limit")
        path.append(then)
        proven.append(step.proven)
        modes.append(step.mode.value)
        here, time = then, time + period
    found = _broken(world, names, order, np.array(path), proven, period)
    notes = {f"steps {mode}": modes.count(mode) for mode in set(modes)}
    notes["steps with a proof"] = sum(value is not None for value in proven)
    wrong = (wrong + found)[:3]
    if wrong:
        inverse = np.argsort(order)
        positions = np.array(path)[:, inverse]
        rows.write(folder / "m.json", rows.Rows(names, positions, period * np.arange(float(len(positions)))))
    return Outcome("steps", "; ".join(wrong), len(modes), notes)


def _settings(rng: np.random.Generator) -> control.ControlSettings:
    barriers = control.BarrierSettings(distance=str(rng.choice(["hdsdf", "hdsdf", "euclidean"])))
    speed, period = float(rng.choice([0.3, 1.0])), float(rng.choice([0.002, 0.005, 0.01]))
    return control.ControlSettings(barriers=barriers, speed=speed, period=period)


def _scene(rng: np.random.Generator, folder: Path) -> tuple[dict[str, Any], tuple[str, ...], World]:
    """Write a robot of a small pool among new obstacles."""
    which = int(rng.integers(ARMS + 2))
    content: dict[str, Any] = {"hdplan": 1, "obstacles": []}
    if which < ARMS:
        home = folder.parent / f"arm{which}"
        home.mkdir(exist_ok=True)
        arm = random_arm(np.random.default_rng([7, which]), home)
        content["robot"] = {"urdf": str(home / "arm.urdf"), "locked": arm.locked}
        names = tuple(arm.planned)
    else:
        name = "panda" if which == ARMS else "ur5"
        content["robot"] = {"name": name, "locked": scenes.PANDA if name == "panda" else {}}
        names = scenes.named_joints(folder, content)
    scenes.write(folder / "scene.yaml", content)
    world = World(folder / "scene.yaml", names)
    coming = rng.random() < 0.2
    for number in range(int(rng.integers(1, 6))):
        shape = scenes.solid(rng, float(rng.uniform(0.05, 0.4)))
        way = rng.normal(size=3)
        place = way / np.linalg.norm(way) * rng.uniform(0.2, 1.0) + [0, 0, 0.3]
        if world.bodies and rng.random() < 0.7:  # beside the arm in some configuration
            q = rng.uniform(-1.0, 1.0, (1, len(names)))
            at, piece = world.places(names, q, np.zeros(1))[:, 0], int(rng.integers(len(world.pieces.body)))
            body = at[world.pieces.body[piece]]
            away = world.pieces.radius[piece] + rng.uniform(0.05, 0.3)
            place = body[:3, :3] @ world.pieces.centre[piece] + body[:3, 3] + away * way / np.linalg.norm(way)
        entry: dict[str, Any] = {"name": f"thing{number}", "shape": shape}
        entry["pose"] = {"position": place.tolist(), "rpy": rng.uniform(-3, 3, 3).tolist()}
        if coming and number == 0:
            entry["motion"] = {"velocity": (-0.3 * way / np.linalg.norm(way)).tolist()}
            content["timing"] = {"duration": 10.0}
        content["obstacles"].append(entry)
    scenes.write(folder / "scene.yaml", content)
    return content, names, World(folder / "scene.yaml", names) if world.bodies else world


def _broken(
    world: World, names: tuple[str, ...], order: list[int], path: Array, proven: list[float | None], period: float
) -> list[str]:
    """Return the places where a clearance that a step claims does not hold."""
    q = path[:, np.argsort(order)]
    places = world.places(names, q, period * np.arange(float(len(q))))
    wrong = _contact(world, places) if not any(body.motion for body in world.bodies) else []
    world.pairs = [pair for pair in world.pairs if pair[1] >= world.robot_count]
    claims = np.array([-np.inf if value is None else value for value in proven])
    claimed = np.flatnonzero(claims > 0.0)
    if not len(claimed) or not world.pairs:
        return wrong
    chosen = np.unique(claimed[np.linspace(0, len(claimed) - 1, 24).round().astype(int)])
    for end in (0, 1):  # both ends of the period
        within = np.full(len(world.pairs), claims[chosen].max())
        for each in judge.closest(world, places, np.minimum(chosen + end, len(q) - 1), within):
            claim = claims[min(each.place - end, len(claims) - 1)]
            if each.high < claim - 1e-7:
                apart = f"at {each.high:.6g} m, proven {claim:.6g} m"
                wrong.append(f"step {each.place}: {world.pair_name(each.pair)} {apart}")
    return wrong


def _contact(world: World, places: Array) -> list[str]:
    """Return a contact among things that stand, where a motion began with all bodies well apart."""
    if not world.pairs or judge.closest(world, places, np.array([0]), np.full(len(world.pairs), APART)):
        return []
    chosen = np.unique(np.linspace(0, places.shape[1] - 1, 24).round().astype(int))
    met = [each for each in judge.closest(world, places, chosen, np.zeros(len(world.pairs))) if each.high <= 0.0]
    return [f"step {each.place}: {world.pair_name(each.pair)}, which meet" for each in met[:1]]
