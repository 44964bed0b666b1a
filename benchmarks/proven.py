"""A motion's proof, written and read again by the checker."""

from __future__ import annotations

from pathlib import Path

import hdplan
from hdplan.planner.job.proof import prove_job
from hdplan.verify import RejectedError
from hdplan.verify.checking import check, check_job


def proven(scene: Path, motion: Path, *beside: Path | str, job: bool = False) -> str:
    """Prove a motion in a scene, or that of a job, and check the proof: "accepted", or why not."""
    try:
        data = prove_job(scene, motion).data if job else hdplan.prove(scene, motion, *beside).data
        verdict = (check_job(scene, motion, data) if job else check(scene, motion, data, *beside))[0]  # type: ignore[arg-type]
    except hdplan.HdplanError as error:
        return f"not written: {error}"
    except RejectedError as error:
        return f"rejected: {error}"
    return "accepted" if verdict.whole else f"in part: {verdict.text.splitlines()[0]}"
