"""Keys: play and step, plan, undo, layers, and a look at what is selected. viser hands them on from the page, except
while somebody types in a field.

viser turns its camera with the arrows; a script on the page keeps these from it, and from the player while a slider or
a tab has them.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import viser

from hdplan.planner.view.layers import LAYERS

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

STEP = 0.02  # of the whole motion, of ← and →
NOTHING = "data:image/gif;base64,R0lGODlhAQABAAAAACw="  # a picture whose arrival runs the script
SCRIPT = (
    "if (!window.hdplanKeys) { window.hdplanKeys = true;"
    "const moves = (event) => /^(Arrow|Home|End)/.test(event.key);"
    "document.body.addEventListener('keydown', (event) => {"
    " if (moves(event) &amp;&amp; event.target.closest('[role=slider],[role=tab]')) event.stopPropagation(); });"
    "document.documentElement.addEventListener('keydown', (event) => {"
    " if (moves(event)) event.stopPropagation(); }); }"
)


class Key(NamedTuple):
    """A key and what it does."""

    shown: str  # in the list
    key: str  # as viser names it
    does: str
    act: Callable[[Any], object]  # called with viser's client
    shift: bool = False


class Keys:
    """The keys, the button that lists them, and the list."""

    def __init__(self, viewer: Viewer) -> None:
        """Register them, and build the button in the container at hand."""
        self._viewer = viewer
        gui = viewer.server.gui
        gui.add_html(f'<img src="{NOTHING}" style="display:none" onload="{SCRIPT}">')
        button = gui.add_button("Keys (?)", icon=viser.Icon.KEYBOARD)
        self._keys = self._all()
        button.on_click(lambda event: self._list(event.client))
        for each in self._keys:
            modifier: Any = "shift" if each.shift else None
            hotkey: Any = each.key  # viser's list lacks the question mark
            command = gui.add_command(each.does, hotkey=hotkey, modifier=modifier)
            command.on_trigger(lambda event, act=each.act: act(event.client))

    def _list(self, client: Any) -> None:
        """Show the list to one browser."""
        if client is None:
            return
        rows = "\n".join(f"| `{each.shown}` | {each.does} |" for each in self._keys)
        with client.gui.add_modal("Keys") as modal:
            client.gui.add_markdown(f"| key | |\n|---|---|\n{rows}")
            client.gui.add_button("Close").on_click(lambda _: modal.close())

    def _all(self) -> tuple[Key, ...]:
        viewer = self._viewer  # its panel is still being built
        layers = [
            Key(str(i), str(i), f"Show or hide: {name}", partial(self._toggle, name))
            for i, name in enumerate(LAYERS, start=1)
        ]
        return (
            Key("space", "space", "Play or pause", lambda _: viewer.panel.player.toggle()),
            Key("←", "arrowleft", "Step back", lambda _: viewer.panel.player.step(-STEP)),
            Key("→", "arrowright", "Step on", lambda _: viewer.panel.player.step(STEP)),
            Key("home", "home", "Go to the start", lambda _: viewer.panel.player.step(-1.0)),
            Key("end", "end", "Go to the goal", lambda _: viewer.panel.player.step(1.0)),
            Key("P", "P", "Plan, or stop", lambda _: viewer.panel.planning.toggle()),
            Key("Z", "Z", "Undo", lambda _: viewer.panel.editing.ask("undo")),
            Key("shift Z", "Z", "Redo", lambda _: viewer.panel.editing.ask("redo"), shift=True),
            Key("F", "F", "Look at what is selected", lambda client: viewer.panel.looking.frame(client)),
            *layers,
            Key("?", "?", "List the keys", self._list, shift=True),
        )

    def _toggle(self, layer: str, _: Any) -> None:
        self._viewer.panel.layers.toggle(layer)
