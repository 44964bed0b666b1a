# ruff: noqa: D105
"""Real numbers up to a radius.

A `Ball` is a real number known up to a radius. NumPy's results are used only as IEEE 754 defines them: + - x /
and sqrt, rounded to nearest, in any order, also fused: a sum of k products is then off by at most k 2^-53 /
(1 - k 2^-53) times the sum of the absolute products (Higham 2002, section 3.1). Radii are rounded up by `up`. What is
not a number passes no comparison.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

EPS = 2.0**-53  # of rounding to nearest


class RejectedError(Exception):
    """Why a proof is not accepted, in one line."""

    def __init__(self, words: str) -> None:
        super().__init__(shown(" ".join(words.split())))


def shown(line: str) -> str:
    """A line without characters by which a name in a file could look like several."""
    return line if line.isprintable() else "".join(x if x.isprintable() else "?" for x in line)


def named(name: str) -> str:
    """A name of a file as it stands among others: in quotes if it could be read as more than a name."""
    return name if re.fullmatch(r"[\w./]+", name) else json.dumps(name, ensure_ascii=False)


@contextmanager
def rejecting() -> Iterator[None]:
    """Reject what is not as it should be, whatever goes wrong; of numbers that are none, nothing is printed."""
    try:
        with np.errstate(all="ignore"):
            yield
    except RejectedError:
        raise
    except MemoryError:
        raise RejectedError("needs more memory than it may take") from None
    except Exception as error:
        raise RejectedError(f"a file is not as it should be ({type(error).__name__}: {error})") from None


def need(condition: Any, words: str) -> None:
    """Reject unless a condition holds."""
    if not condition:
        raise RejectedError(words)


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
        if not isinstance(other, Ball):
            mid = self.mid * other
            return Ball(mid, up(self.rad * np.abs(other) + EPS * np.abs(mid)))
        mid = self.mid * other.mid
        rad = np.abs(self.mid) * other.rad + self.rad * (np.abs(other.mid) + other.rad)
        return Ball(mid, up(rad + EPS * np.abs(mid)))

    __radd__, __rmul__ = __add__, __mul__

    @property
    def size(self) -> Any:
        """An upper bound of the absolute values."""
        return up(np.abs(self.mid) + self.rad)


def dot(spec: str, a: Any, b: Any) -> Ball:
    """einsum of two arrays; sums of at most 60 products, or of as many as the first array's last axis is long."""
    exact, b = not isinstance(a, Ball), b if isinstance(b, Ball) else Ball(b)
    x = np.asarray(a, dtype=np.float64) if exact else a.mid
    terms = max(60, x.shape[-1])
    need(terms < 900, "too many joints")  # as `up` allows for fewer than 1000 roundings
    two = np.abs(b.mid)
    rad = np.einsum(spec, np.abs(x), b.rad + (terms + 4) * EPS * two)
    rad = rad if exact else rad + np.einsum(spec, a.rad, two + b.rad)
    return Ball(np.einsum(spec, x, b.mid), up(rad))


def stack(parts: Sequence[Ball], axis: int = 0) -> Ball:
    """np.stack."""
    return Ball(np.stack([x.mid for x in parts], axis), np.stack([x.rad for x in parts], axis))


def joined(parts: Sequence[Ball], axis: int = 0) -> Ball:
    """np.concatenate."""
    return Ball(np.concatenate([x.mid for x in parts], axis), np.concatenate([x.rad for x in parts], axis))


def where(mask: Any, a: Ball, b: Ball) -> Ball:
    """np.where."""
    return Ball(np.where(mask, a.mid, b.mid), np.where(mask, a.rad, b.rad))


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
    need(1e-10 < m < 1e6, "a direction or rotation must have a length")
    return Ball(m, up((Ball(m) * m - square).size / m))


def inverse(x: Ball) -> Ball:
    """1 / x for x > 0: with |x - m| <= r <= m / 2, |1 / x - 1 / m| <= r / (m (m - r)) <= 2 r / m^2."""
    need((x.mid > 2 * x.rad).all(), "a division by what may be 0")
    return Ball(1 / x.mid, up(2 * x.rad / (x.mid * x.mid) + 2 * EPS / x.mid))


def unit(v: Any) -> Ball:
    """v / |v|."""
    return (v if isinstance(v, Ball) else Ball(v)) * inverse(length(v))


HALF_PI = Ball(1.5707963267948966, 6.2e-17)  # pi/2 = 1.5707963267948965579989... + 6.123...e-17
SINE, COSINE = (
    [(-1) ** (n // 2) / float(np.prod(np.arange(1, n + 1, dtype=float))) for n in range(first, 19, 2)]
    for first in (1, 0)
)


def cos_sin(x: Any) -> tuple[Ball, Ball]:
    """Cosine and sine of exact numbers |x| <= 1e6.

    With k the whole number nearest to 2x/pi and r = x - k pi/2, they are those of r, exchanged and with signs by k mod
    4. For |r| <= 0.8 the series of sin after r^17 and of cos after r^18 alternate with falling terms, so that they are
    off by less than the next: 0.8^19 / 19! < 1.3e-19. The coefficients 1/n!, n <= 18, are one division by a whole
    number that is exact in double precision (18! < 2^53). By Horner's rule the term of r^2i, or r^(2i + 1), meets at
    most 3i + 3 roundings: all are off by less than EPS times the sum of (3i + 3) 0.8^2i / (2i)!, which is below 5.1.
    The error of r counts once, as neither function changes faster.
    """
    x = np.asarray(x, dtype=np.float64)
    need((np.abs(x) <= 1e6).all(), "an angle is beyond 1e6 rad")
    k = np.rint(x * (2 / np.pi))
    r = x - k * HALF_PI
    need((r.size <= 0.8).all(), "an angle could not be reduced")
    square, sin, cos = r.mid * r.mid, 0.0, COSINE[-1]
    for a, b in zip(reversed(SINE), reversed(COSINE[:-1]), strict=True):
        sin, cos = sin * square + a, cos * square + b
    sin, turn = sin * r.mid, k.astype(np.int64) % 4
    rad = up(r.rad + 8 * EPS)
    return tuple(Ball(np.choose(turn, way), rad) for way in ((cos, -sin, -cos, sin), (sin, cos, -sin, -cos)))  # type: ignore[return-value]


Pose = tuple[Ball, Ball]  # rotation (3, 3) and origin (3,)
HERE: Pose = (Ball(np.eye(3)), Ball(np.zeros(3)))
CROSS = np.zeros((3, 3, 3))  # CROSS v is the matrix of v x ...
CROSS[[0, 1, 2], [1, 2, 0], [2, 0, 1]], CROSS[[0, 1, 2], [2, 0, 1], [1, 2, 0]] = -1.0, 1.0
for _array in (CROSS, *(part for ball in (HALF_PI, *HERE) for part in (ball.mid, ball.rad))):
    _array.flags.writeable = False


def compose(a: Pose, b: Pose) -> Pose:
    """The pose b, given in the frame a, where a is."""
    if a is HERE or b is HERE:
        return b if a is HERE else a
    return dot("ij,jk->ik", a[0], b[0]), dot("ij,j->i", a[0], b[1]) + a[1]
