"""The allowed collision matrix of a MoveIt scene: every entry is kept, or a note names it.

Two links that it says to check are checked, also where the robot's SRDF disables them (`robot.check_pairs`), unless the
scene names another robot: its links have other shapes, so that a pair which is free there may touch wherever this
robot stands. What the matrix allows to touch is still kept apart, beside what the SRDF and `touch_links` allow: that is
stricter, and noted. Obstacles are checked against each other neither here nor in MoveIt. A pair without an entry goes
by the defaults of its names. If they have none, MoveIt checks it, unless the matrix is empty; here the robot's
description decides, as robots have links that the writer of a matrix did not know; the checker of proofs names them.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence

from hdplan.scenes.attached import Attached
from hdplan.scenes.fields import Field
from hdplan.scenes.moveit.fields import MESSAGES
from hdplan.scenes.moveit.octomap import NAME as OCTOMAP
from hdplan.scenes.robot_files.description import Semantics, Tree
from hdplan.scenes.robot_files.link_pairs import LinkPair, link_pair
from hdplan.scenes.robot_spec import RobotSpec


def read_allowed(
    section: Field,
    tree: Tree,
    semantics: Semantics,
    robot: RobotSpec,
    objects: Collection[str],
    attached: Sequence[Attached],
    another: bool,
) -> tuple[LinkPair, ...]:
    """Return the pairs of links to check that would not be checked otherwise, and note what is allowed and still kept
    apart, what `robot.ignore_pairs` leaves out, and names that nothing has. `objects` are the names of the obstacles.
    Where the scene names `another` robot, such pairs are noted instead.

    Raises:
        InputError: the number of rows or columns is not that of the names.
    """
    keys = section.mapping(MESSAGES["AllowedCollisionMatrix"])
    allowed, defaults = _entries(section, keys), _defaults(section, keys)
    standing = {_whole(name) for name in objects}
    touching = {link_pair(_whole(part.name), link) for part in attached for link in (part.link, *part.touch_links)}
    bodies = {*tree.solid, *standing, *(_whole(part.name) for part in attached)}
    named = dict.fromkeys([*(name for pair in allowed for name in pair), *defaults])
    if strange := [name for name in named if name not in bodies and name not in (OCTOMAP, *tree.links)]:
        section.note(f"names unknown links or objects, which changes nothing: {', '.join(strange)}")

    of_links = (link_pair(a, b) for a, b in itertools.combinations(tree.solid, 2))
    left_out = {
        pair
        for pair in of_links
        if pair in semantics.disabled or pair in tree.excluded or not tree.solid.intersection(tree.between(*pair))
    }
    contacts: dict[str, list[str]] = {name: ["anything"] for name, free in defaults.items() if free and name in bodies}
    for (a, b), free in allowed.items():
        kept_apart = {a, b} <= bodies and not {a, b} <= standing and (a, b) not in left_out | touching
        if free and a != b and kept_apart:
            first, second = (b, a) if b not in tree.solid else (a, b)
            contacts.setdefault(first, []).append(second)
    if contacts:
        words = "; ".join(f"{name} with {', '.join(others)}" for name, others in contacts.items())
        section.note(f"allows contact, which hdplan still avoids, of {words}")
    ignored = {link_pair(a, b) for a, b in robot.ignore_pairs}
    if unheard := [f"{a}-{b}" for a, b in sorted(ignored) if _says(a, b, allowed, defaults) is False]:
        section.note(
            f"names pairs to check that robot.ignore_pairs leaves out; these are not checked: {', '.join(unheard)}"
        )
    required = sorted(pair for pair in left_out - ignored if _says(*pair, allowed, defaults) is False)
    if required and another:
        pairs = ", ".join(f"{a}-{b}" for a, b in required)
        section.note(f"is another robot's; pairs that it checks and this robot's description does not: {pairs}")
    return () if another else tuple(required)


def _entries(section: Field, keys: Mapping[str, Field]) -> dict[LinkPair, bool]:
    """Return whether two bodies may touch; where the matrix is not symmetric, they may not."""
    names = keys["entry_names"].texts() if "entry_names" in keys else ()
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
    return allowed


def _defaults(section: Field, keys: Mapping[str, Field]) -> dict[str, bool]:
    names = keys["default_entry_names"].texts() if "default_entry_names" in keys else ()
    values = keys["default_entry_values"].booleans() if "default_entry_values" in keys else ()
    if len(names) != len(values):
        raise section.error(
            f"must have as many default_entry_values as default_entry_names, found {len(values)} and {len(names)}"
        )
    defaults: dict[str, bool] = {}
    for name, free in zip(names, values, strict=True):  # of two of one name, the one that checks counts
        defaults[name] = free and defaults.get(name, True)
    return defaults


def _says(a: str, b: str, allowed: Mapping[LinkPair, bool], defaults: Mapping[str, bool]) -> bool | None:
    """Return whether two links may touch: by their entry, or else by their defaults; None if there is neither."""
    if (pair := link_pair(a, b)) in allowed:
        return allowed[pair]
    given = [defaults[link] for link in (a, b) if link in defaults]
    return all(given) if given else None


def _whole(name: str) -> str:
    """Return the name of the object of a primitive: ``box/1`` is of ``box``."""
    return name.partition("/")[0]
