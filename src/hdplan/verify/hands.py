"""The state in which a stage of a job begins: the arm and the fingers, what is held and what stands.

What is taken is held as it stood then; what is let go stands where it was let go, or goes to the hand that holds it
too. Of two hands the first carries it until then, and neither may move meanwhile.
"""

from __future__ import annotations

from typing import Any

from . import scene as scenes
from .balls import Ball, Pose, compose, dot, need
from .joints import Joints
from .motion import SAME_VALUE
from .other_robot import OtherRobot
from .reading import Reader
from .robot import placed, upward
from .sizes import AROUND
from .stages import Stage
from .targets import Targets
from .text import listing, mapping

ROUNDED = 1e-11  # that joints which follow, rounded, may move what they carry; of at most LARGEST
LARGEST = 100.0


def widened(pose: Pose) -> Pose:
    """A pose, with the rounding of joints that follow."""
    turn, at = pose
    return Ball(turn.mid, turn.rad + ROUNDED), Ball(at.mid, at.rad + ROUNDED)


def back(pose: Pose, other: Pose) -> Pose:
    """A pose of the world in the frame of another one."""
    return dot("ji,jk->ik", pose[0], other[0]), dot("ji,j->i", pose[0], other[1] - pose[1])


class Hands:
    """Arm, fingers, held and standing objects."""

    def __init__(self, reader: Reader) -> None:
        """Take what there is at first."""
        top, joints = reader.top, reader.joints
        need(not isinstance(joints, OtherRobot), "job: can be checked with a robot in URDF alone")
        refused = {*top} & {"path", "from_request"}
        refused |= {"timing.duration"} & {f"timing.{x}" for x in top.get("timing", {})}
        refused |= {f"robot.{x}" for x in ("calibration", "tracking") if joints.spec.get(x) is not None}
        refused |= {"self_collision"} if top.get("self_collision") is False else set()
        need(not refused, f"{', '.join(sorted(refused))}: with a job")
        self.reader, self.spec = reader, joints.spec
        start = Targets(joints, False).target(top["start"], "start")
        need("velocity" not in start, "start.velocity: with a job, whose stages begin at rest")
        self.arm = dict(zip(joints.lead, start["joints"], strict=True))
        given = top["start"].get("joints")
        self.hand = {x: joints.held[x] for x in (given if isinstance(given, dict) else ()) if x in joints.held}
        for name, value in start["others"].items():
            here = self.everywhere(joints)[name]
            need(abs(here - value) <= SAME_VALUE, f"start: '{name}' stands at {here:g}")
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

    @property
    def things(self) -> dict[str, dict[str, Any]]:
        """Standing and held objects."""
        return {**self.standing, **self.held}

    @property
    def bare(self) -> dict[str, Any]:
        """The robot's section where the arm moves: the fingers stand as they are."""
        return {**self.spec, "locked": {**(self.spec.get("locked") or {}), **self.hand}}

    @property
    def arm_at(self) -> dict[str, Any]:
        """The arm's values, as a start or goal, and its rates, where it does not rest."""
        return {"joints": [*self.arm.values()], **self.rates}

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
        joints, values = self.joints(), mapping(stage.content["joints"], "joints", " ".join(stage.content["joints"]))
        tree = joints.tree
        leaders = {x: y.mimic[0] for x, y in tree.joints.items() if y.mimic}
        leaders |= {x: rule[0] for x, rule in tree.rules(tree.movable).items()}
        for joint in values:
            need(joint in joints.held, f"joints: '{joint}' is not a joint of the fingers")
            need(leaders.get(joint, joint) in values, f"joints: '{joint}' follows '{leaders.get(joint)}'")
        group = [x for x in values if x not in leaders]
        fixed = {**(self.spec.get("locked") or {}), **self.hand, **self.arm}
        locked = {x: at for x, at in fixed.items() if leaders.get(x, x) not in group}
        start = {"joints": {x: joints.held[x] for x in group}}
        robot = {**self.spec, "group": group, "locked": locked}
        return {"robot": robot, "start": start, "goal": {"joints": values}}

    def touching(self, stage: Stage) -> tuple[list[Any], list[Any]]:
        """Obstacles and held objects in a stage: an obstacle that something may touch is held by a link that stands
        fast, so that the bodies that touch it can be named."""
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

    def carrier(self, stage: Stage) -> str:
        """The link that carries an object which is gripped."""
        joints = self.joints()
        link = stage.content["link"] if "link" in stage.content else self.targets.end_effector()
        need(link in joints.at, f"grip.link: '{link}' is not known")
        return str(link)

    def fingers_on(self, stage: Stage) -> list[str]:
        """The links that may touch an object which is gripped, and hold it."""
        at, name = self.joints().at, stage.content["object"]
        return [*dict.fromkeys(x for pair in stage.touch if name in pair for x in pair if x in at)]

    def holding(self, stage: Stage) -> tuple[str, tuple[str, ...]]:
        """An object that is gripped, and the links that hold it, which must be close to it."""
        return str(stage.content["object"]), tuple(self.fingers_on(stage) or [self.carrier(stage)])

    def take(self, stage: Stage) -> None:
        """Take hold of an object as it stands, or as another hand holds it."""
        joints, places, name = self.joints(), self.links(), stage.content["object"]
        first, place = self.held.get(name), self.place(name)
        shape = first["shape"] if first else self.solid(name)
        link, touching = self.carrier(stage), self.fingers_on(stage)
        for other in touching:
            need(joints.at[other][0] == joints.at[link][0], f"grip: '{other}' does not move with '{link}'")
        held = {"name": name, "link": link, "shape": shape, "pose": back(places[link], place)}
        masses = [x["mass"] for x in (stage.content, first or {}) if "mass" in x]
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
        name = stage.content["object"]
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
        need("shape" in self.standing[name], f"'{name}' is not an object that can be touched or held")
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
