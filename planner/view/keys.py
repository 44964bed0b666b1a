"""Keys: play and step, plan, undo, layers, and a look at what is selected. viser hands them on from the page, except
while somebody types in a field.

viser turns its camera with the arrows, and what was clicked keeps them and the space bar to itself: a script on the
page ends both. Who goes from field to field with the tab key moves sliders and tabs with the arrows, and nothing else.
"""

from __future__ import annotations

import html
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import viser

from hdplan.planner.view.layers import LAYERS
from hdplan.planner.view.player import Player

if TYPE_CHECKING:
    from hdplan.planner.view.panel import Panel

KEY_STEP = 0.02  # of the whole motion, of ← and →
# A picture of one pixel: its arrival runs the script.
NOTHING = "data:image/gif;base64,R0lGODlhAQABAIAAAAAAAP///yH5BAEAAAAALAAAAAABAAEAAAIBRAA7"
SCRIPT = """
if (!window.hdplanKeys) {
  window.hdplanKeys = true;
  const moves = (event) => /^(Arrow|Home|End)/.test(event.key);
  document.body.addEventListener('keydown', (event) => {
    if (moves(event) && event.target.closest('[role=slider],[role=tab]')) event.stopPropagation();
    if (event.key === ' ' && event.target.closest('button,[role=button],[role=tab]')) event.stopPropagation();
  });
  document.documentElement.addEventListener('keydown', (event) => {
    if (moves(event)) event.stopPropagation();
  });
  document.addEventListener('pointerup', () => setTimeout(() => {
    if (document.activeElement.matches('button,[role=slider],[role=tab]')) document.activeElement.blur();
  }));
}
"""


class Key(NamedTuple):
    """A key and what it does."""

    shown: str  # in the list
    key: str  # as viser names it
    does: str
    act: Callable[[Any], object]  # called with viser's client
    modifier: str | None = None


class Keys:
    """The keys, the button that lists them, and the list."""

    def __init__(self, server: viser.ViserServer, keys: Sequence[Key]) -> None:
        """Register them, and build the button in the container at hand."""
        self._lists: dict[int, Any] = {}  # by the browsers that see it
        gui = server.gui
        gui.add_html(f'<img src="{NOTHING}" hidden alt="" onload="{html.escape(SCRIPT)}">')
        button = gui.add_button("Keys (?)")
        listing = [Key("?", "?", "List the keys", self._list, shift) for shift in ("shift", None)]  # by the keyboard
        self._keys = (*keys, *listing)
        button.on_click(lambda event: self._list(event.client))
        for each in self._keys:
            if not each.key:  # the browser's own, which `page_script` hears
                continue
            modifier: Any = each.modifier
            hotkey: Any = each.key  # viser's list lacks the question mark
            command = gui.add_command(each.does, hotkey=hotkey, modifier=modifier)
            command.on_trigger(lambda event, key=each: self._pressed(key, event.client))

    def _pressed(self, key: Key, client: Any) -> None:
        """Do what a key does, but let escape close the list first."""
        if key.key != "escape" or not self._closed(client):
            key.act(client)

    def _closed(self, client: Any) -> bool:
        """Close the list in one browser; whether it was there."""
        shown = None if client is None else self._lists.pop(client.client_id, None)
        if shown is not None:
            shown.close()
        return shown is not None

    def _list(self, client: Any) -> None:
        """Show the list to one browser, or close it there."""
        if client is None or self._closed(client):
            return
        rows = "\n".join(dict.fromkeys(f"| `{each.shown}` | {each.does} |" for each in self._keys))
        with client.gui.add_modal("Keys") as modal:
            client.gui.add_markdown(f"| key | |\n|---|---|\n{rows}")
            client.gui.add_button("Close").on_click(lambda _: self._list(client))
        self._lists[client.client_id] = modal


def keys_of(panel: Panel) -> tuple[Key, ...]:
    """Return the keys of the panel of motions."""
    layers = [
        Key(str(i), str(i), f"Show or hide: {name}", lambda _, name=name: panel.layers.toggle(name))  # type: ignore[misc]
        for i, name in zip(range(1, 10), LAYERS, strict=False)  # the others have no key
    ]
    return (
        *common_keys(
            panel.player, panel.planning.toggle, panel.editing.ask, panel.handles.deselect, panel.looking.frame
        ),
        Key("del", "delete", "Delete the selected obstacles", lambda _: panel.obstacles.ask("delete")),
        Key("ctrl D", "D", "Duplicate them", lambda _: panel.obstacles.ask("duplicate"), "cmd/ctrl"),
        Key("ctrl C, V", "", "Copy them as a scene writes them; paste obstacles", lambda _: None),
        *layers,
    )


def common_keys(
    player: Player,
    plan: Callable[[], object],
    go_back: Callable[[str], object],
    deselect: Callable[[], object],
    frame: Callable[[Any], object],
) -> tuple[Key, ...]:
    """Return the keys of every viewer: they play, plan, undo and select, and `frame` the selection for a browser."""
    return (
        Key("space", "space", "Play or pause", lambda _: player.toggle()),
        Key("←", "arrowleft", "Step back", lambda _: player.step(-KEY_STEP)),
        Key("→", "arrowright", "Step on", lambda _: player.step(KEY_STEP)),
        Key("home", "home", "Go to the start", lambda _: player.step(-1.0)),
        Key("end", "end", "Go to the goal", lambda _: player.step(1.0)),
        Key("P", "P", "Plan, or stop", lambda _: plan()),
        Key("Z", "Z", "Undo", lambda _: go_back("undo")),
        Key("shift Z", "Z", "Redo", lambda _: go_back("redo"), "shift"),
        Key("esc", "escape", "Select nothing, or close this list", lambda _: deselect()),
        Key("F", "F", "Look at the selection", frame),
    )
