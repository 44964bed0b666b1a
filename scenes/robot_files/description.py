"""The content of URDF and SRDF files, without geometry: tree of links, mimic joints, groups, named states, disabled
pairs.

A URDF becomes a `Tree`, an SRDF `Semantics`; errors name the file and what is wrong in it.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from hdplan.scenes.errors import InputError, naming, nearest
from hdplan.scenes.files import Stamps, read_file, stamps_of
from hdplan.scenes.number_text import read_number
from hdplan.scenes.once import made_once
from hdplan.scenes.poses import Pose, compose
from hdplan.scenes.robot_files.degrees import angles_in_degrees
from hdplan.scenes.robot_files.link_pairs import LinkPair, link_pair
from hdplan.scenes.robot_files.source import Source
from hdplan.scenes.robot_files.srdf_words import check_srdf_words
from hdplan.scenes.robot_files.urdf_check import check_urdf, impossible_inertias, read_origin
from hdplan.scenes.robot_files.urdf_text import read_description
from hdplan.scenes.robot_files.urdf_words import check_shapes, check_soft_limits, check_urdf_words
from hdplan.scenes.robot_files.xml_text import DEEPEST_LEVEL, parse

KEPT_DESCRIPTIONS = 8  # descriptions kept in memory


@dataclass(frozen=True)
class Tree:
    """The URDF's tree of links."""

    links: tuple[str, ...]
    parent: Mapping[str, tuple[str, str]]  # child link -> (parent link, joint between them)
    mimics: Mapping[str, tuple[str, float, float]]  # joint -> (joint that it mimics, multiplier, offset)
    collisions: int  # number of collision geometries
    name: str = ""  # of the robot
    fixed: Mapping[str, Pose] = field(default_factory=dict)  # child link of a fixed joint -> pose in its parent
    notes: tuple[str, ...] = ()  # what was ignored
    files: tuple[Path, ...] = ()  # its sources
    excluded: frozenset[LinkPair] = frozenset()  # pairs that are not checked, where the description itself says so
    impossible: tuple[str, ...] = ()  # links with an inertia that no body has
    solid: frozenset[str] = frozenset()  # links with collision geometry
    velocities: Mapping[str, str] = field(default_factory=dict)  # joint -> its velocity limit, as the URDF writes it

    def chain(self, tip: str, base: str) -> tuple[str, ...]:
        """Return the joints of a chain as MoveIt defines it: those from the tip up to the base (or the root). If the
        base is not an ancestor of the tip, also those from the base up to their lowest common ancestor, and its own
        joint."""
        joints: list[str] = []
        while tip != base and tip in self.parent:
            tip, joint = self.parent[tip]
            joints.append(joint)
        if tip == base:
            return tuple(joints)
        others: list[str] = []
        while base in self.parent and self.parent[base][1] not in joints:
            base, joint = self.parent[base]
            others.append(joint)
        if base in self.parent:
            joints = joints[: joints.index(self.parent[base][1]) + 1]
        return (*joints, *others)

    def standing(self) -> dict[str, Pose]:
        """Return the poses, in the root link's frame, of the links that no joint moves, including the root."""
        below: dict[str, list[str]] = {}
        for link in self.fixed:
            below.setdefault(self.parent[link][0], []).append(link)
        found = {link: Pose() for link in self.links if link not in self.parent}
        waiting = list(found)
        while waiting:
            above = waiting.pop()
            for link in below.get(above, ()):
                found[link] = compose(found[above], self.fixed[link])
                waiting.append(link)
        return found

    @property
    def joints(self) -> tuple[str, ...]:
        """All joints, fixed ones too."""
        return tuple(joint for _, joint in self.parent.values())

    def between(self, a: str, b: str) -> tuple[str, ...]:
        """Return the links on the path from link `a` to link `b`, without these two."""
        above_a, above_b = self._upward(a), self._upward(b)
        shared = [link for link in above_a if link in above_b]
        way = [link for link in (*above_a, *above_b) if link not in shared]
        return tuple(link for link in (*way, *shared[:1]) if link not in (a, b))

    def _upward(self, link: str) -> list[str]:
        """Return the links from a link up to the root."""
        found = [link]
        while found[-1] in self.parent:
            found.append(self.parent[found[-1]][0])
        return found


