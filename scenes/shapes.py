"""Shapes of obstacles and held objects, each in its own frame. Lengths in metres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray

from hdplan.scenes.errors import FieldError
from hdplan.scenes.poses import AnyPose, Placement, Vector3
from hdplan.scenes.values import Checked, FilePath, Name, Number, Numbers, Row, absolute_path, is_row

Length = Annotated[float, Number(above=0.0, unit="m")]
FLAT_RATIO = 1e-9  # ratio of thickness to size below which points count as coplanar


def volume(value: object) -> tuple[tuple[float, ...], ...]:
    """Return points that span a volume."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    points = Row(Row(Number(unit="m"), 3), of="points")(value)
    spread = np.ptp(points, axis=0).max() if points else 0.0
    if not points or np.linalg.matrix_rank(np.subtract(points, points[0]), tol=FLAT_RATIO * spread) < 3:
        raise FieldError(
            f"must be points that span a volume (four or more, not in one plane), found {len(points)} that do not"
        )
    return points


def axis_factors(value: object) -> tuple[float, ...]:
    """Return factors along three axes, given as three numbers or as one for all axes."""
    factor = Number(above=0.0)
    return Row(factor, 3)(value) if is_row(value) else (factor(value),) * 3


@dataclass(frozen=True, repr=False)
class Solid(Checked):
    """A shape. In a scene's list of obstacles it may carry its own name and pose."""

    name: Name | None = field(default=None, kw_only=True)  # None: obstacle0, obstacle1, …, by its index in the list
    pose: Placement | None = field(default=None, kw_only=True)  # in the world; None: the identity

    @property
    def requested(self) -> Any:
        """The shape as a file holds it: itself, or that from which it was read."""
        return self


@dataclass(frozen=True, repr=False)
class Box(Solid):
    """A box with full edge lengths `size` [m], centred in its frame."""

    size: Annotated[Vector3, Row(Number(above=0.0, unit="m"), 3)]

    if TYPE_CHECKING:

        def __init__(self, size: Numbers, *, name: str | None = None, pose: AnyPose | None = None) -> None: ...


@dataclass(frozen=True, repr=False)
class Sphere(Solid):
    """A sphere of `radius` [m], centred in its frame."""

    radius: Length

    if TYPE_CHECKING:

        def __init__(self, radius: float, *, name: str | None = None, pose: AnyPose | None = None) -> None: ...


@dataclass(frozen=True, repr=False)
class Ellipsoid(Solid):
    """An ellipsoid with half axes `radii` [m] along x, y and z, centred in its frame."""

    radii: Annotated[Vector3, Row(Number(above=0.0, unit="m"), 3)]

    if TYPE_CHECKING:

        def __init__(self, radii: Numbers, *, name: str | None = None, pose: AnyPose | None = None) -> None: ...


@dataclass(frozen=True, repr=False)
class Cylinder(Solid):
    """A cylinder of `radius` and `length` [m] along z, centred in its frame."""

    radius: Length
    length: Length

    if TYPE_CHECKING:

        def __init__(
            self, radius: float, length: float, *, name: str | None = None, pose: AnyPose | None = None
        ) -> None: ...


@dataclass(frozen=True, repr=False)
class Capsule(Solid):
    """A sphere of `radius` [m] swept along a segment of `length` [m] on the z axis, centred in its frame."""

    radius: Length
    length: Annotated[float, Number(low=0.0, unit="m")]

    if TYPE_CHECKING:

        def __init__(
            self, radius: float, length: float, *, name: str | None = None, pose: AnyPose | None = None
        ) -> None: ...


@dataclass(frozen=True, repr=False)
class Points(Solid):
    """The convex hull of `points` [m], given in its frame."""

    points: Annotated[tuple[Vector3, ...], volume]

    if TYPE_CHECKING:

        def __init__(
            self,
            points: Sequence[Numbers] | NDArray[Any],
            *,
            name: str | None = None,
            pose: AnyPose | None = None,
        ) -> None: ...


@dataclass(frozen=True, repr=False)
class Mesh(Solid):
    """A triangle mesh read from `file`, in any format that trimesh reads, with factors `scale` along the file's
    axes."""

    file: Annotated[Path, absolute_path]
    scale: Annotated[Vector3, axis_factors] = (1.0, 1.0, 1.0)

    if TYPE_CHECKING:

        def __init__(
            self,
            file: FilePath,
            scale: float | Numbers = (1.0, 1.0, 1.0),
            *,
            name: str | None = None,
            pose: AnyPose | None = None,
        ) -> None: ...


Shape = Box | Sphere | Ellipsoid | Cylinder | Capsule | Points | Mesh


_PLACED = ("name", "pose")  # of any shape, in a list of obstacles


def own_fields(shape: Any) -> dict[str, Any]:
    """Return the parameters of a shape, by name: all of its fields without its name and pose."""
    return {each.name: getattr(shape, each.name) for each in fields(shape) if each.init and each.name not in _PLACED}


def files_of(shape: Any) -> list[Path]:
    """Return the files of a shape."""
    return [value for value in own_fields(shape).values() if isinstance(value, Path)]


def check_unplaced(shape: Any, owner: str) -> None:
    """Refuse a shape with its own name or pose where its owner has them."""
    for key in ("name", "pose"):
        if getattr(shape, key) is not None:
            raise FieldError(f"belongs to the {owner}: give it there, not to its shape", f"shape.{key}")
