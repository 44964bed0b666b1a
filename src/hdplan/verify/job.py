"""A job: for every stage the world that follows from the scene, the motion and its marks, and from nothing else.

A stage begins with what the stages before it left: the arm and the fingers at the motion's own row, what was taken held
as it stood then, what was let go standing where it was. So nobody can tell the checker another world than this one: a
proof has directions for its pairs alone. Where fingers move there are two worlds, one of the fingers and one of the arm
that stands still meanwhile, as a world compares nothing that does not move with its joints.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from . import scene as scenes
from .balls import HERE, Ball, Pose, RejectedError, compose, cross, dot, length, named, need, rejecting, stack, unit
from .joints import Joints
from .motion import SAME, Rows
from .other_robot import OtherRobot
from .reading import Reader, Reading
from .robot import placed
from .targets import Targets
from .text import listing, mapping, values

KINDS = {
    "move": "",
    "line": "by to frame link position_tolerance orientation_tolerance",
    "grip": "joints object link mass",
    "release": "joints object",
    "wait": "",
}
MOST_STAGES = 1000
SAME_TIME = 1e-6  # [s] by which a wait may be shorter
SHORTEST = 1e-6  # [m] of lines
ROUNDED = 1e-11  # that joints which follow, rounded, may move what they carry; of at most LARGEST
LARGEST = 100.0


@dataclass(frozen=True)
class Part:
    """A world that is to be proven free: that of a stage, or of the arm that stands still in it."""

    name: str  # in words
    about: str  # what is held, and what may touch
    reading: Reading
    arm: bool  # whether it is that of the arm that stands still while fingers move
    holding: tuple[str, tuple[str, ...]] | None  # an object that is taken at its end, and what is to hold it
    drawn: bool  # along a line, whose path and goal are the checker's own: the proof's may be other boxes around it


@dataclass(frozen=True)
class Stage:
    """A stage as the scene has it."""

    name: str
    kind: str
    said: Any  # of its kind
    touch: list[tuple[str, str]]
    beside: dict[str, Any]  # what else it has

    @property
    def fingers(self) -> bool:
        """True if fingers move in it."""
        return self.kind in ("grip", "release") and bool(self.said.get("joints"))


def read_job(scene: Path, motion: Path, told: list[Any], robot: str | None = None) -> list[Part]:
    """The worlds of a job, in order, of which a proof `told` as many. Raises RejectedError, which names the stage."""
    with rejecting():
        reader = Reader(scene, motion, told[0] if told else None, None, robot)
        stages = stages_of(reader.top)
        count = sum(1 + stage.fingers for stage in stages)
        need(len(told) == count, f"the job has {count} worlds to be proven free, the proof has {len(told)}")
        return [*Job(reader, stages).parts()]


def stages_of(top: dict[str, Any]) -> list[Stage]:
    """The stages of a scene's job, each of one kind that is known."""
    entries = listing(top.get("job"), "job")
    need(0 < len(entries) <= MOST_STAGES, f"job: 1 to {MOST_STAGES} stages are expected")
    found = [stage_of(entry, i) for i, entry in enumerate(entries)]
    need(len({x.name for x in found}) == len(found), "job: two stages of one name")
    return found


def stage_of(entry: Any, number: int) -> Stage:
    """A stage."""
    what = f"job[{number}]"
    keys = mapping(entry, what, f"{' '.join(KINDS)} name touch limits speed path")
    kinds = [x for x in KINDS if x in keys]
    need(len(kinds) == 1, f"{what}: one of {', '.join(KINDS)} is expected")
    (kind,) = kinds
    said = keys.pop(kind)
    said = mapping(said, f"{what}.{kind}", KINDS[kind]) if KINDS[kind] else said
    need("path" not in keys or kind == "move", f"{what}.path: goes with 'move' alone")
    name = scenes.word(keys.pop("name", f"{kind} {number}"), what)
    pairs = dict[tuple[str, str], None]()
    for pair in listing(keys.pop("touch", None), f"{what}.touch"):
        need(type(pair) is list and len(pair) == 2, f"{what}.touch: pairs are expected")
        one, others = pair[0], pair[1] if type(pair[1]) is list else [pair[1]]
        need(one not in others, f"{what}.touch: '{one}' touches itself")
        pairs |= {(scenes.word(one, what), scenes.word(x, what)): None for x in others}
    return Stage(name, kind, said, [*pairs], keys)


