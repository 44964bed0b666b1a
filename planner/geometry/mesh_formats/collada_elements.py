"""COLLADA's elements: which a reader of geometry reads, which are harmless, each with its reason. All others are
refused by name, and so are attributes that are not listed here."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections import defaultdict

from hdplan.scenes.errors import InputError, nearest

Element = ElementTree.Element

VERSIONS = {  # by the file's namespace
    "http://www.collada.org/2005/11/COLLADASchema": ("1.4.0", "1.4.1"),
    "http://www.collada.org/2008/03/COLLADASchema": ("1.5.0",),
}
TRANSFORMS = ("matrix", "translate", "rotate", "scale", "skew", "lookat")
PRIMITIVES = ("triangles", "polylist", "polygons", "tristrips", "trifans")

_LOOK = "how it looks"
_SEEN = "cameras and lights enclose nothing"
_ABOUT = "who made it, when and with what"
_LINE = "lines enclose nothing"
_OWN = "for one program; by the standard whoever does not know it leaves it out"
_UNUSED = "a library shows nothing by itself; what would use it in the scene is refused"

READ = {  # element -> its children that are read
    "COLLADA": "asset library_geometries library_nodes library_visual_scenes library_animations scene",
    "asset": "unit up_axis",
    "library_geometries": "asset geometry",
    "library_nodes": "asset node",
    "library_visual_scenes": "asset visual_scene",
    "library_animations": "asset",
    "scene": "instance_visual_scene",
    "visual_scene": "asset node",
    "node": f"asset node instance_geometry instance_node {' '.join(TRANSFORMS)}",
    "geometry": "asset mesh",
    "mesh": f"source vertices {' '.join(PRIMITIVES)}",
    "source": "asset float_array technique_common",
    "technique_common": "accessor",
    "accessor": "param",
    "vertices": "input",
    **dict.fromkeys(PRIMITIVES, "input p"),
    "polylist": "input vcount p",
    **dict.fromkeys(("instance_visual_scene", "instance_geometry", "instance_node", "input", "param", "unit"), ""),
}
_HARMLESS = (  # element, its children that have no say in the geometry, and why
    ("COLLADA", "library_effects library_images library_materials", _LOOK),
    ("COLLADA", "library_cameras library_lights", _SEEN),
    ("COLLADA", "library_controllers library_force_fields library_animation_clips", _UNUSED),
    ("COLLADA", "library_physics_materials library_physics_models library_physics_scenes", _UNUSED),
    ("COLLADA", "library_joints library_kinematics_models library_kinematics_scenes", _UNUSED),
    ("COLLADA", "library_articulated_systems library_formulas", _UNUSED),
    ("asset", "contributor coverage created keywords modified revision subject title", _ABOUT),
    ("visual_scene", "evaluate_scene", _LOOK),
    ("node", "instance_camera instance_light", _SEEN),
    ("instance_geometry", "bind_material", _LOOK),
    ("mesh", "lines linestrips", _LINE),
    ("source", "technique", _OWN),
    *((element, "extra", _OWN) for element in READ),
)
HARMLESS = frozenset((element, child) for element, children, _ in _HARMLESS for child in children.split())
REFUSED = {  # known, and not read
    "instance_controller": "skins and morphs are not read: export the mesh as it stands",
    "instance_physics_scene": "what physics moves is not read",
    "instance_kinematics_scene": "what joints move is not read",
    "animation": "parts that move are not read: export it without",
    "ph": "polygons with holes are not read: export it as triangles",
    "convex_mesh": "hulls are not read: export it as triangles",
    "spline": "curves are not read: export it as triangles",
    "brep": "curved surfaces are not read: export it as triangles",
    "int_array": "coordinates that are whole numbers are not read",
}
ATTRIBUTES = {  # beside id, name and sid; material, layer, set, digits, magnitude and schemaLocation change no geometry
    "COLLADA": "version {http://www.w3.org/2001/XMLSchema-instance}schemaLocation",
    "unit": "meter",
    "node": "layer type",
    **dict.fromkeys(("instance_visual_scene", "instance_geometry", "instance_node"), "url"),
    "float_array": "count digits magnitude",
    "accessor": "count offset source stride",
    "param": "type",
    "input": "offset semantic set source",
    **dict.fromkeys(PRIMITIVES, "count material"),
}
# Of inputs beside coordinates: looks, and weights, which skins alone use.
SEMANTICS = "NORMAL COLOR TEXCOORD TEXTANGENT TEXBINORMAL TANGENT BINORMAL UV IMAGE WEIGHT JOINT"


def parts_of(element: Element) -> defaultdict[str, list[Element]]:
    """Return an element's children that are to be read, by their names, in order. Raises InputError, by name, for
    whatever is not known in it."""
    check_attributes(element)
    read = READ[element.tag].split()
    found = defaultdict[str, list[Element]](list)
    stray = element.text or ""
    for child in element:
        stray += child.tail or ""
        if not isinstance(child.tag, str) or (element.tag, child.tag) in HARMLESS:  # the first: a comment
            continue
        if child.tag not in read:
            known = (*read, *(each for owner, each in HARMLESS if owner == element.tag))
            reason = REFUSED.get(child.tag) or f"it is not known here{nearest(child.tag, known)}"
            raise InputError(f"{shown(element)} holds {shown(child)}: {reason}")
        found[child.tag].append(child)
    if stray := stray.strip(" \t\r\n"):
        raise InputError(f"{shown(element)} holds the text '{stray[:40]}', which is not known")
    return found


def check_attributes(element: Element) -> None:
    """Raise InputError for an attribute that is not known."""
    allowed = ("id", "name", "sid", *ATTRIBUTES.get(element.tag, "").split())
    for name in element.keys():  # noqa: SIM118
        if name not in allowed:
            raise InputError(f"{shown(element)} has the attribute '{name}', which is not known{nearest(name, allowed)}")


def only(found: list[Element], what: str, owner: Element) -> Element:
    """Return the one element of a list; `what` it is, and whose, is for errors."""
    if len(found) != 1:
        raise InputError(f"{shown(owner)} has {len(found) or 'no'} {what}; one is needed")
    return found[0]


def text_of(element: Element) -> str:
    """Return an element's text, which nothing divides: some readers would join `1<!-- -->2`, and others not."""
    check_attributes(element)
    if len(element):
        raise InputError(f"{shown(element)} holds other things than text")
    return (element.text or "").strip(" \t\r\n")


def shown(element: Element) -> str:
    """Return an element's name, and its own, for errors."""
    name = element.get("id") or element.get("name")
    return f"<{element.tag}>" + (f" '{name[:40]}'" if name else "")
