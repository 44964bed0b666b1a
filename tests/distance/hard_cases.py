"""Hard poses whose signed distance has a closed form: touching, aligned, degenerate, tiny and huge."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from hdplan.distance.bodies import ConvexBody
from hdplan.scenes.array_types import Array


@dataclass(frozen=True, eq=False)
class Case:
    """A hard pose whose signed distance has a closed form."""

    name: str
    body_a: ConvexBody
    pose_a: Array
    body_b: ConvexBody
    pose_b: Array
    distance: float  # [m]
    held: bool = False  # floating-point numbers hold every coordinate and difference exactly


def place(x: float = 0.0, y: float = 0.0, z: float = 0.0, rotation: Rotation | None = None) -> Array:
    pose = np.eye(4)
    pose[:3, :3] = np.eye(3) if rotation is None else rotation.as_matrix()
    pose[:3, 3] = x, y, z
    return pose


def _turn(axis: str, degrees: float) -> Rotation:
    return Rotation.from_euler(axis, degrees, degrees=True)


def _hard_cases() -> list[Case]:
    cube, big = ConvexBody.box([1, 1, 1]), ConvexBody.box([4, 4, 4])
    ball, capsule = ConvexBody.sphere(0.3), ConvexBody.capsule(0.1, 1.0)
    bar = ConvexBody.from_points([[0, 0, -0.5], [0, 0, 0.5]])
    flat = ConvexBody.from_points([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    needle, plate = ConvexBody.box([1, 1e-6, 1e-6]), ConvexBody.box([1, 1, 1e-6])
    edge_z, edge_y = _turn("z", 45), _turn("y", 45)
    corner = Rotation.align_vectors([[1, 0, 0]], [[1, 1, 1]])[0]
    half, root = np.sqrt(0.5), np.sqrt(0.75)
    origin = place()
    cases = [
        ("faces touch", cube, place(1), cube, origin, 0.0),
        ("faces, gap 1e-9", cube, place(1 + 1e-9), cube, origin, 1e-9),
        ("faces, depth 1e-9", cube, place(1 - 1e-9), cube, origin, -1e-9),
        ("faces, shifted along themselves", cube, place(1.25, 0.3, 0.2), cube, origin, 0.25),
        ("parallel boxes 0.5 m apart", cube, place(1.5), cube, origin, 0.5),
        ("aligned edges touch", cube, place(1, 1), cube, origin, 0.0),
        ("aligned corners touch", cube, place(1, 1, 1), cube, origin, 0.0),
        ("identical", cube, origin, cube, origin, -1.0),
        ("one inside the other", cube, origin, big, origin, -2.5),
        ("one inside the other, off centre", cube, place(1.0, 0.2), big, origin, -1.5),
        ("crossed edges touch", cube, place(2 * half, 0, 0, edge_z), cube, place(0, 0, 0, edge_y), 0.0),
        ("crossed edges, 0.1 m apart", cube, place(2 * half + 0.1, 0, 0, edge_z), cube, place(0, 0, 0, edge_y), 0.1),
        ("parallel edges touch", cube, place(2 * half, 0, 0, edge_z), cube, place(0, 0, 0, edge_z), 0.0),
        ("edge on face", cube, place(half + 0.5, 0, 0, edge_z), cube, origin, 0.0),
        ("corner on face", cube, place(root + 0.5, 0, 0, corner), cube, origin, 0.0),
        ("corner on face, gap 1e-9", cube, place(root + 0.5 + 1e-9, 0, 0, corner), cube, origin, 1e-9),
        ("corners touch", cube, place(2 * root, 0, 0, corner), cube, place(0, 0, 0, corner), 0.0),
        ("far away", cube, place(1e6), cube, origin, 1e6 - 1),
        ("micrometres", ConvexBody.box([1e-6] * 3), place(1.5e-6), ConvexBody.box([1e-6] * 3), origin, 0.5e-6),
        ("megametres", ConvexBody.box([1e6] * 3), place(1.5e6), ConvexBody.box([1e6] * 3), origin, 0.5e6),
        ("megametres touch", ConvexBody.box([1e6] * 3), place(1e6), ConvexBody.box([1e6] * 3), origin, 0.0),
        ("needle on box", needle, place(1), cube, origin, 0.0),
        ("needles crossed", needle, place(0, 0, 1.1e-6), needle, place(0, 0, 0, _turn("z", 90)), 1e-7),
        ("plate in box", plate, origin, cube, origin, -0.5 - 0.5e-6),
        ("plates on each other", plate, place(0, 0, 1e-6), plate, origin, 0.0),
        ("balls touch", ball, place(0.6), ball, origin, 0.0),
        ("balls with one centre", ball, origin, ball, origin, -0.6),
        ("balls apart", ball, place(0, 1), ball, origin, 0.4),
        ("ball on a face's centre line, touching", ball, place(0.8), cube, origin, 0.0),
        ("ball's centre on a face", ball, place(0.5), cube, origin, -0.3),
        ("ball's centre on a corner", ball, place(0.5, 0.5, 0.5), cube, origin, -0.3),
        ("ball in the box", ball, origin, cube, origin, -0.8),
        ("ball off a corner", ball, place(1, 1, 1), cube, origin, root - 0.3),
        ("capsules side by side", capsule, place(0.5), capsule, origin, 0.3),
        ("capsules touch along a line", capsule, place(0.2), capsule, origin, 0.0),
        ("capsules on one axis, apart", capsule, place(0, 0, 1.5), capsule, origin, 0.3),
        ("capsules on one axis, overlapping", capsule, place(0, 0, 0.5), capsule, origin, -0.2),
        ("capsules crossed", capsule, place(0.5, 0, 0, _turn("y", 0)), capsule, place(0, 0, 0, _turn("x", 90)), 0.3),
        ("capsules crossed through each other", capsule, origin, capsule, place(0, 0, 0, _turn("x", 90)), -0.2),
        ("capsule along an edge", capsule, place(0.6, 0.6), cube, origin, np.sqrt(0.02) - 0.1),
        ("segments cross", bar, origin, bar, place(0, 0, 0, _turn("x", 30)), 0.0),
        ("segments on one line overlap", bar, place(0, 0, 0.2), bar, origin, 0.0),
        ("segment through a triangle", bar, place(0.2, 0.3), flat, origin, -0.2),
        ("coplanar triangles overlap", flat, place(0.1, 0.1), flat, origin, 0.0),
        ("coplanar triangles apart", flat, place(1.5), flat, origin, 0.5),
        ("triangle in a box", flat, origin, big, origin, -2.0),
        ("equal points", ConvexBody.from_points([[0, 0, 0]]), origin, ConvexBody.from_points([[0, 0, 0]]), origin, 0.0),
    ]
    cases += _nearly_parallel(cube, capsule)
    cases += _tiny_gaps_to_huge(flat)
    cases += _extreme_shapes(cube)
    return [Case(*case) for case in cases]


def _nearly_parallel(cube: ConvexBody, capsule: ConvexBody) -> list[tuple]:
    """Faces, of which the lower edge comes nearest, and edges that cross in the middle, at any angle."""
    cases, origin, edge_z = [], place(), _turn("z", 45)
    for angle in (1e-15, 1e-12, 1e-8, 1e-3):  # [rad]
        about_z, about_x = Rotation.from_rotvec([0, 0, angle]), Rotation.from_rotvec([angle, 0, 0])
        reach = 0.5 * (np.cos(angle) + np.sin(angle))
        edge = np.sqrt(0.5)
        cases += [
            (f"faces {angle} rad from parallel", cube, place(1.5, 0, 0, about_z), cube, origin, 1 - reach),
            (f"touching, {angle} rad from parallel", cube, place(0.5 + reach, 0, 0, about_z), cube, origin, 0.0),
            (
                f"edges {angle} rad from parallel",
                cube,
                place(2 * edge + 0.1, 0, 0, about_x * edge_z),
                cube,
                place(0, 0, 0, edge_z),
                0.1,
            ),
            (
                f"edges touch, {angle} rad from parallel",
                cube,
                place(2 * edge, 0, 0, about_x * edge_z),
                cube,
                place(0, 0, 0, edge_z),
                0.0,
            ),
            (f"capsules {angle} rad from parallel", capsule, place(0.5, 0, 0, about_x), capsule, origin, 0.3),
            (f"capsules touch, {angle} rad from parallel", capsule, place(0.2, 0, 0, about_x), capsule, origin, 0.0),
        ]
    return cases


def _tiny_gaps_to_huge(flat: ConvexBody) -> list[tuple]:
    """Gaps between coordinates that are 0 otherwise, so that floating-point numbers hold them exactly."""
    unit = ConvexBody.box([1, 1, 1])
    right, left = (replace(unit, vertices=unit.vertices + [side, 0, 0]) for side in (0.5, -0.5))
    point, bar = ConvexBody.from_points([[0, 0, 0]]), ConvexBody.from_points([[0, 0, 0], [0, 0, 1]])
    cases = []
    for gap in (1e-300, 1e-30, 1e-15, 1e-6, 1.0, 1e6):  # [m]
        cases += [
            (f"points, gap {gap}", point, place(gap), point, place(), gap, True),
            (f"point on a face, gap {gap}", point, place(gap), left, place(), gap, True),
            (f"segment on a triangle, gap {gap}", bar, place(0.2, 0.2, gap), flat, place(), gap, True),
            (f"boxes, gap {gap}", right, place(gap), left, place(), gap, True),
        ]
    for depth in (1e-300, 1e-15, 1e-6):
        cases.append((f"boxes, depth {depth}", right, place(-depth), left, place(), -depth, True))
    return cases


def _extreme_shapes(cube: ConvexBody) -> list[tuple]:
    point, bar = ConvexBody.from_points([[0, 0, 0]]), ConvexBody.from_points([[0, 0, 0], [0, 0, 1]])
    octahedron, wire = ConvexBody.platonic("octahedron"), ConvexBody.capsule(1e-6, 1.0)
    short = ConvexBody.box([1e-6, 1e-12, 1e-12])
    tiny, huge = ConvexBody.box([2.0**-20] * 3), ConvexBody.box([2.0**20] * 3)
    rod, sheet = ConvexBody.box([1e6, 1, 1]), ConvexBody.box([1e6, 1e6, 1])
    return [
        ("identical octahedra", octahedron, place(), octahedron, place(), -2 / np.sqrt(3)),
        ("a micrometre's box on a megametre's", tiny, place(2.0**19 + 2.0**-21), huge, place(), 0.0),
        ("a micrometre's box in a megametre's", tiny, place(), huge, place(), -(2.0**19) - 2.0**-21),
        ("micrometre needles crossed", short, place(0, 0, 2e-12), short, place(0, 0, 0, _turn("z", 90)), 1e-12),
        ("rods crossed", rod, place(0, 0, 1.5), rod, place(0, 0, 0, _turn("z", 90)), 0.5),
        ("sheets on each other", sheet, place(1e5, 0, 1), sheet, place(), 0.0),
        ("sheet through a sheet", sheet, place(0, 0, 0, _turn("x", 90)), sheet, place(), -5e5 - 0.5),
        ("wires crossed", wire, place(3e-6, 0, 0, _turn("x", 90)), wire, place(), 1e-6),
        ("wire along a face", wire, place(0.5 + 1e-6), cube, place(), 0.0),
        ("point in a segment", point, place(0, 0, 0.5), bar, place(), 0.0),
        ("point beyond a segment's end", point, place(0, 0, 1.5), bar, place(), 0.5),
        ("segments end to end", bar, place(0, 0, 1), bar, place(), 0.0),
        ("segments end to end, apart", bar, place(0, 0, 1.5), bar, place(), 0.5),
        ("far from the origin, touching", cube, place(2.0**20 + 1), cube, place(2.0**20), 0.0),
    ]


HARD = _hard_cases()
