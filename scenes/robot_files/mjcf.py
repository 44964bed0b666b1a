"""MJCF, MuJoCo's robot descriptions, as URDF.

Pinocchio has a reader of MJCF, but it takes the range of a joint that slides for degrees, leaves out where the first
body stands, and says nothing of what it passes over. So bodies, joints and geoms become URDF here, and whatever of
them has no counterpart there is refused by its name (`mjcf_words`). Lengths [m]; angles as the file's compiler says.

MuJoCo's meaning: https://mujoco.readthedocs.io/en/stable/XMLreference.html
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError, listed, nearest
from hdplan.scenes.poses import Pose, compose
from hdplan.scenes.robot_files.link_pairs import LinkPair, link_pair
from hdplan.scenes.robot_files.mjcf_classes import DEFAULT_CLASS, DefaultClasses
from hdplan.scenes.robot_files.mjcf_couplings import add_mimics
from hdplan.scenes.robot_files.mjcf_geoms import Geoms
from hdplan.scenes.robot_files.mjcf_includes import with_includes
from hdplan.scenes.robot_files.mjcf_masses import inertial_of, why_not_known
from hdplan.scenes.robot_files.mjcf_values import Attributes, Settings, about, choice, flag, numbers, vector
from hdplan.scenes.robot_files.mjcf_words import called, check_mjcf_words
from hdplan.scenes.robot_files.urdf_writing import add_joint, words

SLIDE_LIMIT = 1e6  # [rad] or [m] a limit in a URDF that stands for none: it has no slides without limits
WORLD = "world"


@dataclass(frozen=True)
class Converted:
    """A model as URDF."""

    root: Element
    files: tuple[Path, ...] = ()  # that it includes
    excluded: frozenset[LinkPair] = frozenset()  # pairs of links that its `contact` section excludes
    notes: tuple[str, ...] = ()


def as_urdf(root: Element, path: Path) -> Converted:
    """Return a model as URDF; its joints have MuJoCo's coordinates, so that they are at `ref` where it is drawn.

    Bodies with a free joint are held where they stand. If the masses are not those of the `inertial` elements, none
    are given, and so no torques. Changes `root`.

    Raises:
        InputError: an element, joint or geom that URDF cannot say; a word that is not MJCF's; a number that is none; a
            file that cannot be included.
    """
    files = with_includes(root, path)
    check_mjcf_words(root)
    if root.find("worldbody") is None:
        raise InputError("no <worldbody>: it holds no robot")
    model = _Model.of(root, path)
    for world in root.findall("worldbody"):
        model.add_body(_Body(WORLD, None, Pose(), DEFAULT_CLASS), world)
    joints = {joint.get("name", ""): joint for joint in model.urdf.findall("joint")}
    notes = list(add_mimics(root, model.classes, joints, model.references))
    links = {link.get("name", "") for link in model.urdf.findall("link")}
    excluded = set()
    for exclude in root.findall("contact/exclude"):
        pair = [exclude.get(key, "") for key in ("body1", "body2")]
        for body in pair:
            if body not in links:
                raise InputError(f"contact: exclude: unknown body '{body}'{nearest(body, links)}")
        excluded.add(link_pair(*pair))
    if model.free:
        notes.append(f"bodies with a free joint, held where they stand: {listed(model.free)}")
    if reason := model.massless or why_not_known(root, model.settings):
        for link in model.urdf.findall("link"):
            for inertial in link.findall("inertial"):
                link.remove(inertial)
        notes.append(f"no masses: {reason}")
    return Converted(model.urdf, files, frozenset(excluded), tuple(notes))


@dataclass(frozen=True)
class _Body:
    """A body to be added, and where it stands."""

    name: str
    parent: str | None  # link; None for the world
    pose: Pose  # in the parent
    inherited: str  # class of what has none

    @property
    def where(self) -> str:
        """Name in errors."""
        return f"body '{self.name}'"


@dataclass
class _Model:
    """A model on its way to URDF."""

    settings: Settings
    classes: DefaultClasses
    geoms: Geoms
    urdf: Element
    references: dict[str, float] = field(default_factory=dict)  # joint -> its coordinate where the model is drawn
    free: list[str] = field(default_factory=list)  # bodies that a free joint carries
    massless: str | None = None  # why the masses are not known

    @classmethod
    def of(cls, root: Element, path: Path) -> _Model:
        settings, classes = Settings.of(root.findall("compiler")), DefaultClasses(root.findall("default"))
        geoms = Geoms.of(root, path.parent, settings, classes)
        return cls(settings, classes, geoms, Element("robot", name=root.get("model") or path.stem))

    def add_body(self, body: _Body, element: Element) -> None:
        """Add a body, with all bodies below it, to the URDF: its joints, its link, its geometry.

        The worldbody is the root link. Raises what `as_urdf` raises.
        """
        where, content = body.where, list(self._content(element, Pose(), body.inherited, body.where))
        if flag(element.attrib, "mocap", where, "false"):
            raise InputError(f"{where}: mocap is not supported")
        if body.parent is not None:
            self._add_joints(body, [each for each in content if each[0].tag in ("joint", "freejoint")])
        elif held := [each.tag for each, _, _ in content if each.tag in ("joint", "freejoint", "inertial")]:
            raise InputError(f"worldbody: <{held[0]}> is not supported: the world stands still")
        link = next((each for each in self.urdf.findall("link") if each.get("name") == body.name), None)
        if link is not None and body.parent is not None:
            raise InputError(f"{where}: the name is taken; names must differ")
        if link is None:
            link = SubElement(self.urdf, "link", name=body.name)
        geoms = [each for each in content if each[0].tag == "geom"]
        for i, (geom, frame, inherited) in enumerate(geoms):
            self.geoms.add(link, geom, frame, f"{where}: geom '{geom.get('name') or i}'", inherited)
        if link.find("visual") is None:  # it is seen as it is
            for part in link.findall("collision"):
                SubElement(link, "visual").extend(part)
        self._add_masses(link, body, content)
        for i, (below, frame, inherited) in enumerate(each for each in content if each[0].tag == "body"):
            name = below.get("name") or f"{body.name}_{i}"
            pose = compose(frame, self.settings.pose(below.attrib, f"body '{name}'"))
            inherited = self.classes.check(below.get("childclass", inherited), f"body '{name}'")
            self.add_body(_Body(name, body.name, pose, inherited), below)

    def _content(
        self, element: Element, frame: Pose, inherited: str, where: str
    ) -> Iterator[tuple[Element, Pose, str]]:
        """Yield the elements of a body, those in its frames too: the element, the pose of its frame in the body, and
        the class that it inherits."""
        for each in element:
            if each.tag == "frame":
                here = f"{where}: {called(each)}"
                pose = compose(frame, self.settings.pose(each.attrib, here))
                own = self.classes.check(each.get("childclass", inherited), here)
                yield from self._content(each, pose, own, where)
            else:
                yield each, frame, inherited

    def _add_joints(self, body: _Body, joints: list[tuple[Element, Pose, str]]) -> None:
        """Add the joints between a body and its parent: several are a chain of links without geometry."""
        parent, pose, name = body.parent or WORLD, body.pose, body.name
        settings = [(self.classes.applied(joint, inherited), frame) for joint, frame, inherited in joints]
        if any(
            joint.tag == "freejoint" or own.get("type") == "free"
            for (joint, _, _), (own, _) in zip(joints, settings, strict=True)
        ):
            if len(joints) > 1 or parent != WORLD:
                raise InputError(f"{body.where}: a free joint must be the only joint, of a body in the world")
            self.free.append(name)
            settings = []
        at = Pose()  # the frame of the last link, in the body's; they are parallel
        for i, (own, frame) in enumerate(settings):
            joint = own.get("name") or f"{name}_joint{i if len(settings) > 1 else ''}"
            where = f"joint '{joint}'"
            anchor = compose(frame, Pose(vector(own, "pos", where, "0 0 0"))).position
            axis = frame.matrix[:3, :3] @ vector(own, "axis", where, "0 0 1")
            last = i == len(settings) - 1 and not any(anchor)
            child = name if last else f"{name}/{joint}"
            origin = compose(pose, Pose(anchor)) if i == 0 else Pose(np.subtract(anchor, at.position))
            at = Pose(anchor)
            self._add_joint(own, joint, (parent, child), origin, axis)
            if not last:
                SubElement(self.urdf, "link", name=child)
            parent = child
        if not settings or any(at.position):
            rest = pose if not settings else Pose(np.negative(at.position))
            add_joint(self.urdf, f"{name} fixed", "fixed", (parent, name), rest)

    def _add_joint(self, own: Attributes, name: str, ends: tuple[str, str], origin: Pose, axis: Array) -> None:
        where = f"joint '{name}'"
        if any(joint.get("name") == name for joint in self.urdf.findall("joint")):
            raise InputError(f"{where}: the name is taken; names must differ")
        kind = own.get("type", "hinge")
        if kind not in ("hinge", "slide"):
            raise InputError(f"{where}: type '{kind}' is not supported (allowed: hinge, slide, free)")
        length = float(np.linalg.norm(axis))
        if length < 1e-9:
            raise InputError(f"{where}: axis must not be 0, found '{own.get('axis')}'")
        (reference,) = numbers(own, "ref", where, "0", 1)
        if kind == "hinge":
            reference = self.settings.angle(reference)
            shift = Pose(quaternion_xyzw=about(axis, -reference, where))
        else:
            shift = Pose(-reference * axis / length)
        limits = self._limits(own, kind, where)
        types = {"slide": "prismatic", "hinge": "continuous" if limits is None else "revolute"}
        joint = add_joint(self.urdf, name, types[kind], ends, compose(origin, shift) if reference else origin)
        SubElement(joint, "axis", xyz=words(axis))
        if limits is not None or kind == "slide":
            low, high = limits or (-SLIDE_LIMIT, SLIDE_LIMIT)
            SubElement(joint, "limit", lower=repr(low), upper=repr(high), effort="0", velocity="0")
        self.references[name] = reference

    def _limits(self, own: Attributes, kind: str, where: str) -> tuple[float, float] | None:
        """Return the range of a joint [rad or m], None if it has no limits."""
        low, high = numbers(own, "range", where, "0 0", 2)
        limited = choice(own, "limited", where, ("auto", "true", "false"))
        if limited == "false" or (limited == "auto" and low == high == 0.0):
            return None
        if limited == "auto" and not flag(self.settings.own, "autolimits", "compiler", "true"):
            raise InputError(f"{where}: has a range, and must say whether it is limited (compiler: autolimits='false')")
        if not low < high:
            raise InputError(f"{where}: range must be from low to high, found '{own.get('range', '')}'")
        return (self.settings.angle(low), self.settings.angle(high)) if kind == "hinge" else (low, high)

    def _add_masses(self, link: Element, body: _Body, content: list[tuple[Element, Pose, str]]) -> None:
        inertials = [(each, frame) for each, frame, _ in content if each.tag == "inertial"]
        if len(inertials) > 1:
            raise InputError(f"{body.where}: has {len(inertials)} inertial elements; one is allowed")
        for inertial, frame in inertials:
            link.append(inertial_of(inertial, frame, self.settings, body.where))
        if not inertials and body.parent is not None and any(each.tag == "geom" for each, _, _ in content):
            words = f"{body.where} has no inertial, which MuJoCo works out of its geoms"
            self.massless = self.massless or words
