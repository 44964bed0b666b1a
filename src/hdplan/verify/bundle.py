"""The proof of a job: one file with the proofs of its parts, which the kernel checks one by one."""

from __future__ import annotations

import itertools

import numpy as np

from .balls import need
from .kernel import MOST_LINE
from .world import keys_of, loads

MAGIC = b"hdplan job proof\n"


def is_job(data: bytes) -> bool:
    """True if a proof's file is that of a job."""
    return data.startswith(MAGIC)


def parts_of(data: bytes) -> list[bytes]:
    """The proofs of a job's parts in one file: a line with their lengths, and one after the other."""
    need(is_job(data), "the file is not the proof of a job, which the scene holds")
    line, _, rest = data[len(MAGIC) :].partition(b"\n")
    need(len(line) <= MOST_LINE, "the proof's head is too long")
    (lengths,) = keys_of(loads(line), "the proof's head", "lengths")
    good = type(lengths) is list and all(type(x) is int and x > 0 for x in lengths)
    need(good and sum(lengths) == len(rest), "the proof is shorter or longer than its head says")
    ends = np.cumsum([0, *lengths]).tolist()
    return [rest[a:b] for a, b in itertools.pairwise(ends)]
