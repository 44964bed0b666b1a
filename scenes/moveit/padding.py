"""Paddings and scales of links in a MoveIt scene.

MoveIt pads links, and what they hold, against the world alone, not against each other (`checkRobotCollision` and
`checkSelfCollision` of its CollisionEnv): a padding p becomes a clearance p to every obstacle. That is the distance
itself; MoveIt moves the faces of a box by p, its corners by more, and the vertices of a mesh away from its centre.
"""

from __future__ import annotations

from collections.abc import Mapping

from hdplan.scenes.errors import nearest
from hdplan.scenes.fields import Field
from hdplan.scenes.moveit.fields import MESSAGES
from hdplan.scenes.robot_files.description import Tree


def read_padding(keys: Mapping[str, Field], tree: Tree) -> float:
    """Return the clearance [m] to every obstacle that `link_padding` means; 0 without one.

    Raises:
        InputError: a scale other than 1; a negative padding, one of an unknown link, or not the same for all links with
            collision geometry, as all of them keep one clearance here.
    """
    for entry in keys["link_scale"].items() if "link_scale" in keys else ():
        message = entry.mapping(MESSAGES["LinkScale"], ["link_name", "scale"])
        if message["scale"].number() != 1.0:
            raise message["scale"].wrong("1, as scaled links are not supported")
    paddings: dict[str, float] = {}
    for entry in keys["link_padding"].items() if "link_padding" in keys else ():
        message = entry.mapping(MESSAGES["LinkPadding"], ["link_name", "padding"])
        link, padding = message["link_name"].text(), message["padding"].number(low=0.0, high=1.0, unit="m")
        if padding and link not in tree.links:
            raise message["link_name"].error(f"unknown link {link!r}{nearest(link, tree.links)}")
        if paddings.get(link, padding) != padding:
            raise entry.error(f"{link!r} has another padding already")
        paddings[link] = padding
    by_link = {link: paddings.get(link, 0.0) for link in tree.links if link in tree.solid}
    least, most = min(by_link, key=by_link.__getitem__, default=""), max(by_link, key=by_link.__getitem__, default="")
    if not by_link or by_link[most] == 0.0:
        return 0.0
    if by_link[least] != by_link[most]:
        raise keys["link_padding"].error(
            f"must be the same for every link with collision geometry, found {by_link[most]:g} m for '{most}' and "
            f"{by_link[least]:g} m for '{least}': one clearance is kept by all of them"
        )
    keys["link_padding"].note(f"kept as a clearance of {by_link[most]:g} m between the robot and every obstacle")
    return by_link[most]
