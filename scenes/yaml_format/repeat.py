"""Stages that a file repeats over a table: `repeat: {over: [{box: first, y: 0.25}, ..], stages: [..]}`.

In the stages `$box` stands for the row's value of the column `box`: alone for the value itself, in a longer text for
its words. `$$` is a dollar sign. A stage whose name has no column in it gets the number of the row, from 1, behind it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from hdplan.scenes.errors import nearest
from hdplan.scenes.fields import Field
from hdplan.scenes.job import MOST_STAGES

COLUMN = re.compile(r"\$(\$|[A-Za-z_][A-Za-z0-9_]*)?")


def repeated(section: Field) -> Iterator[Field]:
    """Yield the stages of all rounds, each with its row's values. Raises InputError for rows with other columns than
    the first one's, a column that is not there, one that nothing uses, and for too many stages."""
    keys = section.mapping(("over", "stages"), required=["over", "stages"])
    rows, stages = (keys[name].items(of=name) for name in ("over", "stages"))
    if not rows or not stages:
        raise section.error("needs one row or more, and one stage or more")
    if len(rows) * len(stages) > MOST_STAGES:
        raise section.error(f"makes {len(rows) * len(stages)} stages, at most {MOST_STAGES} are allowed")
    columns = rows[0].mapping()
    used: set[str] = set()
    for number, row in enumerate(rows, 1):
        values = row.mapping()
        if values.keys() != columns.keys():
            raise row.error(f"has the columns {', '.join(values) or 'none'}, the first row {', '.join(columns)}")
        given = {name: each.value for name, each in values.items()}
        for stage in stages:
            filled = Field(_filled(stage, stage.value, given, used), stage.key, stage.document)
            yield _numbered(filled, stage, number)
    if unused := [name for name in columns if name not in used]:
        raise keys["over"].error(f"the column '{unused[0]}' is used in no stage: write ${unused[0]}")


def _numbered(made: Field, stage: Field, number: int) -> Field:
    """Return a stage with the number of its row in its name, where that says nothing of the row."""
    value, written = made.value, stage.value
    if not isinstance(value, Mapping) or not isinstance(written, Mapping) or not isinstance(value.get("name"), str):
        return made
    named = value["name"] if value["name"] != written["name"] else f"{value['name']} {number}"
    return Field({**value, "name": named}, made.key, made.document)


def _filled(stage: Field, value: object, row: Mapping[str, object], used: set[str]) -> object:
    if isinstance(value, Mapping):
        return {
            _filled(stage, key, row, used) if isinstance(key, str) else key: _filled(stage, each, row, used)
            for key, each in value.items()
        }
    if isinstance(value, list):
        return [_filled(stage, each, row, used) for each in value]
    if not isinstance(value, str):
        return value

    def column(found: re.Match[str]) -> object:
        name = found[1]
        if name == "$":
            return "$"
        if name is None:
            raise stage.error("a dollar sign marks the name of a column; $$ is the sign itself")
        if name not in row:
            raise stage.error(f"there is no column '{name}'{nearest(name, row)}")
        used.add(name)
        return row[name]

    if (whole := COLUMN.fullmatch(value)) and whole[1] != "$":
        return column(whole)
    return COLUMN.sub(lambda found: str(column(found)), value)
