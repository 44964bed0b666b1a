"""Files of scene and motions on request: an archive of all, a page, a film, a picture. A thread of its own makes
them, as that takes seconds.

A file shows the scene at the moment of its request, whatever is edited meanwhile, and is certified again.
"""

from __future__ import annotations

import importlib.util
import io
import tempfile
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.view.drawing.motion import ShownMotion
from hdplan.planner.view.saving import Saving
from hdplan.planner.view.words import error_words
from hdplan.scenes.errors import HdplanError

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

MOST_PIXELS = 1.2e6  # of a picture, which a browser sends in one message
PATIENCE = 30.0  # [s] for a picture
WAIT = 5.0  # [s] for the thread at the end
NO_MOTION = "there is no motion yet: press Plan"
BUSY = "not saved: another file is still being made"
ARCHIVE = "all of it"


class File(NamedTuple):
    """A file that was made."""

    name: str
    data: bytes
    text: str  # the verdict on it


Making = Callable[[], File]


class Exports:
    """The buttons, and the thread that makes the files."""

    def __init__(self, viewer: Viewer, saving: Saving) -> None:
        """Build them in the container at hand."""
        self._viewer, self._saving = viewer, saving
        gui = viewer.server.gui
        whole = gui.add_button("Save all", hint="scene, motion, proof and page in one archive, certified as one")
        others = gui.add_button_group("export", ("page", "film", "picture"), hint="files of the visible motions")
        whole.on_click(lambda event: self._download(ARCHIVE, event.client))
        others.on_click(lambda event: self._download(str(event.target.value), event.client))
        self._ways: dict[str, Callable[[Any], Making]] = {
            ARCHIVE: self.archive,
            "page": self.page,
            "film": self.film,
            "picture": self.picture,
        }
        self._thread: threading.Thread | None = None

    def end(self) -> None:
        """Wait for the thread."""
        if self._thread is not None:
            self._thread.join(timeout=WAIT)

    # --- by the worker's thread: each takes what is shown now, and returns what makes a file of it ------------------

    def archive(self, client: Any = None) -> Making:
        """Scene, active motion, proof and page in one archive."""
        active = self._viewer.motions.active
        if active is None:
            raise HdplanError(NO_MOTION)
        scene, _ = self._saving.standing_alone()
        trajectory, result = active.motion.trajectory, active.result

        def make() -> File:
            save = None
            if result is not None:
                save = lambda path, known: replace(result, scene=scene.name, certificate=known).save(path)  # noqa: E731
            from hdplan.planner.page.archive import archive

            made = archive(scene, trajectory, save)
            return File(f"{scene.name}.zip", made.data, made.text)

        return make

    def page(self, client: Any = None) -> Making:
        """The motions that are shown as one page, with the planes that are shown."""
        certifier, motions = self._motions()
        active = self._viewer.motions.active
        proof = None if active is None else self._viewer.panel.layers.plane.proof_of(active.motion.trajectory)

        def make() -> File:
            known = motions()
            from hdplan.planner.page.recorded_page import page_of

            page = page_of(certifier.setup, known, proof=proof)
            return File(f"{certifier.setup.requested.name}.html", page.html.encode(), known[0].certificate.text)

        return make

    def film(self, client: Any = None) -> Making:
        """The motions as a film."""
        from hdplan.planner.page.film import FILMS, film

        certifier, motions = self._motions()
        ending = next((end for end, (module, _) in FILMS.items() if importlib.util.find_spec(module)), ".mp4")

        def make() -> File:
            known = motions()
            with tempfile.TemporaryDirectory() as folder:
                file = Path(folder) / f"{certifier.setup.requested.name}{ending}"
                drawn = film(certifier.setup, known, file)
                return File(file.name, file.read_bytes(), f"a film, drawn {drawn}; {known[0].certificate.text}")

        return make

    def picture(self, client: Any = None) -> Making:
        """The scene as the browser that asks for it shows it."""
        if client is None:
            raise HdplanError("a picture is drawn by the requesting browser")
        width, height = client.camera.image_width, client.camera.image_height
        share = min(1.0, (MOST_PIXELS / max(width * height, 1)) ** 0.5)
        name = f"{self._viewer.scene.name}.png"

        def make() -> File:
            from PIL import Image  # which viser needs

            seen = client.get_render(
                max(int(share * height), 1), max(int(share * width), 1), transport_format="png", timeout=PATIENCE
            )
            found = io.BytesIO()
            Image.fromarray(seen).save(found, format="png")
            return File(name, found.getvalue(), "a picture")

        return make

    def _motions(self) -> tuple[Certifier, Callable[[], list[ShownMotion]]]:
        """Return the certifier of the scene as it is now, and what certifies the motions that are shown there, the
        active one first."""
        viewer, active = self._viewer, self._viewer.motions.active
        if active is None:
            raise HdplanError(NO_MOTION)
        _, certifier = self._saving.standing_alone()
        others = [shown for shown in viewer.motions.shown if shown.visible and shown is not active]
        trajectories = [(shown.motion.name, shown.motion.trajectory) for shown in (active, *others)]

        def motions() -> list[ShownMotion]:
            return [ShownMotion.of(name, each, certifier) for name, each in trajectories]

        return certifier, motions

    # --- the thread -----------------------------------------------------------------------------------------------

    def _download(self, what: str, client: Any) -> None:
        """Handle a browser's request."""
        if client is not None and what in self._ways:  # a browser may send anything
            self._viewer.worker.ask(f"{what} for {client.client_id}", lambda: self._begin(what, client))

    def _begin(self, what: str, client: Any) -> None:
        if self._thread is not None and self._thread.is_alive():
            self._saving.say(BUSY)
            return
        try:
            make = self._ways[what](client)
        except HdplanError as error:
            self._saving.say(f"not saved: {error}")
            return
        self._saving.say(f"{what} is being made …")
        about = self._saving.now()
        self._thread = threading.Thread(target=self._run, args=(make, client, about), name="hdplan-export", daemon=True)
        self._thread.start()

    def _run(self, make: Making, client: Any, about: tuple[object, object]) -> None:
        try:
            file = make()
            client.send_file_download(file.name, file.data, save_immediately=True)
            text = f"saved: {file.text}"
        except Exception as error:  # also of a library, or a browser that is gone: the viewer continues
            text = f"not saved: {error_words(error)}"
        self._viewer.worker.ask("exported", lambda: self._tell(text, about))

    def _tell(self, text: str, about: tuple[object, object]) -> None:
        """Show the outcome: a verdict only while scene and motion are unchanged."""
        known = all(one is two for one, two in zip(about, self._saving.now(), strict=True))
        self._saving.say(text if known else "done, from the scene and the motion at the time of the request")
