"""Proofs within a failing search, beside its guesses, that no motion exists."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from hdplan.planner.search.search import Search
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import UnsolvableError
from hdplan.scenes.targets import JointTarget

if TYPE_CHECKING:
    from hdplan.planner.certificate.infeasibility import Shut

FAILED_TIME = 1.0  # [s] of guesses that failed, or
LIMIT_SHARE = 0.2  # of the time that there is, if that is less
PROOF_SHARE = 0.05  # of the time that guesses took


class InfeasibilityCheck:
    """The question whether any motion leads to a goal of the scene: no clock decides anything but how soon the answer
    is known."""

    def __init__(self, searches: Sequence[Search], goals: Sequence[JointTarget]) -> None:
        """Take them as they begin."""
        self._searches, self._goals = searches, goals
        self._began = time.perf_counter()
        self._spent = 0.0  # [s]
        self._looks: Iterator[tuple[Shut, ...] | None] | None = None

    def refuse(self) -> None:
        """Raise UnsolvableError if it is proven that no motion exists."""
        first = self._searches[0]
        passed = time.perf_counter() - self._began - self._spent
        if passed < min(FAILED_TIME, LIMIT_SHARE * (first.deadline - self._began)):
            return
        if self._looks is None:
            self._looks = self._begun()
        while not first.over and self._spent <= PROOF_SHARE * passed:
            before = time.perf_counter()
            found = self._look(self._looks)
            self._spent += time.perf_counter() - before
            if found is None:
                return
            if found:
                why = "; ".join(each.words for each in found)
                by = tuple(dict.fromkeys(name for each in found for name in each.by))
                raise UnsolvableError(f"{first.certifier.scene.source}: no motion exists: {why}", "disconnected", by)

    def _look(self, looks: Iterator[tuple[Shut, ...] | None]) -> tuple[Shut, ...] | None:
        """Return the result of the next attempt at a proof, nothing if the search is over meanwhile, and None after the
        last one."""
        for found in looks:
            if found is not None:
                return found
            if self._searches[0].over:
                return ()
        return None

    def _begun(self) -> Iterator[tuple[Shut, ...] | None]:
        from hdplan.planner.certificate.infeasibility import looks  # few searches ask

        tried: dict[str, list[Array]] = {}
        suspects = set()
        for search, goal in zip(self._searches, self._goals, strict=True):
            if search.best is not None:
                tried.setdefault(goal.field, []).append(search.best.path)
                suspects |= {place.link for place in search.best.certificate.failures}
        certifier = self._searches[0].certifier
        # of a goal that leaves a choice, another configuration may be so close to something that less is required there
        single = isinstance(certifier.scene.goal, JointTarget)
        required = min(search.required for search in self._searches) if single else 0.0
        return looks(certifier, required, tried, suspects)
