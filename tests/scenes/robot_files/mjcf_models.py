"""Random MJCF models beside what they mean: bodies and geoms as plain matrices, worked out while the text is written.

Everything that says where a body is stands in some of them: five ways to turn, frames in frames, joints in frames,
several joints on a body, `ref`, default classes, files within files.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

SHAPES = ("box", "sphere", "capsule", "cylinder", "ellipsoid")
SIZES = {"box": 3, "ellipsoid": 3, "sphere": 1}


def rotation(axis: Sequence[float], angle: float) -> np.ndarray:
    """Rodrigues' formula."""
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def transform(turn: np.ndarray | None = None, position: Sequence[float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = np.eye(3) if turn is None else turn, position
    return result


@dataclass
class Joint:
    name: str
    kind: str
    anchor: np.ndarray  # in the body
    axis: np.ndarray
    ref: float  # [rad or m]
    limits: tuple[float, float] | None

    def moved(self, value: float) -> np.ndarray:
        """MuJoCo's meaning of a coordinate."""
        if self.kind == "slide":
            return transform(position=self.axis / np.linalg.norm(self.axis) * (value - self.ref))
        about = transform(rotation(self.axis, value - self.ref))
        return transform(position=self.anchor) @ about @ transform(position=-self.anchor)


@dataclass
class Body:
    name: str
    place: np.ndarray  # (4, 4) in its parent
    joints: list[Joint] = field(default_factory=list)
    geoms: list[tuple[str, np.ndarray, list[float]]] = field(default_factory=list)  # shape, place, sizes
    bodies: list[Body] = field(default_factory=list)

    def poses(self, q: dict[str, float], above: np.ndarray) -> dict[str, np.ndarray]:
        """Places of the body and of all below it in the world."""
        own = above @ self.place
        for joint in self.joints:
            own = own @ joint.moved(q[joint.name])
        found = {self.name: own}
        for body in self.bodies:
            found |= body.poses(q, own)
        return found

    def all(self) -> list[Body]:
        return [self, *(each for body in self.bodies for each in body.all())]


@dataclass
class Model:
    text: str
    files: dict[str, str]
    world: Body

    @property
    def joints(self) -> list[Joint]:
        return [joint for body in self.world.all() for joint in body.joints]


class Writer:
    """One random model."""

    def __init__(self, seed: int) -> None:
        self.rng, self.files, self.count = np.random.default_rng(seed), dict[str, str](), 0
        self.degree = bool(self.rng.integers(2))
        self.order = "".join(self.rng.choice(list("xyzXYZ"), 3))
        self.classes = {name: self._class() for name in ("a", "b")}

    def model(self) -> Model:
        world = Body("world", np.eye(4))
        texts = [
            self._framed(lambda frame, kind: self._below(world, frame, 0, kind), None)
            for _ in range(self.rng.integers(1, 3))
        ]
        angle = "" if self.degree and self.rng.uniform() < 0.5 else f"angle='{'degree' if self.degree else 'radian'}'"
        defaults = "".join(
            f"<default class='{name}'>{''.join(self._tag(tag, each) for tag, each in own.items())}</default>"
            for name, own in self.classes.items()
        )
        parts = [
            f"<compiler {angle} eulerseq='{self.order}'/>",
            f"<default>{defaults}</default>",
            f"<worldbody>{''.join(texts)}</worldbody>",
        ]
        whole = "".join(parts[i] for i in self.rng.permutation(3))
        return Model(f"<mujoco model='m'>{self._apart(whole, 0.1)}</mujoco>", self.files, world)

    def _class(self) -> dict[str, dict[str, str]]:
        shape = str(self.rng.choice(SHAPES))
        sizes = words(self.rng.uniform(0.05, 0.3, SIZES.get(shape, 2)))
        joint = {
            "type": str(self.rng.choice(["hinge", "slide"])),
            "axis": words(self.rng.normal(size=3)),
            "damping": "1",
        }
        return {"joint": joint, "geom": {"type": shape, "size": sizes, "rgba": "1 0 0 1"}}

    def _body(self, level: int, inherited: str | None) -> tuple[str, Body]:
        rng, name = self.rng, self._name("body")
        attributes, place = self._place()
        child_class = str(rng.choice(["a", "b"])) if rng.uniform() < 0.2 else None
        own, body, content = child_class or inherited, Body(name, place), list[str]()
        for _ in range(rng.choice([0, 1, 1, 1, 2, 3])):
            content.append(self._framed(lambda frame, kind: self._joint(body, frame, kind), own))
        for _ in range(rng.integers(0, 3)):
            content.append(self._framed(lambda frame, kind: self._geom(body, frame, kind), own))
        for _ in range(rng.choice([0, 1, 1, 2]) if level < 2 else 0):
            content.append(self._framed(lambda frame, kind: self._below(body, frame, level, kind), own))
        attributes = {"name": name, **attributes, **({"childclass": child_class} if child_class else {})}
        return self._apart(self._tag("body", attributes, "".join(content)), 0.1), body

    def _below(self, body: Body, frame: np.ndarray, level: int, inherited: str | None) -> str:
        text, below = self._body(level + 1, inherited)
        below.place = frame @ below.place
        body.bodies.append(below)
        return text

    def _framed(self, write, inherited: str | None, frame: np.ndarray | None = None) -> str:
        """Write something, sometimes in one frame or two."""
        frame = np.eye(4) if frame is None else frame
        if self.rng.uniform() > 0.25:
            return str(write(frame, inherited))
        attributes, place = self._place()
        if self.rng.uniform() < 0.3:
            inherited = str(self.rng.choice(["a", "b"]))
            attributes["childclass"] = inherited
        return self._tag("frame", attributes, self._framed(write, inherited, frame @ place))

    def _joint(self, body: Body, frame: np.ndarray, inherited: str | None) -> str:
        rng, kind, axis = self.rng, str(self.rng.choice(["hinge", "slide"])), self.rng.normal(size=3)
        anchor, attributes = rng.normal(size=3) * rng.integers(2), {}
        attributes, known = self._of_class(inherited, "joint")
        if known:
            kind, axis = known["type"], np.array(numbers(known["axis"]))
        else:
            attributes |= {"type": kind, "axis": words(axis)}
        unit = 180 / math.pi if kind == "hinge" and self.degree else 1.0
        name, ref = self._name("joint"), float(rng.normal() * rng.integers(2))
        if ref:
            attributes["ref"] = repr(ref * unit)
        if anchor.any():
            attributes["pos"] = words(anchor)
        limits = None
        if rng.uniform() < 0.6:
            limits = tuple(np.sort(rng.normal(size=2)).tolist())
            attributes |= {
                "range": words(np.array(limits) * unit),
                **({"limited": "true"} if rng.uniform() < 0.3 else {}),
            }
        turned = frame[:3, :3] @ axis
        body.joints.append(Joint(name, kind, (frame @ np.append(anchor, 1.0))[:3], turned, ref, limits))
        return self._tag("joint", {"name": name, **attributes})

    def _geom(self, body: Body, frame: np.ndarray, inherited: str | None) -> str:
        rng, shape = self.rng, str(self.rng.choice(SHAPES))
        sizes = rng.uniform(0.05, 0.3, SIZES.get(shape, 2)).tolist()
        attributes, known = self._of_class(inherited, "geom")
        if known:
            shape, sizes = known["type"], numbers(known["size"])
        elif shape in ("capsule", "cylinder") and rng.uniform() < 0.5:
            first, last = rng.normal(size=(2, 3))
            along = last - first
            place = transform(onto(along), (first + last) / 2)
            body.geoms.append((shape, frame @ place, [sizes[0], float(np.linalg.norm(along)) / 2]))
            return self._tag("geom", {"type": shape, "size": repr(sizes[0]), "fromto": words([*first, *last])})
        else:
            attributes |= {"type": shape, "size": words(sizes)}
        where, place = self._place()
        body.geoms.append((shape, frame @ place, sizes))
        return self._tag("geom", {**attributes, **where})

    def _of_class(self, inherited: str | None, tag: str) -> tuple[dict[str, str], dict[str, str]]:
        """Name a class, or inherit one: the attributes to write, and those of the class."""
        if self.rng.uniform() < 0.2:
            name = str(self.rng.choice(["a", "b"]))
            return {"class": name}, self.classes[name][tag]
        return {}, self.classes[inherited][tag] if inherited else {}

    def _place(self) -> tuple[dict[str, str], np.ndarray]:
        rng, position = self.rng, self.rng.normal(size=3)
        attributes, turn = {"pos": words(position)}, np.eye(3)
        unit = 180 / math.pi if self.degree else 1.0
        match rng.integers(6):
            case 1:
                w, *v = rng.normal(size=4)
                attributes["quat"] = words([w, *v])
                turn = rotation(v, 2 * math.atan2(np.linalg.norm(v), w))
            case 2:
                axis, angle = rng.normal(size=3), rng.uniform(-3, 3)
                attributes["axisangle"], turn = words([*axis, angle * unit]), rotation(axis, angle)
            case 3:
                angles = rng.uniform(-3, 3, 3)
                attributes["euler"] = words(angles * unit)
                for letter, angle in zip(self.order, angles, strict=True):
                    step = rotation(np.eye(3)["xyz".index(letter.lower())], angle)
                    turn = turn @ step if letter.islower() else step @ turn
            case 4:
                x, y = rng.normal(size=(2, 3))
                attributes["xyaxes"] = words([*x, *y])
                z = np.cross(x, y)
                turn = np.column_stack([each / np.linalg.norm(each) for each in (x, np.cross(z, x), z)])
            case 5:
                z = rng.normal(size=3)
                attributes["zaxis"], turn = words(z), onto(z)
        return attributes, transform(turn, position)

    def _apart(self, text: str, share: float) -> str:
        """Put a piece of text into a file of its own, now and then."""
        if self.rng.uniform() > share:
            return text
        name = f"part{len(self.files)}.xml"
        self.files[name] = f"<mujocoinclude>{text}</mujocoinclude>"
        return f"<include file='{name}'/>"

    def _tag(self, tag: str, attributes: dict[str, str], content: str = "") -> str:
        keys = self.rng.permutation(list(attributes))
        return f"<{tag} {' '.join(f'{key}={chr(39)}{attributes[key]}{chr(39)}' for key in keys)}>{content}</{tag}>"

    def _name(self, kind: str) -> str:
        self.count += 1
        return f"{kind}{self.count}"


def onto(z: np.ndarray) -> np.ndarray:
    """The smallest turn of the z axis onto a direction."""
    unit = z / np.linalg.norm(z)
    return rotation(np.cross([0.0, 0.0, 1.0], unit), math.acos(unit[2]))


def words(values: Sequence[float] | np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in values)


def numbers(text: str) -> list[float]:
    return [float(word) for word in text.split()]
