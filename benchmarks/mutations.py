"""Change proofs, motions, scenes, robots and meshes at random, and see what the checker of proofs accepts.

    python benchmarks/mutations.py [--count N] [--seed S] [--scene NAME ...]

Every change keeps the hashes in the proof right, and the world in the proof is the one that the checker reads in the
changed files, so that the kernel gets to see the change. What is accepted although something was changed is judged
twice: by Pinocchio and coal in the world that the checker read (`world_judge.py`), and, for what it read, by hdplan:
the certificate of the changed motion in the changed scene, of the changed robot, finds the closest distances; they must
not be below what the proof claims, and limits and ends that it claims must hold. Prints a table with a row per kind of
change; "false" must be 0, as must errors other than a rejection.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import re
import shutil
import sys
import tempfile
import time
import zlib
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin
from campaign import meshes_of, table
from memory import most_memory
from sieges.mutations import of_bytes, of_text, of_tree
from world_judge import World, judged
from world_mutations import Case, direction, leaf, order, unpaired

import hdplan
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.robot_files.library import description_of, library_package_dirs
from hdplan.scenes.yaml_format.reader import find_scene
from hdplan.verify import RejectedError
from hdplan.verify.checking import check
from hdplan.verify.compare import plain
from hdplan.verify.kernel import MAGIC, unpack
from hdplan.verify.reading import read_world

Random = np.random.Generator

SCENES = (
    *("panda_cage", "panda_carry", "panda_table_pick", "panda_gate", "ur5_table", "ur5_payload", "panda_cup"),
    *("planar_arm", "panda_person"),
)
NUMBER = re.compile(r"(?<![\w.#])-?\d+(?:\.\d+)?(?:e-?\d+)?(?![\w.])")


@dataclass
class Files:
    """A proven motion with everything that the proof is about, in a folder of its own."""

    folder: Path
    parts: dict[str, bytes] = field(default_factory=dict)  # proof's head, world and arrays, and each file
    names: dict[str, str] = field(default_factory=dict)  # of the files, by their keys in the proof

    @classmethod
    def of(cls, scene: str, folder: Path) -> Files:
        """Plan and prove a scene whose robot, SRDF and meshes are copied into the folder."""
        problem = hdplan.load_scene(scene)
        _, urdf, srdf, _ = description_of(problem.robot)
        text, robot = find_scene(scene).read_text(), urdf.read_text()
        for mesh, file in meshes_of(urdf).items():
            shutil.copy(file, folder)
            robot = robot.replace(mesh, file.name)
        (folder / "robot.urdf").write_text(robot)
        where = "urdf: robot.urdf\n"
        if srdf is not None:
            shutil.copy(srdf, folder / "robot.srdf")
            where += "  srdf: robot.srdf\n"
        where += f"  package_dirs: [{', '.join(map(str, library_package_dirs()))}]\n"
        text = re.sub(r"  (name: (panda|ur5)|urdf: .*|srdf: .*)\n", "", text)
        (folder / "scene.yaml").write_text(text.replace("robot:\n", f"robot:\n  {where}", 1))
        for extra in find_scene(scene).parent.glob("*.obj"):
            shutil.copy(extra, folder)
        hdplan.plan(hdplan.load_scene(folder / "scene.yaml"), time_limit=60).save(folder / "motion.json")
        proof = hdplan.prove(folder / "scene.yaml", folder / "motion.json")
        files = cls(folder)
        head, world, arrays = zlib.decompress(proof.data[len(MAGIC) :]).split(b"\n", 2)
        files.parts |= {"head": head, "world": world, "arrays": arrays}
        for key in json.loads(head)["files"]:
            name = {"scene": "scene.yaml", "motion": "motion.json"}.get(key, f"robot.{key}")
            files.names[key] = key.partition("/")[2] or name
            files.parts[key] = (folder / files.names[key]).read_bytes()
        return files

    def verify(self, changed: dict[str, bytes]) -> tuple[str, bytes, World, bool]:
        """Verify with some parts changed; hashes and world are those of the changed files, as far as these are read.
        Returns the statement, the proof, the world that was read, and whether that is all that the scene wants."""
        parts = {**self.parts, **changed}
        for key, name in self.names.items():
            (self.folder / name).write_bytes(parts[key])
        data = changed.get("file")
        if data is None:
            head = parts["head"]
            if "head" not in changed or b'"files"' in head:
                for key in self.names:
                    old, new = (hashlib.sha256(each[key]).hexdigest().encode() for each in (self.parts, parts))
                    head = head.replace(old, new)
            if {*changed} & {*self.names}:
                with contextlib.suppress(RejectedError):
                    parts["world"] = json.dumps(read_world(*self.files).world, default=plain).encode()
            data = MAGIC + zlib.compress(b"\n".join([head, parts["world"], parts["arrays"]]), 1)
        verdict, world = check(*self.files, data)
        return verdict.text, data, json.loads(json.dumps(world, default=plain)), verdict.whole

    @property
    def files(self) -> tuple[Path, Path]:
        """The scene's and the motion's."""
        return self.folder / "scene.yaml", self.folder / "motion.json"

    def restore(self) -> None:
        """Write all files as they were."""
        for key, name in self.names.items():
            (self.folder / name).write_bytes(self.parts[key])

    def judge(self, text: str, data: bytes, world: World, whole: bool) -> str:
        """Say whether what was accepted is true of the world that was read, and of the files as they are now, and why
        not or why it is unknown."""
        if why := judged(world, unpack(data)[0], whole):
            return f"false: {why}"
        try:
            scene, motion = hdplan.load_scene(self.files[0]), hdplan.Trajectory.load(self.files[1])
            certificate = hdplan.certify(scene, motion, required=0.0)
        except hdplan.InputError as error:
            return f"not judged: {error}"
        claims = re.search(r"also proven: (.*)", text)
        claimed = claims[1].split(", ") if claims else []
        status = certificate.status
        ends = status is Status.WRONG_ENDS and {"start", "goal"} <= {*claimed}
        rates = {"velocity", "acceleration", "jerk"} & {*claimed} & {use.quantity for use in certificate.uses}
        broken = (status is Status.OUTSIDE_LIMITS and "limits" in claimed) or ends
        broken |= (status is Status.TOO_FAST and bool(rates)) or (status is Status.OVERLOADED and "torque" in claimed)
        broken |= status is Status.OFF_PATH and "path" in claimed
        if broken:
            return f"false: {certificate.text}"
        if status in (Status.OUTSIDE_LIMITS, Status.WRONG_ENDS):
            return f"not judged: {certificate.text}"
        for words, place in (("from every obstacle", certificate.worst), ("from one another", certificate.self_worst)):
            stated = re.search(rf"at least ([\d.]+) mm {words}", text)
            if stated and place is not None and place.distance < float(stated[1]) / 1e3:
                return f"false: {stated[0]}, but {place}"
        return "true"


# --- changes ----------------------------------------------------------------------------------------------------------

Change = Callable[[Files, Random], dict[str, bytes]]


def numbers(key: str) -> Change:
    """Change one or two numbers in a text file, a little or a lot."""

    def change(files: Files, rng: Random) -> dict[str, bytes]:
        text = files.parts[key].decode()
        for _ in range(int(rng.integers(1, 3))):
            found = list(NUMBER.finditer(text))
            one = found[int(rng.integers(len(found)))]
            value, scale = float(one[0]), 10.0 ** rng.uniform(-5, 1)
            new = float(value + scale * rng.normal() * max(abs(value), 0.1))
            text = f"{text[: one.start()]}{new!r}{text[one.end() :]}"
        return {key: text.encode()}

    return change


def words(key: str) -> Change:
    """Change numbers, lines, pieces or names of a text file."""
    return lambda files, rng: {key: of_text(rng, files.parts[key].decode()).encode(errors="replace")}


def arrays(*changes: Callable[[Case, Random], None]) -> Change:
    """Change what the proof holds of leaves, with the counts in its head."""

    def change(files: Files, rng: Random) -> dict[str, bytes]:
        case = Case.apart({}, files.parts["head"], files.parts["arrays"])
        changes[int(rng.integers(len(changes)))](case, rng)
        head, data = case.parts()
        return {"head": head, "arrays": data}

    return change


def corner_of_a_mesh(files: Files, rng: Random) -> dict[str, bytes]:
    """Move a corner of a triangle of a mesh."""
    keys = [key for key in files.parts if key.startswith("mesh") and key.endswith(".stl")]
    if not keys:
        return numbers("motion")(files, rng)
    key = keys[int(rng.integers(len(keys)))]
    data = bytearray(files.parts[key])
    at = 84 + 50 * int(rng.integers((len(data) - 84) // 50)) + 12 + 4 * int(rng.integers(9))
    value = np.frombuffer(data[at : at + 4], "<f4")[0] + np.float32(10.0 ** rng.uniform(-5, 0) * rng.normal())
    data[at : at + 4] = np.float32(value).astype("<f4").tobytes()
    return {key: bytes(data)}


def head_value(files: Files, rng: Random) -> dict[str, bytes]:
    """Change values of the proof's head."""
    return {"head": json.dumps(of_tree(rng, json.loads(files.parts["head"]))).encode()}


