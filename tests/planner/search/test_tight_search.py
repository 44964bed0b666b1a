"""Laws of searches in narrow places: the first guesses are as ever, and where all of them fail by contacts, the next
ones are solved with exact distances."""

from __future__ import annotations

import dataclasses
import itertools
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import hdplan
from hdplan import Scene, build, load_scene
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.problem.assemble import closer, exactly
from hdplan.planner.search import guesses as trying
from hdplan.planner.search.escape import escapes
from hdplan.planner.search.guesses import EXACT_AFTER, TREES_AFTER_LOOSE, TREES_AFTER_TIGHT, _guesses
from hdplan.planner.search.idle_core import IdleCore
from hdplan.planner.search.roadmap import Roadmap, seeds
from hdplan.planner.search.search import Search
from hdplan.planner.solvers import solver_named

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "benchmarks"))

from narrow_places import places


def search(scene: Scene) -> Search:
    """A search that reports to nobody."""
    problem = build(scene)
    given = problem, Certifier(problem.setup), None, solver_named("gauss_newton"), 0.0, math.inf
    return Search(*given, lambda event: None, lambda: False)


def failing(status: Status) -> Any:
    """A best motion whose certificate says so."""
    certificate = dataclasses.make_dataclass("Certificate", ["status"])(status)
    return dataclasses.make_dataclass("Best", ["certificate"])(certificate)


@pytest.mark.parametrize("overlap", [True, False])
def test_the_first_guesses_are_as_ever_then_trees_grow_in_turn(overlap: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Exact guesses alone if bodies overlap at an end; else those as ever, and later both."""
    monkeypatch.setattr(trying, "ends_overlap", lambda problem: overlap)
    found = np.full((32, 7), 7.0)
    monkeypatch.setattr(trying, "tree_ways", lambda *given: itertools.cycle([None, found]))
    under_way = search(load_scene("panda_cage"))
    ever, problem = seeds(under_way.problem, 5), under_way.problem
    guesses = _guesses(under_way, 5, None, IdleCore(math.inf))
    under_way.best = failing(Status.IN_CONTACT)
    for _ in range(TREES_AFTER_TIGHT if overlap else TREES_AFTER_LOOSE):
        np.testing.assert_array_equal(next(guesses).positions, next(ever))
        assert under_way.problem is problem
    exact = seeds(exactly(problem), 5)
    for turn in range(EXACT_AFTER + 3):
        if turn % 2:
            guess = next(guesses)
            assert guess.positions is found
            assert guess.as_it_is
            assert under_way.problem.exact
        if overlap or turn >= EXACT_AFTER:
            np.testing.assert_array_equal(next(guesses).positions, next(exact))
            assert under_way.problem.exact
        if not overlap:
            np.testing.assert_array_equal(next(guesses).positions, next(ever))
            assert under_way.problem is problem


@pytest.mark.parametrize("status", [Status.TOO_FAST, Status.OFF_PATH, Status.OVERLOADED])
def test_other_failures_do_not_start_a_tight_search(status: Status, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trying, "ends_overlap", lambda problem: True)
    under_way = search(load_scene("panda_corridor"))
    problem, guesses = under_way.problem, _guesses(under_way, 0, None, IdleCore(math.inf))
    under_way.best = failing(status)
    for _ in range(TREES_AFTER_LOOSE + 2):
        next(guesses)
        assert under_way.problem is problem


@pytest.mark.parametrize("settings", [{"distance": "fcl"}, {"swept": True}])
def test_another_distance_that_was_requested_stays(settings: dict[str, Any]) -> None:
    scene = load_scene("planar_arm")
    problem = build(dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, **settings)))
    assert exactly(problem) is problem


def test_a_reassembled_problem_stays_exact() -> None:
    problem = exactly(build(load_scene("panda_cage")))
    near = closer(problem, 0.01, quick=False)
    assert near.exact
    assert near.depth(problem.polyline()).max() == problem.depth(problem.polyline()).max()  # where it begins


def test_ways_back_and_nodes_are_free_by_the_exact_distance() -> None:
    problem = exactly(build(load_scene("panda_cage")))
    certifier = Certifier(problem.setup)
    first, last = escapes(problem)
    for way in (first, last):
        if len(way):
            assert problem.depth(way[-1:])[0] <= problem.depth(np.array([problem.start, problem.goal])).max()
    roadmap = Roadmap(problem, np.random.default_rng(0))
    roadmap.grow()
    assert len(roadmap.nodes) > 2
    touching = [bool(certifier.contacts(q, 0.0)) for q in roadmap.nodes[2:]]
    assert not any(touching)


@pytest.mark.parametrize("name", places())
def test_narrow_places_of_our_own_are_certified(name: str, tmp_path: Path) -> None:
    """A tube, doors that are not in line, from gap to gap: a handful of guesses suffices."""
    file = tmp_path / f"{name}.yaml"
    file.write_text(yaml.safe_dump(places()[name]))
    result = hdplan.plan(hdplan.load_scene(file))
    assert result.certified
    assert result.attempts <= 12
