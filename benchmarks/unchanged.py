"""Show what a change of the code changed in verdicts and motions.

    python benchmarks/unchanged.py [DIR] [--every K] -o before.json      # with the old code
    python benchmarks/unchanged.py [DIR] [--every K] --against before.json    # with the new one

Plans every shipped scene and every K-th problem of MotionBenchMaker below DIR (see `mbm.py`), and notes for each the
status, the proven clearances and a digest of the motion's bytes. With `--against`, every problem that differs is
listed, with what differs; the exit code is 1 if there is any.
"""

from __future__ import annotations

import hashlib
import json
import sys
from pathlib import Path

from problems import SHIPPED, mixed_parser, mixed_problems

import hdplan

TIME_LIMIT = 120.0  # [s] generous: what is cut short by a slow machine would differ by chance


def summary(scene: hdplan.Scene) -> dict[str, object]:
    """Results that must not change, in a form that JSON carries exactly."""
    try:
        result = hdplan.plan(scene, time_limit=TIME_LIMIT)
    except hdplan.InputError as error:
        return {"status": "refused", "words": str(error)}
    certificate, motion = result.certificate, result.trajectory
    rows = (motion.times, motion.positions, motion.velocities, motion.accelerations)
    digest = hashlib.sha256(b"".join(b"-" if part is None else part.tobytes() for part in rows)).hexdigest()
    return {
        "status": certificate.status.value,
        "clearance": certificate.clearance,
        "self_clearance": certificate.self_clearance,
        "motion": digest[:16],
        "attempts": result.attempts,
    }


def main() -> None:
    """Run the comparison from the command line."""
    parser = mixed_parser(__doc__)
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--against", type=Path)
    options = parser.parse_args()
    found = {}
    for group, title, load in mixed_problems(options.folder, options.every):
        name = title if group == SHIPPED else f"{group} {title}"
        found[name] = summary(load())
        print(name, *found[name].values(), flush=True)
    if options.output:
        options.output.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    if options.against:
        before = json.loads(options.against.read_text(encoding="utf-8"))
        same = {name for name in found if found[name] == before.get(name)}
        for name in sorted(set(found) - same):
            print(f"differs: {name}\n  before {before.get(name)}\n  now    {found[name]}")
        gone = sorted(set(before) - set(found))
        print(f"{len(same)} of {len(found)} the same" + (f"; not planned now: {', '.join(gone)}" if gone else ""))
        sys.exit(len(same) < len(found) or bool(gone))


if __name__ == "__main__":
    main()
