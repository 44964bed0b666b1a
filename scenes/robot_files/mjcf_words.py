"""Words of an MJCF that say where bodies are, how they move and what they collide with, and are misspelt.

What is read is looked up by name, so that a misspelt attribute would leave a default in its place: a `typ="box"` a
sphere, a `rnage` a joint without limits. As in a URDF, a word that is close to one of MuJoCo's is refused, and any
other is named in a note.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

from hdplan.scenes.errors import listed
from hdplan.scenes.robot_files.urdf_words import MOST, check_spelling

PLACE = ("pos", "quat", "axisangle", "xyaxes", "zaxis", "euler")
ATTRIBUTES = {  # of MuJoCo 3.3
    "compiler": (
        *("autolimits", "boundmass", "boundinertia", "settotalmass", "balanceinertia", "strippath", "coordinate"),
        *("angle", "fitaabb", "eulerseq", "meshdir", "texturedir", "assetdir", "discardvisual", "usethread"),
        *("fusestatic", "inertiafromgeom", "inertiagrouprange", "alignfree", "saveinertial", "convexhull"),
        "exactmeshinertia",
    ),
    "body": ("name", "childclass", "mocap", *PLACE, "gravcomp", "sleep", "user"),
    "joint": (
        *("name", "class", "type", "group", "pos", "axis", "springdamper", "limited", "actuatorfrclimited", "ref"),
        *("solreflimit", "solimplimit", "solreffriction", "solimpfriction", "stiffness", "range", "actuatorfrcrange"),
        *("actuatorgravcomp", "margin", "springref", "armature", "damping", "frictionloss", "user"),
    ),
    "geom": (
        *("name", "class", "type", "contype", "conaffinity", "condim", "group", "priority", "size", "material"),
        *("friction", "mass", "density", "shellinertia", "solmix", "solref", "solimp", "margin", "gap", "fromto"),
        *(*PLACE, "hfield", "mesh", "fitscale", "rgba", "fluidshape", "fluidcoef", "user"),
    ),
    "mesh": (
        *("name", "class", "content_type", "file", "scale", "inertia", "smoothnormal", "maxhullvert", "vertex"),
        *("normal", "texcoord", "face", "refpos", "refquat", "material", "builtin", "params"),
    ),
    "default": ("class",),
}
IN_DEFAULT = (
    *("mesh", "material", "joint", "geom", "site", "camera", "light", "pair", "equality", "tendon", "general"),
    *("motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle", "adhesion", "plugin", "default"),
)
READ = ("compiler", "default", "asset", "worldbody")  # sections


def check_mjcf_words(root: ElementTree.Element) -> tuple[str, ...]:
    """Return a note on attributes that are not MuJoCo's. Raises InputError for one that is close to one of MuJoCo's,
    and for such an element of default classes."""
    unknown: dict[str, None] = {}
    for section in root:
        for element in section.iter() if section.tag in READ else ():
            known = ATTRIBUTES.get(element.tag, ())
            for attribute in element.attrib if known else ():
                if attribute not in known:
                    where = f"{element.tag} '{element.get('name', '')}'"
                    check_spelling(attribute, known, f"{where}: attribute")
                    unknown[f"{attribute} of {element.tag}"] = None
            for below in element if element.tag == "default" else ():
                if below.tag not in IN_DEFAULT:
                    check_spelling(below.tag, IN_DEFAULT, "default: element")
    return (f"not part of MJCF, ignored: {listed(unknown, MOST)}",) if unknown else ()
