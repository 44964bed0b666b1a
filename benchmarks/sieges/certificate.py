"""Hostile scenes and motions through `hdplan check`; what it certifies is held to the judge's dense samples."""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.errors import InputError
from hdplan.scenes.yaml_format.reader import load_scene
from sieges import command, judge, motions, rows, scenes
from sieges.campaign import Outcome
from sieges.world import World

FREE = 1e-3  # [m] by which a place called contact must be free for the verdict to count as too careful
MORE = 4  # motions in each scene beside the first
ALWAYS = "always touching, which is proven"


def attack(rng: np.random.Generator, folder: Path) -> Outcome:
    """Check one motion in one scene by the command, and some more there by the library."""
    content, motion, _ = scenes.random_case(rng, folder)
    first = check(folder)
    if first.finding or first.kind == "refused":
        return first
    timed = "timing" in content or "limits" in content
    others, finding = _more(rng, folder, motion, timed)
    kinds = others + Counter({first.kind: 1})
    return Outcome(first.kind, finding, kinds.total(), first.notes, dict(kinds))


def _more(rng: np.random.Generator, folder: Path, base: rows.Rows, timed: bool) -> tuple[Counter[str], str]:
    """Certify more motions in the folder's scene; return how often each verdict came, and what is wrong with one."""
    scene, names = load_scene(folder / "scene.yaml"), base.names
    robot = load_scene_robot(scene)
    certifier, world = Certifier(Setup.of(scene, robot)), World(folder / "scene.yaml", names)
    leave, kinds = excused(world, robot, names), Counter[str]()
    world.pairs = [pair for pair in world.pairs if pair not in leave]
    for number in range(MORE):
        near = rng.random() < (0.7 if timed else 0.3)
        motion = motions.varied(rng, base) if near else motions.random_rows(rng, world.machine, names, timed)
        file = folder / f"more{number}{rng.choice(scenes.ENDINGS)}"
        rows.write(file, motion)
        try:
            found = certifier.certify(Trajectory.load(file), check_ends=False)
        except InputError:
            kinds["refused"] += 1
            continue
        kinds[found.status.value] += 1
        if found.certified and (wrong := judge.refute(world, motion, found.clearance, found.self_clearance)):
            return kinds, f"refuted, {file.name}: {'; '.join(wrong)[:300]} ({found.text[:120]})"
    return kinds, ""


def check(folder: Path) -> Outcome:
    """Check the folder's motion in its scene, and judge the verdict."""
    file = next(path.name for path in sorted(folder.glob("m.*")))
    done = command.hdplan("check", "scene.yaml", file, "--json", folder=folder)
    if done.crash or "Traceback" in done.err:
        (folder / "traceback.txt").write_text(done.crash + done.err)
        return Outcome("traceback", f"traceback: {(done.crash or done.err).strip().splitlines()[-1]}"[:300])
    if done.code == 2:
        short = re.sub(r"[-\d.e+]+", "#", done.err.strip())[:200]
        lines = done.err.strip().splitlines()
        return Outcome("refused", "" if len(lines) <= 2 else f"refused in {len(lines)} lines: {short}")
    if done.code not in (0, 1):
        return Outcome("code", f"exit code {done.code}: {done.err.strip()[:200]}")
    lines = json.loads(done.out)
    motion = rows.read(folder / file)
    world = World(folder / "scene.yaml", motion.names)
    if lines["status"] != "certified":
        return Outcome(lines["status"], "", 1, _pessimism(world, motion, lines))
    leave = excused(world, load_scene_robot(load_scene(folder / "scene.yaml")), motion.names)
    world.pairs = [pair for pair in world.pairs if pair not in leave]
    found = judge.refute(world, motion, lines["clearance_m"], lines["self_clearance_m"])
    if found:
        return Outcome("refuted", f"refuted: {'; '.join(found)[:300]} ({lines['text'][:120]})", 1, {"verdict": lines})
    return Outcome("certified")


def _pessimism(world: World, motion: rows.Rows, content: dict[str, Any]) -> dict[str, int]:
    """Count a contact with an obstacle where the judge finds the two bodies free."""
    worst = content.get("worst")
    if content["status"] != "in_contact" or not worst or worst["distance_m"] > 0.0:
        return {}
    if worst["link"] not in content["text"] or worst["obstacle"] not in content["text"]:
        return {}
    where = worst["parameter"] * (len(motion.positions) - 1)
    interval = min(int(where), len(motion.positions) - 2)
    place, s = np.array([interval]), np.array([where - interval])
    places = world.places(motion.names, motion.at(place, s), motion.when(place, s))
    names = {worst["link"], worst["obstacle"]}
    world.pairs = [pair for pair in world.pairs if {world.bodies[k].name for k in pair} == names]
    if not world.pairs or judge.inside(world, places, open_too=True):
        return {}
    near = judge.closest(world, places, np.array([0]), np.full(len(world.pairs), 1e3))
    return {"contacts that the judge calls free": int(min(each.low for each in near) > FREE)} if near else {}


def excused(world: World, robot: Any, names: tuple[str, ...]) -> set[tuple[int, int]]:
    """Return the pairs of links that hdplan says it leaves out as always touching, where the judge finds the same."""
    always = {frozenset(pair) for pair, why in robot.unchecked.items() if why == ALWAYS}
    pairs = [p for p in world.pairs if frozenset((world.bodies[p[0]].name, world.bodies[p[1]].name)) in always]
    if not pairs:
        return set()
    low, high = world.machine.reach(names, np.pi)
    q = np.random.default_rng(0).uniform(low, high, (16, len(names)))
    every, world.pairs = world.pairs, pairs
    places = world.places(names, q, np.zeros(16))
    touching = [
        each.pair for each in judge.closest(world, places, np.arange(16), np.zeros(len(pairs))) if each.high <= 1e-9
    ]
    touching += [pair for at in range(16) for pair, _ in judge.inside(world, places[:, [at]])]
    world.pairs = every
    named = {frozenset(world.bodies[k].name for k in pair) for pair in touching if touching.count(pair) >= 8}
    return {pair for pair in pairs if frozenset(world.bodies[k].name for k in pair) in named}
