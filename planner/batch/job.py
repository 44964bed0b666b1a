"""One of many problems: its source, and the seed of its random guesses, as sent to a worker."""

from __future__ import annotations

import functools
import hashlib
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdplan.planner.geometry.mesh_files import files_beside
from hdplan.scenes.errors import HdplanError, InputError, naming
from hdplan.scenes.files import Stamps, read_file, stamps_of
from hdplan.scenes.scene import Scene
from hdplan.scenes.values import FilePath
from hdplan.scenes.yaml_format.reader import find_scene, load_scene
from hdplan.scenes.yaml_format.variants import load_variant
from hdplan.scenes.yaml_format.writer import scene_text

NAMED = re.compile(rb"""\b(?:file|urdf|srdf)["']?:\s*(?:"([^"\n]+)"|'([^'\n]+)'|([^\s"'{}\[\],][^,}\n#]*))""")
"""Files that a scene's file names."""


@dataclass(frozen=True)
class Job:
    """A problem by its files, or as a scene."""

    name: str  # unlike those of all others of a run
    group: str  # by which results are summed up: the folder, or the scene of a table
    scene: Path | Scene
    request: Path | None = None
    robot: Path | None = None
    fields: tuple[tuple[str, object], ...] = ()  # in which it differs from the scene's file
    seed: int = 0

    def load(self) -> Scene:
        """Return the scene. Raises InputError for a bad file or field."""
        if isinstance(self.scene, Scene):
            return self.scene
        if self.fields:
            with naming(self.name):
                return load_variant(self.scene, dict(self.fields), self.name)
        return load_scene(self.scene, self.request, self.robot)

    @property
    def hashed(self) -> str:
        """SHA-256 of what it is read from, with the files that are named there; empty for one that cannot be read."""
        digest = hashlib.sha256()
        try:
            if isinstance(self.scene, Scene):
                _take(digest, scene_text(self.scene).encode(), Path())
            else:
                for file in (find_scene(self.scene), self.request, self.robot):
                    if file is None:
                        digest.update(b"\0")
                    else:
                        _take(digest, read_file(file), file.parent)
        except (HdplanError, UnicodeEncodeError):
            return ""
        digest.update(repr(self.fields).encode())
        return digest.hexdigest()


def _take(digest: Any, content: bytes, folder: Path) -> None:
    """Add the content of a scene's file to a digest, and that of the files that it names: robots, meshes and
    their buffers, clouds."""
    digest.update(content)
    for name in sorted({b"".join(found) for found in NAMED.findall(content)}):
        file = folder / name.decode(errors="replace").strip()
        for each in (file, *files_beside(file)):
            digest.update(_hash_of(each, stamps_of([each])))


@functools.lru_cache(maxsize=4096)
def _hash_of(file: Path, stamps: Stamps) -> bytes:
    """SHA-256 of a file's content, computed again when it was written again; empty for one that cannot be read, which
    is found when the problem is."""
    try:
        return hashlib.sha256(read_file(file)).digest()
    except InputError:
        return b""


def located(path: FilePath) -> Path:
    """Return a file's absolute path, which means the same to every worker; a shipped scene's name stays."""
    return Path(path).absolute() if os.path.exists(path) else Path(path)


def seed_of(seed: int, name: str) -> int:
    """Return a problem's own seed: the same for the same name, whatever the other problems are; 0 for 0."""
    return int.from_bytes(hashlib.sha256(f"{seed} {name}".encode()).digest()[:4], "big") if seed else 0
