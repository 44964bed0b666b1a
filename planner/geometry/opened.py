"""The files of shapes: meshes, clouds, depth images and maps are opened here, when a scene and its robot become a
`Setup`, and nowhere else.

Scene -> the same scene with the content of every shape in memory: triangles, balls, cells. Whoever plans, judges or
draws then works with one and the same content, also when a file changes meanwhile.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar

from hdplan.planner.geometry.clouds import read_cloud
from hdplan.planner.geometry.mesh_files import mesh_stamps
from hdplan.planner.geometry.meshes import ReadMesh, load_mesh
from hdplan.planner.geometry.voxel_grids import read_map
from hdplan.scenes.attached import Attached
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.deadline import check_time
from hdplan.scenes.errors import naming
from hdplan.scenes.files import Stamps
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.once import made_once
from hdplan.scenes.scene import Scene, derived
from hdplan.scenes.shapes import Mesh
from hdplan.scenes.voxel_grids import OctoMap, Voxels

KEPT_MESHES = 16  # meshes that stay in memory while their files do not change: large ones take 50 MB each

Holder = TypeVar("Holder", Obstacle, Attached)


def opened(scene: Scene) -> Scene:
    """Return a scene with the files of its obstacles and held objects read; itself if there are none. Raises
    InputError, naming the scene's file, the obstacle and the file, for one that cannot be used."""
    with naming(scene.source):
        obstacles = tuple(with_content(each, "obstacles") for each in scene.obstacles)
        attached = tuple(with_content(each, "attached") for each in scene.attached)
    if all(one is other for one, other in zip(obstacles + attached, scene.obstacles + scene.attached, strict=True)):
        return scene
    return derived(scene, obstacles=obstacles, attached=attached)


def with_content(holder: Holder, field: str) -> Holder:
    """Return an obstacle or a held object with the file of its shape read; itself if there is none. `field` is the list
    of the scene that holds it, for error messages. Raises InputError for a file that cannot be used."""
    check_time("reading the scene's files")
    read = _read(holder.shape, f"{field}.{holder.name}")
    return holder if read is holder.shape else replace(holder, shape=read)


def _read(shape: Any, where: str) -> Any:
    match shape:
        case Mesh() if not isinstance(shape, ReadMesh):
            return _read_mesh(shape, where, mesh_stamps([shape.file]))
        case Cloud():
            return read_cloud(shape, where)
        case OctoMap() | Voxels():
            return read_map(shape, where)
    return shape


@made_once(KEPT_MESHES)
def _read_mesh(shape: Mesh, where: str, stamps: Stamps) -> ReadMesh:
    """Read a mesh; the stamps make a file that was written again another one."""
    return ReadMesh(shape.file, shape.scale, mesh=load_mesh(shape, where, upright=True))
