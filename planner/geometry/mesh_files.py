"""Mesh files as vertices and triangles, read strictly: a file is complete, or it is refused.

Each format is read by its reader of `mesh_formats`, to which everything in a file is understood, known to be harmless,
or refused by name. The size of a file bounds what reading it may cost.
"""

from __future__ import annotations

import contextlib
import io
import logging
import warnings
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hdplan.planner.geometry.data_files import read_by_ending
from hdplan.planner.geometry.mesh_formats.collada import read_collada
from hdplan.planner.geometry.mesh_formats.gltf import read_gltf
from hdplan.planner.geometry.mesh_formats.gltf_container import buffer_names
from hdplan.planner.geometry.mesh_formats.obj import read_obj
from hdplan.planner.geometry.mesh_formats.off import read_off
from hdplan.planner.geometry.mesh_formats.ply import read_ply
from hdplan.planner.geometry.mesh_formats.scene_parts import MOST_TRIANGLES
from hdplan.planner.geometry.mesh_formats.stl import read_stl
from hdplan.planner.geometry.mesh_formats.text import shown
from hdplan.planner.geometry.mesh_formats.triangles import Triangles
from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.files import Stamps, read_file, stamps_of
from hdplan.scenes.lazy_imports import LazyModule
from hdplan.scenes.once import ForkSafeLock, made_once

if TYPE_CHECKING:
    import trimesh
else:
    trimesh = LazyModule("trimesh")

_reading = ForkSafeLock()  # warnings and trimesh's log belong to the whole process


def read_mesh_file(path: Path, upright: bool = False) -> Triangles:
    """Read a mesh file by its ending; `upright`: a file that says that another axis than z is up is refused.

    Raises InputError for a file that is missing, not a regular file, too large, of an unknown format, or damaged.
    """
    vertices, triangles = read_by_ending(path, FORMATS, upright)
    points, corners = np.array(vertices, dtype=np.float64), np.array(triangles, dtype=np.int64)
    if len(corners) == 0:
        raise InputError("is empty, it holds no triangles")
    if len(corners) > MOST_TRIANGLES:
        raise InputError(f"has {len(corners)} triangles; at most {MOST_TRIANGLES} are used: simplify it")
    return points, corners


# --- files beside a mesh file -----------------------------------------------------------------------------------------


def mesh_stamps(files: Iterable[Path]) -> Stamps:
    """Return the stamps of mesh files and of the files that hold their buffers, to be taken before they are read."""
    files = tuple(files)
    own = stamps_of(files)  # first: a glTF file that changes meanwhile may name others
    return own + stamps_of(beside for file in files for beside in files_beside(file))


def files_beside(path: Path) -> tuple[Path, ...]:
    """Return the files that hold the buffers of a glTF file; none for other files, and for one that cannot be read."""
    return _buffers(path, stamps_of([path])) if path.suffix.lower() in (".gltf", ".glb") else ()


@made_once(64)
def _buffers(path: Path, stamps: Stamps) -> tuple[Path, ...]:
    """Read which buffers a glTF file names, once while it stays as it is: stamps are taken at every use."""
    with contextlib.suppress(InputError):
        return tuple(path.parent / name for name in buffer_names(read_file(path)))
    return ()


def _beside(path: Path) -> Callable[[str], bytes]:
    """Return a reader of the files that a mesh file names."""

    def read(name: str) -> bytes:
        with naming(f"names the file {shown(name)}, which cannot be used"):
            return read_file(path.parent / name)

    return read


# --- drawing ----------------------------------------------------------------------------------------------------------


def read_scene(data: bytes, path: Path, on_reference: Callable[[str], object]) -> trimesh.Scene:
    """Return a mesh file's content as trimesh reads it, without warnings: its parts with their placements and
    colours. `on_reference` is called with the names of the files beside it that hold more, as they are wanted.

    Only for drawing a file that `read_mesh_file` has accepted, as trimesh overlooks much damage.
    """

    class Beside(trimesh.resolvers.FilePathResolver):  # type: ignore[misc]
        def get(self, name: str) -> bytes:
            on_reference(name)
            return _beside(path)(name)

    log = logging.getLogger("trimesh")
    quiet = logging.NullHandler()  # without a handler, complaints about colours and the like would go to stderr
    with _reading, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.filterwarnings("error", message="string or file could not be read")  # numbers left out
        log.addHandler(quiet)
        try:
            kind = path.suffix.lower().lstrip(".")
            return trimesh.load_scene(io.BytesIO(data), file_type=kind, resolver=Beside(str(path)), process=False)
        finally:
            log.removeHandler(quiet)


FORMATS: dict[str, Callable[[bytes, Path, bool], Triangles]] = {
    "stl": lambda data, *_: read_stl(data),
    "obj": lambda data, *_: read_obj(data),
    "off": lambda data, *_: read_off(data),
    "ply": lambda data, *_: read_ply(data),
    "dae": lambda data, _, upright: read_collada(data, upright),
    "glb": lambda data, path, _: read_gltf(data, _beside(path)),
    "gltf": lambda data, path, _: read_gltf(data, _beside(path)),
}
