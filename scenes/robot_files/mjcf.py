"""MJCF, MuJoCo's robot descriptions, as URDF.

Pinocchio has a reader of MJCF, but it takes the range of a joint that slides for degrees, leaves out where the first
body stands, and says nothing of what it passes over. So bodies, joints and geoms become URDF here, and whatever of
them has no counterpart there is refused by its name. Lengths [m]; angles as the file's compiler says.

MuJoCo's meaning: https://mujoco.readthedocs.io/en/stable/XMLreference.html
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hdplan.scenes.errors import InputError
from hdplan.scenes.poses import Pose, compose
from hdplan.scenes.robot_files.link_pairs import LinkPair, link_pair
from hdplan.scenes.robot_files.mjcf_words import check_mjcf_words

Array = NDArray[np.float64]
Element = ElementTree.Element

TOP = (  # sections that say nothing of where bodies are, or are read here
    *("compiler", "option", "size", "statistic", "visual", "asset", "default", "worldbody", "contact", "equality"),
    *("tendon", "actuator", "sensor", "keyframe", "custom"),
)
IN_BODY = ("body", "joint", "geom", "inertial", "site", "camera", "light")
ANGLE = ("degree", "radian")
UNLIMITED = 1e6  # [rad] or [m] a limit in a URDF that stands for none: it has no slides without limits
AS_GIVEN = {  # settings of the compiler by which it leaves the masses as they are, the default first
    "inertiafromgeom": ("auto", "false"),
    "settotalmass": ("-1", "0"),
    "boundmass": ("0",),
    "boundinertia": ("0",),
    "balanceinertia": ("false",),
}
TURNS = ("quat", "axisangle", "euler", "xyaxes", "zaxis")


def as_urdf(root: Element, path: Path) -> tuple[Element, frozenset[LinkPair], tuple[str, ...]]:
    """Return a model as URDF, the pairs of links that its `contact` section excludes, and notes.

    Geoms that collide with nothing (contype and conaffinity 0, and in no pair of the `contact` section) are visuals,
    all others collision geometry; of bodies without `inertial` the masses are not known, and so no torques.

    Raises:
        InputError: an element, joint or geom that URDF cannot say; a misspelt attribute; a number that is none.
    """
    for section in root:
        if section.tag not in TOP:
            raise InputError(f"<{section.tag}> is not supported (allowed: {', '.join(TOP)})")
    notes = check_mjcf_words(root)
    model = _Model.of(root, path)
    for world in root.findall("worldbody"):
        model.world(world)
    model.couplings(root)
    links = {link.get("name", "") for link in model.urdf.findall("link")}
    excluded = set()
    for exclude in root.findall("contact/exclude"):
        a, b = (exclude.get(key, "") for key in ("body1", "body2"))
        if not {a, b} <= links:
            raise InputError(f"contact: exclude: unknown body '{a if a not in links else b}'")
        excluded.add(link_pair(a, b))
    if without := model.without_masses():
        for link in model.urdf.findall("link"):
            for inertial in link.findall("inertial"):
                link.remove(inertial)
        notes = (*notes, f"no masses: {without}")
    return model.urdf, frozenset(excluded), notes


@dataclass
class _Model:
    """A model on its way to URDF."""

    path: Path
    compiler: dict[str, str]
    defaults: dict[str, dict[str, dict[str, str]]]  # class -> element -> attribute -> value
    meshes: dict[str, Element]
    urdf: Element
    paired: frozenset[str | None]  # names of geoms that collide with one another whatever their masks
    massless: list[str] = field(default_factory=list)  # bodies with geoms and without inertial
    names: set[str] = field(default_factory=set)

    @classmethod
    def of(cls, root: Element, path: Path) -> _Model:
        compiler = {key: value for each in root.findall("compiler") for key, value in each.attrib.items()}
        if compiler.get("coordinate", "local") != "local":
            raise InputError("compiler: coordinate must be local")
        if compiler.get("angle", "degree") not in ANGLE:
            raise InputError(f"compiler: angle must be one of {', '.join(ANGLE)}, found '{compiler['angle']}'")
        urdf = ElementTree.Element("robot", name=root.get("model") or path.stem)
        paired = frozenset(pair.get(key) for pair in root.findall("contact/pair") for key in ("geom1", "geom2"))
        model = cls(path, compiler, {"main": {}}, {}, urdf, paired)
        for each in root.findall("default"):  # several are one
            model._read_defaults(each, "main", model.defaults["main"])
            model.defaults[each.get("class", "main")] = model.defaults["main"]
        for mesh in root.findall("asset/mesh"):
            file = mesh.get("file")
            if file is None:
                raise InputError(f"mesh '{mesh.get('name')}': only meshes of files are supported")
            model.meshes[mesh.get("name") or Path(file).stem] = mesh
        return model

    def _read_defaults(self, element: Element, name: str, above: dict[str, dict[str, str]]) -> None:
        own = {tag: dict(values) for tag, values in above.items()}
        for each in element:
            if each.tag != "default":
                own[each.tag] = {**own.get(each.tag, {}), **each.attrib}
        self.defaults[name] = own
        for below in element.findall("default"):
            called = below.get("class", "")
            if called in self.defaults:
                raise InputError(f"default: the class '{called}' is there already; names must differ")
            self._read_defaults(below, called, own)

    def world(self, world: Element) -> None:
        """Add the worldbody as the root link, and all bodies below it."""
        self._body(world, "world", None, Pose(), "main")

    def _body(self, body: Element, name: str, parent: str | None, pose: Pose, inherited: str) -> None:
        where = f"body '{name}'"
        if body.get("mocap", "false") == "true":
            raise InputError(f"{where}: mocap is not supported")
        for element in body:
            if element.tag not in IN_BODY:
                raise InputError(f"{where}: <{element.tag}> is not supported (allowed: {', '.join(IN_BODY)})")
        inherited = body.get("childclass", inherited)
        if parent is not None:
            self._joints(body, name, parent, pose, inherited)
        if name in self.names:
            raise InputError(f"{where}: the name is taken; names must differ")
        self.names.add(name)
        link = ElementTree.SubElement(self.urdf, "link", name=name)
        geoms = body.findall("geom")
        for i, geom in enumerate(geoms):
            self._geom(link, geom, f"{where}: geom '{geom.get('name') or i}'", inherited)
        if link.find("visual") is None:  # it is seen as it is
            for part in link.findall("collision"):
                ElementTree.SubElement(link, "visual").extend(part)
        inertial = body.find("inertial")
        if inertial is not None:
            link.append(self._inertial(inertial, where))
        elif geoms and parent is not None:
            self.massless.append(name)
        for i, below in enumerate(body.findall("body")):
            own = below.get("name") or f"{name}_{i}"
            self._body(below, own, name, self._pose(below.attrib, f"body '{own}'"), inherited)

    def _joints(self, body: Element, name: str, parent: str, pose: Pose, inherited: str) -> None:
        """Add the joints between a body and its parent: several are a chain of links without geometry."""
        joints = body.findall("joint")
        at = np.zeros(3)  # of the last joint, in the body's frame
        for i, joint in enumerate(joints):
            own = self._with_defaults(joint, inherited)
            called = own.get("name") or f"{name}_joint{i if len(joints) > 1 else ''}"
            where = f"joint '{called}'"
            kind = own.get("type", "hinge")
            if kind not in ("hinge", "slide"):
                raise InputError(f"{where}: type '{kind}' is not supported (allowed: hinge, slide)")
            if any(_numbers(own, "ref", where, "0")):
                raise InputError(f"{where}: ref must be 0, found '{own['ref']}'")
            here = _vector(own, "pos", where, "0 0 0")
            last = i == len(joints) - 1 and not here.any()
            child = name if last else f"{name}/{called}"
            origin = compose(pose, Pose(here)) if i == 0 else Pose(here - at)
            at = here
            self._joint(own, called, kind, (parent, child), origin)
            if not last:
                ElementTree.SubElement(self.urdf, "link", name=child)
            parent = child
        if not joints or at.any():
            fixed = ElementTree.SubElement(self.urdf, "joint", name=f"{name} fixed", type="fixed")
            _ends(fixed, parent, name, pose if not joints else Pose(-at))

    def _joint(self, own: dict[str, str], called: str, kind: str, ends: tuple[str, str], origin: Pose) -> None:
        where = f"joint '{called}'"
        if any(joint.get("name") == called for joint in self.urdf.findall("joint")):
            raise InputError(f"{where}: the name is taken; names must differ")
        limited = own.get("limited", "auto")
        if limited == "auto":
            limited = "true" if "range" in own and self.compiler.get("autolimits", "true") == "true" else "false"
        types = {"slide": "prismatic", "hinge": "revolute" if limited == "true" else "continuous"}
        joint = ElementTree.SubElement(self.urdf, "joint", name=called, type=types[kind])
        _ends(joint, *ends, origin)
        axis = _vector(own, "axis", where, "0 0 1")
        ElementTree.SubElement(joint, "axis", xyz=_text(axis))
        low, high = -UNLIMITED, UNLIMITED
        if limited == "true":
            low, high = (self._angle(end) if kind == "hinge" else end for end in _numbers(own, "range", where, "", 2))
        if limited == "true" or kind == "slide":
            ElementTree.SubElement(joint, "limit", lower=repr(low), upper=repr(high), effort="0", velocity="0")

    def _geom(self, link: Element, geom: Element, where: str, inherited: str) -> None:
        own = self._with_defaults(geom, inherited)
        masks = [_numbers(own, key, where, "1")[0] for key in ("contype", "conaffinity")]
        collides = any(masks) or (own.get("name") in self.paired and "name" in own)
        kind = own.get("type", "sphere")
        known = ("box", "sphere", "cylinder", "capsule", "ellipsoid", "mesh")
        if kind not in known or (kind != "mesh" and "mesh" in own):
            if not collides:
                return
            what = f"{kind} fitted to a mesh" if kind in known else kind
            hint = "; a floor is an obstacle of the scene" if kind == "plane" else ""
            raise InputError(f"{where}: type '{what}' is not supported (allowed: {', '.join(known)}){hint}")
        pose = self._pose(own, where)
        size = list(_numbers(own, "size", where, "")) if kind != "mesh" else []
        if "fromto" in own and kind != "mesh":
            pose, half = self._between(own, where)
            if kind not in ("capsule", "cylinder"):
                raise InputError(f"{where}: fromto goes with capsules and cylinders")
            size = [*size[:1], half]
        needed = {"box": 3, "ellipsoid": 3, "sphere": 1, "mesh": 0}.get(kind, 2)
        if len(size) < needed or not all(value > 0 for value in size[:needed]):
            numbers = f"{needed} numbers" if needed > 1 else "a number"
            raise InputError(f"{where}: size must be {numbers} greater than 0 [m], found '{own.get('size', '')}'")
        part = ElementTree.SubElement(link, "collision" if collides else "visual")
        part.append(_origin(pose))
        shape = ElementTree.SubElement(ElementTree.SubElement(part, "geometry"), kind)
        match kind:
            case "box":
                shape.set("size", _text([2 * value for value in size[:3]]))
            case "ellipsoid":
                shape.set("radii", _text(size[:3]))
            case "sphere":
                shape.set("radius", repr(size[0]))
            case "mesh":
                shape.attrib.update(self._mesh(own.get("mesh", ""), where))
            case _:
                shape.attrib.update({"radius": repr(size[0]), "length": repr(2 * size[1])})

    def without_masses(self) -> str | None:
        """Say why the masses are not those of the `inertial` elements; None if they are."""
        if self.massless:
            return f"body '{self.massless[0]}' has no inertial, which MuJoCo works out of its geoms"
        changed = [key for key, as_given in AS_GIVEN.items() if self.compiler.get(key, as_given[0]) not in as_given]
        return f"compiler: {changed[0]} changes those of the file" if changed else None

    def _mesh(self, name: str, where: str) -> dict[str, str]:
        if name not in self.meshes:
            raise InputError(f"{where}: unknown mesh '{name}'")
        own = self._with_defaults(self.meshes[name], "main")
        for key in ("refpos", "refquat"):
            if key in own:
                raise InputError(f"mesh '{name}': {key} is not supported")
        folder = self.compiler.get("meshdir") or self.compiler.get("assetdir") or ""
        file = own["file"]
        if self.compiler.get("strippath", "false") == "true":
            file = Path(file).name
        file = str((self.path.parent / folder / file).absolute())
        return {"filename": f"file://{file}", "scale": own.get("scale", "1 1 1")}

    def _inertial(self, inertial: Element, where: str) -> Element:
        own, where = inertial.attrib, f"{where}: inertial"
        result = ElementTree.Element("inertial")
        result.append(_origin(self._pose(own, where)))
        ElementTree.SubElement(result, "mass", value=repr(_numbers(own, "mass", where, "")[0]))
        if "fullinertia" in own:
            xx, yy, zz, xy, xz, yz = _numbers(own, "fullinertia", where, "", 6)
        else:
            (xx, yy, zz), (xy, xz, yz) = _numbers(own, "diaginertia", where, "", 3), (0.0, 0.0, 0.0)
        entries = {"ixx": xx, "iyy": yy, "izz": zz, "ixy": xy, "ixz": xz, "iyz": yz}
        ElementTree.SubElement(result, "inertia", {key: repr(value) for key, value in entries.items()})
        return result

    def couplings(self, root: Element) -> None:
        """Add what the `equality` section says: joints that follow others are mimic joints."""
        joints = {joint.get("name"): joint for joint in self.urdf.findall("joint")}
        for section in root.findall("equality"):
            for each in section:
                where = f"equality: {each.tag} '{each.get('name', '')}'"
                one, other = each.get("joint1", ""), each.get("joint2", "")
                factors = (*_numbers(each.attrib, "polycoef", where, "0 1 0 0 0"), *(0.0,) * 5)[:5]
                if each.tag != "joint" or not other or any(factors[2:]):
                    raise InputError(f"{where}: not supported: only joints that follow another in a straight line are")
                if one not in joints or other not in joints:
                    raise InputError(f"{where}: unknown joint '{one if one not in joints else other}'")
                said = {"joint": other, "multiplier": repr(factors[1]), "offset": repr(factors[0])}
                ElementTree.SubElement(joints[one], "mimic", said)

    def _with_defaults(self, element: Element, inherited: str) -> dict[str, str]:
        name = element.get("class", inherited)
        if name not in self.defaults:
            raise InputError(f"{element.tag} '{element.get('name', '')}': unknown class '{name}'")
        return {**self.defaults[name].get(element.tag, {}), **element.attrib}

    def _angle(self, value: float) -> float:
        return math.radians(value) if self.compiler.get("angle", "degree") == "degree" else value

    def _pose(self, own: dict[str, str], where: str) -> Pose:
        """Return what pos and one of quat, axisangle, euler, xyaxes and zaxis say."""
        position = _vector(own, "pos", where, "0 0 0")
        given = [key for key in TURNS if key in own]
        if len(given) > 1:
            raise InputError(f"{where}: {' and '.join(given)} say the same: leave one out")
        turn = np.array([0.0, 0.0, 0.0, 1.0])
        match given:
            case ["quat"]:
                w, x, y, z = _numbers(own, "quat", where, "", 4)
                turn = np.array([x, y, z, w])
            case ["axisangle"]:
                *axis, angle = _numbers(own, "axisangle", where, "", 4)
                turn = _about(np.array(axis), self._angle(angle), where)
            case ["euler"]:
                return self._euler(position, _numbers(own, "euler", where, "", 3), where)
            case ["xyaxes"]:
                values = np.array(_numbers(own, "xyaxes", where, "", 6))
                x_axis = _unit(values[:3], where)
                y_axis = _unit(values[3:] - x_axis * (x_axis @ values[3:]), where)
                turn = _quaternion(np.column_stack([x_axis, y_axis, np.cross(x_axis, y_axis)]))
            case ["zaxis"]:
                turn = _onto(_vector(own, "zaxis", where, ""), where)
        return Pose(position, _unit(turn, where))

    def _euler(self, position: Array, angles: Sequence[float], where: str) -> Pose:
        """Turn about one axis after the other: the moving ones (x y z), or the fixed ones (X Y Z)."""
        order = self.compiler.get("eulerseq", "xyz")
        if len(order) != 3 or not set(order) <= set("xyzXYZ"):
            raise InputError(f"compiler: eulerseq must be three of x, y, z, X, Y, Z, found '{order}'")
        pose = Pose()
        for letter, angle in zip(order, angles, strict=True):
            turn = Pose(quaternion_xyzw=_about(np.eye(3)["xyz".index(letter.lower())], self._angle(angle), where))
            pose = compose(pose, turn) if letter.islower() else compose(turn, pose)
        return Pose(position, pose.quaternion_xyzw)

    def _between(self, own: dict[str, str], where: str) -> tuple[Pose, float]:
        """Return the pose of a capsule or cylinder between two points, and half its length."""
        values = np.array(_numbers(own, "fromto", where, "", 6))
        along = values[3:] - values[:3]
        return Pose((values[:3] + values[3:]) / 2, _onto(along, where)), float(np.linalg.norm(along)) / 2


# --- numbers and turns -----------------------------------------------------------------------------------


def _numbers(own: dict[str, str], key: str, where: str, default: str, count: int | None = None) -> tuple[float, ...]:
    text = own.get(key, default)
    try:
        values = tuple(float(word) for word in text.split())
    except ValueError:
        values = ()
    if not values or not all(map(math.isfinite, values)) or (count is not None and len(values) != count):
        number = "numbers" if count is None else f"{count} finite numbers"
        raise InputError(f"{where}: {key} must be {number}, found '{text}'")
    return values


def _vector(own: dict[str, str], key: str, where: str, default: str) -> Array:
    return np.array(_numbers(own, key, where, default, 3))


def _unit(vector: Array, where: str) -> Array:
    length = float(np.linalg.norm(vector))
    if length < 1e-9:
        raise InputError(f"{where}: a direction must not be 0")
    return vector / length


def _about(axis: Array, angle: float, where: str) -> Array:
    """Return the quaternion (x, y, z, w) of a turn [rad] about an axis."""
    return np.append(_unit(axis, where) * math.sin(angle / 2), math.cos(angle / 2))


def _onto(direction: Array, where: str) -> Array:
    """Return the smallest turn that brings the z axis onto a direction."""
    x, y, z = _unit(direction, where)
    if z < -1 + 1e-12:
        return np.array([1.0, 0.0, 0.0, 0.0])
    return _unit(np.array([-y, x, 0.0, 1.0 + z]), where)


def _quaternion(rotation: Array) -> Array:
    """Return the quaternion (x, y, z, w) of a rotation: the eigenvector of Shepperd's symmetric matrix."""
    (a, b, c), (d, e, f), (g, h, i) = rotation
    symmetric = [
        [a - e - i, b + d, c + g, h - f],
        [b + d, e - a - i, f + h, c - g],
        [c + g, f + h, i - a - e, d - b],
        [h - f, c - g, d - b, a + e + i],
    ]
    return np.linalg.eigh(np.array(symmetric))[1][:, -1]


# --- elements of URDF ------------------------------------------------------------------------------------


def _text(values: Iterator[float] | Sequence[float] | Array) -> str:
    return " ".join(repr(float(value)) for value in values)


def _origin(pose: Pose) -> Element:
    """Return a pose as URDF has it; yaw is what is left of the turn once roll is taken out, so that it is accurate
    where pitch is a right angle too."""
    r = pose.matrix[:3, :3]
    roll = math.atan2(r[2, 1], r[2, 2])
    pitch = math.atan2(-r[2, 0], math.hypot(r[0, 0], r[1, 0]))
    s, c = math.sin(roll), math.cos(roll)
    yaw = math.atan2(s * r[0, 2] - c * r[0, 1], c * r[1, 1] - s * r[1, 2])
    return ElementTree.Element("origin", xyz=_text(pose.position), rpy=_text([roll, pitch, yaw]))


def _ends(joint: Element, parent: str, child: str, origin: Pose) -> None:
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    joint.append(_origin(origin))
