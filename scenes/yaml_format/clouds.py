"""Clouds in scene files: ``cloud: {file: scan.ply, radius: 0.005}`` in the place of an obstacle's shape."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from hdplan.scenes.clouds import Cloud, Ignored
from hdplan.scenes.fields import Field
from hdplan.scenes.fixed_array import FixedArray

SETTINGS = ("radius", "voxel", "drop_nan", "ignore_robot")  # as the class has them
IGNORED = ("link", "obstacle", "margin")


def read_cloud(section: Field) -> Cloud:
    """Read a cloud. Raises InputError for unknown keys and wrong values; its file is read when the scene is planned."""
    keys = section.mapping(("file", "points", *SETTINGS, "ignore"), required=["radius"])
    if ("file" in keys) == ("points" in keys):
        raise section.error("needs either a file or points")
    values: dict[str, object] = {key: keys[key] for key in SETTINGS if key in keys}
    if "file" in keys:
        values["points"] = keys["file"].path()
    else:
        keys["points"].items(of="points")  # a text would be taken for a file
        values["points"] = keys["points"]
    if "ignore" in keys:
        several = isinstance(keys["ignore"].value, list)
        entries = keys["ignore"].items(of="links and obstacles") if several else [keys["ignore"]]
        values["ignore"] = tuple(
            entry.make(Ignored, **entry.mapping(IGNORED, required=["margin"])) for entry in entries
        )
    cloud: Cloud = section.make(Cloud, **values)
    return cloud


def cloud_entry(cloud: Cloud, write_path: Callable[[Path], str]) -> dict[str, Any]:
    """Return what `read_cloud` reads back."""
    source = cloud.points
    entry: dict[str, Any] = (
        {"file": write_path(source)} if isinstance(source, Path) else {"points": source.array.tolist()}
    )
    entry |= {key: value for key in SETTINGS if (value := getattr(cloud, key))}
    if isinstance(cloud.radius, FixedArray):
        entry["radius"] = cloud.radius.array.tolist()
    if cloud.ignore:
        entry["ignore"] = [
            {key: value for key in IGNORED if (value := getattr(each, key)) is not None} for each in cloud.ignore
        ]
    return entry
