"""The page's own part beyond viser's client: a style that keeps the controls in sight, and a script that tells
the server which colour scheme the browser has, and what somebody clicked in a plot or in the panel's own HTML.

The script writes JSON into a text field that nobody sees, as viser's fields are what a page can send. A browser may
send anything: what is not understood is dropped.
"""

from __future__ import annotations

import html
import json
import sys
from collections.abc import Callable, Mapping
from typing import Any, TypeGuard

import viser

from hdplan.planner.view.drawing.nodes import draw_ground
from hdplan.planner.view.gate import ALIVE, WATCH, Gate
from hdplan.scenes.files import MOST_BYTES
from hdplan.scenes.poses import Vector3

Message = Mapping[str, Any]
Handler = Callable[[viser.ClientHandle, Message], object]

WIDTH, NARROWEST = 360, 250  # [px] of the panel
DRAGGED = 8  # [px] by which the mouse moves at least in a plot to zoom
LONGEST_TEXT = 250_000  # characters that are pasted: in a message at most six bytes each, less than the gate allows
SHEET = 700  # [px] of a window's width up to which the panel lies below the scene; viser's own does up to 576
LOW = 45  # [%] of the window's height that it takes there
PANEL_SHARE = 0.4  # of a window's width that the panel takes at most
ENDED = "hdplan view has ended, or cannot be reached: this is the last picture"
# The marker's neighbours in the panel are, in this order: the unseen field, Plan, Play, and the slider.
STYLE = (
    """
div:has(> .hdplan-page) + div { display: none }
div:has(> div > .hdplan-page) { display: grid; grid-template-columns: 1fr 1fr; align-items: center;
  padding-right: 0.7em }  /* what lies under the scroll bar */
div:has(> div > .hdplan-page) > * { grid-column: 1 / -1; min-width: 0 }
div:has(> div > div > div > .hdplan-page) { overflow: visible !important }
div:has(> .hdplan-page) + div + div { grid-column: 1 !important; margin-right: 0.2em !important }
div:has(> .hdplan-page) + div + div + div { grid-column: 2 !important; margin-left: 0.2em !important }
div:has(> .hdplan-page) + div + div, div:has(> .hdplan-page) + div + div + div {
  position: sticky; top: 0; z-index: 7; padding-top: 0.4em; background: var(--mantine-color-body);
  box-shadow: 0 0 0 0.2em var(--mantine-color-body) }  /* also between them, where the panel is scrolled */
div:has(> .hdplan-page) + div + div + div + div {
  position: sticky; top: 2.9em; z-index: 6; padding-top: 0.3em; background: var(--mantine-color-body);
  box-shadow: 0 -0.6em var(--mantine-color-body);
  border-bottom: 1px solid var(--mantine-color-default-border) }
.hd { padding: 0 0.9em; font-size: max(0.8em, 11px); line-height: 1.4; overflow-wrap: anywhere }
.hd-two { min-height: 2.8em; max-height: 8.4em; overflow: auto; margin: 0.4em 0 }
.hd-badge { position: fixed; left: 0.8em; top: 0.6em; z-index: 3; padding: 0.15em 0.6em; border-radius: 6px;
  font-size: 1.25rem; pointer-events: none; background: light-dark(#ffffffd0, #1b1c1ed0) }
.hd-under { margin-top: -0.9em }  /* of what it explains, which leaves room below itself */
.hd-line { white-space: nowrap; overflow: hidden; text-overflow: ellipsis }
.hd-link { cursor: pointer; opacity: 0.75 } .hd-link:hover { opacity: 1; text-decoration: underline }
.hd-row { display: flex; user-select: none; gap: 0.45em; padding: 0.1em 0.3em; border-radius: 4px; cursor: pointer }
.hd-row:hover, .hd-chosen { background: light-dark(#eef2f6, #2c2e33) }
.hd-still { cursor: default; background: none !important }
.hd summary { list-style: none }
.hd-good { color: light-dark(#0072b2, #56b4e9) } .hd-bad { color: light-dark(#a50026, #ff7b7b) }
.hdplan-spoken { position: fixed; width: 1px; height: 1px; overflow: hidden; clip-path: inset(50%) }
.u-over { cursor: pointer; touch-action: pan-y }
label, .mantine-Slider-markLabel, .u-value { color: light-dark(#495057, #ced4da) !important }
@media (max-width: 900px) { .mantine-Button-label, .mantine-Input-input { font-size: 11px !important } }
.mantine-Slider-markLabel, .u-legend, .u-legend * { font-size: 11px !important }
[role="tab"][aria-selected="true"] * { color: light-dark(#0b5cad, #74c0fc) !important }
.mantine-Button-root[data-variant="outline"] { --button-color: light-dark(#0b5cad, #74c0fc) !important }
.mantine-Button-root:not([data-variant="outline"]) {  /* but for Plan, the one loud button */
  --button-bg: light-dark(#e9ecef, #3b3f45) !important; --button-hover: light-dark(#dee2e6, #4b5057) !important;
  --button-color: light-dark(#212529, #f1f3f5) !important }
div:has(> .hdplan-page) + div + div .mantine-Button-root:not([data-variant="outline"]) {
  --button-bg: #0067a3 !important; --button-hover: #00507f !important; --button-color: #fff !important }
.u-legend { line-height: 1.3; text-align: left !important; padding: 0 0.9em;
  margin: 10px 0 0 !important }  /* below the numbers of the axis */
.u-legend tr:last-child, .u-legend tr:has(.u-label:empty) { display: none }  /* of the bar, and of dotted limits */
.u-legend th, .u-legend td { padding: 0 0.2em !important; font-variant-numeric: tabular-nums }
.u-legend .u-marker { width: 0.9em !important; height: 0.25em !important }
div:has(> [role="tab"]) { flex-wrap: nowrap !important; justify-content: space-between; padding: 0 0.9em 0 0.4em }
[role="tab"] { padding: 0 0.25em !important; font-size: max(0.9em, 11px) !important }
@media (max-width: 860px) {
  [role="tab"], [role="tab"] * { overflow: visible !important; padding: 0 !important }
}
@media (pointer: coarse) { .hd-row { padding: 0.35em 0.3em } .hd-link { padding: 0 0.35em } }
@media (max-width: SHEETpx) {  /* the panel is a sheet from below, and the scene stands above it */
  div[style*="position: absolute"]:has(.hdplan-page), .mantine-Paper-root[style*="position: fixed"]:has(.hdplan-page) {
    top: auto !important; left: 0 !important; width: 100% !important; max-height: LOW% !important }
  div[style*="position: absolute"]:has(.hdplan-page) { height: LOW% }
  div[style*="box-shadow"][style*="right: 0px"]:not(:has(*)) { display: none }  /* of the panel beside the scene */
  div[style*="flex-shrink: 0"]:has(.hdplan-page), div[style*="width: 20em"]:has(.hdplan-page) {
    width: 100% !important; padding: 0 !important }
  div:has(> [role="tab"]) { margin-top: 0.7em }
  html:has(div[style*="grid-template-rows: 1fr"] .hdplan-page) div:has(> canvas) { inset: 0 0 LOW% 0 !important }
}
.hdplan-ended::after { content: "ENDED"; position: fixed; inset: 0 0 auto 0; z-index: 9999; padding: 0.7em;
  text-align: center; color: #fff; background: #a50026; font: 1rem sans-serif }
.hdplan-ended body { filter: grayscale(1) opacity(0.6); pointer-events: none }
.hdplan-watching { display: none }
.hdplan-watches .hdplan-watching { display: block }
.hdplan-watches div:has(> div > .hdplan-page) :is(button:not([role=tab]), input, textarea, .mantine-Slider-root,
  .hd-link) { pointer-events: none; opacity: 0.55 }
""".replace("ENDED", ENDED)
    .replace("SHEET", str(SHEET))
    .replace("LOW", str(LOW))
)

