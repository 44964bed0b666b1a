"""Random jobs: an arm takes one of six objects from a table or a board of a shelf and sets it down on another.

Job k depends on k alone. Six objects (a can, a bottle, a carton, a brick, a ball and a bracket, which is a mesh that is
not convex) stand on a table and on two boards of a shelf, at random places and turns. An arm (a Panda with fingers, a
UR5 and an xArm 7 with suction) takes one by any of several grasps, from above or from the side, lifts it straight,
carries it, a bottle upright, sets it down somewhere else in any of several turns, lets go, and backs out. Things and
places are drawn until there is a grasp that fits at both ends, by Pinocchio and coal alone: with it the arm follows the
lines to the object, up with it, down to its place and back, and meets nothing on them. Whether a way leads from one end
to the other is left open, and no job is left out because hdplan fails.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import yaml
from cells import quantiles
from picks_recheck import RefutedError, Scene, recheck
from scipy.spatial.transform import Rotation
from sieges.poses import of_scene

import hdplan
from hdplan.planner.studies.report import markdown_text

BEFORE, RAISED, BACK = 0.10, 0.06, 0.10  # [m] before a grasp, above where an object stands, and behind it
LOOSE = 1e-3  # [m] above its board, in which an object is let go
GAP = 1e-3  # [m] between a suction cup and what it takes
ROOM = 0.05  # [m] at least between two objects
THICK = 0.02  # [m] of boards
BRACKET = "bracket.obj"
INSIDE = 0.03  # [m] that fingers reach into what they take from the side
SHUFFLED = 6  # grasps with which a job is tried when it is drawn
TRIES, STEPS = 12, 40  # of inverse kinematics
INNER = 0.05  # [rad] from the limits of joints
PARTS, FARTHEST = 6, 0.35  # of a line on which an arm is tested; [rad] that a joint moves between two of them


@dataclass(frozen=True)
class Arm:
    """An arm and its hand."""

    robot: dict[str, Any]
    start: dict[str, Any]
    link: str  # its tool
    tool: Rotation  # in that, of a frame whose z points at what is taken; fingers close along its y
    touching: tuple[str, ...]  # links
    fingers: tuple[str, ...]  # joints; none: suction
    acceleration: float
    reach: float  # [m] from its base to where the shelf stands

    @property
    def opened(self) -> dict[str, float]:
        """Its fingers, open."""
        return dict.fromkeys(self.fingers, 0.04)


FINGERS = ("panda_finger_joint1", "panda_finger_joint2")
PANDA = {"name": "panda", "locked": dict.fromkeys(FINGERS, 0.04)}
UR5 = {"name": "ur5", "ignore_pairs": [["wrist_3_link", "ee_link"]]}
UR5_START = {"joints": [0.3, -1.5, 1.9, -1.97, -1.57, 0.0]}
XARM_START = {"joints": [0.0, -0.4, 0.0, 0.9, 0.0, 1.3, 0.0]}
PADS = ("panda_leftfinger", "panda_rightfinger")
ALONG_Z, ALONG_X = Rotation.identity(), Rotation.from_euler("y", 90, degrees=True)
ARMS = {
    "panda": Arm(PANDA, {"state": "default"}, "panda_hand_tcp", ALONG_Z, PADS, FINGERS, 7.5, 0.55),
    "ur5": Arm(UR5, UR5_START, "ee_link", ALONG_X, ("wrist_3_link",), (), 8.0, 0.62),
    "xarm7": Arm({"name": "xarm7"}, XARM_START, "link7", ALONG_Z, ("link7",), (), 8.0, 0.52),
}


@dataclass(frozen=True)
class Kind:
    """A kind of object; its frame is in its middle, z upwards, and fingers take it along its y axis."""

    shape: dict[str, Any]
    height: float  # [m]
    width: float  # [m] along y
    round_: bool  # about its z axis
    away: float  # [m] of its outline from its middle
    beside: float = 0.0  # [m] from its middle to the side at which a cup takes it, along x; 0: not there
    top: tuple[float, float, float] = (0.0, 0.0, 0.0)  # where a cup takes it from above
    held: tuple[float, float, float] = (0.0, 0.0, 0.0)  # where fingers take it
    short: float = 0.0  # [m] of that, at which they stop where they come from the side


def _box(x: float, y: float, z: float) -> Kind:
    shape, away, short = {"type": "box", "size": [x, y, z]}, 0.5 * math.hypot(x, y), max(0.0, 0.5 * x - INSIDE)
    return Kind(shape, z, y, False, away, 0.5 * x, (0, 0, 0.5 * z), short=short)


def _can(radius: float, length: float) -> Kind:
    shape = {"type": "cylinder", "radius": radius, "length": length}
    return Kind(shape, length, 2 * radius, True, radius, radius, (0, 0, 0.5 * length))


KINDS = {
    "can": _can(0.03, 0.12),
    "bottle": _can(0.028, 0.18),
    "carton": _box(0.09, 0.05, 0.14),
    "brick": _box(0.13, 0.06, 0.06),
    "ball": Kind({"type": "sphere", "radius": 0.032}, 0.064, 0.064, True, 0.032, 0.032, (0, 0, 0.032)),
    "bracket": Kind({"type": "mesh", "file": BRACKET}, 0.1, 0.05, False, 0.05, 0.0, (-0.03, 0, 0.05), (-0.03, 0, 0.01)),
}


def write_bracket(folder: Path) -> None:
    """Write the mesh of an angle bracket: an L of 80 by 50 by 100 mm, 20 mm thick."""
    outline = np.array([[-0.04, -0.05], [0.04, -0.05], [0.04, -0.03], [-0.02, -0.03], [-0.02, 0.05], [-0.04, 0.05]])
    sides = [f"v {x} {y} {z}" for y in (-0.025, 0.025) for x, z in outline]
    fan = [(1, 2, 3), (1, 3, 4), (1, 4, 5), (1, 5, 6)]
    faces = [*fan, *((c + 6, b + 6, a + 6) for a, b, c in fan)]
    for a, b in zip(range(1, 7), (2, 3, 4, 5, 6, 1), strict=True):
        faces += [(b, a, a + 6), (b, a + 6, b + 6)]
    (folder / BRACKET).write_text("\n".join([*sides, *("f {} {} {}".format(*face) for face in faces)]) + "\n")


@dataclass(frozen=True)
class Board:
    """A support: the middle of its upper side, its orientation and its size."""

    name: str
    at: np.ndarray
    yaw: float
    size: tuple[float, float]
    covered: bool  # by another board: it is reached from the front, along its own x axis

    def place(self, x: float, y: float) -> np.ndarray:
        """Return the place in the world of one on it."""
        place: np.ndarray = self.at + Rotation.from_euler("z", self.yaw).apply([x, y, 0.0])
        return place


def _furniture(rng: np.random.Generator, arm: Arm) -> tuple[list[dict[str, Any]], list[Board]]:
    """Return obstacles and the boards on which things stand."""
    top = rng.uniform(0.02, 0.2)
    table = Board("table", np.array([0.55, 0.0, top]), 0.0, (0.5, 0.7), False)
    side = rng.choice([-1.0, 1.0])
    around = side * math.radians(rng.uniform(90, 110))
    far = arm.reach + rng.uniform(-0.03, 0.05)
    turn = Rotation.from_euler("z", around)
    low = rng.uniform(0.05, 0.25)
    high = low + rng.uniform(0.36, 0.46)
    boards = [
        Board(name, turn.apply([far, 0.0, 0.0]) + [0.0, 0.0, z], around, (0.28, 0.64), name == "lower")
        for name, z in (("lower", low), ("upper", high))
    ]

    def part(name: str, size: list[float], place: list[float]) -> dict[str, Any]:
        pose = {"position": turn.apply(place).tolist(), "rpy": [0.0, 0.0, around]}
        return {"name": name, "shape": {"type": "box", "size": size}, "pose": pose}

    middle, tall = 0.5 * (low + high), high - low + 2 * THICK
    parts = [
        _obstacle("floor", [2.0, 2.0, 0.04], [0.0, 0.0, -0.03]),
        _obstacle("table", [0.5, 0.7, THICK], [0.55, 0.0, top - 0.5 * THICK]),
        *(part(each.name, [0.28, 0.64, THICK], [far, 0.0, each.at[2] - 0.5 * THICK]) for each in boards),
        part("back", [0.02, 0.68, tall], [far + 0.15, 0.0, middle - 0.5 * THICK]),
        part("left", [0.28, 0.02, tall], [far, 0.33, middle - 0.5 * THICK]),
        part("right", [0.28, 0.02, tall], [far, -0.33, middle - 0.5 * THICK]),
    ]
    return parts, [table, *boards]


def _obstacle(name: str, size: list[float], place: list[float]) -> dict[str, Any]:
    return {"name": name, "shape": {"type": "box", "size": size}, "pose": {"position": place}}


def _spot(
    rng: np.random.Generator, boards: list[Board], away: float, taken: list[tuple[np.ndarray, float]]
) -> tuple[Board, np.ndarray]:
    """Return a random place on a random board, away from what is there."""
    while True:
        board = boards[int(rng.integers(len(boards)))]
        free = 0.5 * np.array(board.size) - away - 0.03
        place = board.place(*rng.uniform(-free, free))
        near = [(other, far) for other, far in taken if abs(place[2] - other[2]) < 0.3]
        apart = [np.linalg.norm(place[:2] - other[:2]) - away - far for other, far in near]
        if min(apart, default=1.0) > ROOM:
            return board, place


def _grasps(arm: Arm, kind: Kind, covered: tuple[bool, bool]) -> Iterator[tuple[np.ndarray, Rotation]]:
    """Yield the tool's places and turns in an object's frame: from above, and from the side, which a board above
    leaves alone."""
    across = np.arange(0, 360, 30) if kind.round_ else np.array([0, 180])
    if arm.fingers:
        deep = max(kind.held[2], 0.5 * kind.height - 0.03)
        for yaw in across if not any(covered) else ():
            yield np.array([*kind.held[:2], deep]), Rotation.from_euler("z", yaw, degrees=True) * _down()
        for yaw in across:
            for pitch in (0, 25):
                yield np.array(kind.held) - kind.short * _sideways(yaw, 0).as_matrix()[:, 2], _sideways(yaw, pitch)
        return
    for yaw in np.arange(0, 360, 60) if not any(covered) else ():
        yield np.array(kind.top) + [0.0, 0.0, GAP], Rotation.from_euler("z", yaw, degrees=True) * _down()
    for yaw in across if kind.beside else ():
        turn = _sideways(yaw, 0)
        for roll in (0, 90, 180, 270):
            yield -(kind.beside + GAP) * turn.as_matrix()[:, 2], turn * Rotation.from_euler("z", roll, degrees=True)


def _down() -> Rotation:
    return Rotation.from_euler("x", 180, degrees=True)


def _sideways(yaw: float, pitch: float) -> Rotation:
    """Return the turn of a tool that points along x, turned about z, and a little downwards; its y stays level."""
    return Rotation.from_euler("ZY", [yaw, 90 + pitch], degrees=True)


def job(number: int, folder: Path) -> dict[str, Any]:
    """Return the scene of a job, of which a folder holds the mesh."""
    rng = np.random.default_rng([36, number])
    name = list(ARMS)[number % len(ARMS)]
    arm = ARMS[name]
    while True:
        obstacles, boards = _furniture(rng, arm)
        stand = _standing(rng, boards)
        what = list(KINDS)[int(rng.integers(len(KINDS)))]
        kind, (source, at, yaw) = KINDS[what], stand[what]
        taken = [(there, KINDS[each].away) for each, (_, there, _) in stand.items()]
        target, place = _spot(rng, boards, kind.away, taken)
        place = place + [0.0, 0.0, LOOSE + 0.5 * kind.height]
        grasps = list(_grasps(arm, kind, (source.covered, target.covered)))
        turns = [target.yaw + a for a in ((0.0, math.pi) if target.covered else np.arange(4) * 0.5 * math.pi)]
        rng.shuffle(grasps)
        obstacles += [
            {"name": each, "shape": KINDS[each].shape, "pose": {"position": there.tolist(), "rpy": [0.0, 0.0, turned]}}
            for each, (_, there, turned) in stand.items()
        ]
        hand = Hand(arm, Scene({"robot": arm.robot, "obstacles": obstacles}, folder), what)
        there = [(place, turn, target.name) for turn in turns]
        if any(hand.fits(grasp, (at, yaw, source.name), there) for grasp in grasps[:SHUFFLED]):
            break
    here = Rotation.from_euler("z", yaw)
    poses = []
    for offset, turn in _grasps(arm, kind, (source.covered, target.covered)):
        whole = here * turn
        before = at + here.apply(offset) - BEFORE * whole.as_matrix()[:, 2]
        poses.append({"link": arm.link, **_pose(before, whole * arm.tool.inv())})
    free = {"free_rotation": "z"} if kind.round_ else {}
    goals = [
        {"link": what, **_pose(place + [0.0, 0.0, RAISED], Rotation.from_euler("z", turn)), **free}
        for turn in (turns[:1] if kind.round_ else turns)
    ]
    return {
        "hdplan": 1,
        "robot": arm.robot,
        "obstacles": obstacles,
        "start": arm.start,
        "limits": {"velocity": "urdf", "acceleration": arm.acceleration, "jerk": 500},
        "job": _stages(arm, what, poses, goals, source, target),
    }


def _standing(rng: np.random.Generator, boards: list[Board]) -> dict[str, tuple[Board, np.ndarray, float]]:
    """Return the places of all objects: board, middle, and turn."""
    taken: list[tuple[np.ndarray, float]] = []
    stand = {}
    for each, kind in KINDS.items():
        board, place = _spot(rng, boards, kind.away, taken)
        yaw = board.yaw + (rng.uniform(-0.4, 0.4) if board.covered else rng.uniform(-math.pi, math.pi))
        taken.append((place, kind.away))
        stand[each] = board, place + [0.0, 0.0, LOOSE + 0.5 * kind.height], yaw
    return stand


def _stages(
    arm: Arm, what: str, poses: list[dict[str, Any]], goals: list[dict[str, Any]], source: Board, target: Board
) -> list[dict[str, Any]]:
    """Return the stages of a job."""
    toward, kind = arm.tool.as_matrix()[:, 2], KINDS[what]
    closed = dict.fromkeys(arm.fingers, 0.5 * kind.width)
    touching = [[what, list(arm.touching)]]
    upright = {"path": {"upright": {"link": what, "axis": "z", "tolerance": 0.35}}} if what == "bottle" else {}
    away = {"touch": touching} if not arm.fingers else {}

    def line(length: float, **more: Any) -> dict[str, Any]:
        return {"line": {"by": (length * toward).tolist(), "frame": "tool", "link": arm.link}, **more}

    def rise(length: float, board: Board) -> dict[str, Any]:
        return {"line": {"by": [0.0, 0.0, length], "link": what}, "touch": [[what, board.name]]}

    return [
        {"name": "before it", "move": {"poses": poses}},
        {"name": "to it", **line(BEFORE, **away)},
        {"name": "take it", "grip": _hand(arm, what, closed, link=arm.link), "touch": touching},
        {"name": "lift", **rise(RAISED, source)},
        {"name": "carry", "move": {"poses": goals}, **upright},
        {"name": "lower", **rise(-RAISED, target)},
        {"name": "let go", "release": _hand(arm, what, arm.opened)},
        {"name": "back out", **line(-BACK, **away)},
    ]


Stand = tuple[np.ndarray, float, str]  # an object's place, its turn, and the board below it


class Hand:
    """A witness of grasps that fit: inverse kinematics by Pinocchio, damped least squares from random configurations
    and then along lines; distances by coal."""

    def __init__(self, arm: Arm, scene: Scene, what: str) -> None:
        """Take the arm, what stands around it, and what it is to take."""
        self.arm, self.scene, self.what, self.model = arm, scene, what, scene.model
        self.data, self.frame = self.model.createData(), self.model.getFrameId(arm.link)
        moved = [self.model.joints[i].idx_q for i, name in enumerate(self.model.names) if i and name not in FINGERS]
        self.moved, self.rng = np.array(moved), np.random.default_rng(0)
        self.low = np.maximum(self.model.lowerPositionLimit, -math.pi)[moved] + INNER
        self.high = np.minimum(self.model.upperPositionLimit, math.pi)[moved] - INNER

    def fits(self, grasp: tuple[np.ndarray, Rotation], stands: Stand, goes: list[Stand]) -> bool:
        """True if the hand takes the object from where it stands by a grasp, and sets it down by it."""
        return self._at(grasp, stands, BEFORE) and any(self._at(grasp, there, BACK) for there in goes)

    def _at(self, grasp: tuple[np.ndarray, Rotation], stands: Stand, back: float) -> bool:
        """True if from a configuration that grasps the object the hand can go back, and up with it."""
        place, yaw, board = stands
        offset, turn = grasp
        object_ = of_scene(_pose(place, Rotation.from_euler("z", yaw)))
        tool = of_scene(_pose(offset, turn * self.arm.tool.inv()))
        taken = object_ @ tool
        up, behind = np.array([0.0, 0.0, RAISED]), -back * (object_[:3, :3] @ turn.as_matrix()[:, 2])
        for _ in range(TRIES):
            q = self._brought(self.rng.uniform(self.low, self.high), taken)
            if q is None:
                continue
            self.scene.held, self.scene.places[self.what] = {}, object_
            touching = set(self.arm.touching) if not self.arm.fingers else set()
            if not self._follows(q, taken, behind, {frozenset((self.what, link)) for link in touching}, 0.04):
                continue
            self.scene.held = {self.what: (self.arm.link, np.linalg.inv(tool), set(self.arm.touching))}
            width = 0.5 * KINDS[self.what].width
            if self._follows(q, taken, up, {frozenset((self.what, board))}, width):
                return True
        return False

    def _follows(
        self, q: np.ndarray, begins: np.ndarray, by: np.ndarray, touch: set[frozenset[str]], fingers: float
    ) -> bool:
        """True if the tool follows a line freely from a configuration (n,), with fingers so far open."""
        pairs = self.scene.pairs(touch)
        for share in np.linspace(0.0, 1.0, PARTS):
            goal = begins.copy()
            goal[:3, 3] += share * by
            found = self._brought(q, goal)
            if found is None or np.abs(found - q).max() > FARTHEST:
                return False
            q = found
            self.scene.place(self._whole(q, fingers))
            if self.scene.least(pairs, LOOSE)[0] < LOOSE:
                return False
        return True

    def _brought(self, q: np.ndarray, goal: np.ndarray) -> np.ndarray | None:
        """Return joint values (n,) that bring the tool to a pose (4, 4), from some; None if none are found."""
        wanted = pin.SE3(goal[:3, :3], goal[:3, 3])
        for _ in range(STEPS):
            pin.computeJointJacobians(self.model, self.data, self._whole(q, 0.0))
            pin.updateFramePlacement(self.model, self.data, self.frame)
            error = pin.log6(self.data.oMf[self.frame].actInv(wanted)).vector
            if np.abs(error).max() < 1e-4:
                return q
            slope = pin.getFrameJacobian(self.model, self.data, self.frame, pin.ReferenceFrame.LOCAL)[:, self.moved]
            step = slope.T @ np.linalg.solve(slope @ slope.T + 1e-3 * np.eye(6), error)
            step *= min(1.0, 0.4 / np.abs(step).max())
            q = np.clip(q + step, self.low, self.high)
        return None

    def _whole(self, q: np.ndarray, fingers: float) -> np.ndarray:
        found = np.full(self.model.nq, fingers)
        found[self.moved] = q
        return found


def _hand(arm: Arm, what: str, fingers: dict[str, float], **more: Any) -> dict[str, Any]:
    return {"object": what, **more, **({"joints": fingers} if arm.fingers else {})}


def _pose(place: np.ndarray, turn: Rotation) -> dict[str, Any]:
    return {"position": place.tolist(), "quaternion_xyzw": turn.as_quat().tolist()}


def picks(folder: Path, count: int, first: int, time_limit: float) -> None:
    """Plan jobs, check them again, and print the outcomes; a folder keeps them, and a second run resumes there."""
    folder.mkdir(parents=True, exist_ok=True)
    write_bracket(folder)
    found: list[dict[str, Any]] = []
    for number in range(first, first + count):
        file = folder / f"{number}.result.json"
        if not file.exists():
            file.write_text(json.dumps(_planned(folder, number, time_limit)))
        found.append(each := json.loads(file.read_text()))
        line = f"{number:4} {each['robot']:6} {each['seconds']:6.2f} s: {each['words'][:200]}"
        print(line, file=sys.stderr, flush=True)
    rows = []
    for name in (*ARMS, "all"):
        if some := [each for each in found if name in (each["robot"], "all")]:
            whole, wrong = (sum(each["is"] == word for each in some) for word in ("certified", "refuted"))
            seconds = quantiles([each["seconds"] for each in some], (0.5, 0.95, 1.0), 2)
            row = {"arm": name, "jobs": len(some), "certified whole": whole, "refuted": wrong}
            rows.append(row | {"processor time of planning [s]: median, 95 %, worst": seconds})
    print(markdown_text(rows))


def _planned(folder: Path, number: int, time_limit: float) -> dict[str, Any]:
    """Plan a job, and look at it again."""
    content = job(number, folder)
    file, motion = folder / f"{number}.yaml", folder / f"{number}.json"
    content = json.loads(json.dumps(content, default=float))  # numbers of NumPy are numbers
    file.write_text(yaml.safe_dump(content, sort_keys=False))
    scene = hdplan.load_scene(file)
    began = time.process_time()
    kind, words = "no", ""
    try:
        result = hdplan.plan_job(scene, time_limit=time_limit)
        words = result.text
    except hdplan.HdplanError as error:
        result, words = None, str(error).removeprefix(f"{scene.source}: ")
    seconds = time.process_time() - began
    if result is not None and result.certified:
        result.save(motion)
        kind = "certified"
        try:
            recheck(content, folder, motion)
        except RefutedError as error:
            kind, words = "refuted", f"REFUTED: {error}"
    return {"number": number, "robot": content["robot"]["name"], "is": kind, "seconds": seconds, "words": words}
