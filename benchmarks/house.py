"""Draw the house: the rooms of the code and what each imports, from the imports themselves.

    python benchmarks/house.py        # writes docs/house.svg

Rooms stand above everything that they import; an arrow that follows from others is left out. The rooms and their order
are those of tests/test_architecture.py, which also holds the picture to be fresh.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PICTURE = ROOT / "docs" / "house.svg"

WIDTH, HEIGHT, ACROSS, UP = 172, 34, 196, 84  # of a room, and from room to room
ASIDE = 14  # from floor to floor, so that an arrow past a room does not seem to begin in it
COLORS = {"scenes": "#dcebd7", "distance": "#d9e4f5", "planner": "#f6e6cf"}


def picture(rooms: list[str], arrows: dict[str, set[str]]) -> str:
    """Return the house as SVG: `rooms` from the ground up, `arrows` from each room to those that it imports."""
    reached: dict[str, set[str]] = {}
    floors: dict[str, int] = {}
    for room in rooms:
        below = arrows.get(room, set())
        reached[room] = below.union(*(reached[other] for other in below))
        floors[room] = 1 + max((floors[other] for other in below), default=-1)
    places = _places(rooms, floors)
    height = UP * (max(floors.values()) + 1)
    width = 4 * ASIDE + ACROSS * max(list(floors.values()).count(floor) for floor in floors.values())
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" '
        'font-size="13">',
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<path d="M0 0L8 4L0 8z" fill="#666"/></marker></defs>',
    ]
    for room in rooms:
        direct = arrows.get(room, set())
        for other in sorted(direct - set().union(*(reached[each] for each in direct))):
            (x, y), (u, v) = places[room], places[other]
            y, v = y + HEIGHT / 2, v - HEIGHT / 2
            bend = (v - y) / 2
            lines.append(
                f'<path d="M{x:g} {y:g}C{x:g} {y + bend:g} {u:g} {v - bend:g} {u:g} {v:g}" fill="none" stroke="#666" '
                f'marker-end="url(#tip)"><title>{room} imports {other}</title></path>'
            )
    for room in rooms:
        x, y = places[room]
        lines.append(
            f'<rect x="{x - WIDTH / 2:g}" y="{y - HEIGHT / 2:g}" width="{WIDTH}" height="{HEIGHT}" rx="6" '
            f'fill="{COLORS[room.split(".")[0]]}" stroke="#888"/>'
            f'<text x="{x:g}" y="{y + 4:g}" text-anchor="middle">{room}</text>'
        )
    return "\n".join([*lines, "</svg>", ""])


def _places(rooms: list[str], floors: dict[str, int]) -> dict[str, tuple[float, float]]:
    """Return the centre of each room: floors from the bottom up, the rooms of a floor side by side about the middle."""
    top = max(floors.values())
    most = max(list(floors.values()).count(floor) for floor in floors.values())
    places = {}
    for floor in range(top + 1):
        beside = [room for room in rooms if floors[room] == floor]
        for place, room in enumerate(beside):
            x = ACROSS * (most / 2 + place - (len(beside) - 1) / 2) + ASIDE * (floor % 5)
            places[room] = (x, UP * (top - floor + 0.5))
    return places


def measured() -> tuple[list[str], dict[str, set[str]]]:
    """Return the rooms from the ground up, and the rooms that each imports, as the architecture test finds them."""
    spec = importlib.util.spec_from_file_location("architecture", ROOT / "tests" / "test_architecture.py")
    assert spec is not None
    assert spec.loader is not None
    house = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(house)
    arrows: dict[str, set[str]] = {room: set() for room in house.ROOMS}
    for module in sorted(set(house.MODULES) - set(house.DOORS)):
        arrows[house.room_of(module)] |= house.imported(module)
    return list(house.ROOMS), arrows


if __name__ == "__main__":
    PICTURE.write_text(picture(*measured()), encoding="utf-8")
