"""The allowed collision matrix of a MoveIt scene: where it differs from what hdplan checks, a note says so.

Pairs of links are checked as the robot's SRDF says, and links against all objects but those that they hold or may
touch.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

from hdplan.scenes.fields import Field
from hdplan.scenes.moveit.fields import MESSAGES
from hdplan.scenes.robot_files.link_pairs import LinkPair, link_pair

SHOWN = 3  # pairs that a note names


def note_allowed(section: Field, objects: Collection[str], disabled: Iterable[LinkPair]) -> None:
    """Add a note where a link may touch an object, and where a pair of links should be checked that the SRDF disables.

    Raises:
        InputError: the number of rows or columns is not that of the names.
    """
    keys = section.mapping(MESSAGES["AllowedCollisionMatrix"])
    names, defaults = _texts(keys.get("entry_names")), _defaults(section, keys)
    rows = keys["entry_values"].items(len(names), "rows") if "entry_values" in keys else []
    if len(rows) != len(names):
        raise section.error(f"must have as many entry_values as entry_names, found {len(rows)} and {len(names)}")
    allowed: dict[LinkPair, bool] = {}
    for name, row in zip(names, rows, strict=True):
        # In ROS 2 messages a row is a mapping {enabled: [...]}.
        values = row.mapping(("enabled",), ["enabled"])["enabled"] if isinstance(row.value, Mapping) else row
        for other, free in zip(names, values.booleans(len(names)), strict=True):
            pair = link_pair(name, other)
            allowed[pair] = free and allowed.get(pair, True)
    whole = {name.partition("/")[0] for name in objects}
    touching = [f"{name} (with anything)" for name, free in defaults.items() if free and name in whole]
    touching += [
        f"{b}-{a}" if a in whole else f"{a}-{b}"
        for (a, b), free in allowed.items()
        if free and (a in whole) != (b in whole)
    ]
    if touching:
        section.note(f"allows contact of {_few(touching)}; hdplan still avoids it")
    checked = [f"{a}-{b}" for a, b in sorted(disabled) if _says(a, b, allowed, defaults) is False]
    if checked:
        section.note(f"asks to check {_few(checked)}, which the robot's SRDF disables; hdplan does not check them")


def _texts(entries: Field | None) -> tuple[str, ...]:
    return entries.texts() if entries else ()


def _defaults(section: Field, keys: Mapping[str, Field]) -> dict[str, bool]:
    names = _texts(keys.get("default_entry_names"))
    values = keys["default_entry_values"].booleans() if "default_entry_values" in keys else ()
    if len(names) != len(values):
        raise section.error(
            f"must have as many default_entry_values as default_entry_names, found {len(values)} and {len(names)}"
        )
    return dict(zip(names, values, strict=True))


def _says(a: str, b: str, allowed: Mapping[LinkPair, bool], defaults: Mapping[str, bool]) -> bool | None:
    """Return whether two links may touch: by their entry, or else by their defaults; None if there is neither."""
    if (pair := link_pair(a, b)) in allowed:
        return allowed[pair]
    given = [defaults[link] for link in (a, b) if link in defaults]
    return all(given) if given else None


def _few(names: list[str]) -> str:
    return ", ".join(names[:SHOWN]) + (f" and {len(names) - SHOWN} more" if len(names) > SHOWN else "")
