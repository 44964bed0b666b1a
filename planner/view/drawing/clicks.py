"""Clicks on a mesh in the browser's scene."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Chosen = Callable[[bool], object]
"""A listener to clicks, which gets whether shift or ctrl was held."""


class Clicks:
    """Clicks on one mesh, which are taken or let through to what is behind it: browsers give a press to the first body
    that takes clicks, also where a handle is drawn over it."""

    def __init__(self, mesh: Any) -> None:
        """Take none yet."""
        self._mesh, self._through = mesh, False
        self._chosen: Chosen | None = None

    def listen(self, chosen: Chosen) -> None:
        """Name the listener."""
        self._chosen = chosen
        self._mesh.on_click(lambda _: chosen(False))
        for held in ("shift", "cmd/ctrl"):
            self._mesh.on_click(modifier=held)(lambda _: chosen(True))

    def let_through(self, through: bool) -> None:
        """Let the mouse through, or take clicks again."""
        if self._chosen is not None and through != self._through:
            self._through = through
            if through:
                self._mesh.remove_click_callback("all")
            else:
                self.listen(self._chosen)
