"""Two worlds, written by programs that share nothing, must be equal number by number."""

from __future__ import annotations

from typing import Any

from .balls import need, up
from .world import OFF

# numbers that were worked out, where a group has `off`
WORKED_OUT = ("rotation", "position", "axis", "follows", "mass", "moment", "inertia", "points", "tolerance")


def check_equal(read: Any, told: Any) -> None:
    """Reject, with the first difference, unless the world that the checker `read` and the one that the proof's writer
    `told` are equal: numbers that were worked out, in a group with `off`, up to the sum of both, all others to the last
    bit."""
    _same(read, told, "", 0.0)


def _same(read: Any, told: Any, where: str, off: float) -> None:
    if isinstance(read, dict) and isinstance(told, dict):
        need(read.keys() == told.keys(), f"the worlds differ: {where or 'their keys'}: {_keys(read, told)}")
        slack = _off(read, where) + _off(told, where) if "off" in read else 0.0
        for key in read:
            if key != "off":
                _same(read[key], told[key], f"{where}.{key}" if where else str(key), slack * (key in WORKED_OUT))
    elif isinstance(read, list) and read == told:  # as nearly all are, and lists compare fast
        return
    elif isinstance(read, list) and isinstance(told, list):
        need(
            len(read) == len(told),
            f"the worlds differ: {where}: {len(read)} entries are read, the proof has {len(told)}",
        )
        for i, (one, two) in enumerate(zip(read, told, strict=True)):
            _same(one, two, f"{where}[{_name(one, i)}]", off)
    elif type(read) in (int, float) and type(told) in (int, float):
        same = read == told or abs(read - told) <= up(off)
        need(same, f"the worlds differ: {where}: {read!r} is read, the proof has {told!r}")
    else:
        need(
            type(read) is type(told) and read == told,
            f"the worlds differ: {where}: {_word(read)} is read, the proof has {_word(told)}",
        )


def _off(group: dict[str, Any], where: str) -> float:
    off = group["off"]
    need(type(off) in (int, float) and 0 <= off <= OFF, f"the worlds differ: {where}.off: is not within 0 and {OFF:g}")
    return float(off)


def _keys(read: dict[str, Any], told: dict[str, Any]) -> str:
    more, less = sorted({*read} - {*told}), sorted({*told} - {*read})
    return "; ".join(
        [f"'{x}' is read, the proof has none" for x in more[:1]]
        + [f"the proof has '{x}', none is read" for x in less[:1]]
    )


def _name(entry: Any, place: int) -> Any:
    if not isinstance(entry, dict):
        return place
    return f"{'obstacle ' * (entry.get('kind') == 'obstacle')}{entry.get('name', place)}"


def _word(value: Any) -> str:
    return "a mapping" if isinstance(value, dict) else "a list" if isinstance(value, list) else repr(value)