def damage(files: Files, rng: Random) -> dict[str, bytes]:
    """Change or cut bytes of the file, before or after compression."""
    content = b"\n".join(files.parts[key] for key in ("head", "world", "arrays"))
    if rng.random() < 0.7:
        return {"file": MAGIC + zlib.compress(of_bytes(rng, content), 1)}
    return {"file": of_bytes(rng, MAGIC + zlib.compress(content, 9))}


def bomb(files: Files, rng: Random) -> dict[str, bytes]:
    """Claim or hold gigabytes."""
    head = json.loads(files.parts["head"])
    head[str(rng.choice(["pairs", "leaves", "rays"]))] = int(10 ** rng.uniform(3, 17))
    zeros = bytes(int(10 ** rng.uniform(5, 8)))
    return {"file": MAGIC + zlib.compress(b"\n".join([json.dumps(head).encode(), files.parts["world"], zeros]), 9)}


def row_of_the_motion(files: Files, rng: Random) -> dict[str, bytes]:
    """Move a row of the motion by a joint's value, far or a little."""
    content = json.loads(files.parts["motion"])
    row = content["positions"][int(rng.integers(1, len(content["positions"]) - 1))]
    row[int(rng.integers(len(row)))] += float(rng.choice([-1, 1]) * 10.0 ** rng.uniform(-1.5, 0.5))
    return {"motion": json.dumps(content).encode()}


