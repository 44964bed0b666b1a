"""One of many problems: where it is read from, and the seed of its random guesses. It travels to whoever solves it."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

from hdplan.scenes.errors import HdplanError, naming
from hdplan.scenes.files import read_file
from hdplan.scenes.scene import Scene
from hdplan.scenes.values import FilePath
from hdplan.scenes.yaml_format.reader import find_scene, load_scene
from hdplan.scenes.yaml_format.variants import load_variant
from hdplan.scenes.yaml_format.writer import scene_text


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
        """Read it. Raises InputError for a bad file or field."""
        if isinstance(self.scene, Scene):
            return self.scene
        if self.fields:
            with naming(self.name):
                return load_variant(self.scene, dict(self.fields), self.name)
        return load_scene(self.scene, self.request, self.robot)

    @property
    def hashed(self) -> str:
        """SHA-256 of what it is read from; empty for a file that cannot be read."""
        digest = hashlib.sha256()
        try:
            if isinstance(self.scene, Scene):
                digest.update(scene_text(self.scene).encode())
            else:
                for file in (find_scene(self.scene), self.request, self.robot):
                    digest.update(read_file(file) if file else b"\0")
        except (HdplanError, UnicodeEncodeError):
            return ""
        digest.update(repr(self.fields).encode())
        return digest.hexdigest()


def located(path: FilePath) -> Path:
    """Return a file's absolute path, which means the same to every worker; a shipped scene's name stays."""
    return Path(path).absolute() if os.path.exists(path) else Path(path)


def seed_of(seed: int, name: str) -> int:
    """Return a problem's own seed: the same for the same name, whatever the other problems are; 0 for 0."""
    return int.from_bytes(hashlib.sha256(f"{seed} {name}".encode()).digest()[:4], "big") if seed else 0