@dataclass(frozen=True)
class EndEffector:
    """A hand or tool, as an SRDF names it."""

    name: str
    link: str  # of the arm, that carries it
    group: str  # its own joints
    parent_group: str  # of the arm; empty where the SRDF does not say


@dataclass(frozen=True)
class Semantics:
    """The part of a description that an SRDF adds to a URDF."""

    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # group -> its joints, fixed ones included
    states: Mapping[str, Mapping[str, Mapping[str, float]]] = field(default_factory=dict)
    """Named state -> group that has a state of this name -> joint -> value."""
    end_effectors: tuple[EndEffector, ...] = ()
    disabled: frozenset[LinkPair] = frozenset()  # pairs that are not checked
    passive: frozenset[str] = frozenset()  # joints that nothing drives
    notes: tuple[str, ...] = ()  # what was ignored

    def group(self, requested: str, robot: Collection[str]) -> str:
        """Return the name of a group, requested by that name or with the robot's name before it (`panda_arm`: arm).

        Raises InputError with the nearest name.
        """
        names = (requested, *(requested.removeprefix(f"{name}_") for name in robot))
        for name in names:
            if name in self.groups:
                return name
        raise InputError(f"unknown group '{requested}'{nearest(min(names, key=len), self.groups)}")

    def named_states(self, group: str | None) -> dict[str, dict[str, float]]:
        """Return the values (joint -> value) of every named state, looked up in one group first: of a joint that the
        state of that name has in several groups, this one's value counts, or else the last one's."""
        found: dict[str, dict[str, float]] = {}
        for name, states in self.states.items():
            ordered = sorted(states.items(), key=lambda each: each[0] == group)  # stable
            found[name] = {joint: value for _, state in ordered for joint, value in state.items()}
        return found


def read_words(source: Source, srdf: Path | None) -> tuple[Tree, Semantics]:
    """Read the description and the SRDF of a robot, empty without one; a plain URDF only once, while the files do not
    change."""
    if source.urdf.suffix.lower() != ".urdf":  # others may include files
        return _read_words(source, srdf)
    return _kept_words(source, srdf, stamps_of(file for file in (source.urdf, srdf) if file))


def _read_words(source: Source, srdf: Path | None) -> tuple[Tree, Semantics]:
    tree = read_tree(source)
    return tree, Semantics() if srdf is None else read_semantics(srdf, tree)


@made_once(KEPT_DESCRIPTIONS)
def _kept_words(source: Source, srdf: Path | None, stamps: Stamps) -> tuple[Tree, Semantics]:
    return _read_words(source, srdf)


def read_tree(source: Source) -> Tree:
    """Read the links and joints of a URDF, or of what can be had as one, on the joints of a mobile base, if any. Raises
    InputError for a file that is missing, not XML, or faulty."""
    description = read_description(source)
    root = description.root
    with naming(f"robot.urdf: {source.urdf}"):
        notes = (*description.notes, *check_urdf_words(root), *check_shapes(root))
        check_urdf(root)
        impossible = impossible_inertias(root)
        notes = (*notes, *check_soft_limits(root), *angles_in_degrees(root))
    parent: dict[str, tuple[str, str]] = {}
    fixed: dict[str, Pose] = {}
    mimics: dict[str, tuple[str, float, float]] = {}
    for joint in root.findall("joint"):
        above, below, mimic = joint.find("parent"), joint.find("child"), joint.find("mimic")
        if above is not None and below is not None:
            parent[below.get("link", "")] = (above.get("link", ""), joint.get("name", ""))
            if joint.get("type") == "fixed":
                with naming(f"robot.urdf: {source.urdf}"):
                    fixed[below.get("link", "")] = read_origin(joint, f"joint '{joint.get('name')}'")
        if mimic is not None:
            factor, offset = (
                read_number(mimic.get(key, value).strip()) for key, value in (("multiplier", "1"), ("offset", "0"))
            )
            mimics[joint.get("name", "")] = (mimic.get("joint", ""), factor, offset)
    limits = {joint.get("name", ""): joint.find("limit") for joint in root.findall("joint")}
    return Tree(
        links=tuple(link.get("name", "") for link in root.findall("link")),
        parent=parent,
        mimics=mimics,
        collisions=len(root.findall("link/collision")),
        name=root.get("name", ""),
        fixed=fixed,
        notes=notes,
        files=description.files,
        excluded=description.excluded,
        impossible=impossible,
        solid=frozenset(link.get("name", "") for link in root.findall("link") if link.find("collision") is not None),
        velocities={joint: limit.get("velocity", "") for joint, limit in limits.items() if limit is not None},
    )


