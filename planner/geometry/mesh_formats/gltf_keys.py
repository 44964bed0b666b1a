"""glTF's objects: which keys a reader of geometry reads, which are harmless, each with its reason. All others, and all
extensions that are not listed here, are refused by name."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import Any

from hdplan.scenes.errors import InputError, nearest

Object = Mapping[str, Any]

_LOOK = "how it looks"
_SEEN = "cameras enclose nothing"
_NAME = "a name, or who made it"
_OWN = "for one program; by the standard it does not concern others"
_HINT = "redundant: follows from the rest, or only serves speed"
_UNUSED = "shows nothing by itself; a node that uses it is refused"

READ = {  # object -> its keys that are read
    "file": "asset scene scenes nodes meshes accessors bufferViews buffers animations extensionsUsed"
    " extensionsRequired",
    "asset": "version minVersion",
    "scene": "nodes",
    "node": "children mesh matrix translation rotation scale skin weights",
    "mesh": "primitives weights",
    "primitive": "attributes indices mode targets",
    "accessor": "bufferView byteOffset componentType normalized count type sparse",
    "sparse": "count indices values",
    "sparse indices": "bufferView byteOffset componentType",
    "sparse values": "bufferView byteOffset",
    "bufferView": "buffer byteOffset byteLength byteStride",
    "buffer": "uri byteLength",
}
_HARMLESS = (  # object, its keys that have no say in the geometry, and why
    ("file", "materials textures images samplers", _LOOK),
    ("file", "cameras", _SEEN),
    ("file", "skins", _UNUSED),
    ("asset", "generator copyright", _NAME),
    ("node", "camera", _SEEN),
    ("primitive", "material", _LOOK),
    ("accessor", "min max", _HINT),
    ("bufferView", "target", _HINT),
    *((kind, "name", _NAME) for kind in ("scene", "node", "mesh", "accessor", "bufferView", "buffer")),
    *((kind, "extras", _OWN) for kind in READ),
)
HARMLESS = frozenset((kind, key) for kind, keys, _ in _HARMLESS for key in keys.split())

_MATERIALS = "anisotropy clearcoat diffuse_transmission dispersion emissive_strength ior iridescence sheen specular"
_MATERIALS += " pbrSpecularGlossiness transmission unlit variants volume volume_scatter"
HARMLESS_EXTENSIONS = {  # each with the reason
    **{f"KHR_materials_{name}": _LOOK for name in _MATERIALS.split()},
    **dict.fromkeys(("KHR_texture_transform", "KHR_texture_basisu", "EXT_texture_webp", "EXT_texture_avif"), _LOOK),
    **dict.fromkeys(("MSFT_texture_dds", "EXT_lights_image_based", "EXT_lights_ies"), _LOOK),
    "KHR_lights_punctual": _LOOK,
    "KHR_xmp_json_ld": _NAME,
}
QUANTIZED = "KHR_mesh_quantization"  # read: it only allows whole numbers as coordinates
REFUSED = {  # known extensions, and not read
    "KHR_draco_mesh_compression": "compressed geometry is not read: export it without",
    "EXT_meshopt_compression": "compressed geometry is not read: export it without",
    "KHR_meshopt_compression": "compressed geometry is not read: export it without",
    "EXT_mesh_gpu_instancing": "instances of an extension are not read: export each as a node",
    "KHR_node_visibility": "hidden nodes are not read: export without them",
    "MSFT_lod": "levels of detail are not read: export one",
}
ATTRIBUTES = {  # of a primitive beside POSITION: the first words of their names, each with the reason
    **dict.fromkeys(("NORMAL", "TANGENT", "TEXCOORD", "COLOR"), _LOOK),
    **dict.fromkeys(("JOINTS", "WEIGHTS"), _UNUSED),
    "": _OWN,  # names that begin with an underscore
}


def checked(value: Any, kind: str, place: str) -> Object:
    """Return an object whose keys and extensions are all known. Raises InputError, by name, for what is not."""
    if not isinstance(value, dict):
        raise InputError(f"{place}: an object is expected, found {str(value)[:40]!r}")
    read = READ[kind].split()
    for key in value:
        if key == "extensions":
            check_extensions(value[key], place)
        elif key not in read and (kind, key) not in HARMLESS:
            known = (*read, *(each for owner, each in HARMLESS if owner == kind))
            raise InputError(f"{place} has the key '{key[:60]}', which is not known{nearest(key, known)}")
    return MappingProxyType(value)


def check_extensions(names: Any, place: str) -> None:
    """Raise InputError for an extension, in a list or as a key, that is neither read nor harmless."""
    if not isinstance(names, Collection) or isinstance(names, str) or not all(isinstance(name, str) for name in names):
        raise InputError(f"{place}: names of extensions are expected, found {str(names)[:40]!r}")
    for name in names:
        if name not in HARMLESS_EXTENSIONS and name != QUANTIZED:
            reason = REFUSED.get(name, "it is not known, so that parts may be missing")
            raise InputError(f"{place} uses the extension '{name[:60]}': {reason}")
