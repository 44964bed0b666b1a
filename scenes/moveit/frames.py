"""The frames in which a MoveIt scene and request may give poses: the world, and every frame that stands in it.

These are the robot's root link, the links fixed to it, and what the scene's `fixed_frame_transforms` hang on them.
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
SAME = 1e-9  # largest entry by which two placements of one frame may differ


@dataclass(frozen=True)
class Frames:
    """Where frames stand in the world."""

    poses: Mapping[str, Pose]  # name -> pose
    moving: frozenset[str]  # links that joints may move

    @classmethod
    def of(cls, tree: Tree, base: Pose) -> Frames:
        """Take the world, and the links of a robot whose root stands at `base`."""
        standing = {link: compose(base, pose) for link, pose in tree.standing().items()}
        return cls({**standing, **dict.fromkeys(WORLD, Pose())}, frozenset(tree.links) - set(standing))

    def with_transforms(self, transforms: Iterable[Field]) -> Frames:
        """Add the frames that a scene names. Raises InputError for one that stands elsewhere already."""
        poses = dict(self.poses)
        for entry in transforms:
            keys = entry.mapping(MESSAGES["TransformStamped"])
            pose = compose(
                Frames(poses, self.moving).of_header(keys.get("header")), read_transform(keys.get("transform"))
            )
            child = keys.get("child_frame_id")
            name = "" if child is None or child.value == "" else _plain(child.text())
            if child is not None and name in self.moving:
                raise child.error(f"is no fixed frame: the link {name!r} moves with the robot")
            if name in poses and not same_place(poses[name], pose):
                raise (keys.get("transform") or entry).error(
                    f"moves a fixed frame: {name!r} stands elsewhere already (the robot's root stands where `base` in "
                    "the robot section says, --robot FILE)"
                )
            poses.setdefault(name, pose)
        return Frames(poses, self.moving)

    def of_header(self, header: Field | None) -> Pose:
        """Return where the frame stands that a header names; without one it is the world.

        Raises InputError for a frame that moves, or is not known.
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
    """Return a frame's name as text, without the slash before names of old."""
    return str(name).removeprefix("/")


def same_place(a: Pose, b: Pose) -> bool:
    """Tell whether two placements are one, to rounding."""
    return bool(abs(a.matrix - b.matrix).max() <= SAME)
