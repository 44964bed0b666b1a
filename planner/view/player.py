"""The time slider, play and pause: they set the time that is shown, from 0 to 1 of the motion.

Playing moves the slider itself, so every browser sees the same time; a frame waits until the one before is drawn.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import viser

from hdplan.planner.view.worker import Worker

DURATION = 4.0  # [s] that a motion takes at speed 1: trajectories are paths without times
FRAME = 1.0 / 30.0  # [s] between frames while playing
SPEEDS = ("0.25", "0.5", "1", "2", "4")


class Player:
    """Slider, button and speed, and the thread that plays."""

    def __init__(self, server: viser.ViserServer, worker: Worker, show: Callable[[float], None]) -> None:
        """Build the controls; `show` draws the moment at a path parameter, and is called by the worker."""
        self._worker, self._show = worker, show
        self._playing, self._ended = threading.Event(), False
        self.slider = server.gui.add_slider("time", 0.0, 1.0, 0.001, 0.0, hint="path parameter of the motion, 0 to 1")
        self.button = server.gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY)
        self.speed = server.gui.add_dropdown(
            "speed",
            SPEEDS,
            initial_value="1",
            hint=f"at 1 the whole motion takes {DURATION:g} s: it is a path without times",
        )
        self.slider.on_update(lambda _: self.draw())
        self.button.on_click(lambda _: self.pause() if self._playing.is_set() else self.play())
        self._thread = threading.Thread(target=self._run, name="hdplan-play", daemon=True)
        self._thread.start()

    @property
    def time(self) -> float:
        """The path parameter that is shown."""
        return float(self.slider.value)

    @property
    def playing(self) -> bool:
        """Whether it plays."""
        return self._playing.is_set()

    def enable(self, on: bool) -> None:
        """Allow the controls, or not, as there is nothing to play."""
        for control in (self.slider, self.button, self.speed):
            if control.disabled == on:
                control.disabled = not on

    def draw(self) -> None:
        """Have the moment drawn at which the slider stands."""
        self._worker.ask("time", lambda: self._show(self.time))

    def go_to(self, when: float) -> None:
        """Move the slider, which draws."""
        self.slider.value = when
        self.draw()

    def play(self) -> None:
        """Play on from here, or from the start if this is the end."""
        if self.time >= 1.0:
            self.slider.value = 0.0
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
            self._worker.settle(1.0)
            time.sleep(max(0.0, FRAME - (time.perf_counter() - before)))
            if self._ended:
                return
            if self._playing.is_set():
                passed = (time.perf_counter() - before) * float(self.speed.value) / DURATION
                self.go_to(min(self.time + passed, 1.0))
                if self.time >= 1.0:
                    self.pause()
