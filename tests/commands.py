"""Runs `hdplan` in this process, as its command line is."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest
import yaml

from hdplan import cli
from hdplan.scenes.yaml_format.reader import shipped_scenes

ARM = Path(shipped_scenes()["planar_arm"]).parent
BLOCKED = {"name": "post", "shape": {"type": "sphere", "radius": 0.05}, "pose": {"position": [0.3, 0.03, 0.1]}}


class Done(NamedTuple):
    """Exit code and outputs of a run."""

    code: int
    out: str
    err: str


Command = Callable[..., Done]


def in_process(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """Runs `hdplan` with some arguments, on a terminal of 80 columns."""
    monkeypatch.setenv("COLUMNS", "80")

    def run(*arguments: object) -> Done:
        monkeypatch.setattr("sys.argv", ["hdplan", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return Done(int(end.value.code or 0), *capsys.readouterr())

    return run


def arm_scene(folder: Path, name: str = "scene.yaml", **changes: object) -> Path:
    """Write the planar arm's scene with some sections changed."""
    content = yaml.safe_load((ARM / "planar_arm.yaml").read_text(encoding="utf-8"))
    content["robot"] = {"urdf": str(ARM / "planar_arm.urdf"), "srdf": str(ARM / "planar_arm.srdf")}
    file = folder / name
    file.write_text(yaml.safe_dump({**content, **changes}, allow_unicode=True), encoding="utf-8")
    return file


def obstacle(shape: str, position: str = "[0, 0, 3]", name: str = "thing") -> list[object]:
    """One obstacle, as the list of a scene file."""
    parts: list[object] = yaml.safe_load(
        f"[{{name: {json.dumps(name)}, shape: {{{shape}}}, pose: {{position: {position}}}}}]"
    )
    return parts


def refused(done: Done, *words: str) -> None:
    """Assert that it was refused in one line that holds these words."""
    assert done.code == 2
    assert done.out == ""
    assert done.err.count("\n") == 1
    assert done.err.startswith("hdplan: ")
    for word in words:
        assert word in done.err