def obstacle_in_the_way(files: Files, rng: Random) -> dict[str, bytes]:
    """Put an obstacle where the last link is at some row, or nearly."""
    files.restore()
    scene = hdplan.load_scene(files.folder / "scene.yaml")
    setup, motion = Setup.of(scene), hdplan.Trajectory.load(files.folder / "motion.json")
    model = setup.robot.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, setup.robot.pin_q(motion.positions[int(rng.integers(len(motion)))]))
    at = data.oMi[model.njoints - 1].translation + rng.normal(size=3) * 0.05
    text = files.parts["scene"].decode()
    places = list(re.finditer(r"pose: \{position: \[[^]]*\]", text))
    one = places[int(rng.integers(len(places)))]
    new = f"pose: {{position: {[round(float(x), 6) for x in at]}"
    return {"scene": (text[: one.start()] + new + text[one.end() :]).encode()}


def joint_elsewhere(files: Files, rng: Random) -> dict[str, bytes]:
    """Move or turn the place of a joint, or its axis."""
    text = files.parts["urdf"].decode()
    found = []
    for joint in re.finditer(r"<joint .*?</joint>", text, re.DOTALL):
        found += [(joint.start() + m.start(1), m[1]) for m in re.finditer(r'(?:xyz|rpy)="([^"]*)"', joint[0])]
    start, old = found[int(rng.integers(len(found)))]
    new = np.array(old.split(), dtype=float) + rng.normal(size=3) * 10.0 ** rng.uniform(-2.5, 0)
    return {"urdf": (text[:start] + " ".join(map(repr, new.tolist())) + text[start + len(old) :]).encode()}


