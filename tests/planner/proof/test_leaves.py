"""Laws of the trees of leaves: what the kernel takes for a cover of the motion is one, and nothing else."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from hdplan.verify import RejectedError
from hdplan.verify.kernel import DEEPEST, leaves


def reference(depths: list[int], rows: int) -> list[tuple[float, float]] | None:
    """The leaves of a tree by a walk through it, one after the other; None for depths that make no tree."""
    waiting, found = [(0.0, float(rows), 0)], []
    for wanted in depths:
        if not waiting:
            return None
        a, b, depth = waiting.pop()
        while depth < wanted:
            middle, depth = (float((a + b) // 2) if b - a > 1 else (a + b) / 2), depth + 1
            waiting.append((middle, b, depth))
            b = middle
        if depth != wanted:
            return None
        found.append((a, b))
    return None if waiting else found


def grown(rng: np.random.Generator, depth: int = 0) -> Iterator[int]:
    """The depths of the leaves of a random tree."""
    if depth < 20 and rng.random() < 0.9 * 0.8**depth:
        yield from grown(rng, depth + 1)
        yield from grown(rng, depth + 1)
    else:
        yield depth


def test_random_trees_have_the_leaves_of_a_walk() -> None:
    """Every tree has the leaves of a walk through it, also beside others; a changed one covers only if it is a tree."""
    rng, trees, changed = np.random.default_rng(0), 0, 0
    for _ in range(60):
        rows, own = int(rng.integers(1, 90)), [list(grown(rng)) for _ in range(int(rng.integers(1, 5)))]
        for depths in own[: int(rng.integers(0, len(own) + 1))]:
            i = int(rng.integers(len(depths)))
            match int(rng.integers(4)):
                case 0:
                    del depths[i]
                case 1:
                    depths.insert(i, depths[i])
                case 2:
                    depths[i] = int(rng.integers(22))
                case _:
                    rng.shuffle(depths)
        counts, expected = np.array([len(x) for x in own]), [reference(x, rows) for x in own]
        spans, node, whole = leaves(counts, np.array([y for x in own for y in x], dtype=np.int64), rows)
        assert whole.tolist() == [x is not None for x in expected]
        ends = np.cumsum(counts)
        for k, message in enumerate(expected):
            if message is not None:
                assert spans[node[ends[k] - counts[k] : ends[k]]].tolist() == [list(x) for x in message]
        trees, changed = trees + int(whole.sum()), changed + int((~whole).sum())
    assert trees > 40 < changed


@pytest.mark.parametrize(
    "depths", [[], [1], [1, 2], [0, 0], [0] * 9, [1, 1, 1], [2, 1, 2], [DEEPEST] * 4, [1, 2, 2, DEEPEST]]
)
def test_depths_that_make_no_tree_are_no_cover(depths: list[int]) -> None:
    """Gaps, more than the whole and leaves that begin where none of their length does are no cover."""
    counts = np.array([1, len(depths), 1])
    _, _, whole = leaves(counts, np.array([0, *depths, 0], dtype=np.int64), 2**20)
    assert whole.tolist() == [True, False, True]


def test_leaves_too_deep_or_too_short_are_refused() -> None:
    """Leaves that are deeper than numbers are exact, or shorter than an interval may be, are refused."""
    for deep in (DEEPEST + 1, 63, 64, 255):
        with pytest.raises(RejectedError, match="too deep"):
            leaves(np.array([1]), np.array([deep]), 5)
    chain = np.array([*range(1, 41), 40])
    with pytest.raises(RejectedError, match="too short"):
        leaves(np.array([len(chain)]), chain, 5)
    assert leaves(np.array([len(chain)]), chain, 2**20)[2].all()
