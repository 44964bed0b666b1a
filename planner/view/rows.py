"""The list of motions in the panel, one line each: its colour, its name, the verdict in short; details at a click.

The lines are HTML whose links tell the server what was clicked (`page`): a click on a line chooses the motion, the
others show, hide, rename and remove it, or go to its closest moment.
"""

from __future__ import annotations

import html
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from hdplan.planner.view.drawing.colors import hex_of
from hdplan.planner.view.motions import Shown
from hdplan.planner.view.page_script import Handler, Message, Page, link, telling
from hdplan.planner.view.words import OUTDATED, figures

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer


class Rows:
    """The lines, and what a click on them does."""

    def __init__(self, viewer: Viewer, page: Page) -> None:
        """Build them in the container at hand."""
        self._viewer = viewer
        self.html = viewer.server.gui.add_html("")
        document = viewer.document
        acts: dict[str, Callable[[Shown, Message], None]] = {
            "choose": lambda shown, _: document.choose(shown.motion.name),
            "hide": lambda shown, _: document.hide(shown),
            "rename": lambda shown, message: document.rename(shown, str(message.get("answer", ""))),
            "remove": lambda shown, _: document.remove(shown),
            "closest": lambda shown, _: self._closest(shown),
        }
        for what, do in acts.items():
            page.on(what, self._handler(do))

    def say(self) -> None:
        """Write the lines. By the worker's thread."""
        lines = "".join(self._line(shown) for shown in self._viewer.motions.shown)
        content = f'<div class="hd" style="padding:0 0.6em">{lines}</div>' if lines else ""
        self.html.content = content

    def _line(self, shown: Shown) -> str:
        document, motion, number = self._viewer.document, shown.motion, shown.number
        holds, certificate, name = document.holds(shown), motion.certificate, html.escape(motion.name)
        tint = ("hd-good" if certificate.certified else "hd-bad") if holds else ""
        text = (
            figures(certificate, motion.trajectory)
            if holds
            else html.escape(shown.misfit) or "not checked in this scene yet"
        )
        if holds and not certificate.certified and shown.origin is not self._viewer.scene:
            text = f"of an older scene: {text}"
        if holds:  # beside the colour, which not everybody sees
            text = f"{'✓' if certificate.certified else '✕'} {text}"
        links = (
            link("●" if shown.visible else "○", "hide", "hide or show", motion=number)
            + link("✎", "rename", "rename", motion=number, ask="name of this motion", answer=motion.name)
            + link("✕", "remove", "remove", motion=number)
        )
        details = f"{html.escape(certificate.text) if holds else OUTDATED}<br/>{motion.trajectory.extent}"
        if (result := shown.result) is not None:
            spent = result.times.solve + result.times.certify
            details += f", {result.attempts} attempt(s), {result.iterations} iterations, {spent:.2f} s"
        if motion.measured and motion.clearance.min(initial=np.inf) < np.inf:
            details += "<br/>" + link("go to the closest moment", "closest", motion=number)
        chosen, choose = " hd-chosen" if shown is document.motions.active else "", telling("choose", motion=number)
        return (
            f'<details><summary class="hd-row{chosen}" data-do="{choose}">'
            f'<span style="color:{hex_of(shown.color)}">▬</span><b class="hd-line" style="max-width:8em">{name}</b>'
            f'<span class="hd-line {tint}" style="flex:1">{html.escape(text)}</span>{links}</summary>'
            f'<div style="padding:0.2em 0.3em 0.5em 1.6em">{details}</div></details>'
        )

    # --- what browsers ask for ------------------------------------------------------------------------------------

    def _handler(self, do: Callable[[Shown, Message], None]) -> Handler:
        """Return a handler that lets the worker run `do` on the named motion, if there is one."""

        def job(message: Message) -> None:
            number: Any = message.get("motion")
            for shown in self._viewer.motions.shown:
                if shown.number == number:
                    return do(shown, message)

        return lambda _, message: self._viewer.worker.ask(
            f"{message['do']} {message.get('motion')}", lambda: job(message)
        )

    def _closest(self, shown: Shown) -> None:
        """Go to the moment at which a motion is closest to anything."""
        motion, player = shown.motion, self._viewer.panel.player
        if motion.measured:
            self._viewer.document.choose(motion.name)
            place = int(np.minimum(motion.clearance, motion.self_clearance).argmin())
            player.go_to(float(player.timeline.moments(motion.curve, motion.parameter[place])))
