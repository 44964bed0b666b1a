"""The study: what its numbers must obey, its Pareto front and its advice, progress and interruption."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from hdplan.distance.baselines.coal import signed_distances
from hdplan.distance.studies.accuracy import (
    BANDS,
    BLOCK,
    GAPS,
    Entry,
    Plan,
    Setting,
    Study,
    best_buy,
    pareto_front,
    study,
)
from hdplan.distance.studies.study_poses import NEAR_GAPS, study_bodies, study_poses

TINY = Plan(
    ("capsule - box", "box - board"), (("paper", 2, "float64"), ("paper+centre", 2, "float64")), (1e-3, 1e-2),
    ("value",), random=BLOCK, near=BLOCK,
)  # fmt: skip
Steps = list[tuple[int, int, str]]


@pytest.fixture(scope="module")
def tiny() -> tuple[Study, Steps]:
    steps: Steps = []
    return study(TINY, report=lambda *step: steps.append(step)), steps


def entry(time: float, loss: float, near: float = 0.01, **setting: object) -> Entry:
    """An entry of which only these numbers count."""
    bands = dict.fromkeys(BANDS, near)
    rates = dict.fromkeys(GAPS, loss)
    chosen = replace(Setting("paper", 2, 1e-3, "float64"), **setting)
    return Entry(chosen, "a - b", rates, 0.0, bands, bands, bands, None, {"gradient": time})


def test_every_setting_is_measured_on_every_pair(tiny: tuple[Study, Steps]) -> None:
    found, steps = tiny
    assert found.complete
    assert len(found.entries) == 2 * 2 * 2
    assert len({(e.bodies, e.setting) for e in found.entries}) == len(found.entries)
    assert [done for done, _, _ in steps] == list(range(len(steps)))
    assert steps[-1][0] == steps[-1][1] == 2 * 2


def test_errors_and_rates_obey_their_laws(tiny: tuple[Study, Steps]) -> None:
    for e in tiny[0].entries:
        assert set(e.false_positives) == set(GAPS)
        assert all(0 <= rate < 0.2 for rate in e.false_positives.values())
        for band in BANDS:
            assert abs(e.bias[band]) <= e.high_error[band]
            assert 0 < e.median_error[band] <= e.high_error[band]
        assert e.sign_lost == 0.0
        assert e.bend is None
        assert set(e.seconds) == {"value"}


def test_the_sign_depends_on_the_normals_alone_and_more_of_them_see_more(tiny: tuple[Study, Steps]) -> None:
    for bodies in TINY.bodies:
        rates = {
            name: {
                tuple(e.false_positives.values())
                for e in tiny[0].entries
                if (e.bodies, e.setting.normals) == (bodies, name)
            }
            for name, _, _ in TINY.kernels
        }
        assert all(len(found) == 1 for found in rates.values())
        (paper,), (centre,) = rates["paper"], rates["paper+centre"]
        assert all(c <= p for p, c in zip(paper, centre, strict=True))


def test_means_are_over_whole_pairs(tiny: tuple[Study, Steps]) -> None:
    found, _ = tiny
    means = found.means()
    assert [m.setting for m in means] == [e.setting for e in found.entries[:4]]
    first, second = found.entries[0], found.entries[4]
    assert means[0].median_error["near"] == pytest.approx(
        (first.median_error["near"] + second.median_error["near"]) / 2
    )
    assert means[0].seconds["value"] == pytest.approx(np.sqrt(first.seconds["value"] * second.seconds["value"]))
    partial = replace(found, entries=found.entries[:7], complete=False)
    assert partial.means() == found.entries[:4]
    assert replace(found, entries=found.entries[:3], complete=False).means() == found.entries[:3]


def test_stopped_it_keeps_whole_steps() -> None:
    answers = iter([False, True])
    found = study(TINY, stop=lambda: next(answers))
    assert not found.complete
    assert [(e.bodies, e.setting.shaping_length) for e in found.entries] == [(TINY.bodies[0], x) for x in (1e-3, 1e-2)]


@pytest.mark.slow
def test_hessians_give_the_bend_which_grows_with_gamma() -> None:
    kernels = (("paper", 1, "float64"), ("paper", 8, "float64"))
    found = study(replace(TINY, bodies=TINY.bodies[:1], kernels=kernels, shaping_lengths=(1e-2,), orders=("hessian",)))
    low, high = (e.bend for e in found.entries)
    assert low is not None
    assert high is not None
    assert 0 < low < high


def test_the_front_is_a_front() -> None:
    rng = np.random.default_rng(0)
    costs, losses = rng.integers(1, 20, 60).tolist(), rng.integers(1, 20, 60).tolist()
    front = pareto_front(costs, losses)
    for k, after in pairwise(front):
        assert costs[k] < costs[after]
        assert losses[k] > losses[after]
    for k in range(60):
        beaten = any(costs[f] <= costs[k] and losses[f] <= losses[k] for f in front)
        assert beaten
        if k in front:
            assert not any(costs[j] <= costs[k] and losses[j] < losses[k] for j in range(60))


def test_the_best_buy_weighs_time_against_false_positives() -> None:
    cheap, dear = entry(1e-6, 0.01), entry(3e-6, 0.002, normals="paper+edges")
    assert best_buy([cheap, dear], GAPS[0], "gradient", 10_000) is dear
    dearer = entry(9e-6, 0.002, normals="paper+edges")
    assert best_buy([cheap, dearer], GAPS[0], "gradient", 10_000) is cheap
    none = entry(5e-6, 0.0, normals="paper+edges")  # none of 100 may be one of 100
    assert best_buy([cheap, none], GAPS[0], "gradient", 100) is cheap
    centre = replace(dear, setting=replace(dear.setting, normals="paper+centre+edges"))
    assert best_buy([cheap, centre], GAPS[0], "gradient", 10_000) is cheap  # D = 0 where the centres meet
    assert best_buy([cheap, none], GAPS[0], "gradient", 10_000) is none


def test_the_best_buy_takes_the_largest_length_that_still_reads_well() -> None:
    lengths = [
        entry(1e-6, 0.01, near, shaping_length=length)
        for length, near in ((1e-4, 0.0100), (1e-3, 0.0105), (1e-2, 0.02))
    ]
    assert best_buy(lengths, GAPS[0], "gradient", 100).setting.shaping_length == 1e-3


@pytest.mark.parametrize("name", study_bodies())
def test_poses_near_contact_are_near_contact(name: str) -> None:
    body_a, body_b = study_bodies()[name]
    poses = study_poses(body_a, body_b, 100, 200, np.random.default_rng(0))
    near = poses.distances[poses.drawn :]
    assert np.all(near <= NEAR_GAPS[1] + 5e-3)
    assert np.mean(near >= NEAR_GAPS[0] - 5e-3) > 0.9
    assert min(np.sum(np.abs(near) < 0.05), np.sum(near < -0.05)) > 50
    assert np.array_equal(signed_distances(body_a, poses.poses_a, body_b, poses.poses_b), poses.distances)
