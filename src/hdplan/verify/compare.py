"""Two worlds, written by programs that share nothing, must be equal number by number."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np

from .balls import RejectedError, need, up
from .world import OFF

SAME_CURVE = 0.25  # of the tolerances: so far apart may be two curves of poses that are one

# numbers that were worked out, where a group has `off`
WORKED_OUT = (
    *("rotation", "position", "axis", "follows", "way", "values"),
    *("mass", "moment", "inertia", "points", "sweep", "tolerance"),
)


def check_equal(read: Any, claimed: Any, slack: float = 0.0) -> None:
    """Reject, with the first difference, unless the world that the checker has `read` equals the `claimed` one of the
    proof: computed numbers, in a group with `off`, up to the sum of both, all others to the last bit, or up to `slack`.
    In place of a mesh, or of camera data, the proof may have its `digest`; that of camera data has the rows that are
    left out beside it."""
    _same(read, claimed, "", slack, slack)


def check_curves(read: list[Any], claimed: list[Any]) -> None:
    """Reject unless the curve of poses that is read is the one that the proof claims, which may have other
    chords: all poses of each are within SAME_CURVE of the tolerances of the other."""
    one, other = ([x for x in each if x.get("kind") == "follow"] for each in (read, claimed))
    need(len(one) == len(other) == 1, "the worlds differ: path: another curve")
    both = [{key: each[0].get(key) for key in ("link", "free", "speed", "acceleration")} for each in (one, other)]
    need(both[0] == both[1], f"the worlds differ: path: {both[0]} is read, the proof has {both[1]}")
    for key in ("position_tolerance", "orientation_tolerance", "begin_tolerance", "end_tolerance"):
        least, most = sorted((x[0][key] is not None, x[0][key]) for x in (one, other))
        good = least[0] == most[0] and (not least[0] or least[1] >= most[1] * (1 - SAME_CURVE))
        need(good, f"the worlds differ: path.{key}")
    axes = [0, 1, 2] if one[0]["free"] == "none" else ["xyz".index(one[0]["free"])]
    sides = list[Any]()
    for each in (one[0], other[0]):
        turns = np.array([x["rotation"] for x in each["poses"]]).reshape(-1, 3, 3)[:, :, axes]
        turns = turns.reshape(-1, 3 * len(axes))
        places = np.array([x["position"] for x in each["poses"]])
        sides.append(
            np.concatenate([places / one[0]["position_tolerance"], turns / one[0]["orientation_tolerance"]], 1)
        )
    for points, line in (sides, sides[::-1]):
        begins, ways = line[:-1], np.diff(line, axis=0)
        squares = np.maximum((ways * ways).sum(axis=1), 1e-300)
        for point in points:
            off = point - begins
            share = np.clip((off * ways).sum(axis=1) / squares, 0.0, 1.0)
            away = ((off - share[:, None] * ways) ** 2).sum(axis=1).min()
            need(away <= SAME_CURVE**2, "the worlds differ: path: another curve")


def digest(shape: dict[str, Any]) -> dict[str, str]:
    """The name of a mesh, or of balls, in a proof: the SHA-256 of the number of its points, in decimal digits with a
    space after them, of the points, and of the triangles, or of the balls' radii along the three axes, as numbers of
    eight bytes, little-endian; -0 is 0."""
    points = np.array(shape["points"], "<f8") + 0.0
    rest = np.array(shape["sweep"], "<f8") + 0.0 if balls(shape) else np.array(shape["parts"], "<i8")
    content = f"{len(points)} ".encode() + points.tobytes() + rest.tobytes()
    return {"sha256": hashlib.sha256(content).hexdigest()}


def triangles(shape: dict[str, Any]) -> bool:
    """True if a shape is a mesh: its parts have three points each, and nothing sweeps them."""
    parts = shape.get("parts")
    return parts is not None and len(parts) > 0 and len(parts[0]) == 3 and not np.any(shape["sweep"])


def balls(shape: dict[str, Any]) -> bool:
    """True if a shape is what was seen: its parts have one point each."""
    parts = shape.get("parts")
    return parts is not None and len(parts) > 0 and len(parts[0]) == 1


def plain(value: Any) -> Any:
    """The form in JSON of a table of numbers that a world has as an array."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f"a world holds no {type(value).__name__}")


