"""Geoms and meshes of an MJCF, as collision and visual geometry of a URDF."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.number_text import read_whole
from hdplan.scenes.poses import Pose, compose
from hdplan.scenes.robot_files.mjcf_classes import DefaultClasses
from hdplan.scenes.robot_files.mjcf_values import Attributes, Settings, between, flag, numbers
from hdplan.scenes.robot_files.urdf_writing import origin, words

SIZES = {"box": 3, "ellipsoid": 3, "sphere": 1, "cylinder": 2, "capsule": 2, "mesh": 0}  # numbers of `size`
HINTS = {
    "plane": "; a floor is an obstacle of the scene: give it there, as a box",
    "hfield": "; terrain is an obstacle of the scene",
}


@dataclass(frozen=True)
class Geoms:
    """Elements of one file that geoms name."""

    folder: Path  # of the file
    settings: Settings
    classes: DefaultClasses
    meshes: Mapping[str, Element]
    paired: Collection[str]  # names of geoms that collide with one another whatever their masks

    @classmethod
    def of(cls, root: Element, folder: Path, settings: Settings, classes: DefaultClasses) -> Geoms:
        """Collect the meshes by name. Raises InputError for one that is not of a file, or whose name is taken."""
        meshes: dict[str, Element] = {}
        for mesh in root.findall("asset/mesh"):
            file = mesh.get("file")
            if file is None:
                raise InputError(f"mesh '{mesh.get('name', '')}': only meshes of files are supported")
            name = mesh.get("name") or Path(file).stem
            if name in meshes:
                raise InputError(f"mesh '{name}': the name is taken; names must differ")
            meshes[name] = mesh
        paired = {pair.get(key, "") for pair in root.findall("contact/pair") for key in ("geom1", "geom2")}
        named = {geom.get("name") for geom in root.iter("geom")}
        for name in sorted(paired - named):
            raise InputError(f"contact: pair: unknown geom '{name}'{nearest(name, filter(None, named))}")
        return cls(folder, settings, classes, meshes, paired)

    def add(self, link: Element, geom: Element, frame: Pose, where: str, inherited: str) -> None:
        """Add a geom that stands in a frame of a body to the body's link.

        Geoms that collide with nothing (contype and conaffinity 0, and in no pair of the `contact` section) are
        visuals, and left out where URDF has no such shape. Raises InputError for other shapes, and for sizes that are
        none.
        """
        own = self.classes.applied(geom, inherited)
        collides = any(_mask(own, key, where) for key in ("contype", "conaffinity")) or own.get("name") in self.paired
        kind = own.get("type", "sphere")
        if kind not in SIZES or (kind != "mesh" and "mesh" in own):
            if not collides:
                return
            what = f"{kind} fitted to a mesh" if kind in SIZES else kind
            raise InputError(
                f"{where}: type '{what}' is not supported (allowed: {', '.join(SIZES)}){HINTS.get(kind, '')}"
            )
        pose, size = self._placed(own, kind, where)
        part = SubElement(link, "collision" if collides else "visual")
        part.append(origin(compose(frame, pose)))
        shape = SubElement(SubElement(part, "geometry"), kind)
        match kind:
            case "box":
                shape.set("size", words(2 * value for value in size))
            case "ellipsoid":
                shape.set("radii", words(size))
            case "sphere":
                shape.set("radius", words(size))
            case "mesh":
                shape.attrib.update(self._mesh(own.get("mesh", ""), where))
            case _:
                shape.attrib.update({"radius": words(size[:1]), "length": words([2 * size[1]])})

    def _placed(self, own: Attributes, kind: str, where: str) -> tuple[Pose, list[float]]:
        """Return a geom's pose and its sizes."""
        size = list(numbers(own, "size", where, "")) if kind != "mesh" and "size" in own else []
        if "fromto" in own:
            if kind not in ("capsule", "cylinder"):
                raise InputError(f"{where}: fromto goes with capsules and cylinders")
            if "pos" in own:
                raise InputError(f"{where}: pos and fromto say the same: leave one out")
            pose, half = between(own, where)
            size = [*size[:1], half]
        else:
            pose = self.settings.pose(own, where)
        needed = SIZES[kind]
        if len(size) < needed or not all(value > 0 for value in size[:needed]):
            expected = f"{needed} numbers" if needed > 1 else "a number"
            raise InputError(f"{where}: size must be {expected} greater than 0 [m], found '{own.get('size', '')}'")
        return pose, size[:needed]

    def _mesh(self, name: str, where: str) -> dict[str, str]:
        if name not in self.meshes:
            raise InputError(f"{where}: unknown mesh '{name}'{nearest(name, self.meshes)}")
        own, settings = self.classes.applied(self.meshes[name]), self.settings.own
        file = own["file"]
        if flag(settings, "strippath", "compiler", "false"):
            file = Path(file).name
        file = str((self.folder / (settings.get("meshdir") or settings.get("assetdir") or "") / file).absolute())
        return {"filename": f"file://{file}", "scale": words(numbers(own, "scale", f"mesh '{name}'", "1 1 1", 3))}


def _mask(own: Attributes, key: str, where: str) -> int:
    try:
        return read_whole(own.get(key, "1"))
    except ValueError:
        raise InputError(f"{where}: {key} must be a whole number, found '{own[key]}'") from None