SCRIPT = (
    """
if (!window.hdplan) {
  const tell = (message) => {
    const field = document.querySelector('div:has(> .hdplan-page) + div input');
    if (!field) return;
    const set = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, 'value').set;
    set.call(field, JSON.stringify({...message, at: performance.now()}));
    field.dispatchEvent(new Event('input', {bubbles: true}));
  };
  document.addEventListener('change', (event) => {
    const file = [...event.target.files || []].find((file) => file.size > MOST);
    if (!file) return;
    event.stopImmediatePropagation();  // before anything of it is sent
    event.target.value = '';
    tell({do: 'too large', name: file.name, size: file.size});
  }, true);
  const dark = matchMedia('(prefers-color-scheme: dark)');
  const theme = () => tell({do: 'theme', dark: dark.matches, width: innerWidth});
  dark.addEventListener('change', theme);
  let resized;
  window.addEventListener('resize', () => { clearTimeout(resized); resized = setTimeout(theme, 300); });
  const numeric = (event) => event.target.matches('input[inputmode=decimal], input[inputmode=numeric]');
  document.addEventListener('keydown', (event) => {  // viser's fields drop the letter alone, and 1e9 would be 19
    if (!/^e$/i.test(event.key) || event.ctrlKey || event.metaKey || !numeric(event)) return;
    event.preventDefault();
    event.stopPropagation();
    event.target.blur();
    tell({do: 'exponent'});
  }, true);
  document.addEventListener('focusin', (event) => {
    if (event.target.matches('input, textarea')) tell({do: 'enter'});
  });
  document.addEventListener('paste', (event) => {
    if (!numeric(event) || !/e/i.test(event.clipboardData.getData('text'))) return;
    event.preventDefault();
    event.stopPropagation();
    tell({do: 'exponent'});
  }, true);
  const show = (alive) => document.documentElement.classList.toggle('hdplan-ended', !alive);
  const address = location.pathname.replace(/\\/?$/, '/ALIVE');
  setInterval(() => fetch(address).then((answer) => show(answer.ok), () => show(false)), 3000);
  const typing = (event) => event.target.closest?.('input, textarea, [contenteditable]');
  document.addEventListener('copy', (event) => {  // of what is selected in the scene, where no words are
    const text = document.querySelector('.hdplan-copied')?.dataset.yaml;
    if (!text || typing(event) || String(getSelection())) return;
    event.clipboardData.setData('text/plain', text);
    event.preventDefault();
  });
  document.addEventListener('paste', (event) => {
    const text = event.clipboardData.getData('text/plain'), long = text.length > PASTED;
    if (long) event.preventDefault();  // in a field, too: a message of that size would end the connection
    if (text && (long || !typing(event))) tell({do: 'paste', text: text.slice(0, PASTED + 1)});
  });
  const share = (plot, x) => { const box = plot.getBoundingClientRect(); return (x - box.left) / box.width; };
  let pressed;  // in a plot: it and where
  document.addEventListener('pointerdown', (event) => {
    const plot = event.target.closest('.u-over');
    pressed = plot && [plot, event.clientX];
  }, true);
  document.addEventListener('pointerup', (event) => {  // a click goes to a moment, a drag shows a part
    if (!pressed) return;
    const [plot, x] = pressed;
    pressed = undefined;
    if (Math.abs(event.clientX - x) < DRAGGED) tell({do: 'seek', share: share(plot, x)});
    else tell({do: 'zoom', from: share(plot, x), to: share(plot, event.clientX)});
  }, true);
  document.addEventListener('dblclick', (event) => {
    if (event.target.closest('.u-over')) tell({do: 'zoom', from: 0, to: 0});
  });
  document.addEventListener('keydown', (event) => {
    if (!/^(Enter| )$/.test(event.key) || !event.target.matches?.('[data-do]')) return;
    event.preventDefault();
    event.stopPropagation();
    event.target.click();
  }, true);
  let held;  // the line that is pressed: browsers send no click to a line that is rewritten before its release
  document.addEventListener('pointerdown', (event) => { held = event.target.closest?.('[data-do]'); }, true);
  document.addEventListener('pointerup', (event) => {
    const now = event.target.closest?.('[data-do]');
    if (held && !held.isConnected && now?.dataset.do === held.dataset.do) now.click();
  }, true);
  document.addEventListener('click', (event) => {
    const link = event.target.closest('[data-do]');
    if (link) {
      if (link.tagName !== 'SUMMARY') event.preventDefault();  // of the line that it is in: no details
      const message = {more: event.shiftKey || event.ctrlKey || event.metaKey, ...JSON.parse(link.dataset.do)};
      if (message.ask !== undefined) {
        const answer = prompt(message.ask, message.answer);
        if (answer === null) return;
        message.answer = answer;
      }
      tell(message);
    }
  });
  document.addEventListener('pointercancel', (event) => {  // viser's handles know none, and would stay in the hand
    if (event.target.tagName === 'CANVAS') event.target.dispatchEvent(new PointerEvent('pointerup', event));
  }, true);
  const spoken = document.createElement('div');  // readers of screens hear changes of what stays, not what is replaced
  spoken.className = 'hdplan-spoken';
  spoken.setAttribute('role', 'status');
  document.body.append(spoken);
  let resting;
  const speak = () => {  // once it rests: it changes with each step of a hand
    const words = document.querySelector('.hd-badge')?.textContent ?? '';
    if (spoken.textContent !== words) spoken.textContent = words;
  };
  let focused, place;  // the line or link that has the keyboard's focus, and which of them all that is
  const linked = () => [...document.querySelectorAll('[data-do]')];
  document.addEventListener('focusin', (event) => {
    focused = event.target.matches('[data-do]:focus-visible') ? event.target : undefined;  // and not by the mouse
    place = linked().indexOf(focused);
  });
  const refocus = () => {  // where it was rewritten; one that is gone leaves it to the next
    if (!focused || focused.isConnected || document.activeElement !== document.body) return;
    const now = linked();
    (now.find((link) => link.dataset.do === focused.dataset.do) ?? now[Math.min(place, now.length - 1)])?.focus();
  };
  const line = (details) => details.querySelector('summary')?.dataset.do;
  const unfolded = new Set();  // lines whose details are open: they stay open when the lines are rewritten
  document.addEventListener('toggle', (event) => {
    const key = event.target.matches('details') && event.target.isConnected && line(event.target);
    if (key) unfolded[event.target.open ? 'add' : 'delete'](key);
  }, true);
  new MutationObserver(() => {
    refocus();
    clearTimeout(resting);
    resting = setTimeout(speak, 300);
    for (const details of document.querySelectorAll('details:not([open])'))
      if (unfolded.has(line(details))) details.open = true;
  }).observe(document.body, {childList: true, subtree: true});
  new MutationObserver((changes) => {  // where a curve has no value under the mouse
    for (const {target} of changes) if (target.data === 'NaN') target.data = '–';
  }).observe(document.body, {characterData: true, subtree: true});
  window.hdplan = {theme};
}
setTimeout(window.hdplan.theme);
history.replaceState(null, '', location.pathname);  // viser writes the address of its server there once more
document.documentElement.classList.toggle('hdplan-watches', location.pathname.startsWith('/WATCH/'));
""".replace("WATCH", WATCH)
    .replace("MOST", str(MOST_BYTES))
    .replace("ALIVE", ALIVE)
    .replace("DRAGGED", str(DRAGGED))
    .replace("PASTED", str(LONGEST_TEXT))
)
# A picture of one pixel, whose arrival runs the script.
PIXEL = "data:image/gif;base64,R0lGODlhAQABAIAAAAAAAP///yH5BAEAAAAALAAAAAABAAEAAAIBRAA7"

