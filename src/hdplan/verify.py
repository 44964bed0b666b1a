# ruff: noqa: D102, D105
"""Check a proof that a robot's motion is free. One file, NumPy alone, nothing of the planner that wrote the proof.

    python -m hdplan.verify SCENE TRAJECTORY PROOF     or     python verify.py SCENE TRAJECTORY PROOF

Scene (YAML), robot (URDF, SRDF, meshes) and motion are read here, by parsers of its own. A proof (`docs/proof.md`)
holds no geometry, only, for every pair of convex pieces, a binary tree of intervals of the motion with a direction n at
every leaf. "Accepted" is a theorem about real numbers; what it rests on is printed with it (`ASSUMES`).

Numbers. A `Ball` is a real number known up to a radius. NumPy's results are used only as IEEE 754 defines them: + - x /
and sqrt, rounded to nearest, in any order, also fused: a sum of k products is then off by at most k 2^-53 /
(1 - k 2^-53) times the sum of the absolute products (Higham 2002, section 3.1). Radii are rounded up by `up`. What is
not a number passes no comparison.

Leaves. On a leaf, -1 <= s <= 1, the joints are at q(s) = q_m + s d + e(s), |e_j| <= eps_j: the control points of the
motion's polynomials differ by at most eps from those of the straight line, so the curve does. Seen from the last body
that carries both pieces, a point x of a piece is at x + s (W x x + V) + r(s), with W and V the sums over the joints j
beyond that body of d_j z_j and d_j o_j x z_j (or d_j z_j, if j slides); z_j is the joint's axis, o_j a point on it, at
q_m. With rho_j the greatest distance of the piece from axis j (1 if j slides), |d2x / dq_i dq_j| <= rho_j for i at or
before j, and 0 if i slides, so that

    |r| <= R = 1/2 sum_j |d_j| rho_j (|d_j| [j turns] + 2 sum_(i<j, turns) |d_i|) + sum_j eps_j rho_j.

rho_j is at most the distance of axis j from the centre of a ball around the piece at q_m, plus its radius, plus what
the joints after j move the piece: sum_(k>j) (|d_k| + eps_k) rho_k. What is linear in s is least at s = -1 or 1, so that

    |n| distance >= min_(s = -1, 1) [min_(a in A) n.(a + s a') - max_(b in B) n.(b + s b')] - (R_A + R_B) |n|,

where least and greatest values over a piece are those over its corners, and of the ellipsoid that sweeps them.

Meshes. A mesh may be divided into groups of triangles, whose hulls contain every triangle. Two surfaces that never meet
do not let one body into the other: if the hulls around both are apart once, neither ever lies within the other. That no
link lies within another one of the same robot is assumed.
"""

from __future__ import annotations

import csv
import hashlib
import json
import os
import re
import sys
import xml.etree.ElementTree as ElementTree
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import yaml

MAGIC, VERSION = b"hdplan proof\n", 1
MOST_BYTES, MOST_HEAD, MOST_LEAVES, MOST_PAIRS = 1 << 27, 1 << 20, 200_000, 1_000_000  # of a proof's content
DEEPEST = 50  # of a proof's trees
MOST_MEMORY, MOST_TIME = 1 << 31, 30  # bytes, and seconds of a processor, that a check may take beside Python itself
NARROWEST, INSTANT = 2.0**-30, 2.0**-36  # of an interval between two rows; of one that stands for a row
AT_ONCE, MOST_PARTS = 20_000, 50_000  # leaves checked together, and parts of rows within them
DECIMAL = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")  # Python reads 1_0 as 10, too
EPS = 2.0**-53  # of rounding to nearest
SAME, ROUNDED = 1e-6, 1e-9  # [rad or m] between the motion's end and the scene's; by which it may be beyond a limit

RATES, TARGETS = ("velocity", "acceleration", "jerk"), "joints state pose poses all any"
ASKING = {  # sections that ask for clearances, and their keys
    "self_collision": "clearance",
    "planner": (
        "waypoints clearance activation gamma shaping_length distance link_bodies swept normals polish objective"
    ),
}
CLAIMS = {"clearance", "limits", "start", "goal", "torque", "path", *RATES}

ASSUMES = """URDF, SRDF and meshes are the robot: links are rigid, and their collision geometry; joints have no play
the robot follows the curve of the trajectory's file, without rounding its corners
obstacles are what and where the scene says, and move as it says; what a link holds is fixed to it
joints that do not move stay where scene or trajectory hold them, or else where the proof says
links that turn about one joint with no other link between them, and pairs excused by SRDF or scene, may touch
links that do not move relative to each other, and links fixed to the world and standing obstacles, are not compared
a mesh is its triangles and what they enclose; no link of the robot lies within another one, apart from its surface
the computer's + - x / and square root are those of IEEE 754, rounded to nearest
Python, NumPy and the libraries that read YAML and XML work
the files read are those whose hashes are in the proof"""


class RejectedError(Exception):
    """Why a proof is not accepted, in one line."""

    def __init__(self, words: str) -> None:
        super().__init__(shown(" ".join(words.split())))


def shown(line: str) -> str:
    """A line without characters by which a name in a file could look like several."""
    return "".join(x if x.isprintable() else "?" for x in line)


def need(condition: Any, words: str) -> None:
    """Reject unless a condition holds."""
    if not condition:
        raise RejectedError(words)


# --- real numbers up to a radius --------------------------------------------------------------------------------------


def up(x: Any) -> Any:
    """An upper bound of what fewer than 1000 roundings (or underflows) of numbers >= 0 have made too small."""
    return x * (1.0 + 2.0**-40) + 2.0**-1000


class Ball:
    """Real numbers within `rad` of `mid`, arrays of one shape."""

    __array_ufunc__ = None

    def __init__(self, mid: Any, rad: Any = 0.0) -> None:
        self.mid: Any = np.asarray(mid, dtype=np.float64)
        rad = np.asarray(rad, dtype=np.float64)
        self.rad: Any = rad if rad.shape == self.mid.shape else np.broadcast_to(rad, self.mid.shape)

    def __getitem__(self, key: Any) -> Ball:
        return Ball(self.mid[key], self.rad[key])

    def __neg__(self) -> Ball:
        return Ball(-self.mid, self.rad)

    def __add__(self, other: Any) -> Ball:
        b = other if isinstance(other, Ball) else Ball(other)
        mid = self.mid + b.mid
        return Ball(mid, up(self.rad + b.rad + EPS * np.abs(mid)))

    def __sub__(self, other: Any) -> Ball:
        b = other if isinstance(other, Ball) else Ball(other)
        return self + (-b)

    def __rsub__(self, other: Any) -> Ball:
        return Ball(other) - self

    def __mul__(self, other: Any) -> Ball:
        b = other if isinstance(other, Ball) else Ball(other)
        mid = self.mid * b.mid
        return Ball(mid, up(np.abs(self.mid) * b.rad + self.rad * (np.abs(b.mid) + b.rad) + EPS * np.abs(mid)))

    __radd__, __rmul__ = __add__, __mul__

    @property
    def size(self) -> Any:
        """An upper bound of the absolute values."""
        return up(np.abs(self.mid) + self.rad)


def dot(spec: str, a: Any, b: Any) -> Ball:
    """einsum of two arrays; sums of at most 60 products, or of as many as the first array's last axis is long."""
    a, b = (x if isinstance(x, Ball) else Ball(x) for x in (a, b))
    terms = max(60, a.mid.shape[-1])
    need(terms < 900, "too many joints")  # as `up` allows for fewer than 1000 roundings
    one, two = np.abs(a.mid), np.abs(b.mid)
    rad = np.einsum(spec, one, b.rad + (terms + 4) * EPS * two) + np.einsum(spec, a.rad, two + b.rad)
    return Ball(np.einsum(spec, a.mid, b.mid), up(rad))


def stack(parts: Sequence[Ball], axis: int = 0) -> Ball:
    """np.stack."""
    return Ball(np.stack([x.mid for x in parts], axis), np.stack([x.rad for x in parts], axis))


def cross(a: Any, b: Ball) -> Ball:
    """a x b along the last axis."""
    i, j = [1, 2, 0], [2, 0, 1]
    one, two = b[..., j] * a[..., i], b[..., i] * a[..., j]
    return Ball.__sub__(one, two)


def norm(x: Any) -> Any:
    """An upper bound of lengths along the last axis, from upper bounds of absolute values."""
    return up(np.sqrt(up((x * x).sum(axis=-1))))


def above(a: Any, b: Any) -> Any:
    """An upper bound of a + b."""
    return a + b + 4 * EPS * (np.abs(a) + np.abs(b)) + 2.0**-1000


def length(v: Any) -> Ball:
    """|v|: with m = fl(|v|) and S = |v|^2 known as a ball, |sqrt(S) - m| <= |S - m^2| / m."""
    square = dot("i,i->", v, v)
    m = float(np.sqrt(square.mid))
    need(1e-6 < m < 1e6, "a direction or rotation is none")
    return Ball(m, up((Ball(m) * m - square).size / m))


def inverse(x: Ball) -> Ball:
    """1 / x for x > 0: with |x - m| <= r <= m / 2, |1 / x - 1 / m| <= r / (m (m - r)) <= 2 r / m^2."""
    need((x.mid > 2 * x.rad).all(), "a division by what may be 0")
    return Ball(1 / x.mid, up(2 * x.rad / (x.mid * x.mid) + 2 * EPS / x.mid))


def unit(v: Any) -> Ball:
    """v / |v|."""
    return Ball(v) * inverse(length(v))


