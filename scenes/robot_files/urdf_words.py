"""Words of a URDF: each element and attribute is part of the format, known to be harmless, or refused by its name.

URDF readers pass over what they do not know: a shape in `<collisionx>` would never be checked. So do they with words of
other namespaces, or do not see the namespace at all. What is inside a `visual` is no concern of planning.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping

from hdplan.scenes.errors import InputError, listed, nearest
from hdplan.scenes.number_text import read_numbers
from hdplan.scenes.robot_files.xml_text import Element, is_xacro, split, stray_text

# What each element may contain, and its attributes.
ELEMENTS: dict[str, tuple[str, ...]] = {
    "robot": ("link", "joint", "material"),
    "link": ("inertial", "visual", "collision", "collision_checking"),  # the last is Pinocchio's, for capsules
    "inertial": ("origin", "mass", "inertia"),
    "collision": ("origin", "geometry"),
    "geometry": ("box", "cylinder", "sphere", "capsule", "ellipsoid", "mesh"),
    "joint": ("origin", "parent", "child", "axis", "calibration", "dynamics", "limit", "mimic", "safety_controller"),
}
ATTRIBUTES: dict[str, tuple[str, ...]] = {
    "robot": ("name", "version"),
    "link": ("name", "type"),
    "joint": ("name", "type"),
    "inertial": (),
    "collision": ("name",),
    "geometry": ("name",),
    "origin": ("xyz", "rpy"),
    "mass": ("value",),
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    "box": ("size",),
    "cylinder": ("radius", "length"),
    "sphere": ("radius",),
    "capsule": ("radius", "length"),
    "ellipsoid": ("radii",),
    "mesh": ("filename", "scale"),
    "parent": ("link",),
    "child": ("link",),
    "axis": ("xyz",),
    "limit": ("lower", "upper", "effort", "velocity"),
    "mimic": ("joint", "multiplier", "offset"),
}
ONCE = (
    *("inertial", "origin", "mass", "inertia", "geometry", "parent", "child", "axis", "limit", "mimic"),
    *("dynamics", "calibration", "safety_controller"),
)

NOT_READ = ("visual", "material", "collision_checking", "dynamics", "calibration", "safety_controller")  # nor used

HOLDERS = ("robot", "link", "joint")  # text in these is no value; public robots have some
DRAKE = "{http://drake.mit.edu}"
# Elements that are not URDF's and change nothing of where bodies are, and why; what they contain is not read.
HARMLESS: dict[str, dict[str, str]] = {
    "robot": {
        **dict.fromkeys(("gazebo", "mujoco", "bullet"), "settings of a simulator"),
        **dict.fromkeys(("transmission", "ros2_control"), "from a motor to its joint"),
        "sensor": "what a sensor measures",
        "frame": "Drake's name for a pose",
        "collision_filter_group": "leaves pairs out in Drake; here they are checked",
    },
    "link": {
        **dict.fromkeys(("contact", "surface"), "friction and stiffness of contacts"),
        **dict.fromkeys(("gravity", "kinematic", "self_collide"), "settings of Gazebo"),
        "self_collision_checking": "an address of geometry for other checks; here the link's own is checked",
        "origin": "no movement, if it is 0",
        "self_filter": "how a filter of images sees the link",
        "sensor": "what a sensor measures",
    },
    "collision": {
        "material": "colours",
        "surface": "friction and stiffness of contacts",
        "verbose": "a word of URDF's first days, without meaning",
        f"{DRAKE}proximity_properties": "stiffness of contacts and resolution of pressure fields",
    },
    "joint": {
        "joint_properties": "damping and friction",
        "controller_gains": "of a controller",
    },
}
# Attributes of the same kind.
HARMLESS_ATTRIBUTES: dict[str, dict[str, str]] = {
    "axis": {"rpy": "no turn, if it is 0"},
    "joint": {"dont_collapse": "how a simulator treats fixed joints"},
    "limit": {
        **dict.fromkeys(
            ("acceleration", f"{DRAKE}acceleration", "deceleration", "jerk"), "limits that URDF does not have"
        ),
        **dict.fromkeys(("current", "command_effort", "gear_velocity", "k_velocity"), "of the motor, not the joint"),
    },
}
ZERO = (("link", "origin"), ("axis", "rpy"))  # harmless only where all of its numbers are 0
ROBOTS = ("robot", "link", "joint", "include")  # words that hold parts of robots, in whatever namespace
UNNOTED = ("robot",)  # where vendors add elements of their own as a matter of course
LISTED_NAMES = 4  # names in a note; further ones are counted


def check_urdf_words(root: Element) -> tuple[str, ...]:
    """Return a note on parts of links and joints that are not URDF.

    Raises InputError for an element or attribute that is not known, or of a foreign namespace, for a text where a value
    may be meant, and for duplicates of elements that may occur once.
    """
    ignored: dict[str, None] = {}
    _walk(root, "robot", "", ignored)
    return (f"not part of URDF, ignored: {listed(ignored, LISTED_NAMES)}",) if ignored else ()


def check_shapes(root: Element) -> tuple[str, ...]:
    """Return a note on links that are visible but have no collision geometry, unless no link has any."""
    links = root.findall("link")
    seen = [
        f"{link.get('name')}" for link in links if link.find("visual") is not None and not link.findall("collision")
    ]
    if not seen or not root.findall("link/collision"):
        return ()
    return (f"links without collision geometry, never checked: {listed(seen, LISTED_NAMES)}",)


def check_soft_limits(root: Element) -> tuple[str, ...]:
    """Return a note on joints of which a safety controller keeps a margin to the limits: MoveIt keeps it, too, and URDF
    does not require it."""
    found = []
    for joint in root.findall("joint"):
        soft, limit = joint.find("safety_controller"), joint.find("limit")
        if soft is None or limit is None or joint.get("type") not in ("revolute", "prismatic"):
            continue
        with contextlib.suppress(ValueError):  # what is no number is refused elsewhere
            low, high = (read_numbers([soft.get(f"soft_{end}_limit", "0")])[0] for end in ("lower", "upper"))
            least, most = (read_numbers([limit.get(end, "0")])[0] for end in ("lower", "upper"))
            if low < high and (low > least or high < most):
                found.append(f"{joint.get('name')} [{low:g}, {high:g}]")
    return (f"soft limits of safety controllers, not kept: {listed(found, LISTED_NAMES)}",) if found else ()


def _walk(element: Element, tag: str, where: str, ignored: dict[str, None]) -> None:
    """Check an element and its children; collect what is not URDF's and harmless."""
    for attribute in element.attrib:
        if attribute not in ATTRIBUTES.get(tag, ()) and not (tag == "robot" and split(attribute)[0]):
            _foreign(attribute, f"{where}{tag}: attribute", ATTRIBUTES.get(tag, ()), HARMLESS_ATTRIBUTES.get(tag, {}))
            if (tag, attribute) in ZERO:
                _zero(element.get(attribute, ""), f"{where}{tag}: {attribute}")
            ignored[f"{split(attribute)[1]} of {tag}"] = None
    if (text := stray_text(element)) and tag not in HOLDERS:
        raise InputError(f"{where}{tag}: holds the text '{text}', where none belongs")
    if text:
        ignored[f"the text '{text}'"] = None
    seen: set[str] = set()
    for child in element:
        name = child.tag
        if name not in ELEMENTS.get(tag, ()):
            namespace, local = split(name)
            if tag == "robot" and namespace and local not in ROBOTS and not is_xacro(namespace):
                continue  # vendors' own
            _foreign(name, f"{where}element", ELEMENTS.get(tag, ()), HARMLESS.get(tag, {}))
            if (tag, name) in ZERO:
                _zero(" ".join(child.attrib.values()), f"{where}{name} in {tag}")
            if tag not in UNNOTED:
                ignored[f"{local} in {tag}"] = None
            continue
        if name in seen and name in ONCE:
            raise InputError(f"{where}<{name}> occurs twice in <{tag}>; only one is allowed")
        seen.add(name)
        if name not in NOT_READ:
            below = f"{name} '{child.get('name')}': " if tag == "robot" else where
            _walk(child, name, below, ignored)


def _zero(text: str, where: str) -> None:
    """Raise InputError for numbers other than 0 where URDF has none."""
    with contextlib.suppress(ValueError):
        if not any(read_numbers(text.split())):
            return
    raise InputError(f"{where} is not part of URDF, and must be 0, found '{text}'")


def _foreign(word: str, where: str, known: Iterable[str], harmless: Mapping[str, str]) -> None:
    """Raise InputError for a word that is none of the format's, unless it is known to be harmless."""
    if word in harmless:
        return
    namespace, local = split(word)
    if is_xacro(namespace):
        raise InputError(f"{where} 'xacro:{local}': the file is xacro, and its name must end in .xacro")
    if namespace:
        raise InputError(f"{where} '{local}' is of the namespace '{namespace}', in which URDF has none")
    near = nearest(word, (*known, *harmless), "not part of URDF")
    raise InputError(f"{where} '{word}' is not known{near}")