def widened(pose: Pose) -> Pose:
    """A pose, with what joints that follow are rounded by."""
    turn, at = pose
    return Ball(turn.mid, turn.rad + ROUNDED), Ball(at.mid, at.rad + ROUNDED)


def back(pose: Pose, other: Pose) -> Pose:
    """A pose of the world in the frame of another one."""
    return dot("ji,jk->ik", pose[0], other[0]), dot("ji,j->i", pose[0], other[1] - pose[1])


@contextmanager
def within(stage: Stage) -> Iterator[None]:
    """Name a stage in what is rejected."""
    try:
        yield
    except RejectedError as error:
        raise RejectedError(f"stage '{stage.name}': {error}") from None


class Job:
    """The state in which a stage begins: arm, fingers, what is held and what stands."""

    def __init__(self, reader: Reader, stages: list[Stage]) -> None:
        """Take what there is at first."""
        top, joints, rows = reader.top, reader.joints, reader.rows
        need(not isinstance(joints, OtherRobot), "job: can be checked with a robot in URDF alone")
        said = {*top} & {"path", "from_request", "goal"}
        said |= {"timing.duration"} & {f"timing.{x}" for x in top.get("timing", {})}
        need(not said and top.get("self_collision") is not False, f"{', '.join(said) or 'self_collision'}: with a job")
        self.reader, self.stages, self.rows, self.spec = reader, stages, rows, joints.spec
        start = Targets(joints, False).target(top["start"], "start")
        need("velocity" not in start, "start.velocity: with a job, whose stages begin at rest")
        self.arm = dict(zip(joints.lead, start["joints"], strict=True))
        given = top["start"].get("joints")
        self.hand = {x: joints.held[x] for x in (given if isinstance(given, dict) else ()) if x in joints.held}
        for name, value in start["others"].items():
            here = self.everywhere(joints)[name]
            need(abs(here - value) <= SAME, f"start: '{name}' stands at {here:g}")
        self.standing, self.held = dict[str, dict[str, Any]](), dict[str, dict[str, Any]]()
        for into, key in ((self.standing, "obstacles"), (self.held, "attached")):
            for i, entry in enumerate(listing(top.get(key), key)):
                name = scenes.word(entry.get("name", f"{key.removesuffix('s')}{i}"), f"{key}[{i}]")
                need(name not in self.things and name not in joints.at, f"'{name}': the name is taken")
                need("motion" not in entry, f"obstacle '{name}': moves, which goes with no job")
                into[name] = {**entry, "name": name}
        self.at_first = dict(self.standing)
        self.marks = self.marks_of(rows)

    @property
    def things(self) -> dict[str, dict[str, Any]]:
        """Standing and held objects."""
        return {**self.standing, **self.held}

    def marks_of(self, rows: Rows) -> list[int]:
        """The rows at which the stages begin, and the last row."""
        marks = [mapping(x, "stages", "name row") for x in listing(rows.stages, f"{rows.path}: stages")]
        for i, stage in enumerate(self.stages):
            there = marks[i].get("name") if i < len(marks) else None
            need(there == stage.name, f"the motion's stage {i} is {there!r}, the job's is '{stage.name}'")
        need(len(marks) == len(self.stages), "the motion has more stages than the job")
        found: list[Any] = [*(x.get("row") for x in marks), len(rows.given[0]) - 1]
        good = all(type(x) is int for x in found) and found[0] == 0
        need(good and all(a < b for a, b in itertools.pairwise(found)), "the rows at which stages begin must increase")
        return found

    def parts(self) -> Iterator[Part]:
        """The worlds of all stages."""
        for number, stage in enumerate(self.stages):
            rows = self.rows.between(self.marks[number], self.marks[number + 1])
            with within(stage):
                found = [*self.worlds(stage, rows)]
                self.advance(stage, rows)
            yield from found

    # --- worlds -------------------------------------------------------------------------------------------------------

    def worlds(self, stage: Stage, rows: Rows) -> Iterator[Part]:
        """The worlds of a stage."""
        top, still = self.reader.top, self.arm_at
        limits = stage.beside.get("limits", top.get("limits", {}))
        if stage.fingers:
            mine = stage.beside["limits"] if "limits" in stage.beside else of_fingers(limits)
            yield self.part(stage, rows, limits=mine, **self.of_fingers(stage))
            only = {key: x for key, x in top.get("limits", {}).items() if key == "position"}
            rested = rows.still([*self.arm], [*self.arm.values()])
            yield self.part(stage, rested, limits=only, robot=self.bare, start=still, goal=still, arm=True)
            return
        if stage.kind not in ("move", "line"):
            need(not rows.moves(), "the robot moves where it is to stand still")
        if stage.kind == "wait":
            asked = scenes.one(stage.said, "wait")
            need(rows.times[-1] - rows.times[0] >= asked - SAME_TIME, f"waits for less than {asked:g} s")
        aim: dict[str, Any] = {"goal": still}
        if stage.kind == "move":
            rates = {"velocity", "acceleration"} & {*stage.said}
            need(not rates, "move.velocity: with a job, whose stages end at rest")
            aim = {"goal": stage.said, "path": stage.beside.get("path", {})}
        elif stage.kind == "line":
            aim = self.line(stage.said)
        yield self.part(stage, rows, limits=limits, robot=self.bare, start=still, **aim)

    def part(self, stage: Stage, rows: Rows, *, limits: Any, arm: bool = False, **sections: Any) -> Part:
        """The world of a scene in which a stage is a motion like any other."""
        top = self.reader.top
        limits = mapping(limits, "limits", "position velocity acceleration jerk torque")
        need(
            arm or "acceleration" in limits, "limits.acceleration: is missing, so that nothing rests where stages meet"
        )
        obstacles, attached = self.touching(stage)
        own: dict[str, Any] = {key: top[key] for key in ("planner", "self_collision") if key in top}
        own |= {"obstacles": obstacles, "attached": attached, "limits": limits, **sections}
        if "payload" in top and "torque" in limits:
            own["payload"] = top["payload"]
        if not arm:
            timing = top.get("timing", {})
            scale = scenes.one(timing.get("scale", 1.0), "timing") * scenes.one(stage.beside.get("speed", 1.0), "speed")
            own["timing"] = {**timing, "scale": scale}
        reader = self.reader.of(own, rows)
        world = reader.world()
        touch = ", ".join("-".join(map(named, pair)) for pair in stage.touch) or "nothing"
        about = f"holds {', '.join(map(named, self.held)) or 'nothing'}; may touch, beside what it holds: {touch}"
        name = f"stage {named(stage.name)}{', the arm that stands still' * arm}"
        read = Reading(world, reader.files.hashes, tuple(reader.told.taken), reader.passed(world))
        holding = None if arm or stage.kind != "grip" or "object" not in stage.said else self.holding(stage)
        return Part(name, about, read, arm, holding, stage.kind == "line")

    @property
    def bare(self) -> dict[str, Any]:
        """The robot's section where the arm moves: the fingers stand as they are."""
        return {**self.spec, "locked": {**(self.spec.get("locked") or {}), **self.hand}}

    @property
    def arm_at(self) -> dict[str, Any]:
        """The arm's values, as a start or goal."""
        return {"joints": [*self.arm.values()]}

    def joints(self) -> Joints:
        """The joints where the arm moves."""
        return Joints(self.bare, self.arm_at, self.reader.joints.tree, self.reader.joints.semantics)

    def everywhere(self, joints: Joints) -> dict[str, float]:
        """The values of all joints."""
        found = {**joints.held, **self.arm}
        for name, (leader, factor, add) in joints.rules.items():
            found[name] = factor * found[leader] + add
            need(abs(found[name]) <= LARGEST, f"joint '{name}': follows to beyond {LARGEST:g}")
        return found

    def links(self) -> dict[str, Pose]:
        """Placements of all links."""
        joints = self.joints()
        base = scenes.pose_of(self.spec.get("base"), "robot.base")
        at, _ = placed(joints.tree, base, {}, self.everywhere(joints))
        return {link: widened(pose) for link, (_, pose) in at.items()}

    def of_fingers(self, stage: Stage) -> dict[str, Any]:
        """The sections in which fingers move, and the arm stands still."""
        joints, asked = self.joints(), mapping(stage.said["joints"], "joints", " ".join(stage.said["joints"]))
        tree = joints.tree
        leaders = {x: y.mimic[0] for x, y in tree.joints.items() if y.mimic}
        leaders |= {x: rule[0] for x, rule in tree.rules(tree.movable).items()}
        for joint in asked:
            need(joint in joints.held, f"joints: '{joint}' is none of the fingers'")
            need(leaders.get(joint, joint) in asked, f"joints: '{joint}' follows '{leaders.get(joint)}'")
        group = [x for x in asked if x not in leaders]
        fixed = {**(self.spec.get("locked") or {}), **self.hand, **self.arm}
        locked = {x: at for x, at in fixed.items() if leaders.get(x, x) not in group}
        start = {"joints": {x: joints.held[x] for x in group}}
        robot = {**self.spec, "group": group, "locked": locked}
        return {"robot": robot, "start": start, "goal": {"joints": asked}}

    def line(self, said: dict[str, Any]) -> dict[str, Any]:
        """The sections of a straight line: the link's origin is in a box around it that is larger by 1/sqrt(3) of the
        tolerance on every side, so that no point of the box is farther from the line than the tolerance."""
        joints, places = self.joints(), self.links()
        link = said["link"] if "link" in said else Targets(joints, False).end_effector()
        need(link in places and joints.at[link][0] >= 0, f"line.link: '{link}' is no link that moves")
        turn, begins = places[link]
        need(("by" in said) != ("to" in said) and ("by" in said or "frame" not in said), "line: either by or to")
        if "to" in said:
            way = Ball(values(said["to"], 3, "line.to")) - begins
        else:
            frame = said.get("frame", "world")
            where = {**{x: self.place(x, places)[0] for x in self.things}, "world": HERE[0], "tool": turn}
            need(frame in where, f"line.frame: unknown '{frame}'")
            way = dot("ij,j->i", where[frame], values(said["by"], 3, "line.by"))
        off = scenes.one(said.get("position_tolerance", 1e-3), "line.position_tolerance")
        angle = scenes.one(said.get("orientation_tolerance", 1e-2), "line.orientation_tolerance")
        need(0 < off <= 0.1 and 0 < angle <= 1, "line: a tolerance")
        ends, middle = begins + way, begins + way * 0.5
        long = float(length(way).mid)
        need(long > SHORTEST, "line: has no length")
        along = unit(way)
        side = unit(cross(along, Ball(np.eye(3)[int(np.abs(along.mid).argmin())])))
        third = cross(along, side)
        axes = stack([along, side, third], 1)
        slack = off / 3**0.5
        box = {"size": [long + 2 * slack, 2 * slack, 2 * slack], **scenes.frame((axes, middle))}
        within_ = {"position_tolerance": 0.5 * long + slack, "orientation_tolerance": angle}
        root = joints.tree.root
        place = scenes.frame(back(places[root], (turn, middle)))
        path = (
            {"kind": "position", "link": link, "point": [0.0] * 3, **box},
            {"kind": "relative", "link": link, "to": root, "frame": place, **within_},
        )
        aim = {"link": link, **scenes.frame((turn, ends)), "position_tolerance": off, "orientation_tolerance": angle}
        return {"goal": ({**aim, "free": "none"},), "path": path}

    def touching(self, stage: Stage) -> tuple[list[Any], list[Any]]:
        """Obstacles and held objects in a stage: an obstacle that something may touch is held by a link that stands
        fast, so that it may be told what touches it."""
        joints = self.joints()
        may = dict[str, list[str]]()
        for pair in stage.touch:
            for name in pair:
                need(name in joints.at or name in self.things, f"touch: '{name}' is not known")
            one, other = sorted(pair, key=lambda x: (x in self.standing, x in self.held), reverse=True)
            need(one not in joints.at, f"touch: '{one}' and '{other}' are links both")
            if other not in self.standing:
                may.setdefault(one, []).append(other)
        attached = [
            {**x, "touch_links": [*dict.fromkeys([*listing(x.get("touch_links"), name), *may.get(name, [])])]}
            for name, x in self.held.items()
        ]
        base = scenes.pose_of(self.spec.get("base"), "robot.base")
        for name in (x for x in may if x in self.standing):
            shape, pose = self.solid(name), back(base, scenes.pose_of(self.standing[name].get("pose"), name))
            need("clearance" not in self.standing[name], f"touch: '{name}' has a clearance of its own")
            root = {"name": name, "link": joints.tree.root, "touch_links": may[name]}
            attached.append({**root, "shape": shape, "pose": pose})
        return [x for name, x in self.standing.items() if name not in may], attached

    # --- what stages leave --------------------------------------------------------------------------------------------

    def advance(self, stage: Stage, rows: Rows) -> None:
        """Go to what there is after a stage."""
        if stage.kind in ("move", "line"):
            self.arm = {x: rows.last(x) for x in self.arm}
        elif stage.kind != "wait":
            if stage.fingers:
                said = self.of_fingers(stage)
                joints = Joints(said["robot"], said["start"], self.reader.joints.tree, self.reader.joints.semantics)
                moved = {x: rows.last(x) for x in joints.lead}
                moved |= {x: factor * moved[y] + add for x, (y, factor, add) in joints.rules.items()}
                self.hand |= moved
            if "object" in stage.said:
                (self.take if stage.kind == "grip" else self.let_go)(stage)

    def carrier(self, stage: Stage) -> str:
        """The link that carries an object which is gripped."""
        joints = self.joints()
        link = stage.said["link"] if "link" in stage.said else Targets(joints, False).end_effector()
        need(link in joints.at, f"grip.link: '{link}' is not known")
        return str(link)

    def fingers_on(self, stage: Stage) -> list[str]:
        """The links that may touch an object which is gripped, and hold it."""
        at, name = self.joints().at, stage.said["object"]
        return [*dict.fromkeys(x for pair in stage.touch if name in pair for x in pair if x in at)]

    def holding(self, stage: Stage) -> tuple[str, tuple[str, ...]]:
        """An object that is gripped, and the links that hold it, which must be close to it."""
        return str(stage.said["object"]), tuple(self.fingers_on(stage) or [self.carrier(stage)])

    def take(self, stage: Stage) -> None:
        """Take hold of an object as it stands."""
        joints, places, name = self.joints(), self.links(), stage.said["object"]
        shape, place = self.solid(name), self.place(name, places)
        link, touching = self.carrier(stage), self.fingers_on(stage)
        for other in touching:
            need(joints.at[other][0] == joints.at[link][0], f"grip: '{other}' does not move with '{link}'")
        del self.standing[name]
        held = {"name": name, "link": link, "shape": shape, "pose": back(places[link], place)}
        mass = {"mass": stage.said["mass"]} if "mass" in stage.said else {}
        self.held[name] = {**held, **mass, "touch_links": touching}

    def let_go(self, stage: Stage) -> None:
        """Leave a held object where it is; nobody may touch it any more."""
        name = stage.said["object"]
        need(name in self.held, f"release.object: '{name}' is not held")
        place = self.place(name, self.links())
        shape = self.held.pop(name)["shape"]
        self.standing[name] = {**self.at_first.get(name, {"name": name, "shape": shape}), "pose": place}
        for other, each in self.held.items():
            near = [x for x in listing(each.get("touch_links"), other) if x != name]
            self.held[other] = {**each, "touch_links": near}

    def solid(self, name: Any) -> Any:
        """The shape of what stands and can be touched or held."""
        need(name in self.standing, f"there is no object '{name}' that stands")
        need("shape" in self.standing[name], f"'{name}' is no object that can be touched, or held")
        return self.standing[name]["shape"]

    def place(self, name: str, places: dict[str, Pose]) -> Pose:
        """Pose of an object."""
        if name in self.standing:
            return scenes.pose_of(self.standing[name].get("pose"), name)
        held = self.held[name]
        need(held.get("link") in places, f"'{name}': its link is not known")
        return compose(places[held["link"]], scenes.pose_of(held.get("pose"), name))


def of_fingers(limits: Any) -> dict[str, Any]:
    """Limits of the arm that hold for fingers: those that are for all joints."""
    said = {x: y for x, y in limits.items() if x in ("velocity", "acceleration", "jerk")}
    kept = {x: y for x, y in said.items() if type(y) in (int, float, str)}
    need({"acceleration", "jerk"} & {*said} <= {*kept}, "limits: by joints of the arm, which do not limit fingers")
    return kept
