"""Files -> verdict: read the world, compare it with the proof's, let the kernel check; within bounds of time and
memory."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .balls import RejectedError, need, rejecting, shown
from .compare import check_equal
from .effects import check_claims
from .kernel import proven_world, unpack
from .reading import Reading, read_world
from .verdict import in_words
from .world import World, loads

MOST_MEMORY = 1 << 31  # bytes that a check may take beside Python itself
MOST_TIME, MOST_WAIT = 30, 60  # [s] of a processor, and by the clock

READ = """the files read are those whose hashes are in the proof, and describe the robot and its surroundings
Python's XML and JSON, and PyYAML, read what is written"""


@dataclass(frozen=True)
class Verdict:
    """What is proven."""

    text: str  # in words, line by line
    whole: bool  # all that the scene wants; False: accepted in part


def check(
    scene: Path, motion: Path, proof: bytes, request: Path | None = None, robot: str | None = None
) -> tuple[Verdict, dict[str, Any]]:
    """What a proof's content proves of a motion in a scene, and the world that was read; of MoveIt's scenes with their
    `request` and `robot`. In this process: what files say may take any time. Raises RejectedError, which names leaf,
    pair and reason, or the first difference."""
    with rejecting():
        head, line, cuts, trees = unpack(proof)
        told = loads(line)
        reading = read_world(scene, motion, told, request, robot)
        read, hashes = reading.world, reading.hashes
        for key in sorted({*hashes} | {*head["files"]}):
            need(key in head["files"], f"{key}: is read, and not among the files of the proof")
            need(
                head["files"][key] == hashes.get(key),
                f"{key}: is not the file that was proven: its SHA-256 differs",
            )
        check_equal(read, told)
        world = proven_world(read, head, cuts, trees)
        check_claims(world, head)
        return verdict_of(world, head, reading), read


def verdict_of(world: World, head: dict[str, Any], reading: Reading) -> Verdict:
    """What a proof proves by its head, whose claims were checked: in words, with the files and what they rest on."""
    text, whole = in_words(world, head)
    files = "".join(
        f"\n  {shown(key)}: SHA-256 {digest[:16]}" for key, digest in reading.hashes.items() if key != "motion"
    )
    assumed = "".join(f"\n    {line}" for line in READ.splitlines())
    said, _, rest = text.partition("\n  if:")
    if reading.taken:  # the proof's word is no proof
        first, _, more = said.partition("\n")
        lacking = f"NOT read by the checker, but taken from the proof: {', '.join(map(shown, reading.taken))}"
        first = first.removeprefix("accepted in part; ").removeprefix("accepted: ")
        said = f"accepted in part; {lacking}; {first}\n{more}"
    said += "".join(f"\n  {line}" for line in reading.passed)
    return Verdict(f"{said}{files}\n  if:{assumed}{rest}", whole and not reading.taken)


def verify(scene: Path, motion: Path, proof: Path, request: Path | None = None, robot: str | None = None) -> Verdict:
    """What a proof's file proves of a motion in a scene, checked in a process of its own that ends in time; of MoveIt's
    scenes with their `request` and `robot`. Raises RejectedError."""
    beside = [f"--{key}={x}" for key, x in (("request", request), ("robot", robot)) if x is not None]
    run = [sys.executable, "-m", __package__, "--json", *beside, "--", *map(str, (scene, motion, proof))]
    try:
        done = subprocess.run(run, capture_output=True, timeout=2 * MOST_WAIT, check=False)
        text, whole = json.loads(done.stdout)
    except (subprocess.TimeoutExpired, ValueError):
        raise RejectedError(f"needs more than {MOST_TIME} s, or more memory than it may take") from None
    if whole is None:
        raise RejectedError(text)
    return Verdict(text, whole)


def bounded() -> None:
    """Let this process take at most MOST_MEMORY, MOST_TIME and MOST_WAIT, whatever the files say: beyond that, the
    proof is rejected."""
    late = threading.Timer(MOST_WAIT, _give_up, (f"needs more than {MOST_WAIT} s",))
    late.daemon = True
    late.start()
    if sys.platform == "linux":
        import resource
        import signal

        def at_most(kind: int, soft: int, hard: int) -> None:
            allowed = resource.getrlimit(kind)[1]
            free = allowed == resource.RLIM_INFINITY
            resource.setrlimit(kind, (soft, hard) if free else (min(soft, allowed), min(hard, allowed)))

        signal.signal(signal.SIGXCPU, lambda *_: _give_up(f"needs more than {MOST_TIME} s of a processor"))
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        at_most(resource.RLIMIT_AS, used + MOST_MEMORY, used + MOST_MEMORY)
        at_most(resource.RLIMIT_CPU, MOST_TIME, MOST_TIME + 5)


def _give_up(words: str) -> None:
    import os

    as_json = "--json" in sys.argv
    os.write(1, (json.dumps([words, None]) if as_json else f"rejected: {words}\n").encode())
    os._exit(1)
