"""The planes of a proof along a motion, for its page: between the pair that is closest at each moment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from hdplan.planner.certificate.verdict import Closest, proven_length
from hdplan.planner.motion.curve import Curve
from hdplan.scenes.array_types import Array

if TYPE_CHECKING:
    from hdplan.planner.proof.reading import Plane, ReadProof

LEAST_THICKNESS = 0.0005  # [m] of a plane that is drawn: as thick as the distance proven


def gliding_planes(
    proof: ReadProof, curve: Curve, parameters: Sequence[float], pairs: Sequence[tuple[Closest | None, Closest | None]]
) -> list[dict[str, Any] | None]:
    """Return the plane that keeps the closest pair apart at each of some path parameters, as the page draws it; None
    where nothing can touch, or the proof does not compare the two."""
    return [_plane(proof, curve, at, near) for at, near in zip(parameters, pairs, strict=True)]


def _plane(
    proof: ReadProof, curve: Curve, parameter: float, pairs: tuple[Closest | None, Closest | None]
) -> dict[str, Any] | None:
    nearest = pairs[0] or pairs[1]
    if nearest is None:
        return None
    plane = proof.closest(nearest.link, nearest.other, nearest.to_obstacle, proof.row(curve, parameter))
    if plane is None:
        return None
    point, thickness = slab_of(plane, nearest)
    return {
        "point": point,
        "normal": plane.normal,
        "thick": thickness,
        "of": f"{nearest.link} – {nearest.other}, plane {plane.leaf + 1} of {plane.leaves}",
        "words": f"proven ≥ {proven_length(plane.bound)}",
    }


def slab_of(plane: Plane, nearest: Closest) -> tuple[Array, float]:
    """Return the position (3,) of a drawn plane, beside the closest points of its two bodies, and its thickness [m]."""
    middle = nearest.points.mean(axis=0)
    point = middle + plane.normal * (plane.normal @ (plane.point - middle))
    return point, max(min(plane.bound, plane.gap), LEAST_THICKNESS)
