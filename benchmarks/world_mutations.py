"""Change worlds and proofs at random, and see what the kernel of the checker accepts.

    python benchmarks/world_mutations.py [--count N] [--seed S] [--seconds T] [--scene NAME ...]

Numbers, signs, indices and names of a world are changed, entries are dropped, doubled and exchanged, proofs get other
leaves, directions, groups and claims. Whatever the kernel accepts is judged from the changed world alone, by Pinocchio
and coal (`world_judge.py`). Prints a table with a row per kind of change: "false" must be 0, as must errors other than
a rejection. Of the changed worlds that are rejected, every tenth is judged, too: the judge must find many of them
false.
"""

from __future__ import annotations

import argparse
import copy
import json
import pickle
import sys
import tempfile
import time
import zlib
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from campaign import table
from scipy.spatial.transform import Rotation
from world_judge import World, judged

import hdplan
from hdplan.scenes.yaml_format.reader import find_scene
from hdplan.verify import RejectedError
from hdplan.verify.checking import check
from hdplan.verify.compare import plain
from hdplan.verify.kernel import CLAIMS, MAGIC, accept

Random = np.random.Generator

SCENES = (
    *("planar_arm", "ur5_table", "ur5_payload", "panda_cup", "panda_carry", "panda_conveyor", "panda_heavy"),
    *("panda_grasp", "panda_cage", "panda_table_pick", "panda_person"),
    *("planar_arm, sizes", "ur5_table, sizes", "panda_carry, sizes", "panda_conveyor, sizes"),
)
SIZES = {  # of what is unknown, as scenes have it: of the robot, and of every obstacle; speeds where a motion has times
    "robot": {"tracking": {"position": 0.001}, "calibration": {"position": 0.001, "orientation": 0.001}},
    "obstacle": {"position": 0.002, "orientation": 0.005},
}


@dataclass
class Case:
    """A world and a proof in it, taken apart."""

    world: World
    head: World
    cuts: dict[str, Any]
    counts: Any  # of leaves, of each pair
    depths: Any
    normals: Any
    rows: Any  # of rays
    ways: Any

    @classmethod
    def of(cls, scene: str) -> Case:
        """Plan and prove a shipped scene, as it is or with SIZES of what is unknown."""
        with tempfile.TemporaryDirectory() as folder:
            name, _, more = scene.partition(", ")
            file, motion = find_scene(name), Path(folder) / "motion.json"
            if more:
                (Path(folder) / "scene.yaml").write_text(with_sizes(file))
                file = Path(folder) / "scene.yaml"
            hdplan.plan(hdplan.load_scene(file), time_limit=60).save(motion)
            data = hdplan.prove(file, motion).data
            world = check(file, motion, data)[1]
        head, _, arrays = zlib.decompress(data[len(MAGIC) :]).split(b"\n", 2)
        return cls.apart(json.loads(json.dumps(world, default=plain)), head, arrays)

    @classmethod
    def apart(cls, world: World, first: bytes, rest: bytes) -> Case:
        """Take a proof's head and arrays apart."""
        head, at = json.loads(first), 0
        sizes = [*((x, "<u2") for x in head["cuts"].values()), (head["pairs"], "<u4"), (head["leaves"], "<u1")]
        sizes += [(3 * head["leaves"], "<i4"), (head["rays"], "<u4"), (3 * head["rays"], "<i4")]
        arrays = []
        for count, kind in sizes:
            arrays.append(np.frombuffer(rest, kind, count, at).astype(np.int64))
            at += count * int(kind[2])
        *groups, counts, depths, normals, rows, ways = arrays
        cuts = dict(zip(head["cuts"], groups, strict=True))
        return cls(world, head, cuts, counts, depths, normals.reshape(-1, 3), rows, ways.reshape(-1, 3))

    def parts(self) -> tuple[bytes, bytes]:
        """The proof's head, which counts what there is, and its arrays."""
        head = {**self.head, "cuts": {k: len(x) for k, x in self.cuts.items()}, "pairs": len(self.counts)}
        head |= {"leaves": len(self.depths), "rays": len(self.rows)}
        parts = [(x, "<u2") for x in self.cuts.values()] + [(self.counts, "<u4"), (self.depths, "<u1")]
        parts += [(self.normals, "<i4"), (self.rows, "<u4"), (self.ways, "<i4")]
        return json.dumps(head).encode(), b"".join(x.astype(kind).tobytes() for x, kind in parts)

    def packed(self) -> bytes:
        """The proof's file."""
        return MAGIC + zlib.compress(b"\nnull\n".join(self.parts()), 1)