def _same(read: Any, claimed: Any, where: str, off: float, least: float) -> None:
    if isinstance(read, np.ndarray) or isinstance(claimed, np.ndarray):  # tables, as a reader may have large ones
        if type(read) is type(claimed) and np.array_equal(read, claimed):
            return
        if type(read) is np.ndarray and read.dtype == np.float64 and _near_table(read, claimed, off):
            return
        read, claimed = (x.tolist() if isinstance(x, np.ndarray) else x for x in (read, claimed))
        if _alike(read, claimed, off):
            return
    seen, differ = isinstance(read, dict) and balls(read), f"the worlds differ: {where}"
    if isinstance(read, dict) and isinstance(claimed, dict) and "sha256" in claimed and (seen or triangles(read)):
        rows = {"left_out": claimed.get("left_out")} if seen else {}  # which the reader has used
        same = claimed == {**digest(read), **rows}
        need(same, f"{differ}: the numbers that are read have another SHA-256")
    elif isinstance(read, dict) and isinstance(claimed, dict):
        if read.keys() != claimed.keys():
            raise RejectedError(f"the worlds differ: {where or 'their keys'}: {_keys(read, claimed)}")
        slack = _off(read, where) + _off(claimed, where) if "off" in read else 0.0
        for key, one in read.items():
            two = claimed[key]
            more = slack + least if key in WORKED_OUT else least
            if key != "off" and not _alike(one, two, more):
                _same(one, two, f"{where}.{key}" if where else str(key), more, least)
    elif isinstance(read, list) and isinstance(claimed, list):
        need(len(read) == len(claimed), f"{differ}: {len(read)} entries are read, the proof has {len(claimed)}")
        for i, (one, two) in enumerate(zip(read, claimed, strict=True)):
            if not _alike(one, two, off):
                _same(one, two, f"{where}[{_name(one, i)}]", off, least)
    elif type(read) in (int, float) and type(claimed) in (int, float):
        same = read == claimed or abs(read - claimed) <= up(off)
        need(same, f"{differ}: {read!r} is read, the proof has {claimed!r}")
    else:
        same = type(read) is type(claimed) and read == claimed
        need(same, f"{differ}: {_word(read)} is read, the proof has {_word(claimed)}")


def _alike(read: Any, claimed: Any, off: float) -> bool:
    """True if two words, numbers, or rows of numbers surely are as near as they must be, as nearly all are; of others
    the first difference counts."""
    if type(read) is not type(claimed) or type(read) not in (str, int, float, list, type(None)):
        return False
    if type(read) is not list or {*map(type, read), *map(type, claimed)} != {float}:
        return not (type(read) is list and read and type(read[0]) is dict) and bool(read == claimed)
    return len(read) == len(claimed) and all(abs(one - two) <= off for one, two in zip(read, claimed, strict=True))


def _near_table(read: Any, claimed: Any, off: float) -> bool:
    """True if a table surely is as near as it must be to the one that the proof has."""
    try:
        other = np.asarray(claimed, dtype=np.float64)
    except (TypeError, ValueError):  # of no numbers, or of rows of several lengths
        return False
    return read.shape == other.shape and bool((np.abs(read - other) <= off).all())


def _off(group: dict[str, Any], where: str) -> float:
    off = group["off"]
    if not (type(off) in (int, float) and 0 <= off <= OFF):
        raise RejectedError(f"the worlds differ: {where}.off: is not within 0 and {OFF:g}")
    return float(off)


def _keys(read: dict[str, Any], claimed: dict[str, Any]) -> str:
    more, less = sorted({*read} - {*claimed}), sorted({*claimed} - {*read})
    found = [f"'{x}' is read, the proof has none" for x in more[:1]]
    return "; ".join(found + [f"the proof has '{x}', none is read" for x in less[:1]])


def _name(entry: Any, place: int) -> Any:
    if not isinstance(entry, dict):
        return place
    return f"{'obstacle ' * (entry.get('kind') == 'obstacle')}{entry.get('name', place)}"


def _word(value: Any) -> str:
    return "a mapping" if isinstance(value, dict) else "a list" if isinstance(value, list) else repr(value)
