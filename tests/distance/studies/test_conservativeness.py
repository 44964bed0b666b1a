"""False positives: rates fall with the tolerance, richer sets have fewer, interruption leaves what was counted."""

from __future__ import annotations

import numpy as np
import pytest

from hdplan.distance.studies import conservativeness as module
from hdplan.distance.studies.conservativeness import Conservativeness, conservativeness

TOLERANCES = np.geomspace(1e-4, 0.3, 20)
Steps = list[tuple[int, int, str]]


@pytest.fixture(scope="module")
def small() -> tuple[Conservativeness, Steps]:
    steps: Steps = []
    with pytest.MonkeyPatch.context() as patch:  # two light pairs
        patch.setattr(module, "PLATONIC_PAIRS", (("tetrahedron", "tetrahedron"), ("cube", "cube")))
        found = conservativeness(
            6000, ("paper", "paper+centre"), with_fcl=False, report=lambda *step: steps.append(step)
        )
    return found, steps


def test_every_configuration_counts_once(small: tuple[Conservativeness, Steps]) -> None:
    found, steps = small
    assert found.complete
    assert len(found.distances) == found.planned == 6000
    assert [done for done, _, _ in steps] == sorted(done for done, _, _ in steps)
    assert steps[-1][:2] == (6000, 6000)


def test_no_contact_is_called_free(small: tuple[Conservativeness, Steps]) -> None:
    assert small[0].missed == 0


def test_rates_of_all_fall_with_the_tolerance_and_with_a_larger_set(small: tuple[Conservativeness, Steps]) -> None:
    found, _ = small
    paper, centre = (found.rates_of_all(rung, TOLERANCES) for rung in found.rungs)
    assert np.all(np.diff(paper) <= 0)
    assert paper[0] > 0
    assert np.all(centre <= paper)
    assert np.all(found.rates(found.rungs[0], TOLERANCES) >= paper)


def test_rates_count_what_they_say(small: tuple[Conservativeness, Steps]) -> None:
    found, _ = small
    rung, tolerance = found.rungs[0], 0.01
    alarms, apart = np.sum(rung.gaps > tolerance), np.sum(found.distances >= tolerance)
    assert found.rates(rung, tolerance) == alarms / apart
    assert found.rates_of_all(rung, tolerance) == alarms / len(found.distances)


def test_the_same_seed_gives_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PLATONIC_PAIRS", (("cube", "cube"),))
    first, again = (conservativeness(500, ("paper",), seed=3, with_fcl=False) for _ in range(2))
    assert np.array_equal(first.distances, again.distances)
    assert np.array_equal(first.rungs[0].gaps, again.rungs[0].gaps)


def test_stopped_it_keeps_what_it_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PLATONIC_PAIRS", (("cube", "cube"),))
    answers = iter([False, False, True])
    found = conservativeness(1000, ("paper",), with_fcl=False, stop=lambda: next(answers))
    assert not found.complete
    assert len(found.distances) == 200
    assert len(conservativeness(1000, ("paper",), with_fcl=False, stop=lambda: True).distances) == 0


def test_exact_distances_are_those_of_fcl(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("fcl")
    monkeypatch.setattr(module, "PLATONIC_PAIRS", (("cube", "cube"),))
    found = conservativeness(500, ("paper",))
    assert found.fcl_compared == 50
    assert found.fcl_difference < 1e-6
