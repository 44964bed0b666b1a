"""The verdict on an accepted proof: what is proven, what is not, and on which assumptions."""

from __future__ import annotations

from decimal import ROUND_DOWN, Decimal
from typing import Any

from .balls import named, shown
from .effects import check_claims, wanted
from .world import World

ASSUMES = """the world is the robot and its surroundings: links are rigid, and their bodies; joints have no play
the robot follows the curve of the motion, without rounding its corners
obstacles are what and where the world says, and move as it says; what a link holds is fixed to it
joints that do not move stay where the world says
links and held objects that need not be compared, for the reasons listed, may touch
a mesh is its triangles and what they enclose; no link of the robot lies within another one, apart from its surface
the computer's + - x / and square root are those of IEEE 754, rounded to nearest
Python and NumPy work"""


def statement(world: World, head: dict[str, Any]) -> tuple[str, bool]:
    """Check what a proof claims beside clearances; say what is proven and what is not, and whether that is all."""
    check_claims(world, head)
    return in_words(world, head)


def in_words(world: World, head: dict[str, Any]) -> tuple[str, bool]:
    """The proven statement and what is not proven, after the check, and whether that is all."""
    claims = [str(x) for x in head["claims"]]
    missing = [x for x in wanted(world) if x not in claims] + [str(x) for x in world.also]
    for key, clearance, where in (("clearance", world.usual, "obstacles"), ("self_clearance", world.among, "links")):
        if (head[key] or clearance) < clearance and key not in claims:
            missing.append(f"a clearance of {digits(clearance, 1000)} mm ({where})")
    lines = [f"accepted in part; NOT proven by this file: {', '.join(missing)}"] * bool(missing) or ["accepted"]
    lines[0] += f": over the whole motion of {len(world.rows)} rows" * (not missing)
    usual = world.usual if "clearance" in claims else 0.0
    least = {x.name: world.clearances.get(x.name, usual) for x in world.pieces if x.kind == "obstacle"}
    own = "".join(
        f"; {millimetres(x)} from obstacle {named(name)}" for name, x in least.items() if x > (head["clearance"] or 0.0)
    )
    for key, what in (("clearance", "from every obstacle"), ("self_clearance", "from one another")):
        if head[key]:
            more = own if key == "clearance" else ""
            lines.append(f"  links and held objects are at least {millimetres(head[key])} {what}{more}")
    lines += [f"  also proven: {', '.join(claims)}"] * bool(claims)
    lines += curves(world) if "path" in claims else []
    for reason in dict.fromkeys(world.left_out.values()):
        pairs = sorted({"-".join(map(named, sorted(x))) for x, why in world.left_out.items() if why == reason})
        lines.append(f"  not compared, {reason}: {', '.join(pairs)}")
    still = [x for i, x in enumerate(world.pieces) if x.joint == -1 and not world.leaving[i]]
    kinds = [dict.fromkeys(named(x.name) for x in still if (x.kind == "obstacle") == own) for own in (False, True)]
    if all(kinds):
        lines.append(f"  not compared, both stand still: {' and obstacles '.join(map(', '.join, kinds))}")
    for end, targets in (("start", world.start), ("goal", world.goal)):
        for rates in [x["velocity"] for x in targets if "velocity" in x]:
            moving = (f"{named(world.joints[i].name)} at {digits(x)}" for i, x in zip(world.lead, rates, strict=True))
            lines.append(f"  moving at the {end}: {', '.join(moving)} (rad or m per second)")
    lines += unknown(world)
    rules = [(x.name, *x.follows) for x in world.joints if x.follows]
    following = (
        f"{named(name)} at {digits(k)} x {named(world.joints[i].name)} + {digits(add)}" for name, i, k, add in rules
    )
    lines += [f"  following: {', '.join(following)}"] * bool(rules)
    held = (f"{named(name)} at {digits(at)}" for name, at in world.held.items())
    lines += [f"  held: {', '.join(held)}"] * bool(world.held)
    assumed = ["  if:", *(f"    {line}" for line in ASSUMES.splitlines())]
    return "\n".join([*map(shown, lines), *assumed]), not missing


def curves(world: World) -> list[str]:
    """The statement on curves that are followed."""
    found = []
    for x in (x for x in world.path if x["kind"] == "follow"):
        within = f"{millimetres(x['position_tolerance'])} and {digits(x['orientation_tolerance'])} rad"
        free = "" if x["free"] == "none" else f", free about {x['free']}"
        radii = ((x["begin_tolerance"], "beginning"), (x["end_tolerance"], "end"))
        but = "".join(f", but within {millimetres(r)} of its {end}" for r, end in radii if r is not None)
        rates = ((x["speed"], "m/s"), (x["acceleration"], "m/s^2"))
        most = "".join(f", at most {digits(y)} {unit}" for y, unit in rates if y is not None)
        poses = f"{len(x['poses'])} poses"
        found.append(f"  {named(x['link'])} follows its curve of {poses} within {within}{free}{but}{most}")
    return found


def unknown(world: World) -> list[str]:
    """The statement on all worlds that differ by no more than these sizes."""
    sizes = world.unknown
    if sizes is None:
        return []
    turned = "up to {} m, {} rad about its origin"
    found = [
        f"obstacle {named(name)} is {turned.format(digits(shift), digits(turn))} and {digits(speed)} m/s away"
        for name, (shift, turn, speed) in sizes.around.items()
    ]
    if sizes.base.any():
        found.append(f"the robot's base is {turned.format(*map(digits, sizes.base))} away")
    for off, unit in ((sizes.joints, "rad or m"), (sizes.rates, "rad/s or m/s")):
        each = (f"{named(x.name)} by {digits(y)}" for x, y in zip(world.joints, off, strict=True) if y)
        found += [f"joints are off by up to {', '.join(each)} ({unit})"] * bool(off.any())
    return ["  in every world in which:", *(f"    {line}" for line in found)]


def millimetres(metres: float) -> str:
    """A length, rounded down to the nanometre."""
    return f"{(Decimal(metres) * 1000).quantize(Decimal('1e-6'), ROUND_DOWN).normalize():f} mm"


def digits(number: float, unit: int = 1) -> str:
    """A number in the digits that tell it from all other doubles, or as many units."""
    return f"{(Decimal(repr(float(number))) * unit).normalize():f}"
