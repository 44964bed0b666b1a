"""A proof is about what files mean: other words of the same meaning are proven and accepted, too."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "benchmarks"))

import rewritings
from proven import proven

original = cache(rewritings.Original)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ["ur5_table", "panda_cup"])
@pytest.mark.parametrize("seed", range(5))
def test_rewritten_files_are_accepted(name: str, seed: int, tmp_path: Path) -> None:
    files = original(name).rewrite(np.random.default_rng(seed), tmp_path)
    assert proven(*files) == "accepted"