def pair_excused(files: Files, rng: Random) -> dict[str, bytes]:
    """Leave a pair's leaves out, or change the SRDF, which names pairs that may touch."""
    if rng.random() < 0.5 and "srdf" in files.parts:
        return words("srdf")(files, rng)
    return arrays(unpaired)(files, rng)


def larger_claim(files: Files, rng: Random) -> dict[str, bytes]:
    """Claim more clearance than is proven, or limits and ends that are not there; or lower a limit of the scene."""
    head = json.loads(files.parts["head"])
    match int(rng.integers(3)):
        case 0:
            key = str(rng.choice([x for x in ("clearance", "self_clearance") if head[x] is not None]))
            head[key] *= 1 + 10.0 ** rng.uniform(-1.5, 1)
        case 1:
            more = ["limits", "start", "goal", "path", "velocity", "acceleration", "jerk", "torque"]
            head["claims"] = sorted({*head["claims"], str(rng.choice(more))})
        case _:
            text = files.parts["scene"].decode()
            share = {"velocity": 3.0, "acceleration": 20.0, "torque": 80.0}
            name = str(rng.choice(list(share)))
            limit = f"limits: {{{name}: {share[name] * 10.0 ** rng.uniform(-3, 0):.4g}}}\n"
            head["claims"] = sorted({*head["claims"], name})
            text = re.sub(r"^limits:.*\n", "", text, flags=re.MULTILINE) + limit
            return {"scene": text.encode(), "head": json.dumps(head).encode()}
    return {"head": json.dumps(head).encode()}


TEXTS = {"world": "world", "motion": "motion", "scene": "scene", "URDF": "urdf"}  # and their keys
CHANGES: dict[str, Change] = {
    "a row of the motion": row_of_the_motion,
    "an obstacle in the way": obstacle_in_the_way,
    "a joint elsewhere": joint_elsewhere,
    "a pair excused": pair_excused,
    "larger claims, lower limits": larger_claim,
    "planes, leaves": arrays(direction, leaf, order),
    "the head": head_value,
    "bytes": damage,
    "gigabytes": bomb,
    **{f"the {name}'s numbers": numbers(key) for name, key in TEXTS.items()},
    **{f"the {name}'s words": words(key) for name, key in TEXTS.items()},
    "corners of meshes": corner_of_a_mesh,
}


def _difference(files: Files, changed: dict[str, bytes]) -> str:
    """Show where a changed part begins to differ."""
    key, new = next(iter(changed.items()))
    old = files.parts.get(key, b"")
    at = next((i for i, (a, b) in enumerate(zip(old, new, strict=False)) if a != b), 0)
    return f"| {key}: {old[max(at - 40, 0) : at + 40]!r} -> {new[max(at - 40, 0) : at + 40]!r}"


def main() -> None:
    """Run the campaign from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scene", action="append", help=f"by default {', '.join(SCENES)}")
    options = parser.parse_args()
    tally, slowest = defaultdict[str, Counter[str]](Counter), 0.0
    with tempfile.TemporaryDirectory() as folder:
        everything = []
        for name in options.scene or SCENES:
            (Path(folder) / name).mkdir()
            everything.append(Files.of(name, Path(folder) / name))
            assert everything[-1].verify({})[0].startswith("accepted")
        for number in range(options.count):
            rng = np.random.default_rng([options.seed, number])
            kind = list(CHANGES)[number % len(CHANGES)]
            files = everything[int(rng.integers(len(everything)))]
            changed = CHANGES[kind](files, rng)
            began = time.process_time()
            try:
                found = files.verify(changed)
            except RejectedError:
                verdict = "rejected"
            except Exception as error:
                verdict = f"error: {type(error).__name__}: {error}"
            else:
                verdict = ""
            slowest = max(slowest, time.process_time() - began)
            verdict = verdict or files.judge(*found)
            tally[kind][verdict.partition(":")[0]] += 1
            if ":" in verdict:
                shown = number, kind, files.folder.name, verdict, _difference(files, changed)
                print(*shown, file=sys.stderr, flush=True)
    print(table(tally, ("rejected", "true", "not judged", "false", "error")))
    print(f"slowest {slowest:.1f} s, memory at most {most_memory() / 1e9:.2f} GB")


if __name__ == "__main__":
    main()
