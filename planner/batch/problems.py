"""Many problems: scene files by pattern, folders of MoveIt's pairs, rows of a table, scenes made in Python."""

from __future__ import annotations

import csv
import glob
import hashlib
import io
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.files import read_file
from hdplan.scenes.scene import Scene
from hdplan.scenes.yaml_format.reader import load_scene, shipped_scenes
from hdplan.scenes.yaml_format.variants import load_variant

TABLES = (".csv", ".parquet")
SCENES = (".yaml", ".yml", ".scene")
OWN = ("name", "group", "seed")  # columns of a table that are no fields of the scene
MOST_SEED = 2**63


@dataclass(frozen=True)
class Problem:
    """One problem: where it is read from, and the seed of its random guesses."""

    name: str  # unlike those of all others of a run
    group: str  # by which results are summed up: the folder, or the scene of a table
    scene: Path | Scene
    request: Path | None = None
    robot: Path | None = None
    fields: tuple[tuple[str, object], ...] = ()  # in which it differs from the scene's file
    seed: int = 0

    def load(self) -> Scene:
        """Read it. Raises InputError for a bad file."""
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
        if isinstance(self.scene, Scene):
            digest.update(repr(self.scene).encode())
        else:
            try:
                scene = shipped_scenes().get(str(self.scene), self.scene)
                for file in (scene, self.request, self.robot):
                    digest.update(file.read_bytes() if file else b"\0")
            except OSError:
                return ""
        digest.update(repr(self.fields).encode())
        return digest.hexdigest()


def problems_of(sources: Sequence[str], scene: str | None = None, seed: int = 0) -> list[Problem]:
    """Return the problems of some sources, in order.

    Args:
        sources: scene files, shipped scenes' names, patterns of files (``shelf_*.yaml``), folders (searched for MoveIt's
            pairs ``scene*.yaml`` and ``request*.yaml``, with `robot.yaml` beside or above, and for hdplan's scenes), or
            tables (CSV, Parquet) of fields by row (`load_variant`).
        scene: the scene that the rows of a table vary.
        seed: of all problems; a problem's own is drawn from it and its name, a table's column `seed` stands as it is.

    Raises:
        InputError: no such source, a source without problems, a table without a scene, two problems of one name.
    """
    found: list[Problem] = []
    for source in sources:
        path = Path(source)
        if path.suffix.lower() in TABLES:
            found += _rows(path, scene, seed)
        elif os.path.isdir(path):
            found += _folder(path, f"{path.absolute().name}/" if len(sources) > 1 else "", seed)
        elif os.path.isfile(path) or source in shipped_scenes():
            found.append(_of_file(path, path.stem, "", seed))
        else:
            files = sorted(Path(file) for file in glob.glob(source, recursive=True) if os.path.isfile(file))
            found += [_of_file(file, str(file.with_suffix("")), str(file.parent), seed) for file in files]
            if not files:
                raise InputError(f"{source}: no such file, folder, pattern of files or shipped scene")
    names: dict[str, int] = {}
    for each in found:
        names[each.name] = names.get(each.name, 0) + 1
    if twice := [name for name, count in names.items() if count > 1]:
        raise InputError(f"{' '.join(sources)}: {names[twice[0]]} problems have the name '{twice[0]}'; names must differ")
    return found


def seed_of(seed: int, name: str) -> int:
    """Return a problem's own seed: the same for the same name, whatever the other problems are."""
    return int.from_bytes(hashlib.sha256(f"{seed} {name}".encode()).digest()[:4], "big") if seed else 0


def _of_file(file: Path, name: str, group: str, seed: int) -> Problem:
    """Return the problem of a scene's file, with its request and robot if it is one of MoveIt's pairs."""
    request = file.with_name(file.name.replace("scene", "request", 1)) if file.name.startswith("scene") else None
    if request is None or not request.is_file():
        return Problem(name, group, file, seed=seed_of(seed, name))
    robot = next((x / "robot.yaml" for x in file.absolute().parents if (x / "robot.yaml").is_file()), None)
    return Problem(name, group, file, request, robot, seed=seed_of(seed, name))


def _folder(folder: Path, begin: str, seed: int) -> list[Problem]:
    """Return the problems of a folder and those within: every scene file that is neither request nor robot."""
    files = sorted(file for file in folder.rglob("*") if file.suffix.lower() in SCENES and file.is_file())
    files = [file for file in files if not file.name.startswith("request") and file.stem != "robot"]
    if not files:
        raise InputError(f"{folder}: has no scene files ({', '.join(SCENES)})")
    inner = [(file, file.relative_to(folder)) for file in files]
    named = [(file, begin + x.with_suffix("").as_posix()) for file, x in inner]
    return [_of_file(file, name, name.rpartition("/")[0], seed) for file, name in named]


def _rows(path: Path, scene: str | None, seed: int) -> Iterator[Problem]:
    """Yield the problems of a table's rows. Raises InputError."""
    if scene is None:
        raise InputError(f"{path}: its rows vary a scene: name it with --scene")
    file = Path(scene)
    for i, row in enumerate(_table(path)):
        name = str(row.pop("name", None) or f"{path.stem}/{i:06d}")
        group, own = str(row.pop("group", None) or file.stem), row.pop("seed", None)
        if own is not None and not (isinstance(own, int) and 0 <= own < MOST_SEED):
            raise InputError(f"{path}: row {i}: seed: must be a whole number of at least 0, found '{own}'")
        yield Problem(name, group, file, fields=tuple(row.items()), seed=seed_of(seed, name) if own is None else own)


def _table(path: Path) -> list[dict[str, object]]:
    """Return a table's rows, without what is empty in them."""
    if path.suffix.lower() == ".parquet":
        import pyarrow
        import pyarrow.parquet

        if not os.path.isfile(path):
            raise InputError(f"{path}: no such file")
        try:
            rows = pyarrow.parquet.read_table(path).to_pylist()
        except (OSError, pyarrow.ArrowException) as error:
            raise InputError(f"{path}: is no Parquet file ({str(error).splitlines()[0]})") from None
        return [{key: value for key, value in row.items() if value is not None} for row in rows]
    with naming(path):
        content = read_file(path)
    try:
        lines = list(csv.reader(io.StringIO(content.decode("utf-8-sig"), newline=""), strict=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: is no CSV table ({error})") from None
    head, *body = [line for line in lines if line] or [[]]
    if len({*head}) < len(head) or not all(head):
        raise InputError(f"{path}: its first line must name every column, each by a name of its own")
    for i, line in enumerate(body):
        if len(line) != len(head):
            raise InputError(f"{path}: row {i}: has {len(line)} values, the first line names {len(head)}")
    return [{key: _value(text) for key, text in zip(head, line, strict=True) if text.strip()} for line in body]


def _value(text: str) -> object:
    """Return the number that a cell holds, else its text."""
    for kind in (int, float):
        try:
            value = kind(text)
        except ValueError:
            continue
        return value if math.isfinite(value) else text
    return text.strip()
