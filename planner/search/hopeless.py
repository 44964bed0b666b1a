"""When a search asks whether there is any motion to be found: once, after guesses that failed for some time."""

from __future__ import annotations

import time
from collections.abc import Sequence

from hdplan.planner.certificate.infeasibility import no_motion
from hdplan.planner.search.search import Search
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import UnsolvableError
from hdplan.scenes.targets import JointTarget

AFTER = 2.0  # [s] of search, or
SHARE = 0.25  # of its time, if that is less


class HopelessSearch:
    """Searches to the goals (configurations) of one scene, which may all be without hope."""

    def __init__(self, searches: Sequence[Search], goals: Sequence[JointTarget]) -> None:
        """Take them as they begin."""
        self._searches, self._goals = searches, goals
        now = time.perf_counter()
        self._when = now + min(AFTER, SHARE * max(0.0, searches[0].deadline - now))
        self._asked = False

    def refuse(self) -> None:
        """Raise UnsolvableError if it is time to ask, and no motion exists."""
        first = self._searches[0]
        if self._asked or first.over or time.perf_counter() < self._when:
            return
        self._asked = True
        tried: dict[str, list[Array]] = {}
        for search, goal in zip(self._searches, self._goals, strict=True):
            if search.best is not None:
                tried.setdefault(goal.field, []).append(search.best.path)
        # of a goal that leaves a choice, another configuration may be so close to something that less is required there
        single = isinstance(first.certifier.scene.goal, JointTarget)
        required = min(search.required for search in self._searches) if single else 0.0
        if why := no_motion(first.certifier, required, tried, lambda: first.over):
            raise UnsolvableError(f"{first.certifier.scene.source}: no motion exists: {why}", "disconnected")
