"""A scene as C99: kinematics, distances and penalty of its pairs of bodies, with the obstacles' poses as inputs.

CasADi writes the two kernels, the kinematics of the joints and the distance of one pair with its wrench; the pairs are
tables, and a loop over them is in `c_text`. So the code is small however many pairs there are, needs no memory but some
kilobytes of stack, and has loops of fixed lengths alone.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from importlib import metadata
from typing import Any

import casadi as ca
import numpy as np

from hdplan.distance.poses import RIGID_ERROR, placement_rows
from hdplan.distance.symbolic.halfspaces import halfspace_distance
from hdplan.planner.collision.broad_phase import BodyPairs
from hdplan.planner.collision.collision_model import SELF_ACTIVATION
from hdplan.planner.robot.robot import Robot
from hdplan.planner.symbolic import c_test_text, c_text
from hdplan.planner.symbolic.c_kernels import kernels
from hdplan.planner.symbolic.c_numbers import Numbers, hdplans_numbers
from hdplan.planner.symbolic.kinematics import joint_values, link_places
from hdplan.planner.symbolic.pairs import ScenePairs
from hdplan.scenes.array_types import Array

TEST_CONFIGURATIONS = 100  # configurations of the test program
TAKEN = (
    "all",
    "clean",
    "help",
    "install",
    "m",
    "package",
    "package_source",
    "preinstall",
    "test",
)  # by CMake; a library


def c_files(found: ScenePairs) -> dict[str, str]:
    """Return the files' names and texts: header, source, a test program with hdplan's own numbers, and a CMake file.

    found: made by `all_movable`.
    """
    prefix = c_name(found.setup.scene.name)
    words = _words(found, prefix) | _of_numbers(hdplans_numbers(found, TEST_CONFIGURATIONS))
    texts = {
        f"{prefix}.h": c_text.HEADER,
        f"{prefix}.c": c_text.SOURCE,
        f"{prefix}_test.c": c_test_text.TEST,
        "CMakeLists.txt": c_test_text.CMAKE,
    }
    return {name: text.substitute(words) for name, text in texts.items()}


def c_name(scene: str) -> str:
    """Return a scene's name as the beginning of names in C, and as a target of CMake."""
    plain = re.sub(r"[^a-z0-9]+", "_", scene.lower()).strip("_")
    return plain if plain[:1].isalpha() and plain not in TAKEN else f"scene_{plain}".rstrip("_")


