"""The honest files that forgers begin with."""

from __future__ import annotations

from pathlib import Path

import pytest

from hdplan.verify.reading import read_world

from .forging import BALL, EVERY, TIMED, TOOL, Data, files, forge

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
