"""Run the checker from the command line."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from .balls import RejectedError, shown
from .checking import bounded, check
from .kernel import IN_PART

USAGE = "usage: python -m hdplan.verify [--world WORLD.json] SCENE MOTION PROOF"


def main(words: list[str]) -> int:
    """Check a proof: 0 if it is accepted, 4 if it is accepted in part, 1 if it is rejected, 2 for files that are
    lacking."""
    as_json, world, names = words[:1] == ["--json"], None, words[words[:1] == ["--json"] :]
    if names[:1] == ["--world"] and len(names) > 1:
        world, names = Path(names[1]), names[2:]
    if len(names) != 3:
        sys.exit(USAGE)
    if lacking := [name for name in names if not Path(name).is_file()]:
        print(f"{shown(lacking[0])}: no such file", file=sys.stderr)
        return 2
    sys.stdout.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]  # names hold any character
    bounded()
    try:
        scene, motion, proof = map(Path, names)
        verdict, read = check(scene, motion, proof.read_bytes())
    except RejectedError as error:
        print(json.dumps([str(error), None]) if as_json else f"rejected: {error}")
        return 1
    if world is not None:
        begun = world.with_name(f".{world.name}.part")  # whole or not at all
        begun.write_text(json.dumps(read, allow_nan=False), encoding="utf-8")
        begun.replace(world)
    print(json.dumps([verdict.text, verdict.whole]) if as_json else verdict.text)
    return 0 if verdict.whole else IN_PART


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
