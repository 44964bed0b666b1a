"""Files of a job on request: its scene, its motion, certified in that very scene, and both as a page.

They are sent to the browser that requests them, as downloads.
"""

from __future__ import annotations

import html
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import viser

from hdplan.planner.view.edited_job import EditedJob
from hdplan.planner.view.words import small
from hdplan.planner.view.worker import Worker
from hdplan.scenes.errors import HdplanError
from hdplan.scenes.yaml_format.writer import scene_text

NO_MOTION = "there is no motion of this job yet: press Plan"


class JobSaving:
    """The buttons, and what they write."""

    def __init__(self, server: viser.ViserServer, worker: Worker, edited: Callable[[], EditedJob]) -> None:
        """Build them in the container at hand; `edited` is the job as it is now."""
        self._worker, self._edited = worker, edited
        buttons = server.gui.add_button_group("save", ("scene", "motion", "page"), hint="files of the job as shown")
        self.text = server.gui.add_html("")
        self._about: EditedJob | None = None  # the one that the text describes
        buttons.on_click(lambda event: self._download(str(event.target.value), event.client))

    # --- by the worker's thread: name, content and message ---------------------------------------------------------

    def file(self, what: str) -> tuple[str, bytes, str]:
        """Return a file of the job as it is now. Raises HdplanError if there is none."""
        edited, name = self._edited(), self._edited().scene.name
        if what == "scene":
            return f"{name}.yaml", scene_text(edited.scene).encode(), "the scene as it is shown"
        if edited.shown is None:
            raise HdplanError(NO_MOTION)
        certificate = edited.shown.certificate  # of this very scene, or there would be no motion
        words = f"not certified: {edited.failure}" if edited.failure else certificate.text
        if what == "page":
            return f"{name}.html", edited.shown.page.html.encode(), words
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "job.json"
            edited.shown.trajectory.save(file)
            return file.name, file.read_bytes(), words

    def outdate(self) -> None:
        """Withdraw the words about another job."""
        if self.text.content and self._about is not self._edited():
            self.text.content = ""

    def _download(self, what: str, client: Any) -> None:
        """Handle a browser's request."""
        if client is not None and what in ("scene", "motion", "page"):  # a browser may send anything
            self._worker.ask(f"{what} for {client.client_id}", lambda: self._hand_over(what, client))

    def _hand_over(self, what: str, client: Any) -> None:
        self._about = self._edited()
        try:
            name, data, words = self.file(what)
        except HdplanError as error:
            self.text.content = small(html.escape(f"not saved: {error}"))
            return
        client.send_file_download(name, data, save_immediately=True)
        self.text.content = small(html.escape(f"saved: {words}"))