def read_semantics(path: Path, tree: Tree) -> Semantics:
    """Read an SRDF file. Raises InputError for a file that is missing or not XML, a group that contains itself or is
    there twice, or a state that is not a number."""
    with naming(f"robot.srdf: {path}"):
        root = parse(read_file(path), ("robot",))
        notes = check_srdf_words(root, tree.links, tree.joints)
        groups = _groups(root, tree)
        states = _states(root, tree)
    hands = tuple(
        EndEffector(*(hand.get(key, "") for key in ("name", "parent_link", "group", "parent_group")))
        for hand in root.findall("end_effector")
    )
    passive = frozenset(joint.get("name", "") for joint in root.findall("passive_joint"))
    return Semantics(groups, states, hands, _disabled(root, tree.links), passive, notes)


def _disabled(root: ElementTree.Element, links: Collection[str]) -> frozenset[LinkPair]:
    """Return the pairs that an SRDF disables: all those of a link, but for the ones that it enables, and each by name,
    whatever is enabled (as MoveIt reads them)."""

    def pairs(tag: str) -> set[LinkPair]:
        return {link_pair(each.get("link1", ""), each.get("link2", "")) for each in root.findall(tag)}

    off = {each.get("link", "") for each in root.findall("disable_default_collisions")} & {*links}
    by_link = {link_pair(link, other) for link in off for other in links if other != link}
    return frozenset((by_link - pairs("enable_collisions")) | pairs("disable_collisions"))


def _groups(root: ElementTree.Element, tree: Tree) -> dict[str, tuple[str, ...]]:
    """Return every group's joints: those it names, those above the links it names, of its chains and of its groups."""
    elements = {group.get("name", ""): group for group in root.findall("group")}

    known: dict[str, list[str]] = {}

    def joints(name: str, above: tuple[str, ...] = ()) -> list[str]:
        if name in known:
            return known[name]
        if len(above) > DEEPEST_LEVEL:
            raise InputError(f"group '{above[0]}': groups within groups, more than {DEEPEST_LEVEL} levels deep")
        if name in above:
            circle = " contains ".join(f"'{each}'" for each in (*above[above.index(name) :], name))
            raise InputError(f"group '{name}': contains itself: {circle}")
        found: list[str] = []
        for entry in elements.get(name, ()):
            match entry.tag:
                case "joint":
                    found.append(entry.get("name", ""))
                case "link" if entry.get("name") in tree.parent:
                    found.append(tree.parent[entry.get("name", "")][1])
                case "chain" if {entry.get("base_link"), entry.get("tip_link")} <= {*tree.links}:
                    found.extend(reversed(tree.chain(entry.get("tip_link", ""), entry.get("base_link", ""))))
                case "group":
                    found.extend(joints(entry.get("name", ""), (*above, name)))
        return known.setdefault(name, list(dict.fromkeys(found)))

    return {name: tuple(joints(name)) for name in elements}


def _states(root: ElementTree.Element, tree: Tree) -> dict[str, dict[str, dict[str, float]]]:
    moving = {joint for child, (_, joint) in tree.parent.items() if child not in tree.fixed}
    states: dict[str, dict[str, dict[str, float]]] = {}
    for state in root.findall("group_state"):
        name = state.get("name", "")
        for joint in state.findall("joint"):
            value = (joint.get("value") or "").split()
            if len(value) != 1 and joint.get("name") in moving:
                found = f"{len(value)} values" if value else "no value"
                raise InputError(f"state '{name}', joint '{joint.get('name')}': one number is needed, found {found}")
            if len(value) != 1:
                continue  # a joint of the SRDF alone, of several coordinates (a floating base), is not planned here
            try:
                number = read_number(value[0])
            except ValueError:
                number = math.nan
            if not math.isfinite(number):
                raise InputError(f"state '{name}', joint '{joint.get('name')}': '{value[0]}' is not a number")
            own = states.setdefault(name, {}).setdefault(state.get("group", ""), {})
            own[joint.get("name", "")] = number
    return states
