"""The frames in which a MoveIt scene and request may give poses: the world, and every frame fixed in it.

These are the robot's root link, the links fixed to it, and the frames that `fixed_frame_transforms` attach to them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from hdplan.scenes.errors import nearest
from hdplan.scenes.fields import Field
from hdplan.scenes.moveit.fields import MESSAGES
from hdplan.scenes.moveit.messages import read_transform
from hdplan.scenes.poses import Pose, compose
from hdplan.scenes.robot_files.description import Tree

WORLD = ("", "world")
SAME = 1e-9  # largest entry by which two poses of one frame may differ


@dataclass(frozen=True)
class Frames:
    """Poses of frames in the world."""

    poses: Mapping[str, Pose]  # name -> pose
    moving: frozenset[str]  # links that joints may move

    @classmethod
    def of(cls, tree: Tree, base: Pose) -> Frames:
        """Return the world, and the fixed links of a robot whose root is at `base`."""
        standing = {link: compose(base, pose) for link, pose in tree.standing().items()}
        return cls({**standing, **dict.fromkeys(WORLD, Pose())}, frozenset(tree.links) - set(standing))

    def with_transforms(self, transforms: Iterable[Field]) -> Frames:
        """Add the frames that a scene defines. Raises InputError for one that has another pose already."""
        poses = dict(self.poses)
        for entry in transforms:
            keys = entry.mapping(MESSAGES["TransformStamped"])
            pose = compose(
                Frames(poses, self.moving).of_header(keys.get("header")), read_transform(keys.get("transform"))
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
        return Frames(poses, self.moving)

    def of_header(self, header: Field | None) -> Pose:
        """Return the pose of the frame that a header names; without one, of the world.

        Raises InputError for a frame that moves or is unknown.
        """
        frame = header.mapping(MESSAGES["Header"]).get("frame_id") if header else None
        if frame is None:
            return Pose()
        name = _plain(frame.value)
        if name in self.poses:
            return self.poses[name]
        if name in self.moving:
            raise frame.error(f"the link {name!r} moves with the robot; give poses in the world frame, '' or 'world'")
        raise frame.error(f"unknown frame {name!r}{nearest(name, filter(None, self.poses))}")


def _plain(name: object) -> str:
    """Return a frame's name as text, without the leading slash of older ROS."""
    return str(name).removeprefix("/")


def same_place(a: Pose, b: Pose) -> bool:
    """Tell whether two poses are equal up to rounding."""
    return bool(abs(a.matrix - b.matrix).max() <= SAME)
