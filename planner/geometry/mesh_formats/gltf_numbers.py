"""The numbers of a glTF file: accessors, which see values in buffer views, which are parts of buffers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from hdplan.planner.geometry.mesh_formats.gltf_container import (
    decoded,
    file_name,
    listed,
    objects_of,
    one_of,
    text_and_binary,
    whole,
)
from hdplan.planner.geometry.mesh_formats.gltf_keys import QUANTIZED, Object, check_extensions, checked
from hdplan.planner.geometry.mesh_formats.scene_parts import MOST_TRIANGLES
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.errors import InputError, naming

Beside = Callable[[str], bytes]  # name of a file beside the one that is read -> its content

TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}  # of componentType
FLOAT, QUANTA, INDICES = 5126, (5120, 5121, 5122, 5123), (5121, 5123, 5125)
MOST_STRIDE = 252  # [bytes] that the standard allows
MOST_VALUES = 3 * MOST_TRIANGLES


class GltfFile:
    """The objects of a file, each checked where it is used, and their numbers."""

    def __init__(self, data: bytes, beside: Beside) -> None:
        """Check what concerns the whole file: its version, its extensions, that nothing moves."""
        text, self.binary = text_and_binary(data)
        self.top, self.beside = checked(objects_of(text), "file", "the file"), beside
        asset = checked(self.top.get("asset"), "asset", "asset")
        for key, value in (("version", asset.get("version")), ("minVersion", asset.get("minVersion", "2.0"))):
            if value != "2.0":
                raise InputError(f"asset: {key} is {str(value)[:20]!r}; glTF 2.0 is read")
        for key in ("extensionsRequired", "extensionsUsed"):
            check_extensions(listed(self.top, key, "the file"), key)
        if listed(self.top, "animations", "the file"):
            raise InputError("has animations: parts that move are not read: export it without")
        self.quantized = QUANTIZED in listed(self.top, "extensionsRequired", "the file")
        self.buffers: dict[int, bytes] = {}
        if self.binary is not None and "uri" in self.item("buffers", 0, "buffer", "the binary chunk")[0]:
            raise InputError("has a binary chunk and a first buffer that lies elsewhere")

    def item(self, key: str, index: Any, kind: str, place: str) -> tuple[Object, str]:
        """Return an object of one of the file's lists, to which `place` refers, and its own place, for errors."""
        items = listed(self.top, key, "the file")
        if type(index) is not int or not 0 <= index < len(items):
            raise InputError(f"{place} refers to {key}[{str(index)[:20]}]; there are {len(items)}")
        return checked(items[index], kind, f"{key}[{index}]"), f"{key}[{index}]"

    def points(self, index: Any, place: str) -> Array:
        """Return the points (n, 3) of an accessor. Whole numbers k of b bits stand for themselves, or, if normalized,
        for max(k / K, -1) with the largest one, K."""
        accessor, place = self.item("accessors", index, "accessor", place)
        kind = one_of(accessor, "componentType", place, (FLOAT, *(QUANTA if self.quantized else ())))
        normalized = accessor.get("normalized", False)
        if not isinstance(normalized, bool) or (normalized and kind == FLOAT):
            raise InputError(f"{place}: normalized is {str(normalized)[:20]}, of componentType {kind}")
        values = self.accessed(accessor, place, kind, "VEC3", 3).astype(np.float64)
        return np.maximum(values / np.iinfo(TYPES[kind]).max, -1.0) if normalized else values

    def indices(self, index: Any, place: str) -> Rows:
        """Return the whole numbers (n,) of an accessor."""
        accessor, place = self.item("accessors", index, "accessor", place)
        kind = one_of(accessor, "componentType", place, INDICES)
        if accessor.get("normalized", False) is not False:
            raise InputError(f"{place}: normalized is {str(accessor['normalized'])[:20]}, of indices")
        return self.accessed(accessor, place, kind, "SCALAR", 1).ravel().astype(np.int64)

    def accessed(self, accessor: Object, place: str, kind: int, shape: str, size: int) -> Array:
        """Return the values (n, size) of an accessor as they are stored, those of a sparse one replaced."""
        if accessor.get("type") != shape:
            raise InputError(f"{place}: type is {str(accessor.get('type'))[:20]!r}; {shape} is needed")
        count = whole(accessor, "count", place)
        if not 0 < count <= MOST_VALUES:
            raise InputError(f"{place}: count is {count}; 1 to {MOST_VALUES} are read")
        if "bufferView" not in accessor and ("sparse" not in accessor or "byteOffset" in accessor):
            raise InputError(f"{place} has no bufferView: its numbers are missing")
        values = np.zeros((count, size), dtype=TYPES[kind])
        if "bufferView" in accessor:
            values[:] = self.viewed(accessor, place, kind, count, size)
        if "sparse" in accessor:
            place = f"{place}.sparse"
            sparse = checked(accessor["sparse"], "sparse", place)
            at, new = (checked(sparse.get(key), f"sparse {key}", f"{place}.{key}") for key in ("indices", "values"))
            changed = whole(sparse, "count", place)
            if not 0 < changed <= count:
                raise InputError(f"{place}: count is {changed}; 1 to {count} are possible")
            kind_of_rows = one_of(at, "componentType", f"{place}.indices", INDICES)
            rows = self.viewed(at, f"{place}.indices", kind_of_rows, changed, 1).ravel().astype(np.int64)
            if (np.diff(rows) <= 0).any() or rows[-1] >= count:
                raise InputError(f"{place}.indices do not increase, or reach beyond the {count} values")
            values[rows] = self.viewed(new, f"{place}.values", kind, changed, size)
        return values

    def viewed(self, owner: Object, place: str, kind: int, count: int, size: int) -> Array:
        """Return rows (count, size) of a buffer view. Only points may lie apart, in strides."""
        view, name = self.item("bufferViews", owner.get("bufferView"), "bufferView", place)
        data, width = self.buffer(view.get("buffer"), name), np.dtype(TYPES[kind]).itemsize
        first, length = whole(view, "byteOffset", name, 0), whole(view, "byteLength", name)
        offset, packed = whole(owner, "byteOffset", place, 0), size * width
        stride = whole(view, "byteStride", name, packed)
        if first + length > len(data):
            raise InputError(f"{name} reaches beyond its buffer, which has {len(data)} bytes")
        if not packed <= stride <= (MOST_STRIDE if owner.get("type") == "VEC3" else packed):
            raise InputError(f"{name}: byteStride is {stride}, for values of {packed} bytes")
        if offset + stride * (count - 1) + packed > length:
            raise InputError(f"{place} reaches beyond {name}, which has {length} bytes")
        return np.ndarray((count, size), TYPES[kind], data, first + offset, (stride, width))

    def buffer(self, index: Any, place: str) -> bytes:
        """Return the bytes of a buffer: in the file, or beside it."""
        buffer, place = self.item("buffers", index, "buffer", place)
        if index not in self.buffers:
            length, uri = whole(buffer, "byteLength", place), buffer.get("uri")
            with naming(place):
                if "uri" not in buffer:
                    found = self.binary if index == 0 else None
                    if found is None or len(found) - length >= 4:
                        raise InputError(f"has no uri, and no binary chunk of {length} bytes")
                elif not isinstance(uri, str):
                    raise InputError(f"uri is {str(uri)[:40]!r}; a text is needed")
                else:
                    found = decoded(uri) if uri[:5].lower() == "data:" else self.beside(file_name(uri))
                if len(found) < length:
                    raise InputError(f"is cut short: it says {length} bytes and has {len(found)}")
            self.buffers[index] = found[:length]
        return self.buffers[index]
