"""Times: every method answers every pose, ratios are ratios, interruption leaves whole pairs."""

from __future__ import annotations

import numpy as np
import pytest

from hdplan.distance.studies.query_time import METHODS, available_methods, query_times
from hdplan.distance.studies.stopwatch import seconds_per_query

PAIRS = (("cube", "cube"), ("tetrahedron", "tetrahedron"))
FAST = ("coal", "interpreter", "compiled, one pose a call", "compiled")


def test_pairs_come_in_the_order_of_their_complexity() -> None:
    found = query_times(PAIRS, FAST)
    assert found.complete
    assert [pair.complexity for pair in found.pairs] == [128, 1024]
    for pair in found.pairs:
        assert set(pair.seconds) == set(FAST)
        assert all(0 < seconds < 1e-2 for seconds in pair.seconds.values())
        assert pair.ratio("coal", "compiled") * pair.ratio("compiled", "coal") == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["FCL", "GDF", "GDF uaibot", "JAX batch"])
@pytest.mark.filterwarnings("ignore")  # of uaibot's own imports
def test_optional_peers_answer_queries(name: str) -> None:
    if name not in available_methods():
        pytest.skip("not installed")
    found = query_times(PAIRS[:1], [name])
    assert found.pairs[0].seconds[name] > 0


def test_only_whole_pairs_are_kept() -> None:
    answers = iter([False, False, True])
    found = query_times(PAIRS, ("coal", "compiled"), stop=lambda: next(answers))
    assert not found.complete
    assert [pair.names for pair in found.pairs] == [("tetrahedron", "tetrahedron")]


def test_methods_that_need_no_package_are_always_there() -> None:
    assert set(FAST) <= set(available_methods()) <= set(METHODS)


def test_a_querys_time_is_that_of_the_fastest_warm_round() -> None:
    took = iter([4.0, 3.0, 2.0, 9.0, 3.0])
    clock = np.zeros(1)

    def run() -> None:
        if warm:
            clock[0] += next(took)
        warm.append(True)

    warm: list[bool] = []
    assert seconds_per_query(run, 10, lambda: float(clock[0])) == pytest.approx(0.2)
