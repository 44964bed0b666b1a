"""The scene drawn from a chosen side: true obstacle shapes, the robot's links as hulls, with hidden parts hidden.

Parallel projection onto a plain matplotlib axis, with everything cut into small polygons that are painted from far to
near: matplotlib's own 3D axes sort only whole shapes and would show a hand in front of the wall that hides it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from hdplan.planner.certificate.exact_proximity import Piece, link_pieces, obstacle_pieces
from hdplan.planner.geometry.seen import seen_mesh
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.pictures.style import BETWEEN, FIXED, FRAME, GOAL, INK, MOVING, OBSTACLE, START
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.obstacle_motion import ObstacleMotion
from hdplan.scenes.obstacles import Obstacle, Seen
from hdplan.scenes.once import read_only
from hdplan.scenes.scene import Scene

GHOSTS = (0.25, 0.5, 0.75)  # path parameters between start and goal at which moving bodies are shown faintly
TIP_STEPS = 200  # segments of the path of the last link
TILE = 0.1  # of the view's size: longest edge of a painted polygon, for sorting by depth
NAME = read_only(np.array([28.0, 11.0]))  # [pt] size of "start" and "goal"
EDGE_COSINE = np.cos(np.radians(35.0))  # faces that meet at a wider angle have a line between them
SURROUNDINGS_SHARE = 0.3  # share of the robot's own extent that is shown around it
LEAST = 1e-3  # [m] from the middle of a window to its edge: a robot without geometry can be a point
# [m] by which the start is painted nearer: links that only rotate are in the same place at the goal
START_OFFSET = 0.03
LINE = 0.4  # [pt] width of outlines
BIAS = 0.01  # [m] by which a line is painted nearer than the faces that it bounds
FINE, COARSE = (28, 9), (14, 6)  # directions around and from pole to pole: for supports of round bodies, of meshes


@dataclass(frozen=True, eq=False)
class Skin:
    """The triangles of a solid, oriented outward, in the frame that carries it."""

    vertices: Array  # (m, 3) [m]
    triangles: NDArray[np.int64]  # (F, 3)

    @cached_property
    def edges(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the edges between two triangles: their vertices (E, 2) and the two triangles (E, 2)."""
        sides = np.sort(self.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        order = np.lexsort(sides.T)
        same = (sides[order[1:]] == sides[order[:-1]]).all(axis=1)
        first, second = order[:-1][same], order[1:][same]
        return sides[first], np.stack([first // 3, second // 3], axis=1)

    def placed(self, pose: Array) -> Skin:
        """The surface moved by `pose` (4, 4)."""
        return Skin(self.vertices @ pose[:3, :3].T + pose[:3, 3], self.triangles)


@dataclass(frozen=True)
class Paint:
    """Colour and opacity of a solid."""

    color: str
    alpha: float
    nearer: float = 0.0  # [m] by which it is painted in front of where it is


STANDING_PAINT = Paint(OBSTACLE, 0.4)
DRIFTING_PAINTS = (  # path parameters, and how a moving obstacle is painted then
    (0.0, Paint(MOVING, 0.85)),
    *((time, Paint(MOVING, 0.12)) for time in GHOSTS),
    (1.0, Paint(MOVING, 0.4)),
)


@dataclass(frozen=True, eq=False)
class Picture:
    """Everything in the scene, in the world frame."""

    solids: tuple[tuple[Skin, Paint], ...]
    moves: bool  # whether an obstacle moves
    tip_link: str
    robot_points: Array  # (m, 3) [m] of all shown configurations and the tip's path, which the view must contain
    obstacle_points: tuple[Array, ...]  # of each obstacle
    tip: Array  # (k, 3) [m] path of the farthest point of the last link

    @classmethod
    def of(cls, setup: Setup, trajectory: Trajectory, now: float | None = None) -> Picture:
        """Place the robot along its motion, and the moving obstacles at the same times; or both at the path parameter
        `now`, with the robot's ends as ghosts."""
        scene, robot = setup.scene, setup.robot
        standing = [(body.placed(o.pose.matrix), STANDING_PAINT) for o, body in _obstacles(scene, moving=False)]
        drifting = _obstacles(scene, moving=True)
        drifted = DRIFTING_PAINTS if now is None else ((now, DRIFTING_PAINTS[0][1]),)
        obstacles = standing + [
            (body.placed(place), paint)
            for o, body in drifting
            for place, paint in zip(
                ObstacleMotion.of(o).at(trajectory.curve.time_of([time for time, _ in drifted])),
                (paint for _, paint in drifted),
                strict=True,
            )
        ]
        links = [
            (int(item.parentJoint), skin(piece, whole=False).placed(item.placement.homogeneous))
            for item in robot.collision.geometryObjects
            for piece in link_pieces(item.geometry, item.name)
        ]
        solids = list(obstacles)
        shown = [(time, Paint(BETWEEN, 0.2)) for time in GHOSTS]
        shown += [(0.0, Paint(START, 1.0, START_OFFSET)), (1.0, Paint(GOAL, 1.0))]
        if now is not None:
            shown = [(0.0, Paint(START, 0.15)), (1.0, Paint(GOAL, 0.15)), (now, Paint(BETWEEN, 1.0))]
        for (_, paint), pose in zip(shown, _poses(robot, trajectory, [time for time, _ in shown]), strict=True):
            solids += [(body.placed(pose[joint]), paint) for joint, body in links if joint]
        solids += [(body, Paint(FIXED, 1.0)) for joint, body in links if not joint]
        planned = {0, *(robot.coordinates + 1).tolist()}  # what follows may hang beside the arm
        outermost = max((joint for joint, _ in links if joint in planned), default=max(planned))
        last = next((body.vertices for joint, body in reversed(links) if joint == outermost), np.zeros((1, 3)))
        farthest = last[np.linalg.norm(last, axis=1).argmax()]
        along = _poses(robot, trajectory, np.linspace(0.0, 1.0, TIP_STEPS + 1))[:, outermost]
        tip = along[:, :3, :3] @ farthest + along[:, :3, 3]
        posed = [body.vertices for body, _ in solids[len(obstacles) :]]
        ends = (link for link in reversed(robot.links) if robot.link_joint[link] == outermost)
        name = next(ends, robot.model.names[outermost])  # without any geometry, the path is that of the joint
        others = tuple(body.vertices for body, _ in obstacles)
        return cls(tuple(solids), bool(drifting), name, np.concatenate([*posed, tip]), others, tip)

    def azimuth(self) -> float:
        """Return the side [rad] from which the tip's path looks longest, on its side of the robot."""
        level = self.tip[:, :2] - self.tip[:, :2].mean(axis=0)
        along = np.linalg.svd(level, full_matrices=False)[2][0]
        outward = self.tip[:, :2].mean(axis=0) - self.robot_points[:, :2].mean(axis=0)
        across = np.array([-along[1], along[0]])
        across = across if across @ outward >= 0.0 else -across
        return float(np.arctan2(across[1], across[0]))


def _obstacles(scene: Scene, moving: bool) -> list[tuple[Obstacle, Skin]]:
    """Return the pieces of the obstacles that move, or of those that do not, in their own frames."""
    return [
        (obstacle, body)
        for obstacle in scene.obstacles
        if (obstacle.motion is not None) == moving
        for body in _bodies(obstacle)
    ]


def _bodies(obstacle: Obstacle) -> list[Skin]:
    """Return the pieces of an obstacle's true shape, of a cloud boxes around its points."""
    if not isinstance(obstacle.shape, Seen):
        return [skin(piece, whole=True) for piece in obstacle_pieces(obstacle)]
    return [Skin(*seen_mesh(obstacle.shape))]


def draw_scene(axis: Any, picture: Picture, azimuth: float, elevation: float) -> None:
    """Draw `picture` on a matplotlib axis as seen from azimuth and elevation [rad]."""
    view = _view(azimuth, elevation)
    box = axis.get_position().bounds[2:] * axis.figure.get_size_inches()
    low, high = _window(picture, view, box[0] / box[1])
    size = float((high - low).max())
    nothing = np.empty((0, 3, 3)), np.empty((0, 4)), np.empty((0, 4))
    parts = [part for body, paint in picture.solids for part in _painted(body, paint, view, TILE * size)]
    polygons, faces, edges = (np.concatenate(column) for column in zip(nothing, *parts, strict=True))
    order = np.argsort(polygons[:, :, 2].mean(axis=1))
    flat: Any = polygons[order, :, :2]
    painted = PolyCollection(
        flat,
        facecolors=faces[order],
        edgecolors=edges[order],
        linewidths=LINE,
        rasterized=True,  # in a PDF or SVG: tens of thousands of polygons
    )
    axis.add_collection(painted)
    path = picture.tip @ view.T
    casing = [withStroke(linewidth=2.6, foreground="white")]
    axis.plot(path[:, 0], path[:, 1], color=INK, linewidth=1.3, path_effects=casing, solid_capstyle="round")
    _ends(axis, path[:, :2], low, high)
    axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xticks=[], yticks=[])
    axis.spines[:].set(visible=True, color=FRAME)
    _scale(axis, view, low, size)


def _ends(axis: Any, path: Array, low: Array, high: Array) -> None:
    """Mark and name both ends of the path (k, 2), with each name within the window on the side farthest from the path
    and from other text."""
    per_point = float(high[0] - low[0]) / (72.0 * axis.get_position().width * axis.figure.get_size_inches()[0])
    avoided = np.vstack([path, low + (high - low).max() * _CORNER])
    for end, name, color, marker in ((0, "start", START, "o"), (-1, "goal", GOAL, "s")):
        axis.plot(*path[end], marker, markersize=5, color=color, markeredgecolor="white", markeredgewidth=0.8)
        places = path[end] + per_point * (6.0 * _AROUND + 0.5 * NAME * np.sign(_AROUND))
        away = (avoided - places[:, None]) / (per_point * NAME)  # in sizes of the name
        outside = np.abs(2.0 * places - low - high) > high - low - per_point * NAME
        best = np.where(outside.any(axis=1), 0.0, np.abs(away).max(axis=2).min(axis=1)).argmax()
        side, avoided = _AROUND[best], np.vstack([avoided, places[best]])
        axis.annotate(
            name,
            path[end],
            6.0 * side,
            textcoords="offset points",
            ha=("right", "center", "left")[int(np.sign(side[0])) + 1],
            va=("top", "center", "bottom")[int(np.sign(side[1])) + 1],
            color=color,
            weight="bold",
            path_effects=[withStroke(linewidth=2.6, foreground="white")],
        )


def _painted(body: Skin, paint: Paint, view: Array, longest: float) -> list[tuple[Array, Array, Array]]:
    """Return the visible parts of a solid, faces, then outlines: polygons (k, 3, 3), face and edge colours (k, 4).

    The polygons are in the view's frame: right, up, towards the eye. A line is a triangle with a vertex repeated.
    """
    color = np.array(to_rgb(paint.color))
    corners = (body.vertices @ view.T)[body.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    front = normals[:, 2] > 0.0
    tiles, owner = _tiles(corners[front], longest)
    light = 0.6 + 0.5 * np.clip(normals[front] @ _LIGHT, 0.0, 1.0)[owner, None]
    shaded = np.c_[np.clip(color * light, 0.0, 1.0), np.full(len(owner), paint.alpha)]
    solid = paint.alpha == 1.0  # tiles then get edges: through anti-aliased rims the back would show
    tiles[..., 2] += paint.nearer
    faces = tiles, shaded, shaded if solid else 0.0 * shaded

    ends, beside = body.edges
    seen = front[beside].any(axis=1)
    sharp = np.einsum("ei,ei->e", normals[beside[:, 0]], normals[beside[:, 1]]) < EDGE_COSINE
    strokes = _dashes((body.vertices @ view.T)[ends[seen & (sharp | ~front[beside].all(axis=1))]], longest)
    strokes = strokes[:, [0, 1, 1]] + [0.0, 0.0, BIAS + paint.nearer]
    ink = np.tile([*(0.5 * color), min(1.0, 2.0 * paint.alpha)], (len(strokes), 1))
    return [faces, (strokes, 0.0 * ink, ink)]


def skin(piece: Piece, whole: bool) -> Skin:
    """Return a piece's triangles: its surface if `whole` and it is not convex, or else its hull.

    The hull is that of support points in a fixed set of directions: exact corners of a box, true rims of round bodies,
    a few hundred points of a fine mesh.
    """
    if whole and piece.surface is not None:
        return Skin(piece.surface.mesh.vertices, piece.surface.mesh.triangles)
    directions = _FINE if piece.sweep else _COARSE
    level = directions * [1.0, 1.0, 0.0]
    around = np.linalg.norm(level, axis=1, keepdims=True)
    rim = np.divide(level, around, out=np.zeros_like(level), where=around > 1e-9)
    points = piece.vertices[(directions @ piece.vertices.T).argmax(axis=1)]
    points = points + piece.ball * directions + piece.disc * rim
    if piece.radii is not None:
        points = points + directions * piece.radii
    points = np.unique(points.round(9), axis=0)
    hull = ConvexHull(points)
    corners = points[hull.simplices]
    inward = (
        np.einsum(
            "fi,fi->f", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), hull.equations[:, :3]
        )
        < 0.0
    )
    triangles = hull.simplices.astype(np.int64)
    triangles[inward] = triangles[inward, ::-1]
    return Skin(points, triangles)


def _poses(robot: Robot, trajectory: Trajectory, times: Iterable[float]) -> Array:
    """Return the joints' placements (k, joints, 4, 4) in the world."""
    data = robot.model.createData()
    columns = [trajectory.joint_names.index(name) for name in robot.joint_names]
    poses = []
    for q in trajectory.at(np.array(list(times)))[:, columns]:
        pin.forwardKinematics(robot.model, data, robot.pin_q(q))
        poses.append([placement.homogeneous for placement in data.oMi])
    return np.array(poses)


def _view(azimuth: float, elevation: float) -> Array:
    """Return the rows right, up, towards the eye (3, 3) of the view's frame."""
    towards = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.stack([right, np.cross(towards, right), towards])


def _window(picture: Picture, view: Array, aspect: float) -> tuple[Array, Array]:
    """Return the corners of the window, with `aspect` its width over its height: the robot and its surroundings."""
    robot = picture.robot_points @ view[:2].T
    low, high = robot.min(axis=0), robot.max(axis=0)
    margin = SURROUNDINGS_SHARE * float((high - low).max())
    seen = np.concatenate([robot, *(points @ view[:2].T for points in picture.obstacle_points)])
    seen = np.clip(seen, low - margin, high + margin)
    low, high = seen.min(axis=0), seen.max(axis=0)
    half = np.maximum(0.54 * (high - low), LEAST)
    half = np.maximum(half, [half[1] * aspect, half[0] / aspect])
    return 0.5 * (low + high) - half, 0.5 * (low + high) + half


def _tiles(triangles: Array, longest: float) -> tuple[Array, NDArray[np.int64]]:
    """Halve triangles (k, 3, 3) until no edge is longer than `longest`; also return the row from which each comes."""
    owner = np.arange(len(triangles))
    while True:
        lengths = np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2)
        large = lengths.max(axis=1, initial=0.0) > longest
        if not large.any():
            return triangles, owner
        turn = (lengths[large].argmax(axis=1)[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(triangles[large], turn[..., None], axis=1), 1, 0)
        middle = 0.5 * (a + b)
        halves = [np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)]
        triangles = np.concatenate([triangles[~large], *halves])
        owner = np.concatenate([owner[~large], owner[large], owner[large]])


def _dashes(segments: Array, longest: float) -> Array:
    """Halve segments (k, 2, 3) until none is longer than `longest`."""
    while len(segments):
        large = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1) > longest
        if not large.any():
            break
        a, b = segments[large, 0], segments[large, 1]
        middle = 0.5 * (a + b)
        segments = np.concatenate([segments[~large], np.stack([a, middle], axis=1), np.stack([middle, b], axis=1)])
    return segments