def with_sizes(file: Path) -> str:
    """A scene with SIZES of what is unknown; its files are named from everywhere."""
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    content["robot"] |= SIZES["robot"]
    for key in {"urdf", "srdf"} & {*content["robot"]}:
        content["robot"][key] = str(file.parent / content["robot"][key])
    for each in content["obstacles"]:
        each["uncertainty"] = SIZES["obstacle"]
    return yaml.safe_dump(content, sort_keys=False)


Place = tuple[Any, Any, str]  # a list or mapping, a key of it, and the path to it


def places(value: Any, path: str = "") -> Iterator[Place]:
    """All entries of a world; of long lists of numbers some."""
    keys = [*value] if isinstance(value, dict) else list(range(len(value)))
    if isinstance(value, list) and len(keys) > 60:
        keys = keys[:: len(keys) // 30]
    for key in keys:
        yield value, key, f"{path}.{key}"
        if isinstance(value[key], (dict, list)):
            yield from places(value[key], f"{path}.{key}")


def chosen(rng: Random, world: World, kinds: tuple[type, ...], within: str = "") -> Place:
    """A random entry of some kinds: first of the world's keys, so that none is drowned."""
    for _ in range(100):
        top = str(rng.choice(within.split() or [*world]))
        found = [x for x in places({top: world[top]}) if type(x[0][x[1]]) in kinds]
        if found:
            holder, key, path = found[int(rng.integers(len(found)))]
            return (world, key, path) if holder is not world and path == f".{top}" else (holder, key, path)
    raise ValueError(within)


def number(case: Case, rng: Random) -> None:
    """Change a number, a little or a lot."""
    holder, key, _ = chosen(rng, case.world, (float,))
    scale = 10.0 ** rng.uniform(-12, 1)
    holder[key] += float(scale * rng.normal())


def geometry(case: Case, rng: Random) -> None:
    """Change a number of bodies, joints, motions or rows a little."""
    holder, key, _ = chosen(rng, case.world, (float,), "bodies bodies joints motion tracks")
    holder[key] += float(10.0 ** rng.uniform(-5, -1) * rng.choice([-1, 1]))


def moved(case: Case, rng: Random) -> None:
    """Move or turn a body, a link or a joint as a whole."""
    group = case.world[str(rng.choice(["bodies", "joints"]))]
    entry = group[int(rng.integers(len(group)))]
    step = 10.0 ** rng.uniform(-5, -0.3)
    turn = Rotation.from_rotvec(rng.normal(size=3) * step * rng.integers(2)).as_matrix()
    entry["rotation"] = (turn @ np.reshape(entry["rotation"], (3, 3))).ravel().tolist()
    entry["position"] = (np.array(entry["position"]) + rng.normal(size=3) * step).tolist()
    entry["off"] = max(entry["off"], 1e-14)


def resized(case: Case, rng: Random) -> None:
    """Make a shape larger or smaller."""
    shape = case.world["bodies"][int(rng.integers(len(case.world["bodies"])))]["shape"]
    factor = 1 + rng.choice([-1, 1]) * 10.0 ** rng.uniform(-5, 0)
    for key in ("points", "sweep") if rng.random() < 0.7 else ("sweep",):
        if key in shape:
            shape[key] = (np.array(shape[key]) * factor).tolist()


def sign(case: Case, rng: Random) -> None:
    """Turn the sign of a number."""
    holder, key, _ = chosen(rng, case.world, (float,))
    holder[key] = -holder[key]


def signs(case: Case, rng: Random) -> None:
    """Turn an axis, a row of a rotation, a position or a velocity."""
    holder, key, _ = chosen(rng, case.world, (list,), "joints bodies tracks links path goal")
    if all(type(x) in (int, float) for x in holder[key]):
        holder[key] = [-x for x in holder[key]]


def index(case: Case, rng: Random) -> None:
    """Change a whole number: a parent, a carrier, a corner, a follower's leader."""
    holder, key, _ = chosen(rng, case.world, (int,))
    holder[key] += int(rng.choice([-2, -1, 1, 2]))


def word(case: Case, rng: Random) -> None:
    """Exchange a word for another one of the world."""
    holder, key, _ = chosen(rng, case.world, (str,))
    _, _, other = chosen(rng, case.world, (str,))
    words = [h[k] for h, k, _ in places(case.world) if type(h[k]) is str]
    holder[key] = str(rng.choice([*words, "prismatic", "revolute", "obstacle", "none", "linear", "", other]))


def drop(case: Case, rng: Random) -> None:
    """Leave out an entry of a list or mapping."""
    holder, key, _ = chosen(rng, case.world, (dict, list, str, float, int))
    del holder[key]


def double(case: Case, rng: Random) -> None:
    """Repeat an entry of a list, or another one's value."""
    holder, key, _ = chosen(rng, case.world, (dict, list, float, int))
    if isinstance(holder, list):
        holder.insert(int(rng.integers(len(holder) + 1)), copy.deepcopy(holder[key]))
    else:
        holder[str(rng.choice([*holder]))] = copy.deepcopy(holder[key])


def exchange(case: Case, rng: Random) -> None:
    """Exchange two entries of a list or mapping: joints, bodies, rows, numbers."""
    holder, key, _ = chosen(rng, case.world, (dict, list, float))
    other = [*holder][int(rng.integers(len(holder)))] if isinstance(holder, dict) else int(rng.integers(len(holder)))
    holder[key], holder[other] = holder[other], holder[key]


def limit(case: Case, rng: Random) -> None:
    """Narrow a limit, a tolerance, a range, a clearance or a size, or change a target."""
    keys = [x for x in ("limits", "path", "goal", "start", "clearances", "loads", "sizes") if case.world.get(x)]
    holder, key, _ = chosen(rng, case.world, (float,), " ".join(keys))
    holder[key] *= float(1 + rng.choice([-1, 1]) * 10.0 ** rng.uniform(-9, 0))


def excused(case: Case, rng: Random) -> None:
    """Leave a pair out, or compare one more, with or without its leaves."""
    listed, names = case.world["not_compared"], [x["name"] for x in case.world["bodies"]]
    if listed and rng.random() < 0.5:
        del listed[int(rng.integers(len(listed)))]
    else:
        reasons = [x[2] for x in listed] + ["the SRDF", "neighbours", "moving as one"]
        listed.append([*sorted(rng.choice(names, 2).tolist()), str(rng.choice(reasons))])
    if rng.random() < 0.5:
        unpaired(case, rng)


def unpaired(case: Case, rng: Random) -> None:
    """Leave a pair's leaves out."""
    pair = int(rng.integers(len(case.counts)))
    first = int(case.counts[:pair].sum())
    gone = np.arange(first, first + int(case.counts[pair]))
    case.depths, case.normals = np.delete(case.depths, gone), np.delete(case.normals, gone, axis=0)
    case.counts = np.delete(case.counts, pair)


def wild(case: Case, rng: Random) -> None:
    """Replace a value by something else."""
    holder, key, _ = chosen(rng, case.world, (dict, list, str, float, int, bool))
    some: list[Any] = [None, True, False, 0, 1, -1, 10**9, 1e300, 1e-320, float("nan"), "", "x"]
    some += [[], {}, [[]], [0.0, 0.0, 0.0]]
    holder[key] = some[int(rng.integers(len(some)))]


def clearance(case: Case, rng: Random) -> None:
    """Claim another clearance."""
    key = str(rng.choice(["clearance", "self_clearance"]))
    if case.head[key] is not None:
        case.head[key] *= float(1 + rng.choice([-1, 1]) * 10.0 ** rng.uniform(-8, 0.5))


def claims(case: Case, rng: Random) -> None:
    """Claim something else, something more or less."""
    content = {*case.head["claims"]} ^ {*rng.choice(sorted(CLAIMS), int(rng.integers(1, 3))).tolist()}
    case.head["claims"] = sorted(content)


def head(case: Case, rng: Random) -> None:
    """Change a value of the head."""
    some: list[Any] = [None, True, 0, -1, 0.5, 1e-9, "x", [], {}, ["limits", "limits"]]
    case.head[str(rng.choice([*case.head]))] = some[int(rng.integers(len(some)))]


def direction(case: Case, rng: Random) -> None:
    """Turn directions of leaves, exchange or turn them round."""
    for _ in range(int(rng.integers(1, 4))):
        i, j = rng.integers(len(case.normals), size=2)
        size = np.linalg.norm(case.normals[i])
        match int(rng.integers(3)):
            case 0:
                case.normals[i] = np.rint(case.normals[i] + rng.normal(size=3) * size * 10.0 ** rng.uniform(-6, 0.5))
            case 1:
                case.normals[i] = -case.normals[i]
            case _:
                case.normals[[i, j]] = case.normals[[j, i]]
    case.normals = case.normals.clip(-(2**31), 2**31 - 1)


def leaf(case: Case, rng: Random) -> None:
    """Drop, repeat or unite leaves, or change their depths."""
    i = int(rng.integers(len(case.depths)))
    pair = int(np.searchsorted(np.cumsum(case.counts), i, side="right"))
    if (way := int(rng.integers(4))) == 0:
        case.depths, case.normals = np.delete(case.depths, i), np.delete(case.normals, i, axis=0)
        case.counts[pair] -= 1
    elif way == 1:
        case.depths = np.insert(case.depths, i, case.depths[i])
        case.normals = np.insert(case.normals, i, case.normals[i], axis=0)
        case.counts[pair] += 1
    elif way == 2 and i + 1 < len(case.depths) and case.depths[i] == case.depths[i + 1] > 0:  # two halves as one
        case.depths, case.normals = np.delete(case.depths, i), np.delete(case.normals, i, axis=0)
        case.depths[i] -= 1
        case.counts[pair] -= 1
    else:
        case.depths[i] = int(rng.integers(60))


def groups(case: Case, rng: Random) -> None:
    """Divide a mesh otherwise, or name another body; or other rays."""
    names = [*case.cuts]
    if names and rng.random() < 0.7:
        name = str(rng.choice(names))
        if rng.random() < 0.2:
            case.cuts[str(rng.integers(len(case.world["bodies"])))] = case.cuts.pop(name)
        else:
            text, labels = case.cuts[name], np.unique(case.cuts[name])
            if rng.random() < 0.3:  # other numbers of the same groups
                case.cuts[name] = rng.permutation(labels.max() + 3)[text]
            else:
                rows = rng.integers(len(text), size=int(rng.integers(1, 5)))
                text[rows] = rng.choice([*labels, labels.max() + int(rng.integers(2))], size=len(rows))
    elif len(case.rows):
        i = int(rng.integers(len(case.rows)))
        if rng.random() < 0.5:
            case.rows[i] = int(rng.integers(60))
        else:
            case.ways[i] = -case.ways[i]
    else:
        leaf(case, rng)


def order(case: Case, rng: Random) -> None:
    """Exchange the leaves of two pairs."""
    ends = np.cumsum(case.counts)
    i, j = rng.integers(len(ends), size=2)
    parts = [np.arange(e - n, e) for e, n in zip(ends, case.counts, strict=True)]
    parts[i], parts[j] = parts[j], parts[i]
    case.counts[[i, j]] = case.counts[[j, i]]
    rows = np.concatenate(parts)
    case.depths, case.normals = case.depths[rows], case.normals[rows]


CHANGES: dict[str, Callable[[Case, Random], None]] = {
    f"world: {x.__name__}": x
    for x in (number, geometry, moved, resized, sign, signs, index, word, drop, double, exchange, limit, excused, wild)
}
CHANGES |= {f"proof: {x.__name__}": x for x in (clearance, claims, head, direction, leaf, groups, order)}


def outcome(case: Case, known: dict[str, str]) -> str:
    """Verdict of the kernel on a changed world and proof, and of the judge if the kernel accepts them."""
    try:
        _, whole = accept(case.world, case.packed())
    except RejectedError:
        return "rejected"
    content = [case.world, case.head["claims"], case.head["clearance"], case.head["self_clearance"], whole]
    key = json.dumps(content)
    if key not in known:
        known[key] = judged(case.world, case.head, whole)
    return f"false: {known[key]}" if known[key] else "true"


def main() -> None:
    """Run the campaign from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=np.inf, help="of a processor, after which no more is changed")
    parser.add_argument("--scene", action="append", help=f"by default {', '.join(SCENES)}")
    options = parser.parse_args()
    names, tally, teeth = options.scene or SCENES, defaultdict[str, Counter[str]](Counter), Counter[str]()
    cases, known, began = [Case.of(x) for x in names], dict[str, str](), time.process_time()
    kept = [pickle.dumps(x) for x in cases]
    for case, name in zip(cases, names, strict=True):
        if (verdict := outcome(case, known)) != "true":
            sys.exit(f"{name}: unchanged, {verdict}")
    for n in range(options.count):
        if time.process_time() - began > options.seconds:
            break
        rng = np.random.default_rng([options.seed, n])
        kind, i = list(CHANGES)[n % len(CHANGES)], int(rng.integers(len(cases)))
        case = pickle.loads(kept[i])
        try:
            CHANGES[kind](case, rng)
            if rng.random() < 0.2:  # and another one
                CHANGES[str(rng.choice([*CHANGES]))](case, rng)
            case.packed()
        except (ValueError, KeyError, IndexError, TypeError, AttributeError, OverflowError):
            tally[kind]["not made"] += 1
            continue
        try:
            verdict = outcome(case, known)
        except Exception as error:
            verdict = f"error: {type(error).__name__}: {error}"
        if verdict == "rejected" and n % 10 == 0:
            try:
                teeth["false" if judged(case.world, case.head, False) else "true"] += 1
            except Exception:
                teeth["no world"] += 1
        tally[kind][verdict.partition(":")[0]] += 1
        if ":" in verdict:
            print(n, kind, names[i], verdict, file=sys.stderr, flush=True)
    print(table(tally, ("rejected", "true", "false", "error", "not made")))
    print(f"of those rejected, the judge finds: {dict(teeth)}")


if __name__ == "__main__":
    main()
