"""The pairs of links and held objects that need not be kept apart, each with its reason."""

from __future__ import annotations

from typing import Any

from . import scene as scenes
from .balls import need
from .joints import Joints
from .other_robot import OtherRobot
from .text import listing


def not_compared(joints: Joints, bodies: list[Any], touching: set[frozenset[str]], off: bool) -> list[Any]:
    """Every pair of links and held objects that need not be kept apart, with its reason; `touching`: held objects and
    the links that they may touch; `off`: links are not checked against each other."""
    kinds = {x["name"]: (x["kind"], x["joint"]) for x in bodies}
    stated = {key: _named(joints, key) for key in ("ignore_pairs", "check_pairs")}
    found, listed = [], sorted(kinds)
    for i, one in enumerate(listed):
        for two in listed[i + 1 :]:
            (kind, a), (other, b), pair = kinds[one], kinds[two], frozenset((one, two))
            if off or a == b:
                reason: str | None = "self_collision: false" if off else "moving as one"
            else:
                reason = _of_links(joints, one, two, stated) if kind == other == "link" else None
                reason = reason or ("touch_links" if pair in touching else None)
            found += [[one, two, reason]] * bool(reason)
    return found


def check_left_out(robot: OtherRobot, touching: set[frozenset[str]], off: bool) -> None:
    """Reject pairs that the world of a proof leaves out by a word of the scene's that is not there."""
    there = {"touch_links": touching, "robot.ignore_pairs": _named(robot, "ignore_pairs")}
    for one, two, reason in robot.claimed["not_compared"]:
        named = off if reason == "self_collision: false" else frozenset((one, two)) in there.get(reason, [{one, two}])
        need(named, f"{one} and {two}: are left out by {reason}, which does not name them")


def _named(joints: Joints | OtherRobot, key: str) -> set[frozenset[str]]:
    """The pairs of links that the robot section names."""
    pairs = [[scenes.word(y, key) for y in listing(x, key)] for x in listing(joints.spec.get(key), key)]
    links = {*joints.at}
    need(all(len({*x}) == 2 == len(x) and {*x} <= links for x in pairs), f"robot.{key}: pairs of links")
    return {frozenset(x) for x in pairs}


def _of_links(joints: Joints, one: str, two: str, stated: dict[str, set[frozenset[str]]]) -> str | None:
    """Why two links that do not move as one need not be kept apart; None if they must be."""
    pair, tree = frozenset((one, two)), joints.tree
    if pair in stated["check_pairs"]:
        return None
    if pair in stated["ignore_pairs"]:
        return "robot.ignore_pairs"
    if pair in joints.semantics.disabled:
        return "the SRDF"
    a, b = joints.at[one][0], joints.at[two][0]
    parents = [joints.frames[joints.moving[x]][0] if x >= 0 else None for x in (a, b)]
    near = (parents[0] == b or parents[1] == a) and not tree.between(one, two) & tree.solid
    return "neighbours" if near else None