def _scale(axis: Any, view: Array, low: Array, size: float) -> None:
    """Draw the directions of x, y, z and a scale bar, valid in the whole picture."""
    lengths: Sequence[float] = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
    length = min(lengths, key=lambda value: abs(value - 0.12 * size))
    cased: dict[str, Any] = {"color": INK, "path_effects": [withStroke(linewidth=3.0, foreground="white")]}
    middle = low + [0.085 * size, 0.11 * size]
    for name, direction in zip("xyz", 0.06 * size * view[:2].T, strict=True):
        axis.plot(*zip(middle, middle + direction, strict=True), linewidth=1.0, **cased)
        axis.text(*(middle + direction + 0.012 * size * np.sign(direction)), name, ha="center", va="center", **cased)
    left, height = low + 0.025 * size
    axis.plot([left, left + length], [height, height], linewidth=2.0, solid_capstyle="butt", color=INK)
    axis.text(left + length + 0.01 * size, height, f"{length:g} m", va="center", **cased)


def _directions(turns: int, rises: int) -> Array:
    turn = np.arange(turns) * 2.0 * np.pi / turns
    rise = np.linspace(-0.5 * np.pi, 0.5 * np.pi, rises + 2)[1:-1, None]
    ring = np.stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise) + 0.0 * turn], axis=-1)
    return np.concatenate([ring.reshape(-1, 3), [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])


_AROUND = np.array(
    [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [0.7, 0.7], [0.7, -0.7], [-0.7, 0.7], [-0.7, -0.7]]
)
_CORNER = np.array([[x, y] for x in (0.03, 0.085, 0.14) for y in (0.03, 0.11, 0.18)])  # of the view: see _scale
_FINE, _COARSE = _directions(*FINE), _directions(*COARSE)  # (k, 3) unit
_LIGHT = np.array([-0.4, 0.6, 0.7]) / np.linalg.norm([-0.4, 0.6, 0.7])  # from the upper left, in the view's frame
