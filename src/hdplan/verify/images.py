"""Tables of numbers in the files of cameras: PNG of one channel, NumPy's npy and npz. What is cut short, or holds more
than it says, is rejected."""

from __future__ import annotations

import ast
import io
import re
import struct
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from .balls import named, need

KINDS = (".png", ".npy", ".npz")
MOST_BYTES = 1 << 28  # of a table
PNG, NPY, ZIP = b"\x89PNG\r\n\x1a\n", b"\x93NUMPY", b"PK\x03\x04"
EXACT = 2.0**53  # up to which every whole number is a double


def table(path: Path, data: bytes, name: str) -> Any:
    """The numbers of a file, as doubles; in an npz those of the array `name`, or of the only one."""
    kind, what = path.suffix.lower(), named(path.name)
    if kind == ".npz":
        data = _member(data, name, what)
    return _png(data, what) if kind == ".png" else _npy(data, what)


def _member(data: bytes, name: str, what: str) -> bytes:
    need(data[:4] == ZIP, f"{what}: is not an npz file")
    with zipfile.ZipFile(io.BytesIO(data)) as held:
        names = held.namelist()
        need(len({*names}) == len(names) and all(x.endswith(".npy") for x in names), f"{what}: arrays of other names")
        need(f"{name}.npy" in names or len(names) == 1, f"{what}: has no array '{name}', and not just one")
        chosen = f"{name}.npy" if f"{name}.npy" in names else names[0]
        need(held.getinfo(chosen).file_size <= MOST_BYTES, f"{what}: is too large")
        return held.read(chosen)  # whose checksum is checked


def _npy(data: bytes, what: str) -> Any:
    size = {1: 2, 2: 4, 3: 4}.get(data[6], 0) if data[:6] == NPY else 0
    need(size and data[7] == 0, f"{what}: is not an npy file")
    begins = 8 + size + int.from_bytes(data[8 : 8 + size], "little")
    need(begins <= min(len(data), 10_000), f"{what}: is cut short")
    header = ast.literal_eval(data[8 + size : begins].decode("ascii").strip())
    need(type(header) is dict and {*header} == {"descr", "fortran_order", "shape"}, f"{what}: its head")
    kind, backwards, shape = header["descr"], header["fortran_order"], header["shape"]
    need(type(kind) is str and re.fullmatch(r"([<>][iuf][248])|(\|[biu]1)", kind), f"{what}: numbers of another kind")
    need(type(backwards) is bool and type(shape) is tuple, f"{what}: its head")
    need(all(type(x) is int and 0 < x < MOST_BYTES for x in shape), f"{what}: its shape")
    count = int(np.prod([1, *shape], dtype=object))
    need(len(data) - begins == count * int(kind[2]), f"{what}: holds more or less than it says")
    found = np.frombuffer(data, kind, offset=begins).reshape(shape, order="F" if backwards else "C")
    need(kind[1] == "f" or (np.abs(found.astype(np.float64)) < EXACT).all(), f"{what}: a number is too large")
    return found.astype(np.float64)


def _png(data: bytes, what: str) -> Any:
    need(data[:8] == PNG, f"{what}: is not a PNG file")
    at, chunks = 8, list[tuple[bytes, bytes]]()
    while at < len(data):
        size = int.from_bytes(data[at : at + 4], "big")
        kind, content, check = data[at + 4 : at + 8], data[at + 8 : at + 8 + size], data[at + 8 + size : at + 12 + size]
        need(check == zlib.crc32(kind + content).to_bytes(4, "big"), f"{what}: is cut short, or damaged")
        chunks.append((kind, content))
        at += 12 + size
    kinds = [kind for kind, _ in chunks]
    once = kinds[:1] == [b"IHDR"] and kinds[-1] == b"IEND" and kinds.count(b"IHDR") == kinds.count(b"IEND") == 1
    plain = all(x in (b"IHDR", b"IDAT", b"IEND") or x[:1].islower() for x in kinds) and b"acTL" not in kinds
    need(once and plain, f"{what}: is cut short, or no plain PNG")
    width, height, bits, *others = struct.unpack(">IIBBBBB", chunks[0][1])
    need(bits in (8, 16) and not any(others), f"{what}: 8 or 16 bits of one channel are expected, not interlaced")
    step, size = bits // 8, height * (1 + width * bits // 8)
    need(width > 0 and 0 < size <= MOST_BYTES, f"{what}: is empty, or too large")
    stream = zlib.decompressobj()
    raw = stream.decompress(b"".join(content for kind, content in chunks if kind == b"IDAT"), size + 1)
    need(len(raw) == size and stream.eof and not stream.unused_data, f"{what}: has more or fewer pixels than it says")
    rows, line = np.frombuffer(raw, np.uint8).reshape(height, -1), np.zeros(width * step, np.uint8)
    found = np.empty((height, width * step), np.uint8)
    for i, row in enumerate(rows):
        found[i] = line = _unfiltered(int(row[0]), row[1:], line, step, what)
    return found.view(">u2" if step == 2 else "u1").astype(np.float64)


def _unfiltered(way: int, row: Any, above: Any, step: int, what: str) -> Any:
    """The bytes of a row, of which a filter has left the differences from what is to the left, above, or from both."""
    need(way <= 4, f"{what}: a filter of another kind")
    if way == 0:
        return row
    if way == 1:
        return row.reshape(-1, step).cumsum(axis=0, dtype=np.uint8).ravel()
    if way == 2:
        return row + above
    left, corner, found = [0] * step, [0] * step, list[int]()
    for x, b in zip(row.tolist(), above.tolist(), strict=True):
        a, c = left.pop(0), corner.pop(0)
        if way == 3:
            guess = (a + b) // 2
        else:
            p, q, r = abs(b - c), abs(a - c), abs(a + b - 2 * c)
            guess = a if p <= q and p <= r else b if q <= r else c
        found.append((x + guess) & 255)
        left.append(found[-1])
        corner.append(b)
    return np.array(found, np.uint8)
