"""Many problems: scene files by pattern, folders of MoveIt's pairs, rows of a table."""

from __future__ import annotations

import csv
import glob
import io
import math
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from hdplan.planner.batch.job import Job, located, seed_of
from hdplan.planner.batch.tables import read_rows
from hdplan.planner.motion.csv_format import check_commas
from hdplan.scenes.errors import InputError, naming, nearest
from hdplan.scenes.files import leads_nowhere, read_file
from hdplan.scenes.number_text import read_number
from hdplan.scenes.values import FilePath
from hdplan.scenes.yaml_format.reader import SECTIONS, find_scene, shipped_jobs, shipped_scenes

TABLES = (".csv", ".parquet")
SCENES = (".yaml", ".yml", ".scene")
OWN = ("name", "group", "seed")  # columns of a table that are no fields of the scene


def jobs_of(sources: Sequence[str], scene: str | None = None, seed: int = 0) -> list[Job]:
    """Return the problems of some sources, in order.

    Args:
        sources: scene files, shipped scenes' names, patterns of files (``shelf_*.yaml``), folders (searched for
            MoveIt's pairs ``scene*.yaml`` and ``request*.yaml``, with `robot.yaml` beside or above, and for hdplan's
            scenes), or tables (CSV, Parquet) of fields by row (`load_variant`).
        scene: the scene that the rows of a table vary.
        seed: of all problems; a problem's own is drawn from it and its name, a table's column `seed` stands as it is.

    Raises:
        InputError: no such source, a source without problems, a table without a scene or a scene without a table, two
            problems of one name. A file or a row that is wrong in itself is found when it is solved.
    """
    if scene is not None and not any(Path(source).suffix.lower() in TABLES for source in sources):
        raise InputError(f"--scene {scene}: only the rows of a table vary a scene, and no source is a table")
    found: list[Job] = []
    for source in sources:
        path = Path(source)
        if path.suffix.lower() in TABLES:
            found += _rows(path, scene, seed)
        elif os.path.isdir(path):
            found += _folder(path, f"{path.absolute().name}/" if len(sources) > 1 else "", seed)
        elif _is_there(source) or source in shipped_scenes() | shipped_jobs():
            found.append(_of_file(path, path.stem, "", seed))
        else:
            files = sorted(Path(file) for file in glob.glob(source, recursive=True) if _is_there(file))
            found += [_of_file(file, str(file.with_suffix("")), _group(file), seed) for file in files]
            if not files:
                raise InputError(f"{source}: no such file, folder, pattern of files or shipped scene")
    name, count = Counter(each.name for each in found).most_common(1)[0]
    if count > 1:
        raise InputError(f"{' '.join(sources)}: {count} problems have the name '{name}'; names must differ")
    return found


def _of_file(file: Path, name: str, group: str, seed: int) -> Job:
    """Return the problem of a scene's file, with its request and robot if it is one of MoveIt's pairs."""
    file = located(file)
    request = file.with_name(file.name.replace("scene", "request", 1)) if file.name.startswith("scene") else None
    if request is None or not request.is_file():
        return Job(name, group, file, seed=seed_of(seed, name))
    robot = next((x / "robot.yaml" for x in file.parents if (x / "robot.yaml").is_file()), None)
    return Job(name, group, file, request, robot, seed=seed_of(seed, name))


def _folder(folder: Path, begin: str, seed: int) -> list[Job]:
    """Return the problems of a folder and those within: every scene file that is neither request nor robot."""
    files = sorted(
        file
        for file in folder.rglob("*")
        if (file.suffix.lower() in SCENES and _is_there(file)) or (not file.suffix and leads_nowhere(file))
    )  # what leads nowhere may have been a scene, or a folder of them
    files = [file for file in files if not file.name.startswith("request") and file.stem != "robot"]
    if not files:
        raise InputError(f"{folder}: has no scene files ({', '.join(SCENES)})")
    inner = [(file, file.relative_to(folder)) for file in files]
    named = [(file, begin + x.with_suffix("").as_posix()) for file, x in inner]
    return [_of_file(file, name, name.rpartition("/")[0], seed) for file, name in named]


def _is_there(file: FilePath) -> bool:
    """True if a file is there, or a link to one that is gone: a problem that fails with a word on it."""
    return os.path.isfile(file) or leads_nowhere(file)


def _group(file: Path) -> str:
    return "" if file.parent == Path() else str(file.parent)


def _rows(path: Path, scene: str | None, seed: int) -> Iterator[Job]:
    """Yield the problems of a table's rows. Raises InputError."""
    rows = _table(path)
    if scene is None:
        raise InputError(f"{path}: its rows vary a scene: name it with --scene")
    file = located(find_scene(scene))
    for column in dict.fromkeys(key for row in rows for key in row):
        section = column.partition(".")[0]
        if section not in (*SECTIONS, *OWN):
            raise InputError(f"{path}: unknown column '{column}'{nearest(section, (*SECTIONS, *OWN))}")
    if not rows:
        raise InputError(f"{path}: has no rows")
    for i, row in enumerate(rows):
        name = str(row.pop("name", f"{path.stem}/{i:06d}"))
        group, own = str(row.pop("group", file.stem)), row.pop("seed", None)
        if own is not None and not (isinstance(own, int) and 0 <= own < 2**63):
            raise InputError(f"{path}: row {i}: seed: must be a whole number of at least 0, found '{own}'")
        yield Job(name, group, file, fields=tuple(row.items()), seed=seed_of(seed, name) if own is None else own)


def _table(path: Path) -> list[dict[str, object]]:
    """Return a table's rows, without what is empty in them."""
    if path.suffix.lower() == ".parquet":
        return [{key: value for key, value in row.items() if value is not None} for row in read_rows(path)]
    with naming(path):
        content = read_file(path)
    try:
        lines = list(csv.reader(io.StringIO(content.decode("utf-8-sig"), newline=""), strict=True))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: is not a CSV table ({error})") from None
    head, *body = [line for line in lines if line] or [[]]
    if not head or len({*head}) < len(head) or not all(head):
        raise InputError(f"{path}: its first line must name every column, each by a name of its own")
    with naming(path):
        check_commas(1, head)
    for i, line in enumerate(body):
        if len(line) != len(head):
            raise InputError(f"{path}: row {i}: has {len(line)} values, the first line names {len(head)}")
    return [{key: _value(text) for key, text in zip(head, line, strict=True) if text.strip()} for line in body]


def _value(text: str) -> object:
    """Return the number that a cell holds, else its text."""
    word = text.strip()
    try:
        number = read_number(word)
    except ValueError:
        return word
    if not math.isfinite(number):
        return word
    return int(word) if word.lstrip("+-").isdigit() else number
