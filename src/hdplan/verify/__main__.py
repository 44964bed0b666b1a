"""Run the checker from the command line."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from .balls import RejectedError, rejecting, shown
from .bounds import bounded
from .bundle import is_job
from .checking import MOST_PARTS, check, check_job
from .compare import plain
from .kernel import IN_PART
from .robot_files import is_name


def there(path: Path) -> bool:
    """True if a file is there; none has a name that no system allows."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def main(words: list[str]) -> int:
    """Check a proof, of a motion or of a job: 0 if it is accepted, 4 if it is accepted in part, 1 if it is rejected, 2
    for files that are lacking or cannot be written."""
    parser = argparse.ArgumentParser(prog="python -m hdplan.verify", description="Check a proof that a motion is free.")
    parser.add_argument("--json", action="store_true", help="print the verdict as JSON")
    parser.add_argument("--world", type=Path, metavar="FILE.json", help="write the world that was read")
    parser.add_argument("--request", type=Path, metavar="FILE", help="the request of a planning scene of MoveIt's")
    parser.add_argument("--robot", metavar="NAME|FILE", help="a robot in place of the scene's")
    for name in ("scene", "motion", "proof"):
        parser.add_argument(name, type=Path)
    given = parser.parse_args(words)
    robot = None if given.robot is None or is_name(given.robot) else Path(given.robot)
    needed = [x for x in (given.scene, given.motion, given.proof, given.request, robot) if x is not None]
    if lacking := [name for name in needed if not there(name)]:
        print(f"{shown(str(lacking[0]))}: no such file", file=sys.stderr)
        return 2
    sys.stdout.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]  # names hold any character
    try:
        with rejecting():  # a file that cannot be opened, too
            with given.proof.open("rb") as file:
                job = is_job(file.read(100))
            bounded(MOST_PARTS if job else 1)
            if job and (given.world or given.request):
                print("--world, --request: are about a single motion, and this is a job's proof", file=sys.stderr)
                return 2
            files = given.scene, given.motion, given.proof.read_bytes()
            verdict, read = check_job(*files, given.robot) if job else check(*files, given.request, given.robot)
    except RejectedError as error:
        print(json.dumps([str(error), None]) if given.json else f"rejected: {error}")
        return 1
    if (world := given.world) is not None:
        try:
            begun = world.with_name(f".{world.name}.part")  # whole or not at all
            begun.write_text(json.dumps(read, allow_nan=False, default=plain), encoding="utf-8")
            begun.replace(world)
        except (OSError, ValueError) as error:
            print(f"{shown(str(world))}: cannot be written ({error})", file=sys.stderr)
            return 2
    print(json.dumps([verdict.text, verdict.whole]) if given.json else verdict.text)
    return 0 if verdict.whole else IN_PART


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
