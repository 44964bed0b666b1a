"""The time slider, play and pause: they set the moment that is shown on the motions' timeline.

Playing moves the slider itself, so that every browser shows the same time; a frame waits until the previous one is
drawn.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

import viser

from hdplan.planner.view.drawing.timeline import PATH_DURATION, Timeline
from hdplan.planner.view.worker import Worker

FRAME = 1.0 / 30.0  # [s] between frames while playing
SLIDER_STEP = 0.001  # of the slider
TIME_HINT, PATH_HINT = "time, for motions and moving obstacles", "path parameter of the motion, 0 to 1"
SPEEDS = ("0.25", "0.5", "1", "2", "4")


class Player:
    """Slider, button and speed, and the thread that plays."""

    def __init__(self, server: viser.ViserServer, worker: Worker, show: Callable[[float], None]) -> None:
        """Build button and slider; `show` draws a moment, and is called by the worker."""
        self._worker, self._show = worker, show
        self._playing, self._ended = threading.Event(), False
        self.timeline = Timeline()
        self.button = server.gui.add_button("Play")
        self.slider = server.gui.add_slider("path", 0.0, 1.0, SLIDER_STEP, 0.0, hint=PATH_HINT)
        self.slider.on_update(lambda _: self.draw())
        self.button.on_click(lambda _: self.toggle())
        self._thread = threading.Thread(target=self._run, name="hdplan-play", daemon=True)
        self._thread.start()

    def add_icon(self) -> None:
        """Give the button its icon, where it is not yet pressed: viser looks for it in an archive of thousands."""
        if self.button.icon is None:
            self.button.icon = viser.Icon.PLAYER_PLAY

    def build_speed(self, server: viser.ViserServer) -> None:
        """Build the choice of the speed in the container at hand."""
        self.speed = server.gui.add_dropdown(
            "speed",
            SPEEDS,
            initial_value="1",
            hint=f"at 1 motions run in real time; a path without times takes {PATH_DURATION:g} s",
        )

    @property
    def time(self) -> float:
        """The moment that is shown, on the timeline."""
        return min(float(self.slider.value), self.timeline.end)

    def run_over(self, timeline: Timeline) -> None:
        """Let the slider run over a timeline, from its beginning if it differs from the previous one."""
        if timeline == self.timeline:
            return
        self.timeline, slider = timeline, self.slider
        slider.label, slider.hint = ("time [s]", TIME_HINT) if timeline.timed else ("path", PATH_HINT)
        end = round(math.ceil(round(timeline.end / SLIDER_STEP, 3)) * SLIDER_STEP, 3)  # in the digits that fit
        slider.min, slider.max = min(slider.min, timeline.begin), max(slider.max, end)  # both values fit
        slider.value = timeline.begin
        slider.min, slider.max = timeline.begin, end

    @property
    def playing(self) -> bool:
        """True if the motion plays."""
        return self._playing.is_set()

    def enable(self, on: bool) -> None:
        """Enable the controls, or disable them where there is nothing to play."""
        for control in (self.slider, self.button, self.speed):
            control.disabled = not on

    def draw(self) -> None:
        """Request a drawing of the slider's moment."""
        self._worker.ask("time", lambda: self._show(self.time), urgent=True)

    def go_to(self, when: float) -> None:
        """Move the slider, which draws."""
        self.slider.value = when
        self.draw()

    def step(self, share: float) -> None:
        """Stop, a share of the whole timeline on from here, or at its beginning or end."""
        self.pause()
        begin, end = self.timeline.begin, self.timeline.end
        if not self.slider.disabled:
            self.go_to(min(max(self.time + share * (end - begin), begin), end))

    def toggle(self) -> None:
        """Play on, or stop."""
        if self.playing:
            self.pause()
        elif not self.slider.disabled:
            self.play()

    def play(self) -> None:
        """Play on from here, or from the start if this is the end."""
        if self.time >= self.timeline.end:
            self.slider.value = self.timeline.begin
        self.button.label, self.button.icon = "Pause", viser.Icon.PLAYER_PAUSE
        self._playing.set()

    def pause(self) -> None:
        """Stop here."""
        self._playing.clear()
        self.button.label, self.button.icon = "Play", viser.Icon.PLAYER_PLAY

    def end(self) -> None:
        """End the thread."""
        self._ended = True
        self._playing.set()
        self._thread.join(timeout=5.0)

    def _run(self) -> None:
        while True:
            self._playing.wait()
            before = time.perf_counter()
            self._worker.done("time", 1.0)
            time.sleep(max(0.0, FRAME - (time.perf_counter() - before)))
            if self._ended:
                return
            if self._playing.is_set():
                timeline = self.timeline
                speed = float(self.speed.value) if self.speed.value in SPEEDS else 1.0  # a browser may send anything
                rate = speed * (timeline.end - timeline.begin) / timeline.duration
                self.go_to(min(self.time + rate * (time.perf_counter() - before), timeline.end))
                if self.time >= timeline.end:
                    self.pause()
