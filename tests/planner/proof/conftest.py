"""Files that are proven: shipped scenes with their motions, and the arm's with all kinds of claims."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path

import pytest

import hdplan
from hdplan.scenes.yaml_format.reader import find_scene
from hdplan.verify.reading import read_world

from .forging import BALL, EVERY, TIMED, TOOL, Data, files, forge
from .worlds import unpacked, words_of

Honest = tuple[tuple[Path, Path], Data, dict[str, str], bytes]


@pytest.fixture(scope="session")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Honest:
    """Files of a motion with all kinds of claims, the world that is read, the files' hashes, and a true proof."""
    scene = {
        "obstacles": [{**BALL, "clearance": 0.02}, {**BALL, "name": "p", "motion": {"velocity": [0.01, 0, 0]}}],
        "attached": [{**TOOL, "mass": 0.1}],
        "limits": {"torque": 90, "acceleration": 10, "position": {"a": [-1, 1]}},
        "timing": {"duration": 10}, "path": {"upright": {"link": "hand", "tolerance": 2.5}},
        "start": {"joints": {"a": 0, "b": 0, "g": 0}}, "planner": {"clearance": 0.01},
    }  # fmt: skip
    given = files(tmp_path_factory.mktemp("honest"), scene, TIMED)
    reading = read_world(*given)
    return given, reading.world, reading.hashes, forge(reading.world, reading.hashes, EVERY, 0.01)


class Proven:
    """A scene, its motion and the proof as files that may be changed."""

    def __init__(self, name: str, folder: Path) -> None:
        self.scene, self.motion, self.folder = find_scene(name), folder / "m.json", folder
        result = hdplan.plan(hdplan.load_scene(name), time_limit=60)
        assert result.certified
        result.save(self.motion)
        self.certificate = result.certificate
        self.proof = hdplan.prove(name, self.motion)

    def verify(self, data: bytes | None = None, scene: Path | None = None, motion: Path | None = None) -> str:
        return words_of(scene or self.scene, motion or self.motion, self.proof.data if data is None else data)

    def content(self) -> tuple[Data, Data, bytes]:
        """Head, world and arrays."""
        return unpacked(self.proof.data)


@pytest.fixture(scope="session")
def proven(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Proven]:
    return functools.cache(lambda name: Proven(name, tmp_path_factory.mktemp(name)))
