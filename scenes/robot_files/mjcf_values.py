"""Numbers, choices and poses in an MJCF, as the settings of its compiler have them read.

Attributes of an element -> values. Lengths [m]; angles in degrees, or in radians where the compiler says so.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np

from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.poses import Pose, compose
from hdplan.scenes.robot_files.mjcf_words import TURNS
from hdplan.scenes.robot_files.xml_text import finite_numbers

Attributes = Mapping[str, str]

SHORTEST_DIRECTION = 1e-9  # length of a direction


@dataclass(frozen=True)
class Settings:
    """Attributes of the `compiler` elements; of one that stands there several times, the last."""

    own: Attributes

    @classmethod
    def of(cls, compilers: Iterable[Element]) -> Settings:
        """Raise InputError for values that are not MuJoCo's, and where it is not clear in which folder meshes lie."""
        own: dict[str, str] = {}
        for compiler in compilers:
            if ("meshdir" in own and "assetdir" in compiler.attrib) or (
                "assetdir" in own and "meshdir" in compiler.attrib
            ):
                raise InputError("compiler: meshdir and assetdir in different elements: leave one out")
            own.update(compiler.attrib)
        choice(own, "coordinate", "compiler", ("local",))
        choice(own, "angle", "compiler", ("degree", "radian"))
        order = own.get("eulerseq", "xyz")
        if len(order) != 3 or not set(order) <= set("xyzXYZ"):
            raise InputError(f"compiler: eulerseq must be three of x, y, z, X, Y, Z, found '{order}'")
        for key in ("autolimits", "strippath"):
            flag(own, key, "compiler", "true")
        return cls(own)

    def angle(self, value: float) -> float:
        """Return an angle of the file in radians."""
        return math.radians(value) if self.own.get("angle", "degree") == "degree" else value

    def pose(self, own: Attributes, where: str) -> Pose:
        """Return the pose that pos and one of quat, axisangle, euler, xyaxes and zaxis give."""
        return Pose(vector(own, "pos", where, "0 0 0"), self._turn(own, where))

    def _turn(self, own: Attributes, where: str) -> Array:
        """Return the quaternion (x, y, z, w)."""
        given = [key for key in TURNS if key in own]
        if len(given) > 1:
            raise InputError(f"{where}: {' and '.join(given)} say the same: leave one out")
        match given:
            case ["quat"]:
                w, x, y, z = numbers(own, "quat", where, "", 4)
                return _unit(np.array([x, y, z, w]), where)
            case ["axisangle"]:
                *axis, angle = numbers(own, "axisangle", where, "", 4)
                return about(np.array(axis), self.angle(angle), where)
            case ["euler"]:
                return self._euler(numbers(own, "euler", where, "", 3), where)
            case ["xyaxes"]:
                values = np.array(numbers(own, "xyaxes", where, "", 6))
                x_axis = _unit(values[:3], where)
                y_axis = _unit(values[3:] - x_axis * (x_axis @ values[3:]), where)
                return _quaternion(np.column_stack([x_axis, y_axis, np.cross(x_axis, y_axis)]))
            case ["zaxis"]:
                return _onto(vector(own, "zaxis", where, ""), where)
        return np.array([0.0, 0.0, 0.0, 1.0])

    def _euler(self, angles: Sequence[float], where: str) -> Array:
        """Turn about one axis after the other: the moving ones (x y z), or the fixed ones (X Y Z)."""
        pose = Pose()
        for letter, angle in zip(self.own.get("eulerseq", "xyz"), angles, strict=True):
            turn = Pose(quaternion_xyzw=about(np.eye(3)["xyz".index(letter.lower())], self.angle(angle), where))
            pose = compose(pose, turn) if letter.islower() else compose(turn, pose)
        return np.array(pose.quaternion_xyzw)


def between(own: Attributes, where: str) -> tuple[Pose, float]:
    """Return the pose of a capsule or cylinder between the two points of `fromto`, and half its length."""
    values = np.array(numbers(own, "fromto", where, "", 6))
    along = values[3:] - values[:3]
    return Pose((values[:3] + values[3:]) / 2, _onto(along, where)), float(np.linalg.norm(along)) / 2


def numbers(own: Attributes, key: str, where: str, default: str, count: int | None = None) -> tuple[float, ...]:
    """Return the numbers of an attribute: `count` of them, or one and more. Raises InputError for anything else."""
    return finite_numbers(own.get(key, default), f"{where}: {key}", count)


def vector(own: Attributes, key: str, where: str, default: str) -> Array:
    """Return the three numbers of an attribute."""
    return np.array(numbers(own, key, where, default, 3))


def choice(own: Attributes, key: str, where: str, allowed: Sequence[str], default: str | None = None) -> str:
    """Return a word of an attribute, the first one that is allowed by default. Raises InputError for another."""
    value = own.get(key, default or allowed[0])
    if value not in allowed:
        raise InputError(f"{where}: {key}: '{value}' is not supported{nearest(value, allowed)}")
    return value


def flag(own: Attributes, key: str, where: str, default: str) -> bool:
    """Return whether an attribute is true. Raises InputError for anything but true and false."""
    return choice(own, key, where, ("true", "false"), default) == "true"


# --- turns, as quaternions (x, y, z, w) ------------------------------------------------------------------


def about(axis: Array, angle: float, where: str) -> Array:
    """Return a turn [rad] about an axis."""
    return np.append(_unit(axis, where) * math.sin(angle / 2), math.cos(angle / 2))


def _onto(direction: Array, where: str) -> Array:
    """Return the smallest turn that brings the z axis onto a direction."""
    x, y, z = _unit(direction, where)
    if z < -1 + 1e-12:
        return np.array([1.0, 0.0, 0.0, 0.0])
    return _unit(np.array([-y, x, 0.0, 1.0 + z]), where)


def _quaternion(rotation: Array) -> Array:
    """Return the quaternion of a rotation: the eigenvector of Shepperd's symmetric matrix."""
    (a, b, c), (d, e, f), (g, h, i) = rotation
    symmetric = [
        [a - e - i, b + d, c + g, h - f],
        [b + d, e - a - i, f + h, c - g],
        [c + g, f + h, i - a - e, d - b],
        [h - f, c - g, d - b, a + e + i],
    ]
    return np.linalg.eigh(np.array(symmetric))[1][:, -1]


def _unit(values: Array, where: str) -> Array:
    length = float(np.linalg.norm(values))
    if length < SHORTEST_DIRECTION:
        raise InputError(f"{where}: a direction must not be 0")
    return values / length
