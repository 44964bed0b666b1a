"""The parts of glTF files: chunks, JSON, and the bytes of buffers in the file or beside it."""

from __future__ import annotations

import base64
import binascii
import json
import math
import re
import struct
import urllib.parse
from collections import Counter
from typing import Any

import numpy as np

from hdplan.planner.geometry.mesh_formats.gltf_keys import Object
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError

JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942
DATA = re.compile(r"data:(?:application/octet-stream|application/gltf-buffer)?;base64,", re.IGNORECASE)


def text_and_binary(data: bytes) -> tuple[bytes, bytes | None]:
    """Return the text of a gltf or glb file, and the binary chunk of a glb file that has one."""
    if data[:4] != b"glTF":
        return data, None
    if len(data) < 20:
        raise InputError("is cut short: a glb file has at least 20 bytes")
    _, version, length, first, kind = struct.unpack_from("<5I", data)
    if version != 2 or kind != JSON_CHUNK:
        raise InputError(f"is of glb version {version}, its first chunk of kind {kind:#x}; version 2, JSON, is read")
    if length != len(data):
        raise InputError(f"says that it has {length} bytes; it has {len(data)}")
    if first % 4 or 20 + first > length:
        raise InputError(f"says that its first chunk has {first} bytes, of {length - 20}")
    rest = data[20 + first :]
    if rest:
        size, kind = struct.unpack_from("<2I", rest) if len(rest) >= 8 else (0, 0)
        if kind != BINARY_CHUNK or size % 4 or len(rest) != 8 + size:
            raise InputError(f"continues after its text with other content than one binary chunk ({len(rest)} bytes)")
    return data[20 : 20 + first], rest[8:] or None


def objects_of(text: bytes) -> Any:
    """Return the content of a JSON text. A key that appears twice has two readings: InputError."""

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        for key, count in Counter(key for key, _ in pairs).items():
            if count > 1:
                raise InputError(f"the key '{key[:60]}' appears twice in one object")
        return dict(pairs)

    def refused(word: str) -> float:
        raise InputError(f"holds {word}, which is not a JSON number")

    try:
        return json.loads(text.decode("utf-8"), object_pairs_hook=unique, parse_constant=refused)
    except (ValueError, RecursionError) as error:
        raise InputError(f"is no JSON in UTF-8, or cut short: {str(error)[:80]}") from None


def buffer_names(data: bytes) -> tuple[str, ...]:
    """Return the names of the files that hold a glTF file's buffers; none for a file that cannot be read."""
    try:
        addresses = [buffer["uri"] for buffer in objects_of(text_and_binary(data)[0])["buffers"] if "uri" in buffer]
        return tuple(file_name(uri) for uri in addresses if uri[:5].lower() != "data:")
    except (InputError, LookupError, TypeError, AttributeError):
        return ()


def file_name(uri: str) -> str:
    """Return the name of the file that a relative address means. Raises InputError for one that is not in the glTF
    file's folder or below it."""
    try:
        name = urllib.parse.unquote(uri, errors="strict")
    except ValueError:
        name = ""
    odd = re.search(r"[:?#]|%(?![0-9a-fA-F]{2})", uri) or "\\" in name or not name.isprintable()
    if odd or {"", ".", ".."} & set(name.split("/")):
        raise InputError(f"names the file '{uri[:60]}': only files in its own folder, or below it, are read")
    return name


def decoded(uri: str) -> bytes:
    """Return the bytes of an address that holds them itself."""
    head = DATA.match(uri)
    if not head:
        raise InputError(f"uri is '{uri[:50]}...'; base64 of application/octet-stream is read")
    try:
        return base64.b64decode(uri[head.end() :], validate=True)
    except (binascii.Error, ValueError) as error:
        raise InputError(f"uri is not base64: {error}") from None


def whole(owner: Object, key: str, place: str, otherwise: int | None = None) -> int:
    """Return a whole number of at least 0."""
    value = owner.get(key, otherwise)
    if type(value) is not int or not 0 <= value < 2**53:
        raise InputError(f"{place}: {key} is {str(value)[:40]}; a whole number of at least 0 is needed")
    return value


def one_of(owner: Object, key: str, place: str, allowed: tuple[int, ...]) -> int:
    """Return a whole number that must be one of several."""
    value = whole(owner, key, place)
    if value not in allowed:
        raise InputError(f"{place}: {key} is {value} (allowed here: {', '.join(map(str, allowed))})")
    return value


def numbers(owner: Object, key: str, place: str, otherwise: list[float]) -> Array:
    """Return a list of finite numbers, as many as there are in `otherwise`."""
    value = owner.get(key, otherwise)
    good = isinstance(value, list) and len(value) == len(otherwise) and all(type(x) in (int, float) for x in value)
    if not good or not all(abs(x) < math.inf and abs(x) < 10**300 for x in value):
        raise InputError(f"{place}: {key} is {str(value)[:60]}; {len(otherwise)} numbers are needed")
    return np.array(value, dtype=np.float64)


def listed(owner: Object, key: str, place: str) -> list[Any]:
    """Return a list; an empty one where there is none."""
    value = owner.get(key, [])
    if not isinstance(value, list):
        raise InputError(f"{place}: {key} is {str(value)[:40]!r}; a list is needed")
    return value