WATCHING = "Watching only: changes by others appear here, and nothing can be changed."


class Page:
    """The invisible part of the page, and the handlers of its messages."""

    def __init__(self, server: viser.ViserServer, gate: Gate, title: str, ground: Vector3) -> None:
        """Build it in the container at hand, as the first there; `title` is the page's, and the middle of the ground
        is at `ground` [m]."""
        self._server, self._ground = server, ground
        self._handlers: dict[str, Handler] = {"theme": self._theme}
        self._widths: dict[int, float] = {}  # of the panel, by browser
        script = SCRIPT + f"document.title = {json.dumps(title)};"
        server.gui.add_html(
            f'<i class="hdplan-page"></i><style>{STYLE}</style>'
            f'<img hidden alt="" src="{PIXEL}" onload="{html.escape(script)}">'
            f'<div class="hd hdplan-watching">{WATCHING}</div>'
        )
        self._field = server.gui.add_text("page", "")
        self._field.on_update(self._heard)
        gate.page_field = str(self._field._impl.uuid)  # viser has no other name for it; a law notices if it goes
        draw_ground(server.scene, ground, dark=False)

    def build(self) -> None:
        """Build what holds the text to be copied, in the container at hand."""
        self._copied = self._server.gui.add_html("")

    def copied(self, text: str) -> None:
        """Let the browsers' copy take this text, where somebody has selected no other."""
        content = f'<i class="hdplan-copied" data-yaml="{html.escape(text)}" hidden></i>'
        self._copied.content = content

    def on(self, what: str, handler: Handler) -> None:
        """Name the `handler` of the messages `what` from browsers: it gets the browser and the message."""
        self._handlers[what] = handler

    async def _heard(self, event: Any) -> None:
        """Pass on what a browser sends: at once, before the next is sent in the same field."""
        try:
            message = json.loads(str(self._field.value))
        except (ValueError, RecursionError):  # of a list in a list in a list …
            return
        handler = self._handlers.get(str(message.get("do"))) if isinstance(message, dict) else None
        if event.client is not None and handler is not None:
            handler(event.client, message)

    def _theme(self, client: viser.ClientHandle, message: Message) -> None:
        """Show one browser the page in its own colour scheme, with a panel that leaves room for the scene."""
        dark = message.get("dark") is True
        client.gui.configure_theme(dark_mode=dark, show_logo=False, show_share_button=False)
        draw_ground(client.scene, self._ground, dark=dark)
        window = message.get("width")
        if is_number(window):
            width = min(max(PANEL_SHARE * window, NARROWEST), WIDTH)
            if self._widths.get(client.client_id, WIDTH) != width:  # else a width set by the user stays
                client.gui.main_panel.set_width(width)
                self._widths[client.client_id] = width


def is_number(message: object) -> TypeGuard[float]:
    """True if a page sent a number that may be used."""
    return (
        isinstance(message, int | float) and abs(message) <= sys.float_info.max
    )  # and is neither NaN nor a longer int


def link(text: str, what: str, title: str = "", **message: object) -> str:
    """Return a link as HTML around the HTML `text`: a click sends `what` to the server."""
    named = f'role="button" tabindex="0" title="{html.escape(title)}"'
    return f'<span class="hd-link" {named} data-do="{telling(what, **message)}">{text}</span>'


def telling(what: str, **message: object) -> str:
    """Return the attribute `data-do` of an element of which a click sends `what` to the server."""
    return html.escape(json.dumps({"do": what, **message}))