def _words(found: ScenePairs, prefix: str) -> dict[str, str]:
    setup, tree, settings = found.setup, found.model.kinematics, found.setup.scene.planner
    robot, obstacles = setup.robot, found.movable
    places = link_places(robot)
    earlier = [settings.activation if group.joint_b.max() >= tree.nj else SELF_ACTIVATION for group in found.groups]
    shapes = sorted({(group.vertex_slots, int(slots)) for group in found.groups for slots in group.plane_slots})
    functions = [_state(robot, tree.state, tree.nj, prefix)]
    functions += [_pair(*shape, settings.gamma, settings.shaping_length, prefix) for shape in shapes]
    written = kernels(prefix, functions)
    frames = tree.nj + len(obstacles)
    memory = 8 * (written.numbers + 12 * frames + 6 * tree.n + 7 * robot.n + 64 + written.arguments + written.results)
    leader = np.arange(robot.n) if robot.linkage is None else robot.linkage.leader
    factor = np.ones(robot.n) if robot.linkage is None else robot.linkage.factor
    counts = {"joints": robot.n, "links": len(places), "obstacles": len(obstacles), "pairs": len(found.names)}
    return {
        "scene": re.sub(r"[^\w .-]", "_", setup.scene.name, flags=re.ASCII),
        "version": metadata.version("hdplan"),
        "prefix": prefix,
        "PREFIX": prefix.upper(),
        **{name: str(count) for name, count in counts.items()},
        **{f"some_{name}": str(max(count, 1)) for name, count in counts.items()},  # C has no empty arrays
        "values": str(tree.n),
        "frames": str(frames),
        "rigid": _number(RIGID_ERROR**2),
        "stack": str(-(-memory // 1024) * 1024),
        "kernels": written.source,
        "arguments": str(written.arguments),
        "results": str(written.results),
        "integers": str(written.integers),
        "numbers": str(written.numbers),
        "joint_names": _row(map(_text, robot.joint_names)),
        "lower": _row(map(_number, robot.lower)),
        "upper": _row(map(_number, robot.upper)),
        "link_names": _row(map(_text, places)),
        "link_rows": _row(
            f"{{{joint}, {{{_row(map(_number, placement_rows(place)))}}}}}" for joint, place in places.values()
        ),
        "obstacle_names": _row(_text(obstacle.name) for obstacle in obstacles),
        "obstacle_poses": _row(map(_number, found.poses.ravel())),
        "pair_names": _row(f"{{{_text(a)}, {_text(b)}}}" for a, b in found.names),
        "leader": _row(map(str, leader.tolist())),
        "factor": _row(map(_number, factor)),
        "tables": "".join(_tables(group, row) for row, group in enumerate(found.groups)),
        "pair_rows": _row(
            line for row, group in enumerate(found.groups) for line in _pairs(group, row, earlier[row], prefix)
        ),
    }


def _state(robot: Robot, state: ca.Function, joints: int, prefix: str) -> ca.Function:
    """Return the frames (12 joints) and screws (6 values) at q (n,)."""
    q = ca.SX.sym("q", robot.n)
    both = state(joint_values(robot, q))
    return ca.Function(f"{prefix}_state", [q], [both[: 12 * joints], both[12 * joints :]])


def _pair(vertices: int, planes: int, gamma: int, shaping_length: float, prefix: str) -> ca.Function:
    """Return D and its wrench of one pair, the first body's radius enlarged."""
    distance = halfspace_distance(vertices, planes, gamma, shaping_length)
    frame, other = ca.MX.sym("frame", 12), ca.MX.sym("other", 12)
    body, body_planes, more = ca.MX.sym("body", 4 * vertices + 1), ca.MX.sym("planes", 4 * planes), ca.MX.sym("more")
    found = distance(frame, other, ca.vertcat(body[:-1], body[-1] + more), body_planes)
    return ca.Function(f"{prefix}_pair_{vertices}_{planes}", [frame, other, body, body_planes, more], list(found[:2]))


def _tables(group: BodyPairs, row: int) -> str:
    """Declare the bodies in a group of pairs, and their planes, whose supports include the clearances."""
    tables = {f"bodies_{row}": group.body_table[np.unique(group.body)]}
    for slots, table in group.plane_tables.items():
        if len(used := np.unique(group.plane_row[group.plane_slots == slots])):
            tables[f"planes_{row}_{slots}"] = table[used]
    return "".join(
        f"static const double {name}[{table.shape[0]}][{table.shape[1]}] = {{{_row(map(_braced, table))}}};\n\n"
        for name, table in tables.items()
    )


def _pairs(group: BodyPairs, row: int, earlier: float, prefix: str) -> Iterable[str]:
    body, plane = np.searchsorted(np.unique(group.body), group.body), group.plane_row.copy()
    for slots in group.plane_tables:
        own = group.plane_slots == slots
        plane[own] = np.searchsorted(np.unique(plane[own]), plane[own])
    for p in range(len(group)):
        slots = group.plane_slots[p]
        moves = ", ".join(str(int(way)) for way in group.moves[p])
        yield (
            f"{{{group.joint_a[p]}, {group.joint_b[p]}, bodies_{row}[{body[p]}], "
            f"planes_{row}_{slots}[{plane[p]}], {prefix}_pair_{group.vertex_slots}_{slots}, "
            f"{_number(earlier)}, {{{moves}}}}}"
        )


def _of_numbers(numbers: Numbers) -> dict[str, str]:
    return {
        "count": str(TEST_CONFIGURATIONS),
        "q": _row(map(_braced, numbers.q)),
        "poses": _row(map(_braced, numbers.obstacles)),
        "expected_poses": _row(map(_braced, numbers.poses)),
        "distance": _row(map(_braced, numbers.distance)),
        "slope": _row(map(_braced, numbers.slope)),
        "penalty": _row(map(_number, numbers.penalty)),
        "pull": _row(map(_braced, numbers.pull)),
    }


def _braced(values: Array) -> str:
    return f"{{{_row(map(_number, values.ravel()))}}}"


def _row(parts: Iterable[str]) -> str:
    """Join the entries of a table; an empty one has a zero, as C has no empty initializers."""
    return ",\n".join(parts) or "0"


def _number(value: Any) -> str:
    """Return the double with its exact value in C."""
    number = float(value)
    if np.isinf(number):
        return "INFINITY" if number > 0 else "-INFINITY"
    return repr(number)


def _text(name: Sequence[str] | str) -> str:
    """Return a name as a C string; ? is escaped, as two of them may begin a trigraph."""
    return json.dumps(name).replace("?", "\\?")
