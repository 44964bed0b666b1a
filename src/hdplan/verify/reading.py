"""Scene, robot and motion, read from their files into a world (`docs/world.md`), by readers that share nothing with
hdplan's."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from . import scene as scenes
from .balls import HERE, Ball, Pose, compose, dot, named, need, rejecting, up
from .motion import Rows
from .robot import Tree, placed
from .semantics import Semantics, held_at, moving
from .text import Files, listing, mapping, row, values
from .world import symmetric

ROBOT = "name urdf srdf package_dirs xacro_args group base base_joints locked ignore_pairs check_pairs"
ROOM = 0.1  # [rad or m] by which held joints, a named state or a request may be beyond limits: descriptions differ
RATES = ("velocity", "acceleration", "jerk", "torque")


@dataclass(frozen=True)
class Reading:
    """What was read."""

    world: dict[str, Any]
    hashes: dict[str, str]  # of the files
    taken: tuple[str, ...]  # what the checker does not read, and took from the proof's own world


def read_world(scene: Path, motion: Path, told: Any = None) -> Reading:
    """The world of a motion; what the checker does not read by itself (clouds, xacro, MJCF, other kinds of meshes) is
    taken from the world that a proof `told`, and named. Raises RejectedError."""
    with rejecting():
        reader = Reader(scene, motion, told)
        world = reader.world() if reader.tree is not None else reader.world_of_other_robot(told)
        return Reading(world, reader.files.hashes, tuple(reader.told.taken))


class Reader:
    """One scene and one motion."""

    def __init__(self, scene: Path, motion: Path, told: Any) -> None:
        self.files, self.told = Files(), scenes.Told(told)
        self.folder = scene.absolute().parent
        self.top = scenes.read_scene(scene, self.files)
        self.spec = mapping(self.top["robot"], "robot", ROBOT)
        self.rows = Rows(motion, self.files.read("motion", motion))
        urdf, srdf = self.find_robot()
        self.urdf, data = urdf, self.files.read("urdf", urdf)
        words = self.files.read("srdf", srdf) if srdf else b"<robot/>"
        self.tree: Any = None
        if urdf.suffix.lower() in (".xacro", ".xml"):
            self.told.taken[f"the robot ({named(urdf.name)}) with what it holds, its limits, start and goal"] = None
            return
        need(not self.spec.get("xacro_args"), "robot.xacro_args: the file is no xacro")
        self.tree = Tree(urdf, data, self.base_joints())
        self.semantics = Semantics(words, self.tree.above, self.tree.links)
        self.choose_joints()
        base = scenes.pose_of(self.spec.get("base"), "robot.base")
        self.at, self.frames = placed(self.tree, base, {x: i for i, x in enumerate(self.moving)}, self.held)

    # --- the robot ---

    def base_joints(self) -> dict[str, Any] | None:
        """The joints of a mobile base, if there are any."""
        said = self.spec.get("base_joints")
        return None if said is None else mapping(said, "robot.base_joints", "kind x y yaw")

    def find_robot(self) -> tuple[Path, Path | None]:
        """URDF and SRDF, and the folders in which meshes are looked for."""
        spec = self.spec
        told = [Path(x) for x in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if x]
        named = [
            self.folder / scenes.word(x, "package_dirs") for x in listing(spec.get("package_dirs"), "package_dirs")
        ]
        if "name" in spec:
            need("urdf" not in spec, "robot: either a name or a file is expected")
            package = metadata.distribution("example-robot-data")
            some = re.search(r"^(.*/robots)/.*\.urdf,", package.read_text("RECORD") or "", re.MULTILINE)
            need(some, "robot: its library is not installed")
            library = Path(str(package.locate_file(some[1] if some else "")))
            urdf, srdf = robot_of(library, scenes.word(spec["name"], "robot.name"))
            self.folders = [*named, library.parent.parent, library, *told]
        else:
            urdf, srdf = (self.folder / scenes.word(spec.get("urdf"), "robot.urdf")).resolve(), None
            self.folders = [*named, *urdf.parents, *told]
        if "srdf" in spec:
            srdf = self.folder / scenes.word(spec["srdf"], "robot.srdf")
        return urdf, srdf

    def choose_joints(self) -> None:
        """Which joints move, lead and follow, and where the others stand."""
        tree, spec = self.tree, dict(self.spec)
        start = mapping(self.top["start"], "start", "joints state").get("joints")
        locked = {x: scenes.one(y, f"robot.locked.{x}") for x, y in (spec.get("locked") or {}).items()}
        need({*locked} <= {*tree.movable}, "robot.locked: names a joint that is none")
        spec["locked"] = locked
        planned, self.group = moving(spec, tree, self.semantics)
        if self.spec.get("base_joints") is not None:
            planned += [x for x in ("base_x", "base_y", "base_yaw") if x not in planned and x not in locked]
        rules = {x: rule for x, rule in tree.rules(tree.movable).items() if rule[0] in planned and rule[1]}
        need(not {*locked} & {*rules}, "robot.locked: holds a joint that follows one that moves")
        self.moving = [x for x in tree.movable if x in planned or x in rules]
        self.rules = rules
        self.lead = [x for x in self.moving if x not in rules]
        resting = [x for x in tree.movable if x not in self.moving]
        if isinstance(start, dict):  # values of the start hold joints that do not move
            spec["locked"] = {x: scenes.one(y, f"start: '{x}'") for x, y in start.items() if x in resting} | locked
        self.held = {x: held_at(x, spec, tree, self.semantics) for x in resting}
        for x, at in self.held.items():
            near = tree.joints[x].low - ROOM <= at <= tree.joints[x].high + ROOM
            need(near, f"joint '{x}' is held at {at:g}, more than {ROOM} beyond its limits")

    def joints(self) -> list[Any]:
        """The joints that move, as a world has them."""
        found = []
        for name in self.moving:
            joint, (parent, pose) = self.tree.joints[name], self.frames[name]
            said = scenes.frame(pose)
            said["off"] = max(said["off"], float(joint.axis.rad.max()))
            kind = "prismatic" if joint.kind == "prismatic" else "revolute"
            follows = self.rules.get(name)
            rule = None if follows is None else [self.moving.index(follows[0]), follows[1], follows[2]]
            along = {"axis": joint.axis.mid.tolist()}
            found.append({"name": name, "parent": parent, "kind": kind, **said, **along, "follows": rule})
        return found

    def place(self, link: str) -> dict[str, Any]:
        """The joint that carries a link, and its frame there."""
        joint, pose = self.at[link]
        return {"joint": joint, **scenes.frame(pose)}

    def link_bodies(self) -> list[Any]:
        """The collision geometry of all links."""
        bodies = []
        for link in sorted(self.tree.elements):
            joint, pose = self.at[link]
            for i, (own, kind, said) in enumerate(self.tree.shapes(link)):
                place = scenes.frame(compose(pose, own))
                shape = self.link_shape(link, i, kind, said)
                bodies.append({"name": link, "kind": "link", "joint": joint, **place, "shape": shape})
        return bodies

    def link_shape(self, link: str, number: int, kind: str, said: dict[str, str]) -> dict[str, Any]:
        """A shape of a link as a world has it."""
        where = f"link '{link}'"
        if kind == "mesh":
            scale = row(said.get("scale", "1 1 1"), 3, where)
            need(scale.all(), f"{where}: a mesh of scale 0")
            path = self.mesh_file(said.get("filename", ""), where)
            body = (link, number, f"link {named(link)}")
            return scenes.mesh_of(path, scale, self.files, self.told, body, upright=False)
        sizes: dict[str, Any] = {x: float(row(y, 1, where)[0]) for x, y in said.items() if x in ("radius", "length")}
        sizes |= {x: row(y, 3, where).tolist() for x, y in said.items() if x in ("size", "radii")}
        need(np.hstack([*sizes.values(), 1]).min() > 0, f"{where}: a size is not above 0")
        return {"type": kind, **sizes}

    def mesh_file(self, address: str, where: str) -> Path:
        """The file of a mesh; where it is looked for does not matter to what is proven, as the two worlds are
        compared."""
        scheme, told, rest = address.partition("://")
        packaged = bool(told) and scheme in ("package", "model")
        name = rest.lstrip("/") if packaged else rest or scheme
        inner, beside = name.partition("/")[2], (self.urdf.parent / name, self.folder / name)
        places = [x / y for x in self.folders for y in (name, inner)] if packaged else beside
        found = next((x for x in places if x.is_file()), None)
        need(found, f"{where}: mesh '{name}' is not found")
        return Path(found or "")

    # --- the world ---

    def world(self) -> dict[str, Any]:
        """The whole of it."""
        top, files, folder = self.top, self.files, self.folder
        joints = self.joints()
        links, held = self.link_bodies(), []
        self.touching = dict[frozenset[str], None]()
        for i, entry in enumerate(listing(top.get("attached"), "attached")):
            what = f"attached[{i}]"
            said = mapping(entry, what, "name link shape pose touch_links mass")
            name, link = scenes.word(said.get("name", f"attached{i}"), what), scenes.word(said.get("link"), what)
            need(link in self.at and name not in self.at, f"{what}: its link is not known, or its name is taken")
            joint, pose = self.at[link]
            pose = compose(pose, scenes.pose_of(said.get("pose"), what))
            shape = scenes.shape_of(said.get("shape"), name, folder, files, self.told)
            held.append({"name": name, "kind": "held", "joint": joint, **scenes.frame(pose), "shape": shape})
            self.touching |= {frozenset((name, str(x))): None for x in listing(said.get("touch_links"), what)}
        around, motions, own = scenes.obstacles(top, folder, files, self.told)
        names = [x["name"] for x in [*held, *around]]
        for each in names:
            need(names.count(each) == 1, f"'{each}': the name is taken")
        limits, off = self.limits(), top.get("self_collision", True) is False
        return {
            "hdplan_world": 2,
            "joints": joints,
            "held": self.held,
            "links": {link: self.place(link) for link in self.tree.links},
            "bodies": [*links, *held, *around],
            "motions": motions,
            "not_compared": self.not_compared([*links, *held], off),
            "motion": self.rows.of(joints, self.held),
            "limits": limits,
            **({"loads": self.loads()} if "torque" in limits else {}),
            "path": scenes.path_of(top),
            "start": [self.target(top["start"], "start")],
            "goal": self.goals(),
            **self.wanted(own),
        }

    def wanted(self, own: dict[str, Any]) -> dict[str, Any]:
        """What the scene wants that needs no robot."""
        timing, planner = self.top.get("timing", {}), self.top.get("planner", {})
        usual = scenes.one(planner.get("clearance", 0.0), "planner.clearance")
        self_collision = self.top.get("self_collision", True)
        among = mapping(self_collision, "self_collision", "clearance") if type(self_collision) is not bool else {}
        least = {"obstacles": usual, "own": own, "self": scenes.one(among.get("clearance", 0.0), "self_collision")}
        duration = scenes.one(timing["duration"], "timing.duration") if "duration" in timing else None
        slower = scenes.one(timing.get("scale", 1.0), "timing.scale") != 1
        also = ["planner.objective"] * ("objective" in planner) + ["timing.scale"] * slower
        return {"clearances": least, "duration": duration, "also": also}

    def world_of_other_robot(self, told: Any) -> dict[str, Any]:
        """The world with a robot that the checker does not read, as the proof has it, with all that is about its joints
        and links; motion, obstacles and what is wanted of them are the scene's."""
        need(type(told) is dict, "robot: cannot be read by the checker, and there is no proof that has it")
        around, motions, own = scenes.obstacles(self.top, self.folder, self.files, self.told)
        robot = [x for x in told["bodies"] if x["kind"] != "obstacle"]
        return {
            **told,
            "bodies": [*robot, *around],
            "motions": motions,
            "motion": self.rows.of(told["joints"], told["held"]),
            "path": scenes.path_of(self.top),
            **self.wanted(own),
        }

    def not_compared(self, bodies: list[Any], off: bool) -> list[Any]:
        """Every pair of links and held objects that need not be kept apart, with its reason."""
        kinds = {x["name"]: (x["kind"], x["joint"]) for x in bodies}
        said = {key: self.named_pairs(key) for key in ("ignore_pairs", "check_pairs")}
        found, listed = [], sorted(kinds)
        for i, one in enumerate(listed):
            for two in listed[i + 1 :]:
                (kind, a), (other, b), pair = kinds[one], kinds[two], frozenset((one, two))
                reason = self.excuse(pair, (one, two), a, b, (kind, other), said, off)
                found += [[one, two, reason]] * bool(reason)
        return found

    def named_pairs(self, key: str) -> set[frozenset[str]]:
        """The pairs of links that the robot section names."""
        pairs = [[scenes.word(y, key) for y in listing(x, key)] for x in listing(self.spec.get(key), key)]
        need(
            all(len({*x}) == 2 == len(x) and {*x} <= {*self.tree.links} for x in pairs), f"robot.{key}: pairs of links"
        )
        return {frozenset(x) for x in pairs}

    def excuse(
        self,
        pair: frozenset[str],
        ends: tuple[str, str],
        a: int,
        b: int,
        kinds: tuple[str, str],
        said: dict[str, set[frozenset[str]]],
        off: bool,
    ) -> str | None:
        """Why two links, or held objects, need not be kept apart; None if they must be."""
        if off or a == b:
            return "self_collision: false" if off else "moving as one"
        if kinds == ("link", "link") and pair not in said["check_pairs"]:
            if pair in said["ignore_pairs"]:
                return "robot.ignore_pairs"
            if pair in self.semantics.disabled:
                return "the SRDF"
            parents = [self.frames[self.moving[x]][0] if x >= 0 else None for x in (a, b)]
            if (parents[0] == b or parents[1] == a) and not self.tree.between(*ends) & self.tree.solid:
                return "neighbours"
        return "touch_links" if pair in self.touching else None

    def limits(self) -> dict[str, Any]:
        """Ranges of all joints that move, and what else the scene limits, one entry for each of them."""
        said = mapping(self.top.get("limits") or {}, "limits", f"position {' '.join(RATES)}")
        ranges = said.pop("position", {})
        need(isinstance(ranges, dict) and {*ranges} <= {*self.lead}, "limits.position: of a joint that does not lead")
        spans, ends = [], self.beyond()
        for name in self.moving:
            joint = self.tree.joints[name]
            low, high = joint.low, joint.high
            if name in ranges:
                least, most = values(ranges[name], 2, f"limits.position.{name}").tolist()
                low, high = max(low, least), min(high, most)
            for x in ends.get(name, []):
                low, high = (x if 0 < low - x <= ROOM else low), (x if 0 < x - high <= ROOM else high)
            spans.append([None if abs(x) == np.inf else float(x) for x in (low, high)])
        timed = bool(said) or "timing" in self.top
        found: dict[str, Any] = {"position": spans}
        for name in RATES:
            if (asked := said.get(name, "urdf" if name == "velocity" and timed else None)) is not None:
                found[name] = [self.limit(name, asked, x) for x in self.moving]
        return found

    def beyond(self) -> dict[str, list[float]]:
        """Values of a named state, or of a request, which may lie a little beyond the limits of joints that nothing
        follows."""
        ends = [self.top[x] for x in ("start", "goal")]
        ends = [x for x in ends if "state" in x or self.top.get("from_request")]
        found = dict[str, list[float]]()
        for each in ends:
            said = {x: each[x] for x in ("joints", "state") if x in each}
            if not said or any(
                isinstance(x, (list, dict)) for x in said.get("joints", []) if isinstance(said.get("joints"), list)
            ):
                continue
            for name, x in zip(self.lead, self.target(said, "an end")["joints"], strict=True):
                if name not in [rule[0] for rule in self.rules.values()]:
                    found.setdefault(name, []).append(x)
        return found

    def limit(self, name: str, asked: Any, joint: str) -> float | None:
        """The limit of a rate or torque of one joint; what follows is within one number for all, or the URDF's."""
        where, each = f"limits.{name}", self.tree.joints[joint]
        own = {"velocity": each.velocity, "torque": each.effort}.get(name)
        if type(asked) in (int, float):
            return scenes.one(asked, where)
        if joint in self.rules:
            return own if name == "velocity" and own else None
        if isinstance(asked, list):
            return float(values(asked, len(self.lead), where)[self.lead.index(joint)])
        if isinstance(asked, dict):
            need({*asked} <= {*self.lead} or self.top.get("from_request"), f"{where}: of a joint that does not lead")
            if joint in asked:
                return scenes.one(asked[joint], where)
        need(isinstance(asked, dict) or asked == "urdf", f"{where}: '{asked}'")
        need(own and own > 0, f"{where}: nothing limits '{joint}'")
        return own

    def loads(self) -> list[Any]:
        """What each moving joint carries up to the next: mass, mass times centre, inertia about the joint's origin."""
        found = [[Ball(0.0), Ball(np.zeros(3)), Ball(np.zeros((3, 3)))] for _ in self.moving]

        def carry(link: str, mass: float, at: Pose, about: Any) -> None:
            joint, pose = self.at[link]
            if joint < 0:
                return
            turn, centre = compose(pose, at)
            moment, square = centre * mass, dot("i,i->", centre, centre)
            inert = dot("ij,kj->ik", dot("ij,jk->ik", turn, about), turn)
            inert = inert + (np.eye(3) * square - centre[:, None] * centre) * mass
            own = found[joint]
            found[joint] = [x + y for x, y in zip(own, (Ball(mass), moment, inert), strict=True)]

        for link, mass, at, about in self.tree.masses():
            carry(link, mass, at, Ball(about))
        if (load := self.top.get("payload")) is not None:
            said = mapping(load, "payload", "link mass com inertia")
            mass, com = scenes.one(said.get("mass"), "payload"), values(said.get("com", [0.0] * 3), 3, "payload.com")
            need(mass >= 0, "payload: a mass below 0")
            six = values(said.get("inertia", [0.0] * 6), 6, "payload.inertia")
            about = symmetric(six)
            need(said.get("link") in self.at, "payload: its link is not known")
            carry(said["link"], mass, (HERE[0], Ball(com)), Ball(about))
        for i, entry in enumerate(listing(self.top.get("attached"), "attached")):
            if (weight := entry.get("mass")) is not None:
                mass, shape = scenes.one(weight, f"attached[{i}].mass"), entry["shape"]
                need(mass >= 0, f"attached[{i}]: a mass below 0")
                at = scenes.pose_of(entry.get("pose"), f"attached[{i}]")
                carry(entry["link"], mass, at, solid_inertia(shape, mass, f"attached[{i}]"))
        return [
            {
                "mass": float(mass.mid),
                "moment": first.mid.tolist(),
                "inertia": inert.mid[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]].tolist(),
                "off": float(max(np.max(x.rad) for x in (mass, first, inert))),
            }
            for mass, first, inert in found
        ]

    # --- start and goal ---

    def target(self, value: Any, end: str) -> dict[str, Any]:
        """A configuration as a world has it."""
        said = mapping(value, end, "joints state")
        need(len(said) == 1, f"{end}: joints or a state")
        if "state" in said:
            states = self.semantics.states(self.group)
            need(said["state"] in states, f"{end}: no state '{said['state']}'")
            named: Any = {x: y for x, y in states[said["state"]].items() if x in self.tree.movable}
        else:
            named = said["joints"]
        if isinstance(named, list):
            return {"joints": values(named, len(self.lead), end).tolist(), "others": {}}
        given = {x: scenes.one(y, f"{end}: '{x}'") for x, y in named.items()}
        need({*given} <= {*self.tree.movable} or self.top.get("from_request"), f"{end}: names a joint that is none")
        need({*self.lead} <= {*given}, f"{end}: names not every joint that moves")
        told = self.spec.get("locked") or {} if "state" in said else {}  # which says where they stand
        others = {x: y for x, y in given.items() if (x in self.held or x in self.rules) and x not in told}
        return {"joints": [given[x] for x in self.lead], "others": dict(sorted(others.items()))}

    def goals(self) -> list[Any]:
        """The goal's targets, one of which is to be met."""
        said = mapping(self.top["goal"], "goal", "joints state pose poses all any")
        need(len(said) == 1, "goal: one of joints, state, pose, poses, all, any")
        if "pose" in said:
            return [{"poses": [self.pose(said["pose"])]}]
        if "poses" in said:
            return [{"poses": [self.pose(x)]} for x in listing(said["poses"], "goal.poses")]
        if "all" in said:
            each = [mapping(x, "goal.all", "pose").get("pose") for x in listing(said["all"], "goal.all")]
            return [{"poses": [self.pose(x) for x in each]}]
        if "any" in said:
            return [
                {"poses": [self.pose(x["pose"])]} if "pose" in mapping(x, "goal.any", "joints state pose")
                else self.target(x, "goal")
                for x in listing(said["any"], "goal.any")
            ]  # fmt: skip
        values_ = said.get("joints")
        if isinstance(values_, list) and any(isinstance(x, (list, dict)) for x in values_):
            return [self.target({"joints": x}, "goal") for x in values_]
        return [self.target(said, "goal")]

    def pose(self, value: Any) -> dict[str, Any]:
        """A goal pose."""
        said = scenes.pose_goal(value, "goal", self.end_effector)
        need(said["link"] in self.at, f"goal: no link '{said['link']}'")
        return said

    def end_effector(self) -> str:
        """The link that a goal is about where it names none: the one of all that every leading joint moves that carries
        the SRDF's end effector, or else the last one of the group's chain, or of the joints that move."""
        tree, lead = self.tree, {*self.lead}
        moved = {
            x: {self.rules[y][0] if y in self.rules else y for y in tree.way(x) if y in self.moving}
            for x in self.moving
        }
        last = [x for x in self.moving if moved[x] == lead]
        carrier = {link: self.moving[at[0]] if at[0] >= 0 else None for link, at in self.at.items()}
        hands = sorted({link for link in self.semantics.hands if carrier.get(link) in last})
        if last and not hands:
            whole = [{*own} for own in self.semantics.groups.values() if lead <= {*own} and not {*own} & {*self.held}]
            behind = [x for x in tree.order if carrier[tree.joints[x].child] == last[0]]
            fixed = [x for x in behind if tree.joints[x].kind == "fixed" and whole and x in whole[0]]
            hands = [tree.joints[fixed[-1] if fixed else last[0]].child]
        need(len(hands) == 1, "goal: names no link, and the robot has no one end effector")
        return str(hands[0])


