"""Files that browsers send: kept in a folder of their own while the viewer runs, beside each other, so that a scene
finds the meshes that were sent before it. Nothing else on the server's machine is written."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Collection
from pathlib import Path

from hdplan.planner.geometry.mesh_files import FORMATS
from hdplan.planner.view.drawing.motion import shortened
from hdplan.scenes.errors import InputError
from hdplan.scenes.files import MOST_BYTES

MESHES = tuple(f".{ending}" for ending in FORMATS)
LONGEST_NAME = 100  # bytes of a name
_UNSAFE = re.compile(r"[^\w .()+-]")


class Uploads:
    """The folder, and what is in it."""

    def __init__(self) -> None:
        """Make a folder that is deleted with this object."""
        self._folder = tempfile.TemporaryDirectory(prefix="hdplan-view-")

    @property
    def folder(self) -> Path:
        """Folder of the uploaded files."""
        return Path(self._folder.name)

    def take(self, name: str, content: bytes, endings: Collection[str]) -> Path:
        """Write a file under its own name, in place of an earlier one, and return where. Raises InputError for a name
        without one of the endings, and for a file that is empty or too large."""
        path = self.folder / _checked(name, content, endings)
        path.write_bytes(content)
        return path

    def take_mesh(self, name: str, content: bytes) -> Path:
        """Write a mesh file, as `take`; numbered if another one has its name, as obstacles may be made of that."""
        bare, number = Path(_checked(name, content, MESHES)), 2
        path = self.folder / bare
        while path.exists() and path.read_bytes() != content:
            path, number = self.folder / _short(f"{bare.stem}_{number}{bare.suffix}"), number + 1
        path.write_bytes(content)
        return path

    def of(self, paths: Collection[Path]) -> tuple[Path, ...]:
        """Return those of some files that were sent by browsers, each once."""
        return tuple(dict.fromkeys(path for path in paths if path.parent == self.folder))

    def close(self) -> None:
        """Delete the uploaded files."""
        self._folder.cleanup()


def _checked(name: str, content: bytes, endings: Collection[str]) -> str:
    """Return the name under which a file is written."""
    bare = _short(_UNSAFE.sub("_", Path(name.replace("\\", "/")).name))
    shown = shortened(name, LONGEST_NAME)
    if not bare.lower().endswith(tuple(endings)):
        raise InputError(f"{shown}: a file that ends with one of {', '.join(endings)} is needed")
    if not content:
        raise InputError(f"{shown}: is empty")
    check_size(shown, len(content))
    return bare


def _short(name: str) -> str:
    """Return the end of a name, no longer than a file's may be, which counts in bytes."""
    return name.encode()[-LONGEST_NAME:].decode(errors="ignore").lstrip(".")


def check_size(name: str, size: float) -> None:
    """Raise InputError for a file that is too large [bytes]: a page asks before it sends one."""
    if size > MOST_BYTES:
        raise InputError(f"{name}: is {size / 1e6:.0f} MB large; files of at most {MOST_BYTES / 1e6:.0f} MB are read")
