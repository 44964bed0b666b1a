"""A job: for every stage the world that follows from the scene, the motion and its marks, and from nothing else.

A stage begins with what the stages before it left: the arm and the fingers at the motion's own row, what was taken held
as it stood then, what was let go standing where it was. So nobody can tell the checker another world than this one: a
proof has directions for its pairs alone. Where fingers move there are two worlds, one of the fingers and one of the arm
that stands still meanwhile, as a world compares nothing that does not move with its joints.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import scene as scenes
from .balls import Ball, Pose, RejectedError, compose, dot, named, need, rejecting
from .job_curves import Corner, check_radius, corner_after, following, settled
from .joints import Joints
from .motion import SAME, Rows
from .other_robot import OtherRobot
from .reading import Reader, Reading
from .robot import placed, upward
from .sizes import AROUND
from .stages import ARM, Stage, stages_of
from .targets import Targets
from .text import listing, mapping

SAME_TIME = 1e-6  # [s] by which a wait may be shorter
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
    drawn: bool  # along a curve, which is the checker's own: the proof's may have other chords


def read_job(scene: Path, motion: Path, told: list[Any], robot: str | None = None) -> list[Part]:
    """The worlds of a job, in order, of which a proof `told` as many. Raises RejectedError, which names the stage."""
    with rejecting():
        reader = Reader(scene, motion, told[0] if told else None, None, robot)
        stages = stages_of(reader.top)
        count = sum(1 + stage.fingers for stage in stages)
        need(len(told) == count, f"the job has {count} worlds to be proven free, the proof has {len(told)}")
        return [*Job(reader, stages).parts()]


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
        said |= {f"robot.{x}" for x in ("calibration", "tracking") if joints.spec.get(x) is not None}
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
                unsure = mapping(entry.get("uncertainty") or {}, name, " ".join(AROUND.values()))
                need(not unsure.get("speed"), f"obstacle '{name}': uncertainty.speed: with a job")
                into[name] = {**entry, "name": name}
        reader.around()  # of what was seen, balls are left out where the job begins
        self.at_first = dict(self.standing)
        self.taken = dict[str, dict[str, Any]]()  # what two hands hold, as the second one has it
        self.rates = dict[str, list[float]]()  # of the arm, where it does not rest
        self.corner: Corner | None = None  # of the stage before, if that is blended into this one
        self.marks = self.marks_of(rows)

    @property
    def things(self) -> dict[str, dict[str, Any]]:
        """Standing and held objects."""
        return {**self.standing, **self.held}

    def marks_of(self, rows: Rows) -> list[int]:
        """The rows at which the stages begin, and the last row."""
        marks = [mapping(x, "stages", "name row outputs") for x in listing(rows.stages, f"{rows.path}: stages")]
        for i, stage in enumerate(self.stages):
            there = marks[i].get("name") if i < len(marks) else None
            need(there == stage.name, f"the motion's stage {i} is {there!r}, the job's is '{stage.name}'")
            sets = stage.said if stage.kind == "set" else {}
            same = json.dumps(marks[i].get("outputs", {}), sort_keys=True) == json.dumps(sets, sort_keys=True)
            need(same, f"stage '{stage.name}': the motion sets other outputs than the job")
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
                if self.corner is not None and stage.curve:
                    self.corner = settled(self, self.corner, rows)
                found = [*self.worlds(number, rows)]
                self.advance(number, rows)
            yield from found

    # --- worlds -------------------------------------------------------------------------------------------------------

    def worlds(self, number: int, rows: Rows) -> Iterator[Part]:
        """The worlds of a stage."""
        stage, top, still = self.stages[number], self.reader.top, self.arm_at
        limits = stage.beside.get("limits", top.get("limits", {}))
        if stage.fingers:
            mine = stage.beside["limits"] if "limits" in stage.beside else of_fingers(limits)
            moved = self.of_fingers(stage)
            self.check_both(moved)
            yield self.part(stage, rows, limits=mine, **moved)
            only = {key: x for key, x in top.get("limits", {}).items() if key == "position"}
            rested = rows.still([*self.arm], [*self.arm.values()])
            yield self.part(stage, rested, limits=only, robot=self.bare, start=still, goal=still, arm=True)
            return
        for name, other in self.taken.items():
            words = f"'{name}' is held by '{self.held[name]['link']}' and '{other['link']}'"
            need(stage.kind not in ARM, f"{words}: one has to let go before an arm moves")
        if stage.kind not in ARM:
            need(not rows.moves(), "the robot moves where it is to stand still")
        if stage.kind == "wait":
            asked = scenes.one(stage.said, "wait")
            need(rows.times[-1] - rows.times[0] >= asked - SAME_TIME, f"waits for less than {asked:g} s")
        aim: dict[str, Any] = {"goal": still}
        if stage.kind == "move":
            rates = {"velocity", "acceleration"} & {*stage.said}
            need(not rates, "move.velocity: with a job, whose stages end at rest")
            aim = {"goal": stage.said, "path": stage.beside.get("path", {})}
        elif stage.curve:
            aim = following(self, number)
        if stage.blend:
            passed = {x: rows.last(x) for x in self.arm}
            if stage.kind == "move":
                check_radius(self, number, passed)
            aim["goal"] = {"joints": [*passed.values()], **self.passing(rows)}
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
        into = f"; goes over into the next within {stage.blend:g} m" if stage.blend else ""
        about = f"holds {', '.join(map(named, self.held)) or 'nothing'}; may touch, beside what it holds: {touch}{into}"
        name = f"stage {named(stage.name)}{', the arm that stands still' * arm}"
        read = Reading(world, reader.files.hashes, tuple(reader.told.taken), reader.passed(world))
        holding = None if arm or stage.kind != "grip" or "object" not in stage.said else self.holding(stage)
        return Part(name, about, read, arm, holding, stage.curve)

    @property
    def bare(self) -> dict[str, Any]:
        """The robot's section where the arm moves: the fingers stand as they are."""
        return {**self.spec, "locked": {**(self.spec.get("locked") or {}), **self.hand}}

    @property
    def arm_at(self) -> dict[str, Any]:
        """The arm's values, as a start or goal, and its rates, where it does not rest."""
        return {"joints": [*self.arm.values()], **self.rates}

    def passing(self, rows: Rows) -> dict[str, list[float]]:
        """The arm's rates at the last row, by as many as the motion has."""
        need(len(rows.given) > 1, "is to go over into the next stage, and the motion has no velocities")
        columns = [rows.names.index(x) for x in self.arm]
        found = (rows.given[1:][k][-1, columns].tolist() for k in range(len(rows.given) - 1))
        return dict(zip(("velocity", "acceleration"), found, strict=False))

    def joints(self) -> Joints:
        """The joints where the arm moves."""
        return Joints(self.bare, self.arm_at, self.reader.joints.tree, self.reader.joints.semantics)

    def everywhere(self, joints: Joints, arm: dict[str, float] | None = None) -> dict[str, float]:
        """The values of all joints, of the arm's as it is or as given."""
        found = joints.everywhere(arm or self.arm)
        for name in joints.rules:
            need(abs(found[name]) <= LARGEST, f"joint '{name}': follows to beyond {LARGEST:g}")
        return found

    def links(self, arm: dict[str, float] | None = None) -> dict[str, Pose]:
        """Placements of all links, with the arm as it is or as given."""
        joints = self.joints()
        base = scenes.pose_of(self.spec.get("base"), "robot.base")
        at, _ = placed(joints.tree, base, {}, self.everywhere(joints, arm))
        above = joints.tree.above
        follow = {link: any(x in joints.rules for x, _ in upward(above, link)) for link in at}
        return {link: widened(pose) if follow[link] else pose for link, (_, pose) in at.items()}

    def frames(self, arm: dict[str, float] | None = None) -> dict[str, Pose]:
        """Placements of all links and held objects, with the arm as it is or as given."""
        places = self.links(arm)
        return places | {name: self.held_at(name, places) for name in self.held}

    def moves(self, link: str) -> bool:
        """True for a link, or a held object, that the arm moves."""
        at, carrier = self.joints().at, self.held[link].get("link") if link in self.held else link
        return carrier in at and at[carrier][0] >= 0

    @property
    def targets(self) -> Targets:
        """The reader of the targets of moves."""
        return Targets(self.joints(), False, [name for name in self.held if self.moves(name)])

    def check_both(self, moved: dict[str, Any]) -> None:
        """Reject fingers that move a link of two that hold one object: it would go with that one, and not with the
        other."""
        joints = Joints(moved["robot"], moved["start"], self.reader.joints.tree, self.reader.joints.semantics)
        for name, other in self.taken.items():
            for link in (self.held[name]["link"], other["link"]):
                need(joints.at[link][0] < 0, f"'{name}' is held by two hands, and '{link}' moves with the fingers")

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

    def advance(self, number: int, rows: Rows) -> None:
        """Go to what there is after a stage."""
        stage = self.stages[number]
        if stage.kind in ARM:
            self.corner = corner_after(self, number) if stage.blend else None
            self.rates = self.passing(rows) if stage.blend else {}
            self.arm = {x: rows.last(x) for x in self.arm}
        elif stage.kind in ("grip", "release"):
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
        link = stage.said["link"] if "link" in stage.said else self.targets.end_effector()
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
        """Take hold of an object as it stands, or as another hand holds it."""
        joints, places, name = self.joints(), self.links(), stage.said["object"]
        first, place = self.held.get(name), self.place(name)
        shape = first["shape"] if first else self.solid(name)
        link, touching = self.carrier(stage), self.fingers_on(stage)
        for other in touching:
            need(joints.at[other][0] == joints.at[link][0], f"grip: '{other}' does not move with '{link}'")
        held = {"name": name, "link": link, "shape": shape, "pose": back(places[link], place)}
        masses = [x["mass"] for x in (stage.said, first or {}) if "mass" in x]
        held |= {"touch_links": touching, **({"mass": masses[0]} if masses else {})}
        if first is None:
            del self.standing[name]
            self.held[name] = held
            return
        need(name not in self.taken, f"grip.object: '{name}' is held by two hands already")
        apart = joints.at[first["link"]][0] != joints.at[link][0]
        need(apart, f"grip.object: '{name}' is held by '{first['link']}', which moves with '{link}'")
        near = listing(first.get("touch_links"), name)
        self.held[name], self.taken[name] = {**first, "touch_links": [*dict.fromkeys([*near, *touching])]}, held

    def let_go(self, stage: Stage) -> None:
        """Leave a held object where it is: to the hand that holds it too, or standing there, where nobody may touch it
        any more."""
        name = stage.said["object"]
        need(name in self.held, f"release.object: '{name}' is not held")
        if name in self.taken:
            self.held[name] = self.taken.pop(name)
            return
        place = self.place(name)
        shape = self.held.pop(name)["shape"]
        self.standing[name] = {**self.at_first.get(name, {"name": name, "shape": shape}), "pose": place}
        for other, each in self.held.items():
            near = [x for x in listing(each.get("touch_links"), other) if x != name]
            self.held[other] = {**each, "touch_links": near}

    def solid(self, name: Any) -> Any:
        """The shape of what stands and can be touched or held."""
        need(name in self.standing, f"there is no object '{name}' that stands")
        need("shape" in self.standing[name], f"'{name}' is no object that can be touched, or held")
        known = not any((self.standing[name].get("uncertainty") or {}).values())
        need(known, f"'{name}': has an uncertainty, and is held or touched: its place must be known")
        return self.standing[name]["shape"]

    def place(self, name: str) -> Pose:
        """Pose of an object."""
        if name in self.standing:
            return scenes.pose_of(self.standing[name].get("pose"), name)
        return self.held_at(name, self.links())

    def held_at(self, name: str, places: dict[str, Pose]) -> Pose:
        """Pose of a held object, by those of the links."""
        held = self.held[name]
        need(held.get("link") in places, f"'{name}': its link is not known")
        return compose(places[held["link"]], scenes.pose_of(held.get("pose"), name))


def of_fingers(limits: Any) -> dict[str, Any]:
    """Limits of the arm that hold for fingers: those that are for all joints."""
    said = {x: y for x, y in limits.items() if x in ("velocity", "acceleration", "jerk")}
    kept = {x: y for x, y in said.items() if type(y) in (int, float, str)}
    need({"acceleration", "jerk"} & {*said} <= {*kept}, "limits: by joints of the arm, which do not limit fingers")
    return kept
