"""Data of sensors in scene files, in place of an obstacle's shape: ``cloud: {file: scan.ply, radius: 0.005}``,
``depth: {file: depth.png, intrinsics: [fx, fy, cx, cy]}``, ``octomap: {file: room.bt}`` or ``voxels: {file: grid.npz,
size: 0.02}``."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any, assert_never

from hdplan.scenes.clouds import Cloud, Ignored
from hdplan.scenes.depth_images import DepthImage
from hdplan.scenes.fields import Field
from hdplan.scenes.fixed_array import FixedArray
from hdplan.scenes.obstacles import Seen
from hdplan.scenes.voxel_grids import OctoMap, Voxels

SETTINGS = ("radius", "voxel", "drop_nan", "ignore_robot")  # as the class has them
CAMERA = ("intrinsics", "scale", "range")


def read_cloud(section: Field) -> Cloud:
    """Read a cloud. Raises InputError for unknown keys and wrong values; its file is read when the scene is planned."""
    keys = section.mapping(("file", "points", *SETTINGS, "ignore"), required=["radius"])
    source = _source(section, keys, "points")
    return _made(section, keys, source)


def read_depth(section: Field) -> Cloud:
    """Read a depth image as a cloud. Raises InputError as `read_cloud`."""
    settings = [name for name in SETTINGS if name != "drop_nan"]
    keys = section.mapping(("file", "image", *CAMERA, *settings, "ignore"), required=["intrinsics"])
    camera = {key: keys.pop(key) for key in CAMERA if key in keys}
    source = section.make(DepthImage, image=_source(section, keys, "image"), **camera)
    return _made(section, keys, source)


def _source(section: Field, keys: dict[str, Field], here: str) -> object:
    """Return the named file, or the value that is given here instead of one."""
    if ("file" in keys) == (here in keys):
        raise section.error(f"needs either file or {here}")
    if "file" in keys:
        return keys.pop("file").path()
    keys[here].items(of="rows")  # a text would be taken for a file
    return keys.pop(here).value


def _made(section: Field, keys: dict[str, Field], source: object) -> Cloud:
    values: dict[str, object] = {**keys, "points": source}
    if "ignore" in keys:
        several = isinstance(keys["ignore"].value, list)
        entries = keys["ignore"].items(of="links and obstacles") if several else [keys["ignore"]]
        values["ignore"] = tuple(entry.read(Ignored) for entry in entries)
    return section.make(Cloud, **values)


def read_voxels(section: Field) -> Voxels:
    """Read a voxel grid. Raises InputError as `read_cloud`."""
    keys = section.mapping(("file", "occupied", "size", "origin"), required=["size"])
    source = _source(section, keys, "occupied")
    return section.make(Voxels, **{**keys, "occupied": source})


def read_octomap(section: Field) -> OctoMap:
    """Read the name of an octomap's file, or its content in base64. Raises InputError as `read_cloud`."""
    keys = section.mapping(("file", "content", "unknown"))
    if ("file" in keys) == ("content" in keys):
        raise section.error("needs either file or content")
    source = keys.pop("file").path() if "file" in keys else _bytes_in(keys.pop("content"))
    return section.make(OctoMap, **{**keys, "source": source})


def _bytes_in(field: Field) -> bytes:
    try:
        return base64.b64decode(field.text(), validate=True)
    except ValueError:
        raise field.wrong("a text in base64") from None


def seen_entry(shape: Seen) -> dict[str, Any]:
    """Return the key and the section that are read back."""
    match shape:
        case Cloud():
            return _cloud_entry(shape)
        case OctoMap(source, unknown):
            content = {"content": base64.b64encode(source).decode()} if isinstance(source, bytes) else {"file": source}
            return {"octomap": {**content, "unknown": unknown}}
        case Voxels(grid, size, origin):
            cells = {"file": grid} if isinstance(grid, Path) else {"occupied": grid.array.astype(int).tolist()}
            return {"voxels": {**cells, "size": size, "origin": origin}}
        case _:
            assert_never(shape)


def _cloud_entry(cloud: Cloud) -> dict[str, Any]:
    depth = cloud.points if isinstance(cloud.points, DepthImage) else None
    source = depth.image if depth else cloud.points
    assert isinstance(source, Path | FixedArray)
    here = "image" if depth else "points"
    entry: dict[str, Any] = {"file": source} if isinstance(source, Path) else {here: source.array.tolist()}
    if depth:
        entry |= {key: getattr(depth, key) for key in CAMERA}
    entry |= {key: value for key in (*SETTINGS, "ignore") if (value := getattr(cloud, key))}
    if isinstance(cloud.radius, FixedArray):
        entry["radius"] = cloud.radius.array.tolist()
    return {"depth" if depth else "cloud": entry}
