"""Words of an MJCF: each is read, known to be harmless (with the reason), or refused by its name.

What is read is looked up by name, so a word that is passed over would leave a default in its place: a `typ="box"` a
sphere, a `rnage` a joint without limits. The words are those of MuJoCo 3 and 4, as `mj_printSchema` lists them.
"""

from __future__ import annotations

from collections.abc import Mapping

from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.robot_files.xml_text import Element, finite_numbers

TURNS = ("quat", "axisangle", "euler", "xyaxes", "zaxis")
PLACE = ("pos", *TURNS)
READ = {  # attributes, by element
    "compiler": (
        *("angle", "eulerseq", "coordinate", "autolimits", "meshdir", "assetdir", "strippath"),
        *("inertiafromgeom", "settotalmass", "boundmass", "boundinertia", "balanceinertia"),
    ),
    "default": ("class",),
    "body": ("name", "childclass", "mocap", "gravcomp", *PLACE),
    "worldbody": (),
    "frame": ("name", "childclass", *PLACE),
    "joint": ("name", "class", "type", "pos", "axis", "limited", "range", "ref"),
    "freejoint": ("name",),
    "geom": ("name", "class", "type", "contype", "conaffinity", "size", "fromto", "mesh", "hfield", *PLACE),
    "inertial": ("mass", "diaginertia", "fullinertia", *PLACE),
    "mesh": ("name", "class", "file", "scale"),
    "pair": ("name", "class", "geom1", "geom2"),
    "exclude": ("name", "body1", "body2"),
    "coupling": ("name", "class", "active", "joint1", "joint2", "polycoef"),  # `joint` in `equality`
}
HARMLESS: Mapping[
    str, Mapping[str, tuple[str, ...]]
] = {  # attributes, by element, with the reason why they do not affect planning
    "compiler": {
        "visuals do not concern planning": ("texturedir", "discardvisual"),
        "how the model is compiled and saved": ("usethread", "saveinertial", "convexhull"),
        "bodies stay where they are": ("fusestatic", "alignfree"),
        "of what is worked out of geoms: masses, which are not taken": ("inertiagrouprange", "exactmeshinertia"),
        "of primitives fitted to meshes, which are refused": ("fitaabb",),
    },
    "body": {"how the simulation runs": ("sleep",), "the user's own": ("user",)},
    "joint": {
        "forces": (
            *("springdamper", "stiffness", "springref", "springyield", "damping", "armature", "frictionloss"),
            *("actuatorfrclimited", "actuatorfrcrange", "actuatorgravcomp"),
        ),
        "how limits are held": (*("solreflimit", "solimplimit", "solreffriction", "solimpfriction", "margin"),),
        "looks, and the user's own": ("group", "user"),
    },
    "freejoint": {"looks": ("group",), "where its coordinates are counted from, and it is held": ("align",)},
    "geom": {
        "looks, and the user's own": ("material", "rgba", "group", "castshadow", "user"),
        "masses that are worked out of geoms are not taken": ("mass", "density", "shellinertia"),
        "forces of contacts": (
            *("condim", "priority", "friction", "solmix", "solref", "solimp", "margin", "gap", "adhesion"),
            *("surfacevel", "fluidshape", "fluidcoef"),
        ),
        "of primitives fitted to meshes, which are refused": ("fitscale",),
    },
    "mesh": {
        "looks": ("smoothnormal", "normal", "texcoord", "material"),
        "masses that are worked out of meshes are not taken": ("inertia",),
        "meshes are taken as they are, not their hulls": ("maxhullvert",),
    },
    "pair": {
        "forces of contacts": (
            *("condim", "friction", "gap", "margin", "adhesion", "solimp", "solref", "solreffriction"),
        ),
    },
    "coupling": {"how it is held": ("solref", "solimp")},
}
UNSUPPORTED = {  # attributes of MuJoCo whose meaning the planner does not support
    "mesh": ("vertex", "face", "refpos", "refquat", "builtin", "params", "content_type"),
    "body": ("fuse", "simple"),
    "compiler": ("conflict", "passthrough", "savecanonical", "savecompiled"),
}
NUMBERS = (  # attributes that hold finite numbers, whether they are used or not
    *(*PLACE, "axis", "range", "ref", "size", "fromto", "contype", "conaffinity", "scale", "gravcomp", "polycoef"),
    *("mass", "diaginertia", "fullinertia"),
)
KINDS = {  # that MuJoCo has
    "joint": ("hinge", "slide", "ball", "free"),
    "geom": ("plane", "hfield", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh", "sdf"),
}
IN_BODY = ("body", "joint", "geom", "inertial", "frame", "freejoint", "site", "camera", "light")
FORCES = (
    *("general", "motor", "position", "velocity", "intvelocity", "orientation", "pid", "damper", "cylinder", "muscle"),
    *("adhesion", "dcmotor"),
)
ELEMENTS = {  # that may stand in an element which is looked through
    "mujoco": (
        *("compiler", "option", "size", "statistic", "visual", "asset", "default", "worldbody", "contact", "equality"),
        *("tendon", "actuator", "sensor", "keyframe", "custom"),
    ),
    "compiler": ("lengthrange",),
    "asset": ("mesh", "texture", "material", "hfield", "skin", "model"),
    "default": (
        *("default", "mesh", "joint", "geom", "pair", "equality", "tendon", "material", "texture", "site", "camera"),
        *("light", *FORCES),
    ),
    "worldbody": IN_BODY,
    "body": IN_BODY,
    "frame": IN_BODY,
    "contact": ("pair", "exclude"),
}
PASSED_OVER = {  # elements that are not read, with the reason
    **dict.fromkeys(("size", "statistic", "visual", "custom"), "the simulator's, and the user's own"),
    **dict.fromkeys(("option", "sensor", "keyframe"), "how the simulation runs; of options, gravity is looked up"),
    **dict.fromkeys(("actuator", "lengthrange", *FORCES), "forces, whose limits are the scene's"),
    **dict.fromkeys(("texture", "material", "skin", "camera", "light"), "visuals do not concern planning"),
    **dict.fromkeys(("site",), "marks a place"),
    **dict.fromkeys(("hfield", "model"), "refused is what uses them"),
    **dict.fromkeys(("equality", "tendon"), "looked through by `mjcf_couplings`"),
}
UNSUPPORTED_ELEMENTS = ("composite", "flexcomp", "plugin", "attach", "replicate", "extension", "deformable")
NONE_LIKE_IT = "MJCF has none like it here"


def check_mjcf_words(root: Element) -> None:
    """Raise InputError for an element or attribute that is neither read nor known to be harmless."""
    allowed = ELEMENTS.get(root.tag, ())
    for element in root:
        tag = element.tag
        if tag in UNSUPPORTED_ELEMENTS:
            raise InputError(f"{called(root)}: <{tag}> is not supported (allowed: {', '.join(allowed)})")
        if tag not in allowed:
            raise InputError(f"{called(root)}: element '{tag}' is not known{nearest(tag, allowed, NONE_LIKE_IT)}")
        if tag in PASSED_OVER:
            continue
        check_attributes(element, tag)
        if root.tag == "default" and tag != "default":
            if given := [key for key in ("name", "class") if key in element.attrib]:
                raise InputError(f"default: {called(element)}: {given[0]} has no meaning in a default")
            if len(root.findall(tag)) > 1:
                raise InputError(f"default: <{tag}> appears twice")
        check_mjcf_words(element)


def check_attributes(element: Element, kind: str) -> None:
    """Raise InputError for an attribute that elements of a kind do not have, or that is not supported."""
    known = (*READ.get(kind, ()), *(word for words in HARMLESS.get(kind, {}).values() for word in words))
    for attribute in element.attrib:
        if attribute in UNSUPPORTED.get(kind, ()):
            raise InputError(f"{called(element)}: {attribute} is not supported")
        if attribute not in known:
            similar = nearest(attribute, known, NONE_LIKE_IT)
            raise InputError(f"{called(element)}: attribute '{attribute}' is not known{similar}")
        value = element.attrib[attribute]
        if attribute in NUMBERS:
            finite_numbers(value, f"{called(element)}: {attribute}")
        if attribute == "type" and value not in KINDS.get(kind, (value,)):
            raise InputError(f"{called(element)}: type '{value}' is not known{nearest(value, KINDS[kind])}")


def called(element: Element) -> str:
    """Return an element's kind, and its name if it has one, for errors."""
    return f"{element.tag} '{element.get('name')}'" if element.get("name") else element.tag