def solid_inertia(shape: dict[str, Any], mass: float, what: str) -> Ball:
    """The inertia about its centre of a solid of even density: m / 12 (b^2 + c^2) of a box' edges, m / 5 (b^2 + c^2) of
    an ellipsoid's semi-axes; of a cylinder m r^2 / 2 about its axis and m (3 r^2 + l^2) / 12."""
    kind, r = shape.get("type"), shape.get("radius", 0.0)
    three = np.array(shape.get("size", shape.get("radii", [r, r, r])), dtype=np.float64)
    squares = three * three
    need(kind in ("box", "sphere", "ellipsoid", "cylinder"), f"{what}: the inertia of a {kind} cannot be checked")
    if kind == "cylinder":
        diagonal = mass / 12 * np.array([3 * r * r + shape["length"] ** 2] * 2 + [6 * r * r])
    else:
        diagonal = mass / (12 if kind == "box" else 5) * (squares.sum() - squares)
    return Ball(np.diag(diagonal), np.diag(up(2.0**-48 * (diagonal + mass * squares.sum()))))


def robot_of(library: Path, name: str) -> tuple[Path, Path | None]:
    """URDF and SRDF of a robot of example-robot-data, of which a proof must not choose the one it likes. Its name is
    its file's, without `_robot`, or its folder's, without `_description`, where several folders have such a file; of
    two such files in a folder it is the larger one. Its SRDF is that of its name, or of the longest beginning of it.
    Any file goes by FOLDER/FILE, without SRDF."""
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
