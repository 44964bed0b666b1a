"""Files -> verdict: read the world, compare it with the proof's, let the kernel check."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .balls import RejectedError, need, rejecting, shown
from .bounds import MOST_WAIT
from .bundle import is_job, parts_of
from .compare import check_curves, check_equal
from .effects import check_claims
from .job import Part, read_job
from .kernel import Trees, proven_world, unpack
from .reach import check_reach
from .reading import Reading, read_world
from .verdict import in_words
from .world import World, loads

SAME_PLACE = 1e-9  # [m], [rad] by which the worlds of a job may differ that hdplan and the checker derived
MOST_PARTS = 20  # of a job, for each of which the check may take as much time

JOB = """of a job: what is gripped is then held as it stood, and what is let go stays where it was let go"""
READ = """the files read are those whose hashes are in the proof, and describe the robot and its surroundings
Python's XML, JSON and zip, and PyYAML, read what is written"""


@dataclass(frozen=True)
class Verdict:
    """The proven statement."""

    text: str  # in words, line by line
    whole: bool  # all that the scene wants; False: accepted in part


def check(
    scene: Path, motion: Path, proof: bytes, request: Path | None = None, robot: str | None = None
) -> tuple[Verdict, dict[str, Any]]:
    """The statement that a proof proves of a motion in a scene, and the world that was read; MoveIt's scenes have their
    `request` and `robot`. In this process: what files say may take any time. Raises RejectedError, which names leaf,
    pair and reason, or the first difference."""
    with rejecting():
        head, line, cuts, trees = unpack(proof)
        claimed = loads(line)
        reading = read_world(scene, motion, claimed, request, robot)
        read, hashes = reading.world, reading.hashes
        check_files(hashes, head)
        check_equal(read, claimed)
        world = proven_world(read, head, cuts, trees)
        check_claims(world, head)
        return verdict_of(world, head, reading), read


def check_files(hashes: dict[str, str], head: dict[str, Any]) -> None:
    """Reject unless the files that were read are those of a proof."""
    for key in sorted({*hashes} | {*head["files"]}):
        need(key in head["files"], f"{key}: is read, and not among the files of the proof")
        need(head["files"][key] == hashes.get(key), f"{key}: is not the file that was proven: its SHA-256 differs")


def check_job(scene: Path, motion: Path, proof: bytes, robot: str | None = None) -> tuple[Verdict, list[Any]]:
    """The statement that a job's proof proves: every stage is free in the world that the stages before it leave; and
    these worlds. In this process. Raises RejectedError, which names the stage."""
    with rejecting():
        proofs = [unpack(each) for each in parts_of(proof)]
        claimed = [loads(line) for _, line, _, _ in proofs]
        parts, verdicts = read_job(scene, motion, claimed, robot), list[Verdict]()
        for part, world, (head, _, cuts, trees) in zip(parts, claimed, proofs, strict=True):
            try:
                verdicts.append(checked_part(part, world, head, cuts, trees))
            except RejectedError as error:
                raise RejectedError(f"{part.name}: {error}") from None
        return verdict_of_job(parts, verdicts), [part.reading.world for part in parts]


def checked_part(
    part: Part, claimed: dict[str, Any], head: dict[str, Any], cuts: dict[str, Any], trees: Trees
) -> Verdict:
    """The statement proven in one world of a job."""
    check_files(part.reading.hashes, head)
    check_part(part, claimed)
    if part.holding is not None:
        check_reach(World(part.reading.world, cuts), *part.holding)
    world = proven_world(part.reading.world, head, cuts, trees)
    check_claims(world, head)
    return verdict_of(world, head, part.reading)


def check_part(part: Part, claimed: dict[str, Any]) -> None:
    """Reject unless the world that a proof claims is that of a part: it derived its own, by roundings of its own. Along
    a curve they may have other chords, and the motion must keep to the checker's."""
    read = part.reading.world
    need(read["motion"] == claimed.get("motion"), "the proof is that of another motion")
    own = {"path": read["path"]} if part.drawn else {}
    if part.drawn:
        check_curves(read["path"], claimed["path"])
    check_equal(read, {**claimed, **own}, SAME_PLACE)


def verdict_of_job(parts: list[Part], verdicts: list[Verdict]) -> Verdict:
    """The statement proven of all parts of a job: the words on each, and once those on all."""
    lines = [verdict.text.split("\n") for verdict in verdicts]
    common = [x for x in lines[0][1:] if all(x in own for own in lines)]
    stages, whole = sum(not part.arm for part in parts), all(x.whole for x in verdicts)
    lacking = ", ".join(part.name for part, x in zip(parts, verdicts, strict=True) if not x.whole)
    claim = ["accepted" if whole else f"accepted in part; NOT whole, as each says: {lacking}"]
    claim[0] += f": a job of {stages} stages, each of which begins as the one before it ended"
    for part, own in zip(parts, lines, strict=True):
        claim += [f"  {part.name}: {own[0]}; {part.about}", *(f"  {x}" for x in own[1:] if x not in common)]
    more = [f"    {line}" for line in JOB.splitlines()]
    return Verdict("\n".join([*map(shown, claim), *common, *more]), whole)


def verdict_of(world: World, head: dict[str, Any], reading: Reading) -> Verdict:
    """The statement of a proof by its checked head: in words, with the files and the assumptions."""
    text, whole = in_words(world, head)
    files = "".join(
        f"\n  {shown(key)}: SHA-256 {digest[:16]}" for key, digest in reading.hashes.items() if key != "motion"
    )
    assumed = "".join(f"\n    {line}" for line in READ.splitlines())
    claim, _, rest = text.partition("\n  if:")
    if reading.taken:  # the proof's word is no proof
        first, _, more = claim.partition("\n")
        lacking = f"NOT read by the checker, but taken from the proof: {', '.join(map(shown, reading.taken))}"
        first = first.removeprefix("accepted in part; ").removeprefix("accepted: ")
        claim = f"accepted in part; {lacking}; {first}\n{more}"
    claim += "".join(f"\n  {line}" for line in reading.passed)
    return Verdict(f"{claim}{files}\n  if:{assumed}{rest}", whole and not reading.taken)


def verify(scene: Path, motion: Path, proof: Path, request: Path | None = None, robot: str | None = None) -> Verdict:
    """The statement of a proof's file on a motion in a scene, checked in a process of its own that ends in time.
    MoveIt's scenes have their `request` and `robot`. Raises RejectedError."""
    beside = [f"--{key}={x}" for key, x in (("request", request), ("robot", robot)) if x is not None]
    run = [sys.executable, "-m", __package__, "--json", *beside, "--", *map(str, (scene, motion, proof))]
    try:
        with rejecting():
            need(proof.is_file(), f"{proof}: no such file")
            with proof.open("rb") as file:
                parts = MOST_PARTS if is_job(file.read(100)) else 1
        done = subprocess.run(run, capture_output=True, timeout=2 * parts * MOST_WAIT, check=False)
        if done.returncode == 2:  # a file that is not there
            raise RejectedError(done.stderr.decode(errors="replace").strip())
        text, whole = json.loads(done.stdout)
    except (subprocess.TimeoutExpired, ValueError):
        raise RejectedError("needs more time, or more memory, than it may take") from None
    if whole is None:
        raise RejectedError(text)
    return Verdict(text, whole)
