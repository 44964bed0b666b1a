"""A motion's proof, written and read again by the checker."""

from __future__ import annotations

from pathlib import Path

import hdplan
from hdplan.verify import RejectedError
from hdplan.verify.checking import check


def proven(scene: Path, motion: Path) -> str:
    """Prove a motion in a scene and check the proof: "accepted", or why not."""
    try:
        verdict, _ = check(scene, motion, hdplan.prove(scene, motion).data)
    except hdplan.HdplanError as error:
        return f"not proven: {error}"
    except RejectedError as error:
        return f"rejected: {error}"
    return "accepted" if verdict.whole else verdict.text.partition("\n")[0]