HALF_PI = Ball(1.5707963267948966, 6.2e-17)  # pi/2 = 1.5707963267948965579989... + 6.123...e-17
SINE, COSINE = (
    [Ball((-1) ** (n // 2) / float(np.prod(np.arange(1, n + 1, dtype=float))), EPS) for n in range(first, 19, 2)]
    for first in (1, 0)
)


def cos_sin(x: Any) -> tuple[Ball, Ball]:
    """Cosine and sine of exact numbers |x| <= 1e6.

    With k the whole number nearest to 2x/pi and r = x - k pi/2, they are those of r, exchanged and with signs by k mod
    4. For |r| <= 0.8 the series of sin after r^17 and of cos after r^18 alternate with falling terms, so that they are
    off by less than the next: 0.8^19 / 19! < 1.3e-19, 0.8^20 / 20! < 5e-21. The coefficients 1/n!, n <= 18, are one
    division by a whole number that is exact in double precision (18! < 2^53), off by less than 2^-53.
    """
    x = np.asarray(x, dtype=np.float64)
    need((np.abs(x) <= 1e6).all(), "an angle is beyond 1e6 rad")
    k = np.rint(x * (2 / np.pi))
    r = x - k * HALF_PI
    need((r.size <= 0.8).all(), "an angle could not be reduced")
    square, sin, cos = r * r, Ball(np.zeros_like(x)), Ball(np.zeros_like(x))
    for a, b in zip(reversed([*SINE, Ball(0.0)]), reversed(COSINE), strict=True):
        sin, cos = sin * square + a, cos * square + b
    sin, cos = sin * r + Ball(0.0, 1.3e-19), cos + Ball(0.0, 5e-21)
    turn, ways = k.astype(np.int64) % 4, ((cos, -sin, -cos, sin), (sin, cos, -sin, -cos))
    one, two = (Ball(np.choose(turn, [v.mid for v in w]), np.choose(turn, [v.rad for v in w])) for w in ways)
    return one, two


Pose = tuple[Ball, Ball]  # rotation (3, 3) and origin (3,)
HERE: Pose = (Ball(np.eye(3)), Ball(np.zeros(3)))
CROSS = np.zeros((3, 3, 3))  # CROSS v is the matrix of v x ...
CROSS[[0, 1, 2], [1, 2, 0], [2, 0, 1]], CROSS[[0, 1, 2], [2, 0, 1], [1, 2, 0]] = -1.0, 1.0
for _array in (CROSS, *(part for ball in (HALF_PI, *SINE, *COSINE, *HERE) for part in (ball.mid, ball.rad))):
    _array.flags.writeable = False


def rotation(axis: Ball, angle: Any) -> Ball:
    """Rotations (..., 3, 3) by exact angles (...,) about a unit axis: 1 + sin K + (1 - cos) K^2, K x = axis x x."""
    k, (cos, sin) = dot("ijk,k->ij", CROSS, axis), cos_sin(angle)
    return np.eye(3) + sin[..., None, None] * k + (1.0 - cos)[..., None, None] * dot("ij,jk->ik", k, k)


def compose(a: Pose, b: Pose) -> Pose:
    """The pose b, given in the frame a, where a is."""
    return dot("ij,jk->ik", a[0], b[0]), dot("ij,j->i", a[0], b[1]) + a[1]


def rpy(angles: Any) -> Ball:
    """R = Rz(yaw) Ry(pitch) Rx(roll)."""
    turn = HERE[0]
    for axis in np.flatnonzero(angles):
        turn = dot("ij,jk->ik", rotation(Ball(np.eye(3)[axis]), angles[axis]), turn)
    return turn


@dataclass(eq=False)
class Line:
    """Numbers m + b s + r, |s| <= 1 the same for all, |r| <= `rad`; arrays of one shape, the first axis for parts."""

    mid: Any
    slope: Any
    rad: Any

    def __add__(self, other: Line) -> Line:
        mid, slope = self.mid + other.mid, self.slope + other.slope
        return Line(mid, slope, up(self.rad + other.rad + EPS * (np.abs(mid) + np.abs(slope))))

    @property
    def size(self) -> Any:
        """An upper bound of the absolute values."""
        return up(np.abs(self.mid) + np.abs(self.slope) + self.rad)


def still(x: Ball) -> Line:
    """What does not depend on s."""
    return Line(x.mid, np.zeros_like(x.mid), x.rad)


def times(spec: str, a: Line, b: Line) -> Line:
    """einsum of two, sums of at most 9 products: what is quadratic in s goes to the radius."""

    def sums(x: Any, y: Any) -> Any:
        return np.einsum(spec, x, y)

    one, two = np.abs(a.mid) + np.abs(a.slope), np.abs(b.mid) + np.abs(b.slope)
    rad = sums(np.abs(a.slope), np.abs(b.slope)) + sums(one, b.rad + 16 * EPS * two) + sums(a.rad, two + b.rad)
    return Line(sums(a.mid, b.mid), sums(a.mid, b.slope) + sums(a.slope, b.mid), up(rad))


def wedge(a: Line, b: Line) -> Line:
    """a x b of vectors (k, 3)."""
    parts = (
        np.einsum("ijk,pk->pij", x, y) for x, y in zip((CROSS, CROSS, np.abs(CROSS)), vars(a).values(), strict=True)
    )
    return times("pij,pj->pi", Line(*parts), b)


def line_of(control: Ball) -> Line:
    """Polynomials (k, n) by their control points (k, d + 1, n), -1 <= s <= 1: those of m + b s are m + b (2 i / d - 1),
    and a curve is no farther from it than its control points are from these."""
    slope = (control.mid[:, -1] - control.mid[:, 0]) / 2
    degree = control.mid.shape[1] - 1
    line = Ball(2 * np.arange(degree + 1) / max(degree, 1) - 1, 4 * EPS)[None, :, None] * slope[:, None]
    over = control - line
    mid = (over.mid.max(axis=1) + over.mid.min(axis=1)) / 2
    return Line(mid, slope, (over - mid[:, None]).size.max(axis=1))


# --- what the files say -----------------------------------------------------------------------------------------------


def numbers(value: Any, count: int, what: str) -> Any:
    """Return `count` finite numbers; one for all of them will do."""
    rows = value if isinstance(value, list) else [value] * count
    good = len(rows) == count and all(type(x) in (int, float) and abs(x) < 1e9 for x in rows)
    need(good, f"{what}: {count} finite numbers are expected")
    return np.array(rows, dtype=np.float64)


def mapping(value: Any, what: str, allowed: str) -> dict[str, Any]:
    """Return a mapping that has no other keys than those `allowed`, as others may change what is meant."""
    need(isinstance(value, dict) and {*value} <= {*allowed.split()}, f"{what}: a mapping of some of {allowed}")
    return {key: item for key, item in value.items() if item is not None}


def listing(value: Any, what: str) -> list[Any]:
    """Return a list; empty for nothing."""
    need(value is None or isinstance(value, list), f"{what}: a list is expected")
    return value or []


def unique(pairs: list[tuple[Any, Any]]) -> dict[str, Any]:
    """Return a mapping in which no key stands twice, as that would hide what the other says."""
    need(all(type(key) is str for key, _ in pairs), "a mapping has a key that is not a word")
    need(len(pairs) == len({key for key, _ in pairs}), f"a key stands twice among {[key for key, _ in pairs]}")
    return dict(pairs)


class Loader(yaml.SafeLoader):
    """Reads YAML without keys that stand twice."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        self.flatten_mapping(node)
        return unique([(self.construct_object(key, True), self.construct_object(x, True)) for key, x in node.value])


def pose_of(value: Any, what: str) -> Pose:
    """Read a pose of a scene."""
    keys, turn = mapping(value or {}, what, "position rpy quaternion_xyzw"), HERE[0]
    need(not {"rpy", "quaternion_xyzw"} <= {*keys}, f"{what}: has two rotations")
    if "quaternion_xyzw" in keys:
        q = unit(numbers(keys["quaternion_xyzw"], 4, what))
        k = dot("ijk,k->ij", CROSS, q[:3])
        turn = np.eye(3) + 2.0 * (q[3] * k + dot("ij,jk->ik", k, k))
    elif "rpy" in keys:
        turn = rpy(numbers(keys["rpy"], 3, what))
    return turn, Ball(numbers(keys.get("position", 0.0), 3, what))


def words(element: Any, key: str, default: str) -> Any:
    """Return the three numbers of an element's attribute."""
    text = default if element is None else element.get(key, default)
    return numbers([float(x) for x in text.split()], 3, f"URDF: {key}")


def inertia(six: Any) -> Any:
    """The matrix of xx, xy, xz, yy, yz, zz."""
    return np.array(six)[np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])]


def solid_inertia(shape: dict[str, Any], mass: float) -> Ball | None:
    """The inertia about its centre of a box or ellipsoid of even density, m / 12 (b^2 + c^2) of edges and m / 5 (b^2 +
    c^2) of semi-axes; of a cylinder m r^2 / 2 about its axis and m (3 r^2 + l^2) / 12; None of other shapes."""
    kind, r = shape["type"], shape.get("radius", 0.0)
    three = np.array(shape.get("size", shape.get("radii", [r, r, r])), dtype=float)
    squares = three * three
    if kind == "cylinder":
        diagonal = mass / 12 * np.array([3 * r * r + shape["length"] ** 2] * 2 + [6 * r * r])
    elif kind in ("box", "sphere", "ellipsoid"):
        diagonal = mass / (12 if kind == "box" else 5) * (squares.sum() - squares)
    else:
        return None
    return Ball(np.diag(diagonal), np.diag(16 * EPS * (diagonal + mass * squares.sum())))


def origin(element: Any) -> Pose:
    """Read the origin of an element of a URDF."""
    at = element.find("origin")
    need(len(element.findall("origin")) <= 1 and (at is None or {*at.attrib} <= {"xyz", "rpy"}), "URDF: an origin")
    return rpy(words(at, "rpy", "0 0 0")), Ball(words(at, "xyz", "0 0 0"))


def triangles(path: Path, data: bytes) -> Ball:
    """Return the corners (F, 3, 3) of a mesh file's triangles."""
    kind, size = path.suffix.lower(), 84 + 50 * int.from_bytes(data[80:84], "little")
    need(kind in (".stl", ".obj", ".dae"), f"{path}: meshes of this kind cannot be checked (stl, obj and dae can)")
    if kind == ".stl" and len(data) == size:
        rows = np.frombuffer(data, dtype=np.dtype([("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")]), offset=84)
        found = Ball(rows["v"])
    else:
        need(b"\0" not in data, f"{path}: is no text")
        found = collada(tree(data)) if kind == ".dae" else Ball((stl if kind == ".stl" else obj)(data))
    good = len(found.mid) and (np.abs(found.mid) < 1e9).all() and (found.rad < 1e-3).all()
    need(good, f"{path}: has no triangles, or numbers that are not finite")
    return found


def stl(data: bytes) -> Any:
    """Return the triangles of an STL file that is text: of 21 words each, between two lines."""
    first, *lines, last = data.strip().lower().replace(b"\r", b"\n").split(b"\n")
    words = np.array(b" ".join(lines).split()).reshape(-1, 21)
    rule = b"facet normal outer loop vertex vertex vertex endloop endfacet".split()
    same = words[:, [0, 1, 5, 6, 7, 11, 15, 19, 20]] == rule
    good = first.startswith(b"solid") and last.startswith(b"endsolid") and same.all() and b"vertex" not in first + last
    need(good, "STL: its lines are not those of triangles")
    return words[:, [8, 9, 10, 12, 13, 14, 16, 17, 18]].astype(np.float64).reshape(-1, 3, 3)


def fans(faces: Iterable[Sequence[int]]) -> Any:
    """Return triangles (F, 3) of polygons, all at the first corner of theirs."""
    corners = [[x[0], x[i], x[i + 1]] for x in faces for i in range(1, len(x) - 1)]
    return np.array(corners, dtype=np.int64).reshape(-1, 3)


OBJ_WORDS = b"v f vn vt vp g o s l p usemtl mtllib".split()


def obj(data: bytes) -> Any:
    """Return the triangles of an OBJ file: vertices count from 1, or backwards from the last before the face."""
    points, faces = list[list[float]](), list[list[int]]()
    for key, *rest in filter(None, (line.split() for line in data.replace(b"\r", b"\n").split(b"\n"))):
        good = (key in OBJ_WORDS or key[:1] == b"#") and not [key, *rest][-1].endswith(b"\\")
        need(good, "OBJ: a line that may be read in two ways")
        if key == b"v":
            points.append([float(x) for x in rest[:3]])
        elif key == b"f":
            told = [int(x.split(b"/")[0]) for x in rest]
            faces.append([x - 1 if x > 0 else len(points) + x for x in told])
            need(all(told) and min(faces[-1]) >= 0, "OBJ: a face has a vertex that is not there")
    return np.array(points, dtype=np.float64).reshape(-1, 3)[fans(faces)]


def collada(root: Any) -> Ball:
    """Return the triangles of a COLLADA file in metres, whichever of its axes is up (as ROS reads it)."""
    for x in root.iter():
        x.tag = x.tag.rpartition("}")[2]
    named = unique([(x.get("id"), x) for x in root.iter() if "id" in x.attrib])
    need(all(float(x.get("meter", 1)) == 1 for x in root.iter("unit")), "COLLADA: its unit is not the metre")

    def there(element: Any, key: str = "source") -> Any:
        need(element is not None and element.get(key, "")[:1] == "#", "COLLADA: a reference is not within the file")
        return named[element.get(key)[1:]]

    def soup(geometry: Any) -> Iterator[Ball]:
        need({x.tag for x in geometry} <= {"mesh", "extra"}, "COLLADA: a geometry that is no mesh")
        for part in geometry.findall("mesh/*"):
            need(part.tag in ("source", "vertices", "lines", "triangles", "polylist", "extra"), f"COLLADA: {part.tag}")
            if part.tag not in ("triangles", "polylist"):  # lines enclose nothing
                continue
            ways = {x.get("semantic"): x for x in part.findall("input")}
            source = there(there(ways["VERTEX"]).find("input[@semantic='POSITION']"))
            (array,), (way,) = source.findall("float_array"), source.findall("technique_common/accessor")
            plain = (way.get("stride"), way.get("offset", "0"), there(way)) == ("3", "0", array)
            plain = plain and [x.get("name") for x in way.findall("param")] in ([], ["X", "Y", "Z"])
            need(plain, "COLLADA: its points are not three numbers each")
            points, stride = np.array(array.text.split(), dtype=np.float64).reshape(-1, 3), 1
            stride += max(int(x.get("offset")) for x in part.findall("input"))
            text = " ".join(x.text or "" for x in part.findall("p")).split()
            corners = np.array(text, dtype=np.int64).reshape(-1, stride)[:, int(ways["VERTEX"].get("offset"))]
            if part.tag == "polylist":
                ends = np.cumsum(np.array((part.findtext("vcount") or "").split(), dtype=np.int64))
                need(len(corners) == ends.max(initial=0), "COLLADA: polygons of other sizes than it says")
                corners = fans(x.tolist() for x in np.split(corners, ends[:-1]))
            need((corners >= 0).all(), "COLLADA: a face has a vertex that is not there")
            yield Ball(points[corners.reshape(-1, 3)])

    def parts(node: Any) -> list[Ball]:
        ways = ("matrix", "translate", "scale", "rotate")
        plain = (*ways, "asset", "node", "instance_geometry", "instance_camera", "instance_light", "extra")
        need({x.tag for x in node} <= {*plain}, f"COLLADA: a node has other parts than {', '.join(plain)}")
        found = [x for each in node.findall("instance_geometry") for x in soup(there(each, "url"))]
        found += [x for each in node.findall("node") for x in parts(each)]
        for step in [x for x in reversed(node) if x.tag in ways]:
            v, (turn, at) = np.array(step.text.split(), dtype=np.float64), HERE
            if step.tag == "matrix":
                need(v[12:].tolist() == [0, 0, 0, 1], "COLLADA: a matrix is no affine map")
                turn, at = (Ball(x) for x in np.split(v.reshape(4, 4)[:3], [3], axis=1))
                at = at[:, 0]
            elif step.tag == "rotate":  # by an angle in degrees, wrong by less than 4 roundings
                turn = rotation(unit(v[:3]), v[3] * np.pi / 180)
                turn = Ball(turn.mid, up(turn.rad + 4 * EPS * 0.02 * abs(v[3])))
            else:
                turn, at = (turn, Ball(v)) if step.tag == "translate" else (Ball(np.diag(v)), at)
            found = [dot("ij,fkj->fki", turn, x) + at for x in found]
        return found

    all_ = parts(there(root.find("scene/instance_visual_scene"), "url"))
    return Ball(*(np.concatenate([np.zeros((0, 3, 3)), *x]) for x in ([y.mid for y in all_], [y.rad for y in all_])))


def tree(data: bytes) -> Any:
    """Return the root of an XML file. A DTD could give attributes that are not to be seen where they act."""
    need(b"<!DOCTYPE" not in data and b"\0" not in data, "XML with a DTD, or in another encoding")
    root = ElementTree.fromstring(data)
    for word in {word for x in root.iter() for value in x.attrib.values() for word in value.split()}:
        try:
            float(word)
        except ValueError:
            continue
        need(DECIMAL.fullmatch(word), f"XML: '{word}' is no number to other readers")
    return root


def robot_of(library: Path, name: str) -> tuple[Path, Path | None]:
    """Return URDF and SRDF of a robot of example-robot-data, of which a proof must not choose the one it likes. Its
    name is its file's, without `_robot`, or its folder's, without `_description`, where several folders have such a
    file; of two such files in a folder it is the larger one. Its SRDF is that of its name, or of the longest beginning
    of it. Any file goes by FOLDER/FILE, without SRDF."""
    stems, found = dict[str, set[Path]](), list[Path]()
    files = [(x, x.parents[1], x.stem.removesuffix("_robot")) for x in library.glob("*/*/*.urdf")]
    files = [x for x in files if x[0].parent.name in ("urdf", "robots")]
    for _, folder, stem in files:
        stems.setdefault(stem, set()).add(folder)
    for file, folder, stem in files:
        plain = stem if len(stems[stem]) == 1 else folder.name.removesuffix("_description")
        found += [file] * (name in (plain, f"{folder.name}/{file.name}"))
    need(found and len({x.parents[1] for x in found}) == 1, f"robot: '{name}' is not the name of one robot")
    urdf = max(found, key=lambda x: x.stat().st_size)
    srdfs = {x.stem: x for x in (urdf.parents[1] / "srdf").glob("*.srdf") if "/" not in name}
    begins = max((x for x in srdfs if name.startswith(x)), key=len, default="")
    return urdf, srdfs.get(urdf.stem if urdf.stem in srdfs else begins)


def excused(srdf: Any) -> dict[frozenset[str], str]:
    """Return the pairs of links that an SRDF leaves out."""
    known = not {"enable_collisions", "disable_default_collisions"} & {x.tag for x in srdf}
    need(known, "SRDF: only disable_collisions can be checked, no enable_collisions or disable_default_collisions")
    pairs = [frozenset((x.get("link1", ""), x.get("link2", ""))) for x in srdf.findall("disable_collisions")]
    return dict.fromkeys(pairs, "the SRDF")


@dataclass(eq=False)
class Piece:
    """The hull of corners, swept by an ellipsoid, in a frame that is fixed in that of a joint (-1: the world)."""

    name: str  # of the link, held object or obstacle
    joint: int
    pose: Pose
    key: str  # of its shape, which several pieces may cover
    corners: Any  # (m, 3)
    off: Any = 0.0  # (3,) by how much the corners may be wrong
    sweep: Any = field(default_factory=lambda: np.zeros(3))  # (3,) semi-axes of the ellipsoid, along the frame's axes
    cover: bool = False  # whether it is only the hull around several pieces of its shape


@dataclass(eq=False)
class Bond:
    """Points (m, 3) in one joint's frame, or directions (`turns`), that are to be where others are in another's, off by
    at most `most`: the length of all differences as one vector, or of their parts `along` a direction."""

    what: str
    joint: int
    local: Ball
    other: int
    target: Ball
    most: float
    turns: bool = False
    along: Ball | None = None


@dataclass
class Joint:
    """A joint that moves; its pose is that of its frame at 0, in the frame of the moving joint before it (-1: none)."""

    name: str
    parent: int
    pose: Pose
    axis: Ball
    turns: bool
    low: float
    high: float
    most: dict[str, float] = field(default_factory=dict)  # of velocity and torque, by the URDF
    follows: bool = False  # another joint


def turn_of(matrix: Ball) -> tuple[Ball, Ball]:
    """Axis and angle of a rotation M that is neither too small nor near a half turn. M - M^T is 2 sin(angle) times the
    cross product's matrix of the axis, and its trace 1 + 2 cos(angle). With w near the angle, e = sin(angle) cos w -
    cos(angle) sin w is sin(angle - w), so that |angle - w| <= 1.01 |e| where |e| <= 0.1. A direction v off by r is
    off by at most 2 r / |v| once it has length 1."""
    v = dot("ijk,ij->k", CROSS, matrix) * 0.5
    m = float(np.sqrt((v.mid * v.mid).sum()))
    cos = (dot("ij,ij->", np.eye(3), matrix) - 1.0) * 0.5
    r = norm(v.rad)
    w = float(np.arctan2(m, cos.mid))
    one, two = cos_sin(w)
    e, near = (Ball(m, r) * one - cos * two).size, (cos * one + Ball(m, r) * two).mid > 0.9
    good = m > 1e-6 > 1e6 * r and e < 0.1 and near
    need(good, "an obstacle turns by too little, or by half a turn, from one pose to the next")
    axis = unit(v.mid * 2.0**10)
    return Ball(axis.mid, up(axis.rad + 2 * r / m)), Ball(w, up(1.01 * e))


def track(times: list[float], values: list[Ball], now: float) -> Ball:
    """Return what is linear between times and constant outside of them."""
    if not times[0] < now < times[-1]:
        return values[0] if now <= times[0] else values[-1]
    i = max(k for k, x in enumerate(times) if x <= now)
    return values[i] + (values[i + 1] - values[i]) * ((Ball(now) - times[i]) * inverse(Ball(times[i + 1]) - times[i]))


def blossom(control: Ball, start: Any, end: Any) -> Ball:
    """Return the control points (k, d + 1, n) of parts of polynomials from `start` to `end` (k, 1, 1): the values of
    their blossoms."""
    made, degree = [], control.mid.shape[1] - 1
    for i in range(degree + 1):
        points = control
        for step in range(degree):
            cut = end if step < i else start
            points = points[:, :-1] * (1.0 - cut) + points[:, 1:] * cut
        made.append(points[:, 0])
    return stack(made, 1)


class World:
    """What is to be kept apart, as the files say it: pieces of the robot, of what it holds, of obstacles, and pairs."""

    def __init__(self, scene: Path, motion: Path, said: dict[str, Any], cuts: dict[str, Any]) -> None:
        """Read all files; `said` is the head of a proof, `cuts` its groups of the triangles of meshes."""
        self.scene, self.said, self.cuts, self.files = scene, said, cuts, dict[str, str]()
        self.keys = set[str]()  # of all shapes
        self.pieces, self.meshes = list[Piece](), dict[str, Any]()  # triangles of each mesh, by its key
        sections = "robot obstacles attached start goal from_request self_collision limits payload path timing planner"
        self.top = mapping(yaml.load(self.file("scene", scene), Loader), str(scene), f"hdplan {sections}")
        need(self.top.get("hdplan") == 1, f"{scene}: not a hdplan scene, version 1")
        self.read_motion(motion)
        self.read_robot()
        self.own, self.clearances, taken = len(self.pieces), dict[str, float](), {x.name for x in self.pieces}
        for i, entry in enumerate(listing(self.top.get("obstacles"), "obstacles")):
            keys = mapping(entry, f"obstacles[{i}]", "name shape pose clearance motion")
            name = str(keys.get("name", f"obstacle{i}"))
            need(name not in taken, f"obstacle '{name}': its name is taken")
            taken.add(name)
            usual = self.wanted("planner") if "clearance" in listing(said.get("claims"), "claims") else 0.0
            self.clearances[name] = float(numbers(keys.get("clearance", usual), 1, name)[0])
            joint, pose = -1, pose_of(keys.get("pose"), name)
            need("pose" not in keys or "times" not in (keys.get("motion") or {}), f"obstacle '{name}': has two poses")
            if "motion" in keys:
                joint, pose = self.drift(name, mapping(keys["motion"], name, "velocity spin times poses"), pose)
            self.add(name, joint, pose, self.shape(keys.get("shape"), name), name)
        self.lay_tracks()
        self.pair_up()

    @property
    def limits(self) -> dict[str, Any]:
        """The scene's limits."""
        return mapping(self.top.get("limits", {}), "limits", f"position torque {' '.join(RATES)}")

    def wanted(self, section: str) -> float:
        """The clearance that a section of the scene asks for."""
        said = self.top.get(section, {})
        keys = {} if isinstance(said, bool) else mapping(said, section, ASKING[section])
        return float(numbers(keys.get("clearance", 0.0), 1, f"{section}.clearance")[0])

    def file(self, key: str, path: Path) -> bytes:
        """Read a file and note its hash, which must be the proof's."""
        need(path.is_file(), f"{path}: no such file")
        data = path.read_bytes()
        digest = hashlib.sha256(data).hexdigest()
        while self.files.setdefault(key, digest) != digest:  # two meshes of one name
            key += "'"
        same = self.said["files"].get(key, digest) == digest
        need(same, f"{key}: {path} is not the file that was proven: its SHA-256 differs")
        return data

    def read_motion(self, path: Path) -> None:
        """Read the rows, and make the control points (N - 1, d + 1, n) of the polynomial between each two."""
        data, kind, rates = self.file("motion", path), path.suffix.lower(), ("positions", "velocities", "accelerations")
        need(kind in (".json", ".csv"), f"{path}: motions of this kind cannot be checked (json and csv can)")
        if kind == ".json":
            keys = f"hdplan_trajectory joint_names interpolation locked times verdict steps {' '.join(rates)}"
            said = mapping(json.loads(data, object_pairs_hook=unique), str(path), keys)
            self.names, self.locked = [str(x) for x in said["joint_names"]], said.get("locked", {})
        else:
            head, *lines = [row for row in csv.reader(data.decode("utf-8-sig").splitlines()) if row]
            columns = dict(zip((x.strip() for x in head), np.array(lines, dtype=np.float64).T, strict=True))
            ends, self.locked = ("", ".velocity", ".acceleration"), dict[str, float]()
            self.names = [x for x in columns if x != "time" and not x.endswith(ends[1:])]
            need(len(columns) == len(head), f"{path}: a column stands twice")
            said = {"times": columns["time"]} if "time" in columns else {}
            for rate, end in zip(rates, ends, strict=True):
                if any(x.endswith(end) for x in columns):
                    said[rate] = np.transpose([columns[x + end] for x in self.names])
        need(said.get("hdplan_trajectory", 1) == 1, f"{path}: not a hdplan trajectory, version 1")
        given = [np.array(said[key], dtype=np.float64) for key in rates if key in said]
        rule = ("", "linear", "cubic", "quintic")[len(given)]
        need(said.get("interpolation", rule) == rule, f"{path}: its interpolation is not that of its rows")
        times = np.array(said["times"], dtype=np.float64) if "times" in said else None
        count, n = given[0].shape
        good = count >= 2 and 1 <= n <= 60 and len({*self.names}) == n == len(self.names)
        need(good, f"{path}: too few rows, or too many joints, or a joint twice")
        need(all(x.shape == (count, n) and (np.abs(x) < 1e9).all() for x in given), f"{path}: numbers must be finite")
        rated = [x in said for x in ("times", *rates[1:])]
        need(sorted(rated, reverse=True) == rated, f"{path}: velocities need times, accelerations need velocities")
        a, b = Ball(given[0][:-1]), Ball(given[0][1:])
        control, self.rows = [a, b], given[0]
        self.times: Any = times
        if times is not None:
            good = times.shape == (count,) and (np.abs(times) < 1e9).all() and (np.diff(times) > 0).all()
            need(good, f"{path}: times must be finite and increase")
            width = (Ball(times[1:]) - times[:-1])[:, None]
        if len(given) == 2:
            v, w = (x * (width * Ball(1 / 3, EPS)) for x in (given[1][:-1], given[1][1:]))
            control = [a, a + v, b - w, b]
        if len(given) == 3:
            v, w = (x * (width * Ball(0.2, EPS)) for x in (given[1][:-1], given[1][1:]))
            x, y = (x * (width * width * Ball(0.05, EPS)) for x in (given[2][:-1], given[2][1:]))
            control = [a, a + v, a + 2.0 * v + x, b - 2.0 * w + y, b - w, b]
        self.control = stack(control, 1)

    def drift(self, name: str, motion: dict[str, Any], pose: Pose) -> tuple[int, Pose]:
        """Note how an obstacle moves, as joints that follow the time: three slide along the world's axes, and every
        turn has one of its own, the last turn first. Return the last joint, and the obstacle's pose in its frame."""
        need(self.times is not None, f"obstacle '{name}': moves, and the motion has no times")
        tracks: list[tuple[Ball, list[float], list[Ball]]] = []  # of the turns: axis, and angles at two times
        if {*motion} == {"times", "poses"}:
            times = numbers(motion["times"], len(listing(motion["times"], name)), name).tolist()
            poses = [pose_of(x, name) for x in listing(motion["poses"], name)]
            need(len(poses) == len(times) > 1 and min(np.diff(times)) > 0, f"obstacle '{name}': times must increase")
            places, pose = stack([at for _, at in poses], 1), poses[0]
            for i in range(len(times) - 1):
                one, two = poses[i][0], poses[i + 1][0]
                if not (np.array_equal(one.mid, two.mid) and np.array_equal(one.rad, two.rad)):
                    axis, angle = turn_of(dot("ij,kj->ik", two, one))
                    tracks.append((axis, times[i : i + 2], [Ball(0.0), angle]))
        else:
            need({*motion} <= {"velocity", "spin"}, f"obstacle '{name}': its motion is not known")
            velocity, spin = (numbers(motion.get(key, 0.0), 3, name) for key in ("velocity", "spin"))
            times = [float(self.times[0]), float(self.times[-1])]
            places = stack([pose[1] + Ball(velocity) * x for x in times], 1)
            if spin.any():
                tracks.append((unit(spin), times, [length(spin) * x for x in times]))
        self.tracks += [(times, [places[i, k] for k in range(len(times))]) for i in range(3)]
        ways = [(Ball(x), False) for x in np.eye(3)] + [(axis, True) for axis, _, _ in reversed(tracks)]
        for i, (axis, turns) in enumerate(ways):
            parent = len(self.joints) - 1 if i else -1
            self.joints.append(Joint(f"{name} moves", parent, HERE, axis, turns, -np.inf, np.inf))
        self.tracks += [(span, angles) for _, span, angles in reversed(tracks)]
        return len(self.joints) - 1, (pose[0], HERE[1])

    def lay_tracks(self) -> None:
        """Add what obstacles do to the motion, whose intervals end where that changes; note what each joint carries."""
        knots = {x for span, _ in self.tracks for x in span}
        if self.tracks:
            degree, inside = self.control.mid.shape[1] - 1, {x for x in knots if self.times[0] < x < self.times[-1]}
            times, rows_at = np.array(sorted({*self.times.tolist(), *inside})), self.times
            row: Any = np.searchsorted(rows_at, times[:-1], side="right") - 1
            share = inverse(Ball(rows_at[row + 1]) - rows_at[row])
            start, end = ((Ball(x) - rows_at[row]) * share for x in (times[:-1], times[1:]))
            self.times = times
            columns = [blossom(self.control[row], start[:, None, None], end[:, None, None])]
            for span, values in self.tracks:
                at = [track(span, values, x) for x in times.tolist()]
                a, b = stack(at[:-1]), stack(at[1:])
                rows = [a + (b - a) * (Ball(i) * Ball(1 / degree, EPS)) for i in range(degree + 1)]
                columns.append(stack(rows, 1)[:, :, None])
            mid, rad = (np.concatenate(x, axis=2) for x in ([y.mid for y in columns], [y.rad for y in columns]))
            self.control = Ball(mid, rad)
        count = len(self.joints)
        self.carried = np.zeros((count + 1, count), dtype=bool)  # by which joints; the last row: the world
        for i, each in enumerate(self.joints):
            self.carried[i] = self.carried[each.parent]
            self.carried[i, i] = True

    # --- the robot ---

    def read_robot(self) -> None:
        """Read the tree of links, where each is in the frame of the joint that carries it, and the pieces of all."""
        keys = "name urdf srdf package_dirs group base base_joints locked ignore_pairs check_pairs"
        spec, here = mapping(self.top.get("robot"), "robot", keys), self.scene.absolute().parent
        self.spec, self.folders = spec, [Path(x) for x in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if x]
        if "name" in spec:
            need(not {"urdf", "srdf", "package_dirs"} & {*spec}, "robot: either a name or files are expected")
            package = metadata.distribution("example-robot-data")
            some = re.search(r"^(.*/robots)/.*\.urdf,", package.read_text("RECORD") or "", re.MULTILINE)
            need(some, "robot: its library is not installed")
            library = Path(str(package.locate_file(some[1] if some else "")))
            urdf, srdf = robot_of(library, str(spec["name"]))
            self.folders = [library.parent.parent, library, *self.folders]
        else:
            urdf, srdf = (here / str(spec["urdf"])).resolve(), here / str(spec["srdf"]) if "srdf" in spec else None
            folders = [here / str(x) for x in listing(spec.get("package_dirs"), "package_dirs")]
            self.folders = [*folders, *urdf.parents, *self.folders]
        self.urdf, root = urdf, tree(self.file("urdf", urdf))
        recipe = urdf.suffix.lower() == ".xacro" or any("xacro" in x.tag for x in root.iter())
        plain = root.tag == "robot" and not recipe
        need(plain, f"{urdf}: robots that are no URDF, such as xacro and MJCF, cannot be checked")
        words_ = tree(self.file("srdf", srdf) if srdf else b"<robot/>")
        bodies = [x for x in root if x.tag.rpartition("}")[2] in ("link", "joint")]
        said_ = [word for part in (*bodies, *words_) for x in part.iter() for word in (x.tag, *x.attrib)]
        need(
            not any(word.startswith("{") for word in said_), f"{urdf}: words of a namespace, which readers differ about"
        )
        self.excused, self.states = excused(words_), dict[str, dict[str, float]]()
        for state in words_.findall("group_state"):  # a joint that two states of one name have elsewhere is at neither
            known_ = self.states.setdefault(state.get("name", ""), {})
            for x in [x for x in state.findall("joint") if len(x.get("value", "").split()) == 1]:
                name, value = x.get("name", ""), float(x.get("value", ""))
                known_[name] = value if known_.get(name, value) == value else np.nan
        ignored = listing(spec.get("ignore_pairs"), "ignore_pairs")
        self.excused |= {frozenset(map(str, listing(x, "ignore_pairs"))): "robot.ignore_pairs" for x in ignored}
        asked = listing(spec.get("check_pairs"), "check_pairs")
        self.asked = {frozenset(map(str, listing(x, "check_pairs"))) for x in asked}  # whatever the SRDF says
        links = {x.get("name", ""): x for x in root.findall("link")}
        self.excused = {pair: why for pair, why in self.excused.items() if pair <= {*links}}  # not of what links hold
        if "base_joints" in spec:
            links |= self.add_base(root, {*links} - {x.get("link", "") for x in root.findall("joint/child")})
        self.above, below = dict[str, str](), dict[str, list[tuple[str, str, Any]]]()
        for joint in sorted(root.findall("joint"), key=lambda x: x.get("name", ""), reverse=True):
            parent, child = (x.get("link", "") for x in (joint.find("parent"), joint.find("child")) if x is not None)
            need({parent, child} <= {*links} and child not in self.above, f"{urdf}: its links make no tree")
            self.above[child] = parent
            below.setdefault(parent, []).append((parent, child, joint))
        (first,) = [x for x in links if x not in self.above]
        self.at: dict[str, tuple[int, Pose]] = {first: (-1, pose_of(spec.get("base"), "robot.base"))}
        self.rules, by_name = dict[str, tuple[str, float, float]](), {x.get("name"): x for x in root.findall("joint")}
        for name in by_name:
            self.follow(name, by_name)
        self.joints, self.held, waiting = list[Joint](), dict[str, float](), below.get(first, [])[:]
        self.followed = dict[str, tuple[str, float, float]]()  # of joints that follow others that are held
        while waiting:  # depth first, by the joints' names, as a scene counts them
            parent, child, joint = waiting.pop()
            self.at[child] = self.place(joint, *self.at[parent])
            waiting += below.get(child, [])
        need(len(self.at) == len(root.findall("link")), f"{urdf}: its links make no tree")
        moved = {*self.held, *(x.name for x in self.joints)}
        need({*(spec.get("locked") or {}), *self.locked} <= moved, "locked: names a joint that is none")
        for name, (other, scale, add) in self.followed.items():
            off = abs(self.held[name] - (scale * self.held[other] + add)) if other in self.held else 0.0
            need(off <= ROUNDED, f"joint '{name}': is held where it does not follow '{other}'")
        same = sorted(self.names) == sorted(x.name for x in self.joints)
        need(same, f"{urdf}: not all joints of the motion can move in it")
        order = [self.names.index(x.name) for x in self.joints]
        self.control, self.rows = self.control[:, :, order], self.rows[:, order]
        self.curve, self.clock = self.control, self.times  # of the robot alone
        self.tracks = list[tuple[list[float], list[Ball]]]()  # of joints that follow the time: times and values there
        self.masses: list[tuple[float, int, Pose, Ball]] = []  # mass, joint, place of its centre, inertia about it
        for link, element in links.items():
            for body in element.findall("inertial"):
                part = unique([(x.tag, x) for x in body])
                mass, six = float(part["mass"].get("value", "")), part["inertia"].attrib
                about = inertia([float(six.get(key, 0.0)) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")])
                self.carry(mass, link, origin(body), Ball(about))
        if load := self.top.get("payload"):
            said = mapping(load, "payload", "link mass com inertia")
            mass, com = numbers(said["mass"], 1, "payload.mass")[0], numbers(said.get("com", 0.0), 3, "payload.com")
            about = inertia(numbers(said.get("inertia", 0.0), 6, "payload.inertia"))
            self.carry(float(mass), str(said["link"]), (HERE[0], Ball(com)), Ball(about))
        for link, element in links.items():
            known = {x.tag for x in element} <= {"visual", "collision", "inertial"}
            need(known, f"{urdf}: link '{link}' has parts that are not known")
            for i, shape in enumerate(element.findall("collision")):
                number, pose = self.at[link]
                self.add(link, number, compose(pose, origin(shape)), self.solid(shape, f"link '{link}'"), f"{link} {i}")
        for i, entry in enumerate(listing(self.top.get("attached"), "attached")):
            held = mapping(entry, f"attached[{i}]", "name link shape pose touch_links mass")
            name, link = str(held.get("name", f"attached{i}")), str(held["link"])
            need(link in links and name not in self.at, f"attached[{i}]: its link is not known, or its name is taken")
            self.at[name] = number, pose = self.at[link]
            at = pose_of(held.get("pose"), name)
            self.add(name, number, compose(pose, at), self.shape(held["shape"], name), name)
            if "mass" in held:
                mass = float(numbers(held["mass"], 1, name)[0])
                self.carry(mass, link, at, solid_inertia(held["shape"], mass))
            touching = [str(x) for x in listing(held.get("touch_links"), "touch_links")]
            self.excused |= {frozenset((name, x)): "touch_links" for x in touching}

    def follow(self, name: str, joints: dict[str, Any]) -> None:
        """Let a joint that follows one of the motion's, or one that follows itself, move with it: at scale times its
        value + add, as do the control points."""
        mimic = joints[name].find("mimic")
        if mimic is None or joints[name].get("type") == "fixed" or name in self.rules:
            return
        other = mimic.get("joint", "")
        if other in joints and other not in self.names:
            self.follow(other, joints)
        if other not in self.names:  # it is held
            return
        need(name not in self.names, f"joint '{name}': follows '{other}', and the motion says where it is")
        scale, add = numbers([float(mimic.get(key, x)) for key, x in (("multiplier", 1.0), ("offset", 0.0))], 2, name)
        column = [self.names.index(other)]
        at, every = self.control[:, :, column] * float(scale) + float(add), self.control
        mid, rad = (np.concatenate(x, axis=2) for x in ((every.mid, at.mid), (every.rad, at.rad)))
        self.control, self.rows = Ball(mid, rad), np.hstack([self.rows, self.rows[:, column] * scale + add])
        self.names, self.rules[name] = [*self.names, name], (other, float(scale), float(add))

    def link(self, name: Any) -> tuple[int, Pose]:
        """Return the joint that carries a link, and where the link is in its frame."""
        need(name in self.links, f"'{name}' is no link of the robot")
        return self.at[name]

    def carry(self, mass: float, link: str, at: Pose, about: Ball | None) -> None:
        """Note a body on a link: where its centre is in the link's frame, its inertia about it along its axes."""
        number, pose = self.at[link]
        if about is None or not 0 <= mass < 1e9 or not (about.size < 1e9).all():
            self.masses.append((np.nan, number, HERE, Ball(np.zeros((3, 3)))))
        elif number >= 0:
            self.masses.append((mass, number, compose(pose, at), about))

    def add_base(self, root: Any, roots: set[str]) -> dict[str, Any]:
        """Put the joints of a mobile base under the root link, and return the links before it."""
        base, links = (
            mapping(self.spec["base_joints"], "robot.base_joints", "kind x y yaw"),
            ["base 0", "base 1", "base 2"],
        )
        need(base.get("kind", "planar") == "planar", "robot.base_joints: 'planar' is the only kind")
        ways = ("x", "prismatic", "1 0 0"), ("y", "prismatic", "0 1 0"), ("yaw", "revolute", "0 0 1")
        for i, (name, kind, axis) in enumerate(ways):
            low, high = numbers(base[name], 2, f"robot.base_joints.{name}").tolist()
            joint = ElementTree.SubElement(root, "joint", name=f"base_{name}", type=kind)
            ends = ("parent", {"link": links[i]}), ("child", {"link": [*links[1:], *roots][i]})
            for tag, said in (*ends, ("axis", {"xyz": axis}), ("limit", {"lower": repr(low), "upper": repr(high)})):
                ElementTree.SubElement(joint, tag, said)
        return {x: ElementTree.SubElement(root, "link", name=x) for x in links}

    def place(self, joint: Any, parent: int, pose: Pose) -> tuple[int, Pose]:
        """Return the moving joint that carries a joint's child, and the child's pose in its frame."""
        unique([(x.tag, x) for x in joint])
        name, kind, limit = joint.get("name", ""), joint.get("type", ""), joint.find("limit")
        pose = compose(pose, origin(joint))
        if kind == "fixed":
            return parent, pose
        need(kind in ("revolute", "continuous", "prismatic"), f"joint '{name}': type '{kind}' cannot be checked")
        axis, mimic = unit(words(joint.find("axis"), "xyz", "1 0 0")), joint.find("mimic")
        start = mapping(self.top.get("start"), "start", TARGETS).get("joints")
        sources = [x for x in (self.spec.get("locked"), self.locked) if isinstance(x, dict) and name in x]
        if name in self.names:
            need(mimic is None or name in self.rules, f"joint '{name}': follows another joint and cannot be moved")
            at = self.control[:, :, self.names.index(name)]
            held = all(((at - numbers(x[name], 1, name)).size <= SAME).all() for x in sources)
            need(held, f"joint '{name}': moves, and is to be held")
            low, high = (float(limit.get(x, 0)) for x in ("lower", "upper")) if limit is not None else (np.nan, np.nan)
            ends = (-np.inf, np.inf) if kind == "continuous" else (low, high)
            kinds = (("velocity", "velocity"), ("torque", "effort")) if limit is not None else ()
            most = {key: float(limit.get(word, "nan")) for key, word in kinds}
            follows = name in self.rules
            self.joints.append(Joint(name, parent, pose, axis, kind != "prismatic", *ends, most, follows))
            return len(self.joints) - 1, HERE
        if mimic is not None:
            need(mimic.get("joint") not in self.names, f"joint '{name}': follows a joint that moves: cannot be checked")
            scale, add = (float(mimic.get(key, x)) for key, x in (("multiplier", 1.0), ("offset", 0.0)))
            self.followed[name] = mimic.get("joint", ""), scale, add
        said = (self.spec.get("locked"), start, self.locked, self.said["held"])
        values = [numbers(x[name], 1, name)[0] for x in said if isinstance(x, dict) and name in x]
        need(values, f"joint '{name}': nothing says where it is held")
        value = self.held[name] = float(values[0])
        need(np.ptp(values) <= SAME, f"joint '{name}': is held at {value:g}, and said to be elsewhere too")
        step = (rotation(axis, value), HERE[1]) if kind != "prismatic" else (HERE[0], axis * value)
        return parent, compose(pose, step)

    def solid(self, collision: Any, where: str) -> tuple[Any, Any, Any]:
        """Return the shape of a collision element of a URDF, as `shape` does."""
        (shape,) = (x for element in collision.findall("geometry") for x in element)
        if shape.tag == "mesh":
            scheme, told, rest = shape.get("filename", "").partition("://")
            packaged = told and scheme in ("package", "model")
            name = rest.lstrip("/") if packaged else rest or scheme
            found = [x / name for x in (self.folders if packaged else [self.urdf.parent]) if (x / name).is_file()]
            need(found, f"{where}: mesh '{name}' is not found")
            return self.mesh(found[0], words(shape, "scale", "1 1 1"))
        sizes: dict[str, Any] = {key: float(shape.get(key)) for key in ("radius", "length") if key in shape.attrib}
        sizes |= {key: words(shape, key, "").tolist() for key in ("size", "radii") if key in shape.attrib}
        return self.shape({"type": shape.tag, **sizes}, where)

    def shape(self, value: Any, where: str) -> tuple[Any, Any, Any]:
        """Return corners (m, 3), their error and the sweeping ellipsoid's semi-axes, of a shape of the scene; triangles
        (F, 3, 3) in place of corners for a mesh."""
        keys = mapping(value, f"{where}: shape", "type size radius radii length points file scale")
        kind, none = str(keys.pop("type", "")), np.zeros(3)
        round_ = {"sphere": "radius", "cylinder": "radius length", "capsule": "radius length", "ellipsoid": "radii"}
        needed = {**round_, "box": "size", "points": "points", "mesh": "file"}.get(kind, "?").split()
        need({*keys} - {*(["scale"] * (kind == "mesh"))} == {*needed}, f"{where}: a shape '{kind}' with other keys")
        if kind == "mesh":
            return self.mesh(self.scene.absolute().parent / str(keys["file"]), numbers(keys.get("scale", 1), 3, where))
        if kind == "points":
            return np.array([numbers(x, 3, where) for x in listing(keys["points"], where)]), none, none
        three = numbers(keys.get("size", keys.get("radii", 1)), 3, where)
        radius, length = (float(numbers(keys.get(key, 1), 1, where)[0]) for key in ("radius", "length"))
        need(min(*three, radius, length) >= 0, f"{where}: a size is negative")
        if kind == "box":
            corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
            return corners * three, none, none
        line = np.array([[0, 0, -0.5], [0, 0, 0.5]]) * (length if "length" in keys else 0.0)
        return line, none, three if kind == "ellipsoid" else radius * np.array([1.0, 1.0, float(kind != "cylinder")])

    def mesh(self, path: Path, scale: Any) -> tuple[Any, Any, Any]:
        """Return the triangles of a mesh file, scaled."""
        found = triangles(path, self.file(f"mesh {path.parent.name}/{path.name}", path)) * scale
        return found.mid, found.rad.max(axis=(0, 1)), np.zeros(3)

    def add(self, name: str, joint: int, pose: Pose, shape: tuple[Any, Any, Any], key: str) -> None:
        """Note a shape as pieces: a mesh as its hull, or as the hulls of the groups of its triangles and one around."""
        corners, off, sweep = shape
        need(key not in self.keys, f"'{key}' is the name of two shapes")
        self.keys.add(key)
        if corners.ndim == 2:
            self.pieces.append(Piece(name, joint, pose, key, corners, off, sweep))
            return
        self.meshes[key], groups = corners, self.cuts.get(key, np.zeros(len(corners)))
        need(groups.shape == corners.shape[:1], f"mesh of {key}: has {len(corners)} triangles, not {len(groups)}")
        labels = np.unique(groups).tolist()
        need(len(labels) * len(groups) <= 100 * MOST_PAIRS, f"mesh of {key}: has too many groups")
        for mask, cover in [(groups == x, False) for x in labels] + [(groups >= 0, True)] * (len(labels) > 1):
            own = np.unique(corners[mask].reshape(-1, 3), axis=0)
            self.pieces.append(Piece(name, joint, pose, key, own, off, sweep, cover))

    # --- what is to be kept apart ---

    def pair_up(self) -> None:
        """List the pairs of pieces to be kept apart (P, 2), the pairs of hulls that have to be apart once (Q, 2), and
        why other pairs are left out."""
        pieces, self.left_out = self.pieces, dict[frozenset[str], str]()
        rows, once = list[tuple[int, int]](), dict[tuple[int, int], None]()
        need(self.own * len(pieces) <= MOST_PAIRS, "there are more pairs of pieces than can be checked")
        self.solid_links, self.links = {x.name for x in pieces}, {*self.above, *self.above.values()}
        last = {x.key: i for i, x in enumerate(pieces)}  # of each shape: the hull around it
        for a in range(self.own):
            for b in range(a + 1, len(pieces)):
                one, two = pieces[a], pieces[b]
                if one.cover or two.cover or one.name == two.name or (b >= self.own and one.joint == two.joint):
                    continue
                if b < self.own and (reason := self.excuse(one.name, two.name)):
                    self.left_out[frozenset((one.name, two.name))] = reason
                    continue
                rows.append((a, b))
                covered = pieces[last[one.key]].cover or pieces[last[two.key]].cover
                if covered and not {one.name, two.name} <= self.links:  # of two links, ASSUMES has it
                    once[last[one.key], last[two.key]] = None
        self.pairs, self.once = (np.array(list(x), dtype=np.int64).reshape(-1, 2) for x in (rows, once))
        self.centers = np.array([(x.corners.min(axis=0) + x.corners.max(axis=0)) / 2 for x in pieces]).reshape(-1, 3)
        away = [norm(up(np.abs(x.corners - c) + x.off)).max() for x, c in zip(pieces, self.centers, strict=True)]
        self.radii = up(np.array(away) + [x.sweep.max() for x in pieces])  # of balls around the pieces

    def excuse(self, one: str, two: str) -> str | None:
        """Say why two links, or held objects, need not be kept apart; None if they must be."""
        (a, _), (b, _) = self.at[one], self.at[two]
        if a == b or self.top.get("self_collision") is False:
            return "fixed to each other" if a == b else "self_collision: false"
        if (pair := frozenset((one, two))) in self.asked:
            return None
        if reason := self.excused.get(pair):
            return reason
        one_joint = (a >= 0 and self.joints[a].parent == b) or (b >= 0 and self.joints[b].parent == a)
        if not one_joint or not {one, two} <= self.links:
            return None
        ways = [[link] for link in (one, two)]
        for way in ways:
            while way[-1] in self.above:
                way.append(self.above[way[-1]])
        between = {*ways[0]} ^ {*ways[1]} | {next(x for x in ways[0] if x in ways[1])}
        return None if (between - {one, two}) & self.solid_links else "neighbours"


# --- leaves -----------------------------------------------------------------------------------------------------------


def half(a: float, b: float) -> float:
    """Where an interval of the motion is cut: between two rows if it has any within, or else in its middle."""
    return float(np.floor((a + b) / 2)) if b - a > 1 else (a + b) / 2


def leaves(depths: Sequence[int], rows: int) -> Iterator[tuple[float, float]]:
    """Yield the intervals of the leaves of a binary tree over [0, rows], whose depths stand in order."""
    waiting = [(0.0, float(rows), 0)]
    for wanted in depths:
        need(waiting, "there are more leaves than the motion needs")
        a, b, depth = waiting.pop()
        while depth < wanted <= DEEPEST:
            middle, depth = half(a, b), depth + 1
            waiting.append((middle, b, depth))
            b = middle
        need(depth == wanted and b - a >= NARROWEST, f"the leaves' depths make no tree at {a:g} of {rows}")
        yield a, b
    need(not waiting, f"no leaf covers the motion from {waiting[-1][0] if waiting else 0:g} on, of {rows}")


class Motion:
    """Joints, frames and reaches on intervals of the motion, one row each: see the head of this file."""

    def __init__(self, world: World, spans: Any) -> None:
        """Compute them for `spans` (k, 2) of the rows, exact numbers."""
        self.world, (low, high), degree = world, spans.T, world.control.mid.shape[1] - 1
        first, k, count = np.floor(low).astype(int), len(spans), len(world.joints)
        counts = np.ceil(high).astype(int) - first
        begins = np.cumsum(counts) - counts
        row, span = np.arange(counts.sum()) - np.repeat(begins - first, counts), np.repeat(np.arange(k), counts)
        start, end = (np.clip(x[span] - row, 0, 1)[:, None, None] for x in (low, high))
        part = blossom(world.control[row], start, end)
        self.step: Any = (part.mid[begins + counts - 1, -1] - part.mid[begins, 0]) / 2  # any numbers will do, as for
        place = (row - low[span])[:, None] + start[:, 0] + (end - start)[:, 0] * np.arange(degree + 1) / degree
        line = Ball(2 * place / (high - low)[span, None] - 1, 16 * EPS)[:, :, None] * self.step[span, None]
        over = part.mid - line.mid
        edges = np.maximum.reduceat(over.max(axis=1), begins), np.minimum.reduceat(over.min(axis=1), begins)
        self.middle: Any = (edges[0] + edges[1]) / 2  # the middle: `off` is how far the curve is from their line
        self.off: Any = np.maximum.reduceat((part - (line + self.middle[span, None])).size.max(axis=1), begins)
        self.most: Any = up(np.abs(self.step) + self.off)
        still: Pose = (Ball(np.zeros((k, 3, 3)) + np.eye(3)), Ball(np.zeros((k, 3))))
        frames = [still] * (count + 1)  # the last is the world's
        for j, joint in enumerate(world.joints):
            turn, at = frames[joint.parent]
            turn, at = dot("kij,jl->kil", turn, joint.pose[0]), dot("kij,j->ki", turn, joint.pose[1]) + at
            if joint.turns:
                frames[j] = dot("kij,kjl->kil", turn, rotation(joint.axis, self.middle[:, j])), at
            else:
                frames[j] = turn, dot("kij,kj->ki", turn, joint.axis * self.middle[:, j, None]) + at
        self.turn, self.at = stack([x for x, _ in frames], 1), stack([x for _, x in frames], 1)
        self.turning = np.array([x.turns for x in world.joints])
        self.axis = dot("knij,nj->kni", self.turn[:, :-1], stack([x.axis for x in world.joints]))
        arm, turns = cross(self.at[:, :-1], self.axis), self.turning[:, None]
        self.moment = Ball(np.where(turns, arm.mid, self.axis.mid), np.where(turns, arm.rad, self.axis.rad))
        own = [g for g, x in enumerate(world.pieces) if x.joint >= 0]
        self.slot = np.zeros(len(world.pieces), dtype=int)  # of each piece that moves, among those
        self.slot[own], ends = np.arange(len(own)), [Ball(np.zeros((k, 3)))] * (not own)
        for g in own:
            piece = world.pieces[g]
            local = dot("ij,j->i", piece.pose[0], world.centers[g]) + piece.pose[1]
            ends.append(dot("kij,j->ki", self.turn[:, piece.joint], local) + self.at[:, piece.joint])
        carried = world.carried[[world.pieces[g].joint for g in own] or [-1]]
        self.reach = self.reaches(stack(ends, 1), world.radii[own] if own else 0.0, carried)

    def reaches(self, ends: Ball, radii: Any, carried: Any) -> Any:
        """Return rho (k, m, n) of balls around points (k, m, 3) that joints carry (m, n)."""
        reach, after = np.zeros((*ends.mid.shape[:2], carried.shape[1])), np.zeros(ends.mid.shape[:2])
        for j in reversed(range(carried.shape[1])):
            away = norm(cross(ends - self.at[:, j, None], self.axis[:, j, None]).size)
            far = up(away + radii + after) if self.turning[j] else np.ones_like(after)
            reach[:, :, j] = np.where(carried[:, j], far, 0.0)
            after = up(after + self.most[:, j, None] * reach[:, :, j])
        return reach

    def rest(self, step: Any, reach: Any, off: Any) -> Any:
        """Return R."""
        angle = np.abs(step) * self.turning
        before = np.cumsum(np.pad(angle, ((0, 0), (1, 0)))[:, :-1], axis=1)
        return up((reach * (0.5 * np.abs(step) * (angle + 2 * before) + off)).sum(axis=1))

    def apart(self, bond: Bond) -> Any:
        """Return upper bounds (k,) of how far a bond's points are from where they are to be, as one vector's length:
        that is convex in s, so greatest at s = -1 or 1. What carries both ends changes no length."""
        carried, joints = self.world.carried[[bond.joint, bond.other]], (bond.joint, bond.other)
        x, rate, rests = [], [], 0.0
        for joint, local, moves in zip(joints, (bond.local, bond.target), carried & ~carried[::-1], strict=True):
            step = self.step * moves
            at = dot("kij,mj->kmi", self.turn[:, joint], local)
            at = at if bond.turns else at + self.at[:, joint, None]
            turned = cross(dot("kn,kni->ki", step * self.turning, self.axis)[:, None], at)
            slide = dot("kn,kni->ki", step, self.moment)[:, None]
            reach = (
                self.turning[None]
                if bond.turns
                else self.reaches(at, 0.0, carried[[joints.index(joint)] * len(local.mid)]).max(axis=1)
            )
            x.append(at)
            rate.append(turned if bond.turns else turned + slide)
            rests = rests + self.rest(step, reach * moves, self.off)
        gap, change = x[0] - x[1], rate[0] - rate[1]
        if bond.along is not None:
            gap, change = (dot("kmi,i->km", each, bond.along) for each in (gap, change))
        ends = [norm((gap + sign * change).size.reshape(len(gap.mid), -1)) for sign in (1.0, -1.0)]
        return above(np.maximum(*ends), up(np.sqrt(len(bond.local.mid)) * rests))

    def gaps(self, node: Any, pairs: Any, normal: Any) -> Any:
        """Return lower bounds (L,) of the distance of pairs (L, 2) on intervals (L,) by directions (L, 3)."""
        moves, count = self.world.carried[[x.joint for x in self.world.pieces]], len(node)
        body, other = pairs.T.ravel(), pairs.T[::-1].ravel()
        directions = np.concatenate([-normal, normal])
        most, rest = self.extremes(np.tile(node, 2), body, moves[body] & ~moves[other], directions)
        length = norm(np.abs(normal))
        both = above(most[:, :count], most[:, count:]).max(axis=0)
        least = -above(both, up(length * (rest[:count] + rest[count:]))) / length
        return np.where(least > 0, least * (1 - 8 * EPS), 2 * least)  # `length` may be too large

    def extremes(self, node: Any, body: Any, moves: Any, d: Any) -> tuple[Any, Any]:
        """Return upper bounds (2, L) of d.(x + s x') over the points x of pieces at s = 1, -1, and R (L,)."""
        world, step = self.world, self.step[node] * moves
        turned = cross(d, dot("ln,lni->li", step * self.turning, self.axis[node]))
        slide = dot("li,li->l", d, dot("ln,lni->li", step, self.moment[node]))
        rest = self.rest(step, self.reach[node, self.slot[body]] * moves, self.off[node])
        joint = np.array([x.joint for x in world.pieces])[body]
        way = stack([turned + d, d - turned])
        base = dot("sli,li->sl", way, self.at[node, joint]) + stack([slide, -slide])
        local, value = dot("sli,lij->slj", way, self.turn[node, joint]), above(base.mid, base.rad)
        order = np.argsort(body, kind="stable")
        for rows in np.split(order, np.flatnonzero(np.diff(body[order])) + 1) if len(order) else []:
            value[:, rows] = above(value[:, rows], support(world.pieces[body[rows[0]]], local[:, rows]))
        return value, rest


def support(piece: Piece, d: Ball) -> Any:
    """Return upper bounds (2, k) of d.x over the points x of a piece, for directions (2, k, 3) in its joint's frame."""
    local, shift = dot("ski,ij->skj", d, piece.pose[0]), dot("ski,i->sk", d, piece.pose[1])
    size = np.abs(piece.corners).max(axis=0)
    error = ((local.rad + 8 * EPS * np.abs(local.mid)) * size + local.size * piece.off).sum(axis=-1)
    parts = np.array_split(local.mid.reshape(-1, 3), 1 + local.mid.size * len(piece.corners) // 12_000_000)
    most = np.concatenate([(x @ piece.corners.T).max(axis=1) for x in parts]).reshape(error.shape)
    value = above(most, up(error + norm(piece.sweep * local.size)))
    return above(value, above(shift.mid, shift.rad))


# --- the proof --------------------------------------------------------------------------------------------------------

Trees = tuple[Any, Any, Any, Any, Any]
"""Of every pair the number of leaves (P,), their depths (L,) and directions (L, 3); rows (Q,) and directions (Q, 3)
where hulls around several pieces are apart."""


def unpack(data: bytes) -> tuple[dict[str, Any], dict[str, Any], Trees]:
    """Return head, groups of triangles by mesh, and trees of a proof's file."""
    need(data.startswith(MAGIC), "the file is not a proof")
    inflate = zlib.decompressobj()
    line, _, rest = inflate.decompress(data[len(MAGIC) :], MOST_BYTES).partition(b"\n")
    good = inflate.eof and not inflate.unused_data and len(line) <= MOST_HEAD
    need(good, "the proof is cut short, too large, or goes on after its end")
    keys = "version files clearance self_clearance held cuts pairs leaves once claims"
    head, at, arrays = mapping(json.loads(line, object_pairs_hook=unique), "the proof's head", keys), 0, []
    good = all(isinstance(head[x], dict) for x in ("files", "held", "cuts"))
    need(good and head["version"] == VERSION, "the proof's head is not of this version")
    sizes = [*((x, "<u2") for x in head["cuts"].values()), (head["pairs"], "<u4"), (head["leaves"], "<u1")]
    sizes += [(3 * head["leaves"], "<i4"), (head["once"], "<u4"), (3 * head["once"], "<i4")]
    for count, kind in sizes:
        need(type(count) is int and 0 <= count <= 5 * MOST_LEAVES, "the proof counts more than is allowed")
        array = np.frombuffer(rest[at : at + count * int(kind[2])], dtype=kind)
        need(len(array) == count, "the proof is shorter than its head says")
        arrays.append(array.astype(np.int64))
        at += array.nbytes
    need(at == len(rest), "the proof is longer than its head says")
    *groups, counts, depths, normals, rows, ways = arrays
    trees = counts, depths, normals.reshape(-1, 3).astype(np.float64), rows, ways.reshape(-1, 3).astype(np.float64)
    return head, dict(zip(head["cuts"], groups, strict=True)), trees


def verify(scene: Path, motion: Path, proof: Path | bytes) -> str:
    """Return what is proven by a proof's file, or its content. Raises RejectedError, which names leaf, pair and
    reason."""
    try:
        with np.errstate(all="ignore"):
            head, cuts, trees = unpack(proof if isinstance(proof, bytes) else proof.read_bytes())
            world = World(scene, motion, head, cuts)
            need(world.files == head["files"] and {*cuts} <= {*world.meshes}, "the proof names other files or meshes")
            check_apart(world, head, trees)
            return statement(world, head)
    except RejectedError:
        raise
    except MemoryError:
        raise RejectedError("needs more memory than it may take") from None
    except Exception as error:  # whatever is not as it should be: it is no proof
        raise RejectedError(f"a file is not as it should be ({type(error).__name__}: {error})") from None


def check_apart(world: World, head: dict[str, Any], trees: Trees) -> None:
    """Check that the leaves cover the motion and keep the pairs apart."""
    counts, depths, normals, rows, ways = trees
    kinds = ("clearance", "self_clearance")
    asked = {key: float(numbers(head[key], 1, key)[0]) for key in kinds if head.get(key) is not None}
    kind = [kinds[int(b < world.own)] for b in world.pairs[:, 1]]
    need(len(counts) == len(world.pairs), f"{len(world.pairs)} pairs are to be kept apart, the proof has {len(counts)}")
    need({*kind} == {*asked} and min(asked.values(), default=1.0) > 0, "clearances are missing, or not above 0")
    need(len(rows) == len(world.once) and rows.max(initial=0) < len(world.control.mid), "rows where hulls are apart")
    need(counts.sum() == len(depths) <= MOST_LEAVES, "the pairs have other leaves than the proof")
    need(normals.any(axis=1).all() and ways.any(axis=1).all(), "a direction is 0")
    others = [world.pieces[b].name for b in world.pairs[:, 1]]
    least: Any = np.array([max(asked[k], world.clearances.get(x, 0.0)) for k, x in zip(kind, others, strict=True)])
    pieces = world.pieces
    spans, pair, ends = list[tuple[float, float]](), np.repeat(np.arange(len(counts)), counts), np.cumsum(counts)
    bodies = np.concatenate([world.pairs[pair], world.once])
    for p, end in enumerate(ends.tolist()):
        try:
            spans += leaves(depths[end - counts[p] : end].tolist(), len(world.control.mid))
        except RejectedError as error:
            raise RejectedError(f"{' and '.join(pieces[i].key for i in world.pairs[p])}: {error}") from None
    spans += [(float(row), float(row) + NARROWEST) for row in rows.tolist()]
    floor, normals = np.append(least[pair], np.full(len(rows), 1e-9)), np.concatenate([normals, ways])
    unique, node = np.unique(np.array(spans).reshape(-1, 2), axis=0, return_inverse=True)
    order = np.argsort(node.ravel(), kind="stable")
    parts = np.append(0, np.cumsum(np.ceil(unique[:, 1]) - np.floor(unique[:, 0])))[:-1]  # before each interval
    count = len(world.joints)
    at_once = max(1, min(AT_ONCE, 10_000_000 // ((world.own + 10) * (count + 12))))
    most_parts = min(MOST_PARTS, 500_000 // max(count, 1))
    chunk = parts[node.ravel()[order]] // most_parts * len(order) + np.arange(len(order)) // at_once
    for chosen in np.split(order, np.flatnonzero(np.diff(chunk)) + 1) if len(order) else []:
        used, local = np.unique(node.ravel()[chosen], return_inverse=True)
        found = Motion(world, unique[used]).gaps(local.ravel(), bodies[chosen], normals[chosen])
        for i in np.flatnonzero(~(found >= floor[chosen]))[:1]:
            leaf, (low, high) = chosen[i], spans[chosen[i]]
            where = f"leaf {leaf}, from {low:.6g} to {high:.6g} of {len(world.control.mid)} intervals"
            short = f"its plane keeps them {found[i] * 1e3:.6g} mm apart, not {floor[leaf] * 1e3:.6g} mm"
            raise RejectedError(f"{' and '.join(pieces[i].key for i in bodies[leaf])}: {where}: {short}")


def limits_of(world: World, name: str, joints: list[Joint]) -> Any:
    """Return the scene's limits (n,) of a rate, or of torques. What follows another joint is within one number for all,
    or within the URDF's own, if it has any."""
    asked = world.limits.get(name, "urdf" if name == "velocity" else None)
    need(world.clock is not None, f"limits.{name}: the motion has no times")
    named = [x.name for x in joints if not x.follows]
    values = asked if isinstance(asked, dict) else {x.name: asked for x in joints}
    values = dict(zip(named, asked, strict=True)) if isinstance(asked, list) else values
    good = {*values} <= {*named} or not isinstance(asked, dict)
    need(good, f"limits.{name}: names a joint that does not move, or follows another one")
    most = [values.get(x.name, "urdf") for x in joints]
    most = [x.most.get(name) if y == "urdf" else y for x, y in zip(joints, most, strict=True)]
    free: Any = np.array([x.follows and not (y or 0.0) > 0.0 for x, y in zip(joints, most, strict=True)])
    found = numbers([0.0 if x else y for x, y in zip(free, most, strict=True)], len(joints), f"limits.{name}")
    return np.where(free, np.inf, found)


def rates_of(world: World, name: str, order: int) -> list[Ball]:
    """Return the control points of the joints' values and of their time derivatives, as far as they exist: a motion is
    smooth enough by the rule of its interpolation, but for its ends, where it is to be at rest."""
    share = inverse(Ball(world.clock[1:]) - world.clock[:-1])[:, None, None]
    need(world.curve.mid.shape[1] >= 2 * order, f"limits.{name}: the motion's interpolation is not smooth enough")
    rates = [world.curve]
    for k in range(order):
        last = rates[-1]
        at_rest = max(last[0, 0].size.max(), last[-1, -1].size.max()) <= SAME or k == 0
        need(at_rest, f"limits.{name}: the motion begins or ends with a jump")
        rates.append((last[:, 1:] - last[:, :-1]) * (float(last.mid.shape[1] - 1) * share))
    return rates


def everywhere(name: str, of: list[str], count: int, beyond: Callable[[Any], Any]) -> None:
    """Check that nothing (k, m), named by `of`, is `beyond` a limit on parts (k, 2) of a motion of `count` intervals.
    Where that is not sure parts are halved, until it is so at the middle of one."""
    spans = np.arange(float(count))[:, None] + [0, 1]
    while True:
        spans = spans[np.concatenate([beyond(x).any(axis=1) for x in np.array_split(spans, 1 + len(spans) // 5000)])]
        middle = spans.mean(axis=1)[:, None]
        if not len(spans):
            return
        surely: Any = beyond(np.concatenate([middle, middle + INSTANT], axis=1)[:5000])
        finest = bool(len(spans) > AT_ONCE or spans[0, 1] - spans[0, 0] < 2.0**-20)
        for row, column in np.argwhere(surely | finest)[:1]:
            where = f"{of[column]} is beyond it, or too close to it to be shown"
            raise RejectedError(f"{name}: {where}, after row {spans[row, 0]:.6g}")
        ends = [spans[:, :1], middle], [middle, spans[:, 1:]]
        spans = np.concatenate([np.concatenate(each, axis=1) for each in ends])


def parts_of(control: Ball, spans: Any) -> Line:
    """Return polynomials, known by their control points, on parts (k, 2) of the motion."""
    row = np.floor(spans[:, 0]).astype(int)
    return line_of(blossom(control[row], *((x - row)[:, None, None] for x in spans.T)))


def check_rates(world: World, name: str, order: int) -> None:
    """Check a limit on the time derivative of that order of the joints' values."""
    joints = world.joints[: world.rows.shape[1]]
    bound, rates = limits_of(world, name, joints), rates_of(world, name, order)[-1]
    names = [f"joint '{x.name}'" for x in joints]
    everywhere(f"limits.{name}", names, len(rates.mid), lambda x: ~(parts_of(rates, x).size <= bound * (1 + ROUNDED)))


def check_torques(world: World) -> None:
    """Check the limits of torques: inverse dynamics (Luh, Walker and Paul 1980) of numbers that are linear in s but for
    a radius, from the joints' values and rates on parts of the motion. Gravity is 9.81 m/s^2 along -z."""
    joints = world.joints[: world.rows.shape[1]]
    need(not world.rules, "limits.torque: nothing says how joints share a load that follow one another")
    most, rates = limits_of(world, "torque", joints), rates_of(world, "torque", 2)
    need(np.isfinite([mass for mass, *_ in world.masses]).all(), "limits.torque: a mass's inertia cannot be checked")
    loads = [
        [Ball(0.0), Ball(np.zeros(3)), Ball(np.zeros((3, 3)))] for _ in joints
    ]  # mass, its moments about the joint
    for mass, joint, (turn, at), about in world.masses:
        moment, square = at * mass, dot("i,i->", at, at)
        inert = dot("ij,kj->ik", dot("ij,jk->ik", turn, about), turn)
        inert = inert + (np.eye(3) * square - at[:, None] * at) * mass
        loads[joint] = [a + b for a, b in zip(loads[joint], (Ball(mass), moment, inert), strict=True)]

    def beyond(spans: Any) -> Any:
        lines = [parts_of(each, spans) for each in rates]
        return ~(torques(joints, loads, *lines) <= most * (1 + ROUNDED))

    everywhere("limits.torque", [f"joint '{x.name}'" for x in joints], len(world.curve.mid), beyond)


def torques(joints: list[Joint], loads: list[list[Ball]], q: Line, v: Line, a: Line) -> Any:
    """Return upper bounds (k, n) of torques, or forces, of joints at values, velocities and accelerations (k, n)."""
    k = len(q.mid)
    zero = Line(*np.zeros((3, k, 3)))
    known: list[tuple[Line, Line, Line]] = []  # angular velocity, angular acceleration, acceleration, in each frame
    frames, moved = [], []  # of each joint: rotation (k, 3, 3) and origin in the frame of the joint before
    force, torque = [], []
    for j, joint in enumerate(joints):
        qj, vj, aj = (Line(x.mid[:, j], x.slope[:, j], x.rad[:, j]) for x in (q, v, a))
        along = [times("p,i->pi", x, still(joint.axis)) for x in (qj, vj, aj)]
        turn, at = joint.pose
        origin_, frame = Line(*(np.tile(x, (k, 1)) for x in vars(still(at)).values())), still(turn[None])
        if joint.turns:
            cos, sin = cos_sin(qj.mid)
            off = up(qj.slope * qj.slope / 2 + qj.rad)  # of first-order expansion
            cross_ = dot("ijk,k->ij", CROSS, joint.axis)
            ways = turn, dot("ij,jk->ik", turn, cross_), dot("ij,jk->ik", turn, dot("ij,jk->ik", cross_, cross_))
            c, s = (Line(x.mid, d, up(x.rad + off + up(y.rad * np.abs(qj.slope)) + EPS * np.abs(d)))
                    for x, y, d in ((cos, sin, -sin.mid * qj.slope), (sin, cos, cos.mid * qj.slope)))  # fmt: skip
            less = Line(1.0 - c.mid, -c.slope, up(c.rad + EPS))
            frame = (
                still(ways[0][None]) + times("p,ij->pij", s, still(ways[1])) + times("p,ij->pij", less, still(ways[2]))
            )
        else:
            origin_ = origin_ + times("ij,pj->pi", still(turn), along[0])
        w, dw, acc = (
            known[joint.parent] if joint.parent >= 0 else (zero, zero, zero + Line(np.array([[0, 0, 9.81]]), 0.0, 0.0))
        )
        acc = acc + wedge(dw, origin_) + wedge(w, wedge(w, origin_))
        w, dw, acc = (times("pij,pi->pj", frame, x) for x in (w, dw, acc))
        if joint.turns:
            dw, w = dw + wedge(w, along[1]) + along[2], w + along[1]
        else:
            swerve = wedge(w, along[1])
            acc = acc + swerve + swerve + along[2]
        known.append((w, dw, acc))
        frames.append(frame)
        moved.append(origin_)
        mass, first, inert = (still(x[None]) for x in loads[j])
        first = Line(*(np.tile(x, (k, 1)) for x in vars(first).values()))
        force.append(times("q,pi->pi", mass, acc) + wedge(dw, first) + wedge(w, wedge(w, first)))
        spin = times("qij,pj->pi", inert, w)
        torque.append(wedge(first, acc) + times("qij,pj->pi", inert, dw) + wedge(w, spin))
    sizes = []
    for j in reversed(range(len(joints))):
        sizes.append(times("pi,i->p", torque[j] if joints[j].turns else force[j], still(joints[j].axis)).size)
        if (parent := joints[j].parent) >= 0:
            pull, twist = (times("pij,pj->pi", frames[j], x) for x in (force[j], torque[j]))
            force[parent], torque[parent] = force[parent] + pull, torque[parent] + twist + wedge(moved[j], pull)
    return np.stack(sizes[::-1], axis=1)


def chord(angle: float) -> float:
    """Return a lower bound of 2 sin(angle / 2), the distance between unit vectors at an angle (of at most pi) apart."""
    sin = cos_sin(min(angle, 4.0) / 2 + ROUNDED / 2)[1]
    return np.inf if angle > 3.15 else float(2 * (sin.mid - sin.rad) * (1 - 4 * EPS))


def bonds_of_path(world: World) -> list[Bond]:
    """Return what keeps the scene's path constraints."""
    path, found = mapping(world.top.get("path") or {}, "path", "upright position relative"), []
    if "upright" in path:
        keys = mapping(path["upright"], "path.upright", "link axis tolerance")
        axis = keys.get("axis", "z")
        axis = (
            np.eye(3)["xyz".index(axis[-1])] * (-1) ** (len(axis) - 1)
            if isinstance(axis, str)
            else numbers(axis, 3, "axis")
        )
        joint, pose = world.link(keys["link"])
        most = chord(float(numbers(keys.get("tolerance", 0.1), 1, "path.upright")[0]))
        local = dot("ij,j->i", pose[0], unit(axis))[None]
        found.append(Bond("path.upright", joint, local, -1, Ball(np.eye(3)[2:]), most, True))
    if "position" in path:
        keys = mapping(path["position"], "path.position", "link size position rpy quaternion_xyzw point")
        joint, pose = world.link(keys["link"])
        turn, centre = pose_of(
            {x: keys[x] for x in ("position", "rpy", "quaternion_xyzw") if x in keys}, "path.position"
        )
        local = (dot("ij,j->i", pose[0], numbers(keys.get("point", 0.0), 3, "path.position")) + pose[1])[None]
        need(len(keys["size"]) == 3, "path.position.size: three numbers are expected")
        for i, size in enumerate(keys["size"]):
            if size != np.inf:
                most = float(numbers(size, 1, "path.position")[0]) / 2 + ROUNDED
                found.append(Bond("path.position", joint, local, -1, centre[None], most, along=turn[:, i]))
    if "relative" in path:
        keys = mapping(path["relative"], "path.relative", "link to pose position_tolerance orientation_tolerance")
        one, other = world.link(keys["link"]), world.link(keys["to"])
        there = pose_of(keys["pose"], "path.relative") if "pose" in keys else None
        if there is None:
            need(reached(world, "start"), "path.relative: the motion does not begin at the start")
            begin = Motion(world, np.array([[0.0, INSTANT]]))
            a, b = (compose((begin.turn[0, j], begin.at[0, j]), pose) for j, pose in (one, other))
            there = dot("ji,jk->ik", b[0], a[0]), dot("ji,j->i", b[0], a[1] - b[1])
        found += bonds_of_pose("path.relative", one, (other[0], compose(other[1], there)), keys)
    return found


def bonds_of_pose(what: str, link: tuple[int, Pose], to: tuple[int, Pose], keys: dict[str, Any]) -> list[Bond]:
    """Return what keeps a link's frame at another one, within tolerances; about one of its axes it may be free."""
    (joint, pose), (other, target), free = link, to, str(keys.get("free_rotation", "none"))
    path = what == "path.relative"
    usual = {"position_tolerance": 5e-3 if path else 1e-3, "orientation_tolerance": 0.05 if path else 1e-2}
    off, angle = (float(numbers(keys.get(key, x), 1, what)[0]) for key, x in usual.items())
    bonds = [Bond(what, joint, pose[1][None], other, target[1][None], off + ROUNDED)]
    need(free in ("none", "x", "y", "z", "all"), f"{what}: free_rotation '{free}'")
    if free != "all":
        axes = [0, 1, 2] if free == "none" else ["xyz".index(free)]
        one, two = (Ball(x[0].mid.T, x[0].rad.T)[axes] for x in (pose, target))
        # the columns of two rotations an angle apart differ by 2 sqrt(2) sin(angle / 2) in all
        bonds.append(
            Bond(what, joint, one, other, two, chord(angle) * (1.4142135623730950 if free == "none" else 1.0), True)
        )
    return bonds


def check_path(world: World) -> None:
    """Check the scene's path constraints on the whole motion."""
    for bond in bonds_of_path(world):

        def off(spans: Any, bond: Bond = bond) -> Any:
            return ~(Motion(world, spans).apart(bond) <= bond.most)[:, None]

        everywhere(bond.what, ["the link"], len(world.control.mid), off)


POSE = "link position quaternion_xyzw rpy position_tolerance orientation_tolerance free_rotation"


def at_poses(world: World, goal: dict[str, Any]) -> bool:
    """Whether the motion ends at one of the poses of a goal, or at all of them."""
    every = [x["pose"] for x in listing(goal.get("all"), "goal.all")]
    some = [goal["pose"]] if "pose" in goal else listing(goal.get("poses"), "goal.poses")
    count = float(len(world.control.mid))
    end = Motion(world, np.array([[count - INSTANT, count]]))
    met = []
    for i, each in enumerate(every or some):
        keys = mapping(each, f"goal[{i}]", POSE)
        turned = {*keys} & {"rpy", "quaternion_xyzw"} or keys.get("free_rotation") == "all"
        need("link" in keys and turned, "goal: names no link, or has no orientation: cannot be checked")
        pose = pose_of({x: keys[x] for x in ("position", "rpy", "quaternion_xyzw") if x in keys}, "goal")
        bonds = bonds_of_pose("goal", world.link(keys["link"]), (-1, pose), keys)
        met.append(all((end.apart(x) <= x.most).all() for x in bonds))
    return all(met) if every else any(met)


def at_values(world: World, target: Any, end: str) -> bool:
    """Whether the motion's end is at joint values, by name or in order; at a goal, joints that turn without limits may
    be whole turns away from theirs."""
    joints, row = world.joints[: world.rows.shape[1]], world.rows[0 if end == "start" else -1]
    names = [x.name for x in joints]
    if not isinstance(target, dict):
        leading = [x.name for x in joints if not x.follows]
        target = dict(zip(leading, numbers(listing(target, end), len(leading), end).tolist(), strict=True))
    here = {**world.held, **dict(zip(names, row.tolist(), strict=True))}
    need({*target} <= {*here} or world.top.get("from_request"), f"{end}: names a joint that is none")
    free = {x.name for x in joints if end == "goal" and x.turns and x.low == -np.inf == -x.high}
    free -= {*world.rules} | {other for other, _, _ in world.rules.values()}  # a turn of these leads elsewhere
    here = {name: at for name, at in here.items() if name not in world.rules or name in target}
    for name, at in here.items():
        off = at - float(numbers(target.get(name, world.held.get(name)), 1, f"{end}: joint '{name}'")[0])
        off -= 2 * np.pi * np.rint(off / (2 * np.pi)) * (name in free)
        if abs(off) > SAME:
            return False
    return True


def reached(world: World, end: str) -> bool:
    """Whether the motion begins at the scene's start, or ends at its goal: one of several."""
    asked = mapping(world.top.get(end), end, TARGETS)
    need(len(asked) == 1, f"{end}: one of {TARGETS} is expected")
    need("any" not in asked or end == "goal", "start: 'any' is for goals")
    each = [mapping(x, end, "joints state pose") for x in listing(asked["any"], end)] if "any" in asked else [asked]
    return any([at_target(world, x, end) for x in each])


def at_target(world: World, asked: dict[str, Any], end: str) -> bool:
    """Whether the motion begins, or ends, at a target that is given in one way."""
    need(len(asked) == 1, f"{end}: one of {TARGETS} is expected")
    if end == "goal" and {*asked} & {"pose", "poses", "all"}:
        return at_poses(world, asked)
    state = world.states.get(str(asked.get("state")), {})
    values: Any = asked.get("joints")
    if "state" in asked:
        values = [state.get(x.name) for x in world.joints[: world.rows.shape[1]] if not x.follows]
    several = isinstance(values, list) and any(isinstance(x, (list, dict)) for x in values)
    return any(at_values(world, x, end) for x in (values if several else [values]))


def statement(world: World, head: dict[str, Any]) -> str:
    """Check limits and ends, as far as the proof claims them, and say what is proven and what is not."""
    claims, top = [str(x) for x in listing(head["claims"], "claims")], world.top
    joints = world.joints[: world.rows.shape[1]]  # the others follow the time
    need({*claims} <= CLAIMS, "the proof claims what cannot be checked")
    for name in RATES:
        if name in claims:
            check_rates(world, name, RATES.index(name) + 1)
    if "torque" in claims:
        check_torques(world)
    if "path" in claims:
        check_path(world)
    ranges = world.limits.get("position", {})
    need({*ranges} <= {x.name for x in joints if not x.follows}, "limits.position: a joint does not move, or follows")
    low, high = np.array([(x.low, x.high) for x in joints]).T
    for i, name in enumerate(x.name for x in joints):
        least, most = numbers(ranges[name], 2, f"limits.position.{name}") if name in ranges else (low[i], high[i])
        low[i], high[i] = max(low[i], least) - ROUNDED, min(high[i], most) + ROUNDED
    if "limits" in claims:

        def outside(spans: Any) -> Any:
            q = parts_of(world.curve, spans)
            reach = up(np.abs(q.slope) + q.rad)
            return ~((-above(-q.mid, reach) >= low) & (above(q.mid, reach) <= high))

        everywhere("limits.position", [f"joint '{x.name}'" for x in joints], len(world.curve.mid), outside)
    for end in ("start", "goal"):
        if end in claims:
            need(reached(world, end), f"{end}: the motion's end is elsewhere")
    open_ = [x for x in ("limits", "start", "goal") if x not in claims]
    rated = {x: None for x in world.limits if x != "position"}
    rated |= {"velocity": None} if rated or top.get("timing") else {}
    open_ += [x for x in [*rated, *(["path"] if "path" in top else [])] if x not in claims]
    for section, key in (("planner", "clearance"), ("self_collision", "self_clearance")):
        wanted = 0.0 if key in claims else world.wanted(section)
        open_ += [f"{section}.clearance, {1e3 * wanted:g} mm"] * ((head.get(key) or wanted) < wanted)
    part = " in part" * bool(open_)
    said = [f"accepted{part}: over the whole motion of {len(world.rows)} rows"]
    said += [f"  robot: {world.urdf}, SHA-256 {world.files['urdf'][:8]}"]
    own = {name: x for name, x in world.clearances.items() if x > (head.get("clearance") or 0.0)}
    more = "".join(f"; {1e3 * x:g} mm from {name}" for name, x in own.items())
    for key, what in (("clearance", "from every obstacle"), ("self_clearance", "from one another")):
        if head.get(key):
            least = f"at least {1e3 * head[key] - 5e-7:.6f} mm {what}"
            said.append(f"  links and held objects are {least}{more * (key == 'clearance')}")
    said += [f"  also proven: {', '.join(claims)}"] * bool(claims)
    said += [f"  NOT proven by this file: {', '.join(open_)}"] * bool(open_)
    for reason in dict.fromkeys(world.left_out.values()):
        pairs = sorted("-".join(sorted(x)) for x, why in world.left_out.items() if why == reason)
        said.append(f"  not compared, {reason}: {', '.join(pairs)}")
    rules = (f"{name} at {k:g} x {other} + {add:g}" for name, (other, k, add) in world.rules.items())
    said += [f"  following, as the URDF says: {', '.join(rules)}"] * bool(world.rules)
    said += [f"  held: {', '.join(f'{name} at {at:g}' for name, at in world.held.items())}"] * bool(world.held)
    return "\n".join([*map(shown, said), "  if:", *(f"    {line}" for line in ASSUMES.splitlines())])


def limit() -> None:
    """Take at most MOST_MEMORY and MOST_TIME, whatever the files say: beyond that, the proof is rejected."""
    if sys.platform == "linux":
        import resource
        import signal

        def late(*_: Any) -> None:
            signal.signal(signal.SIGXCPU, signal.SIG_IGN)
            raise RejectedError(f"needs more than {MOST_TIME} s")

        def at_most(kind: int, soft: int, hard: int) -> None:
            allowed = resource.getrlimit(kind)[1]
            free = allowed == resource.RLIM_INFINITY
            resource.setrlimit(kind, (soft, hard) if free else (min(soft, allowed), min(hard, allowed)))

        signal.signal(signal.SIGXCPU, late)
        at_most(resource.RLIMIT_CPU, MOST_TIME, MOST_TIME + 5)
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        at_most(resource.RLIMIT_AS, used + MOST_MEMORY, used + MOST_MEMORY)


def main() -> int:
    """Run from the command line."""
    if len(sys.argv) != 4:
        sys.exit("usage: python -m hdplan.verify SCENE TRAJECTORY PROOF")
    if lacking := [name for name in sys.argv[1:] if not Path(name).is_file()]:
        print(f"{shown(lacking[0])}: no such file", file=sys.stderr)
        return 2
    sys.stdout.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]  # names hold any character
    try:
        limit()
        print(verify(*map(Path, sys.argv[1:])))
    except RejectedError as error:
        print(f"rejected: {error}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
