"""Groups of obstacles, as pure functions: the part of a name before its last slash is its group.

So groups are saved with the scene, and everything else that reads it needs to know nothing of them.
"""

from __future__ import annotations

from collections.abc import Sequence

from hdplan.planner.view.edited_scene import Edited
from hdplan.planner.view.scene_edits import free_name, renamed
from hdplan.scenes.errors import InputError

BETWEEN = "/"


def group_of(name: str) -> str:
    """Return the group of an obstacle; "" for one that is in none."""
    return name.rpartition(BETWEEN)[0]


def members(edited: Edited, group: str) -> tuple[str, ...]:
    """Return the names of a group's obstacles."""
    return tuple(each.name for each in edited.scene.obstacles if group and group_of(each.name) == group)


def free_group(edited: Edited) -> str:
    """Return a name that no group has: "group", or with a number."""
    taken = {group_of(each.name) for each in edited.scene.obstacles}
    names = ("group", *(f"group{number}" for number in range(2, len(taken) + 3)))
    return next(name for name in names if name not in taken)


def grouped(edited: Edited, names: Sequence[str], group: str) -> tuple[Edited, tuple[str, ...]]:
    """Return the scene with obstacles in a group, "" for none, and how they are called there. Raises InputError for a
    name that no scene allows."""
    group = group.strip().strip(BETWEEN)
    if not names:
        raise InputError("group: no obstacle is selected")
    found = []
    for name in names:
        bare = name.rpartition(BETWEEN)[2]
        new = f"{group}{BETWEEN}{bare}" if group else bare
        if new != name:
            new = free_name(edited, new)
            edited = renamed(edited, name, new)
        found.append(new)
    return edited, tuple(found)
