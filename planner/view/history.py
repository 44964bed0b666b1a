"""Undo and redo: the states before each step, and the undone ones.

A value is stored when it is left, since a step that has begun keeps changing it: a motion follows a drag.
"""

from __future__ import annotations

from typing import Generic, TypeVar

Value = TypeVar("Value")


class History(Generic[Value]):
    """Earlier values and undone ones; what is shown now is another's."""

    def __init__(self) -> None:
        """Begin without any."""
        self._before: list[Value] = []
        self._after: list[Value] = []

    @property
    def can_undo(self) -> bool:
        """True if there is a step to undo."""
        return bool(self._before)

    @property
    def can_redo(self) -> bool:
        """True if there is a step to redo."""
        return bool(self._after)

    def step(self, now: Value) -> None:
        """Begin a step, which leads away from what is shown now."""
        self._before.append(now)
        self._after.clear()

    def part(self) -> None:
        """Go on with the last step: what was undone can no longer be done again."""
        self._after.clear()

    def dropped(self, now: Value) -> Value:
        """Return the state before the last step, which is forgotten; the present state if there is none."""
        return self._before.pop() if self._before else now

    def undone(self, now: Value) -> Value:
        """Return the state before the last step, or the present state if there is none."""
        if not self._before:
            return now
        self._after.append(now)
        return self._before.pop()

    def redone(self, now: Value) -> Value:
        """Return the state before the last undo, or the present state if there is none."""
        if not self._after:
            return now
        self._before.append(now)
        return self._after.pop()
