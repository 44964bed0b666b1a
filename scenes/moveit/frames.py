"""The frames in which a MoveIt scene and request may give poses: the world, and every frame fixed in it.

These are the robot's root link, the links fixed to it, and the frames that `fixed_frame_transforms` attach to them.
MoveIt seeks a frame among the links first, then among the objects, and last among `fixed_frame_transforms`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from hdplan.scenes.errors import nearest
from hdplan.scenes.fields import Field
from hdplan.scenes.moveit.fields import MESSAGES
from hdplan.scenes.moveit.messages import read_transform
from hdplan.scenes.poses import Pose, compose
from hdplan.scenes.robot_files.description import Tree

WORLD = ("", "world")
SAME_POSE = 1e-9  # largest entry by which two poses of one frame may differ
VARIABLE = re.compile(r"/(x|y|theta|trans_[xyz]|rot_[xyzw])$")  # MoveIt's names of a floating or planar joint's values


@dataclass(frozen=True)
class Frames:
    """Poses of frames in the world."""

    poses: Mapping[str, Pose]  # name -> pose
    moving: frozenset[str]  # links that joints may move
    links: frozenset[str]  # all of them
    joints: frozenset[str]
    objects: frozenset[str] = frozenset()  # that stand around or are held

    @classmethod
    def of(cls, tree: Tree, base: Pose) -> Frames:
        """Return the world, and the fixed links of a robot whose root is at `base`."""
        standing = {link: compose(base, pose) for link, pose in tree.standing().items()}
        links = frozenset(tree.links)
        poses = {**dict.fromkeys(WORLD, Pose()), **standing}
        if not same_place(poses["world"], Pose()) or "world" in links - set(standing):
            del poses["world"]  # a link of this name is elsewhere
        return cls(poses, links - set(standing), links, frozenset(tree.joints))

    def beside(self, objects: Iterable[str]) -> Frames:
        """Return these frames among objects of these names, too."""
        return replace(self, objects=self.objects.union(objects))

    def with_transforms(self, transforms: Iterable[Field]) -> Frames:
        """Add the frames that a scene defines. Raises InputError for one that has another pose already."""
        poses = dict(self.poses)
        for entry in transforms:
            keys = entry.mapping(MESSAGES["TransformStamped"])
            pose = compose(
                replace(self, poses=poses).of_header(keys.get("header")), read_transform(keys.get("transform"))
            )
            child = keys.get("child_frame_id")
            name = "" if child is None or child.value == "" else _plain(child.text())
            if child is not None and name in self.moving:
                raise child.error(f"is not a fixed frame: the link {name!r} moves with the robot")
            if name in poses and not same_place(poses[name], pose):
                raise (keys.get("transform") or entry).error(
                    f"moves a fixed frame: {name!r} has another pose already (the robot's root is at `base` of the "
                    "robot section, --robot FILE)"
                )
            poses.setdefault(name, pose)
        return replace(self, poses=poses)

    def of_header(self, header: Field | None) -> Pose:
        """Return the pose of the frame that a header names; without one, of the world.

        Raises InputError for a frame that moves, is unknown, or has the name of an object or of a frame of it.
        """
        frame = header.mapping(MESSAGES["Header"]).get("frame_id") if header else None
        if frame is None:
            return Pose()
        name = _plain(frame.value)
        if name in self.poses:
            if name not in self.links and any(f"{name}/".startswith(f"{each}/") for each in self.objects):
                raise frame.error(f"is {name!r}, the name of an object, too, whose frame MoveIt takes: rename either")
            return self.poses[name]
        if name in self.moving:
            raise frame.error(f"the link {name!r} moves with the robot; give poses in the world frame, '' or 'world'")
        raise frame.error(f"unknown frame {name!r}{nearest(name, filter(None, self.poses))}")

    def check_base(self, name: str, value: float, field: Field) -> None:
        """Raise InputError for the value of a joint that would move the robot's base."""
        if name not in self.joints and VARIABLE.search(name) and value != float(name.endswith("w")):
            raise field.error(
                f"{name!r} at {value:g} moves the robot's base, which is not supported: place the robot with `base` in "
                "the robot section (--robot FILE)"
            )


def _plain(name: object) -> str:
    """Return a frame's name as text, without the leading slash of older ROS."""
    return str(name).removeprefix("/")


def same_place(a: Pose, b: Pose) -> bool:
    """Tell whether two poses are equal up to rounding."""
    return bool(abs(a.matrix - b.matrix).max() <= SAME_POSE)
