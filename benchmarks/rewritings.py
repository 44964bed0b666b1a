"""Rewrite scenes, robots, meshes and motions in other words of the same meaning, and see whether their proofs are still
written and accepted.

    python benchmarks/rewritings.py [--count N] [--seed S] [--scene NAME ...] [--keep DIR]

Every rewriting is legal: other orders of keys and elements, YAML's merges and anchors, flow and block style, comments,
numbers in other digits, the same orientation in other words, words that change nothing, meshes and motions in other
formats. hdplan proves the motion in the files so written, and the checker must accept. Prints a table with a row per
scene; what is not accepted goes to the error stream, with files in DIR.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import struct
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from campaign import meshes_of, table
from proven import proven
from scipy.spatial.transform import Rotation

import hdplan
from hdplan.scenes.robot_files.library import description_of
from hdplan.scenes.yaml_format.reader import find_scene

Random = np.random.Generator

SCENES = (
    *("planar_arm", "ur5_table", "ur5_payload", "panda_cup", "panda_cage", "panda_carry", "panda_heavy"),
    *("panda_conveyor", "panda_grasp"),
)
WORDS = ("a comment", "x: 1", "- 1", "{ [ ' #", "<<: *a", "é ü 手")


# --- numbers and comments ---------------------------------------------------------------------------------------------


def digits(rng: Random, value: float) -> str:
    """The same double in other decimal digits, as YAML 1.1 and XML read them."""
    text = repr(float(value))
    if float(value).is_integer() and abs(value) < 1e6 and rng.random() < 0.5:
        return str(int(value)) if value or not text.startswith("-") else "-0.0"
    if "e" in text or "." not in text:
        mantissa, _, power = text.partition("e")
        mantissa = mantissa if "." in mantissa else f"{mantissa}.0"
        return f"{mantissa}e{int(power or 0):+d}"
    sign, body = ("-", text[1:]) if text.startswith("-") else ("", text)
    whole, _, part = body.partition(".")
    forms = [body, body + "0", f"{whole}.{part}e+0", f"{whole}.{part}E-00", f"{whole}.{part}000"]
    if whole == "0" and part.strip("0"):
        forms += [f".{part}", f".{part}0", f"{part[0]}.{part[1:] or '0'}e-1"]
    elif part == "0" and body != "0.0":
        forms += [f"{whole}.", f"{whole[0]}.{whole[1:] or '0'}e+{len(whole) - 1}"]
    found = ("+" if not sign and rng.random() < 0.1 else sign) + str(rng.choice(forms))
    assert float(found) == value
    return found


def comment(rng: Random) -> str:
    return str(rng.choice(WORDS))


def shuffled(rng: Random, items: list[Any]) -> list[Any]:
    return [items[i] for i in rng.permutation(len(items))]


# --- scenes -----------------------------------------------------------------------------------------------------------

TAG = "tag:yaml.org,2002:"
WHOLE = ("hdplan", "waypoints")  # keys of whole numbers


class Nodes:
    """Makes YAML's nodes of values in random styles; what stands for several values is written with an anchor."""

    def __init__(self, rng: Random) -> None:
        self.rng = rng
        self.known = list[tuple[Any, yaml.Node]]()  # of lists and mappings

    def of(self, value: Any, key: str = "") -> yaml.Node:
        """The node of a value."""
        if isinstance(value, (dict, list)):
            twins = [node for other, node in self.known if other == value and repr(other) == repr(value)]
            if twins and self.rng.random() < 0.5:
                return twins[0]
            node = self.mapping(value, key == "top") if isinstance(value, dict) else self.sequence(value)
            self.known.append((value, node))
            return node
        if isinstance(value, bool) or value is None:
            word = "null" if value is None else str(value).lower()
            return yaml.ScalarNode(f"{TAG}{'null' if value is None else 'bool'}", word)
        if isinstance(value, str):
            return yaml.ScalarNode(f"{TAG}str", value, style=str(self.rng.choice(["", "'", '"'])) or None)
        if value == np.inf:
            return yaml.ScalarNode(f"{TAG}float", str(self.rng.choice([".inf", ".Inf", "+.inf"])))
        text = str(value) if isinstance(value, int) and key in WHOLE else digits(self.rng, value)
        return yaml.ScalarNode(f"{TAG}{'float' if '.' in text else 'int'}", text)

    def sequence(self, value: list[Any]) -> yaml.Node:
        return yaml.SequenceNode(f"{TAG}seq", [self.of(x) for x in value], flow_style=bool(self.rng.random() < 0.7))

    def mapping(self, value: dict[str, Any], top: bool) -> yaml.Node:
        """A mapping, part of which may be merged from others, whose other values it overrides."""
        rng, rest, pairs = self.rng, dict(value), list[Any]()
        fits = [(x, node) for x, node in self.known if isinstance(x, dict) and x and {*x} <= {*value}]
        if len(value) > 1 and rng.random() < 0.1 and not top:  # a mapping made for it, some of whose values are wrong
            keys = shuffled(rng, [*value])[: int(rng.integers(1, len(value)))]
            other = {k: value[k] if rng.random() < 0.7 else [0.5] for k in keys}
            fits = [(other, self.of(other))]
        if fits and not top and rng.random() < 0.7:
            other, node = fits[int(rng.integers(len(fits)))]
            rest = {k: x for k, x in rest.items() if repr(other.get(k)) != repr(x) or rng.random() < 0.2}
            node = yaml.SequenceNode(f"{TAG}seq", [node], flow_style=True) if rng.random() < 0.2 else node
            pairs.append((yaml.ScalarNode(f"{TAG}merge", "<<"), node))
        pairs += [(self.of(k), self.of(x, k)) for k, x in rest.items()]
        return yaml.MappingNode(f"{TAG}map", shuffled(rng, pairs), flow_style=bool(rng.random() < 0.4) and not top)


def scene_text(rng: Random, top: dict[str, Any]) -> str:
    """A scene as YAML in a random style, with comments."""
    node = Nodes(rng).of(top, "top")
    way: dict[str, Any] = {"indent": int(rng.integers(2, 7)), "explicit_start": bool(rng.integers(2))}
    way |= {"version": (1, 1)} if rng.random() < 0.2 else {}
    text = str(yaml.serialize(node, Dumper=yaml.SafeDumper, width=10**6, allow_unicode=True, **way))
    lines = list[str]()
    for line in text.splitlines():
        first = line.startswith(("%", "---"))
        lines += [" " * int(rng.integers(9)) + f"# {comment(rng)}"] * (not first and rng.random() < 0.1)
        lines.append(line + " # " * (not first and rng.random() < 0.1) + "  " * (rng.random() < 0.1))
    return "\n".join([*lines, *["", "# the end"][: rng.integers(3)], ""])


def other_angles(rng: Random, angles: list[float]) -> list[float]:
    """Roll, pitch and yaw of the same rotation: the other solution, or whole turns away."""
    roll, pitch, yaw = angles
    if rng.random() < 0.5:
        roll, pitch, yaw = roll + np.pi, np.pi - pitch, yaw - np.pi
    return [roll + 2 * np.pi * int(rng.integers(-1, 2)), pitch, yaw]


def turned(rng: Random, pose: dict[str, Any]) -> dict[str, Any]:
    """A pose whose orientation is written in another notation."""
    if "rpy" in pose:
        rotation = Rotation.from_euler("xyz", pose["rpy"])
    elif "quaternion_xyzw" in pose:
        rotation = Rotation.from_quat(pose["quaternion_xyzw"])
    else:
        none = [{}, {"rpy": [0, 0, 0.0]}, {"quaternion_xyzw": [0, 0, 0.0, rng.choice([-1, 1]).item()]}]
        return pose | none[rng.integers(3)]
    pose = {k: x for k, x in pose.items() if k not in ("rpy", "quaternion_xyzw")}
    if rng.random() < 0.4:
        return {**pose, "rpy": other_angles(rng, rotation.as_euler("xyz").tolist())}
    scale = rng.choice([1.0, -1.0]) * (1 + rng.choice([0.0, 1e-9, 5e-7, 3e-3]) * rng.uniform(-1, 1))
    return {**pose, "quaternion_xyzw": (rotation.as_quat() * scale).tolist()}


def reworded(rng: Random, value: Any, key: str = "") -> Any:
    """A scene's values in other words of the same meaning."""
    if isinstance(value, list):
        return [reworded(rng, x, "pose" if key == "poses" else "") for x in value]
    if not isinstance(value, dict):
        return value
    value = {k: reworded(rng, x, k) for k, x in value.items()}
    if key in ("pose", "base") and value.get("free_rotation", "none") == "none" and rng.random() < 0.7:
        value = turned(rng, value)
    if value.get("type") == "mesh" and not isinstance(value.get("scale", 1), list) and rng.random() < 0.5:
        value = {**value, "scale": [value.get("scale", 1)] * 3}
    return value


# --- XML --------------------------------------------------------------------------------------------------------------

NUMERIC = {"origin", "mass", "inertia", "box", "sphere", "cylinder", "limit", "axis", "mimic"}  # of numbers alone
SENSOR = '<sensor name="eye" type="camera"><origin xyz="1 2 3"/><update_rate>30</update_rate></sensor>'
HARMLESS = {  # elements that may be added
    "link": [SENSOR, "<gravity>1</gravity>", "<visual><geometry><box size='1 1 1'/></geometry></visual>"],
    "joint": ["<dynamics damping='0.1' friction='0'/>", "<calibration rising='0.0'/>"],
    "robot": ["<gazebo reference='x'><material>Red</material></gazebo>", "<material name='dark'/>"],
}


def spaces(rng: Random) -> str:
    return str(rng.choice(["", "", " ", "\n  ", "\t", "  \n"]))


def attribute(rng: Random, key: str, value: str, numeric: bool) -> str:
    """An attribute in other words: numbers in other digits, other quotes, other spaces."""
    if numeric and key != "joint":
        parts = [digits(rng, float(x)) for x in value.split()]
        value = spaces(rng).replace("\n", " ") + str(rng.choice([" ", "  ", "\t"])).join(parts)
    elif value and rng.random() < 0.1:
        value = f"&#{ord(value[0])};{value[1:]}" if value[0].isalnum() else value
    quote = str(rng.choice(["'", '"'])) if "'" not in value and '"' not in value else '"'
    gap = str(rng.choice(["", "", " "]))
    return f"{rng.choice([' ', '  ', chr(10)])}{key}{gap}={gap}{quote}{value}{quote}"


def xml_text(rng: Random, root: Any, srdf: bool) -> str:
    """A URDF or SRDF in another order, with comments, harmless additions and other spaces."""
    ordered = ("collision", "link", "chain", "group") if srdf else ("collision",)

    def of(element: Any, tag: str) -> str:
        children = [x for x in element if type(x.tag) is str]
        if srdf and tag == "disable_collisions" and rng.random() < 0.5 and {"link1", "link2"} <= {*element.attrib}:
            one, two = element.get("link1"), element.get("link2")
            element.set("link1", two), element.set("link2", one)
        if not srdf:
            children = [x for x in children if x.tag != "visual" or rng.random() < 0.8]
        given = dict(element.attrib)
        if not srdf and tag == "origin":
            given = {k: x for k, x in given.items() if any(map(float, x.split())) or rng.random() < 0.5}
            given |= {k: "0 0 0" for k in ("xyz", "rpy") if k not in given and rng.random() < 0.3}
        if not srdf and tag == "origin" and "rpy" in given and rng.random() < 0.2:
            given["rpy"] = " ".join(map(repr, other_angles(rng, [*map(float, given["rpy"].split())])))
        if not srdf and tag == "axis" and rng.random() < 0.2:  # of any length
            given["xyz"] = " ".join(repr(2.5 * float(x)) for x in given["xyz"].split())
        numeric, pairs = tag in NUMERIC and not srdf, shuffled(rng, [*given.items()])
        attributes = "".join(attribute(rng, k, x, numeric) for k, x in pairs)
        inner = children
        if tag in ("robot", "link", "joint"):
            kept = iter([x for x in children if x.tag in ordered])
            inner = [next(kept) if x.tag in ordered else x for x in shuffled(rng, children)]
        plain = ("link", "joint") if tag == "robot" and not srdf else [x.tag for x in inner if x.tag != "visual"]
        parts = [of(x, x.tag) if x.tag in plain else ElementTree.tostring(x, encoding="unicode") for x in inner]
        if not srdf and tag in HARMLESS and rng.random() < 0.2:
            new = str(rng.choice(HARMLESS[tag]))
            once = re.match(r"<(dynamics|calibration)", new)
            parts += [new] * (not (once and element.find(once[1]) is not None))
        text = (element.text or "").strip()
        parts = [y for x in parts for y in ([f"<!-- {comment(rng)} -->"] * (rng.random() < 0.05) + [x])]
        body = text + "".join(spaces(rng) + x for x in parts)
        if not body and rng.random() < 0.8:
            return f"<{tag}{attributes}{spaces(rng)}/>"
        return f"<{tag}{attributes}>{body}{'' if text else spaces(rng)}</{tag}>"

    head = str(rng.choice(["", '<?xml version="1.0"?>\n', "<?xml version='1.0' encoding='utf-8'?>\n<!-- made -->\n"]))
    return head + of(root, "robot") + str(rng.choice(["", "\n", "\n<!-- the end -->\n"]))


# --- meshes and motions -----------------------------------------------------------------------------------------------


def triangles_of(path: Path) -> Any:
    """The corners (F, 3, 3) of a binary STL file, or None for any other."""
    data = path.read_bytes()
    if path.suffix.lower() != ".stl" or len(data) != 84 + 50 * int.from_bytes(data[80:84], "little"):
        return None
    rows = np.frombuffer(data, np.dtype([("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")]), offset=84)
    return rows["v"].astype(float)


def mesh_written(rng: Random, corners: Any, path: Path) -> Path:
    """The same triangles as STL, text or binary, or as OBJ with groups."""
    kind = int(rng.integers(3))
    corners = corners[rng.permutation(len(corners))] if rng.random() < 0.5 else corners
    if kind == 0:
        head = str(rng.choice(["solid like text", "made"])).encode().ljust(80, b" ")
        body = b"".join(struct.pack("<12fH", 0, 0, 1, *x.ravel(), rng.integers(2)) for x in corners)
        path.write_bytes(head + struct.pack("<I", len(corners)) + body)
        return path
    if kind == 1:
        lines = ["solid a mesh"]
        for x in corners:
            lines += ["facet normal 0 0 1.0e+00", " outer loop"]
            lines += [f"  vertex {' '.join(digits(rng, y).lower() for y in v)}" for v in x.tolist()]
            lines += [" endloop", "endfacet"]
        text = "\n".join([*lines, "endsolid a mesh"]) + "\n"
        text = text.upper() if rng.random() < 0.1 else text
        path.write_bytes((text.replace("\n", "\r\n") if rng.random() < 0.3 else text).encode())
        return path
    path = path.with_suffix(str(rng.choice([".obj", ".OBJ"])))
    flat = corners.reshape(-1, 3)
    points, index = np.unique(flat, axis=0, return_inverse=True) if rng.random() < 0.7 else (flat, np.arange(len(flat)))
    lines = ["# a mesh", "mtllib none.mtl", "o body"] + [f"v {' '.join(map(repr, x))}" for x in points.tolist()]
    lines += ["vn 0 0 1", "vt 0 0"]
    for i, face in enumerate(index.reshape(-1, 3).tolist()):
        lines += [f"g part{i}", "s off", "usemtl grey"] * (rng.random() < 0.02)
        way = int(rng.integers(4))
        numbers = [x - len(points) if way == 3 else x + 1 for x in face]
        lines.append("f " + " ".join(f"{x}{('', '//1', '/1/1', '')[way]}" for x in numbers))
    path.write_text("\n".join(lines) + "\n", newline=str(rng.choice(["\n", "\r\n"])))
    return path


def motion_written(rng: Random, folder: Path, content: dict[str, Any]) -> Path:
    """The motion's JSON in another order, or CSV, with the joints in another order."""
    order, rates = rng.permutation(len(content["joint_names"])), ("positions", "velocities", "accelerations")
    content = {**content, "joint_names": [content["joint_names"][i] for i in order]}
    content |= {k: [[x[i] for i in order] for x in content[k]] for k in rates if content.get(k)}
    if rng.random() < 0.5:
        spared = [k for k in ("verdict", "interpolation", "steps") if rng.random() < 0.5]
        keys = [k for k in shuffled(rng, [*content]) if k not in spared]
        text = json.dumps({k: content[k] for k in keys}, indent=[None, 1, 4][rng.integers(3)])
        (folder / "motion.json").write_text(text.replace("\n", "\r\n") if rng.random() < 0.2 else text)
        return folder / "motion.json"
    columns = {"time": content["times"]} if content.get("times") else {}
    for rate, end in zip(rates, ("", ".velocity", ".acceleration"), strict=True):
        if content.get(rate):
            values = zip(content["joint_names"], zip(*content[rate], strict=True), strict=True)
            columns |= {name + end: list(column) for name, column in values}
    gap, names = str(rng.choice(["", " "])), shuffled(rng, [*columns]) if rng.random() < 0.5 else [*columns]
    quote = '"' * int(rng.random() < 0.3)
    lines = [f",{gap}".join(f"{quote}{x}{quote}" for x in names) if not gap else ",".join(names)]
    lines += [f",{gap}".join(digits(rng, columns[x][i]) for x in names) for i in range(len(content["positions"]))]
    end = str(rng.choice(["\n", "\r\n"]))
    mark = "\ufeff" if rng.random() < 0.2 else ""
    (folder / "motion.csv").write_text(mark + end.join([*lines, ""]), newline="")
    return folder / "motion.csv"


# --- the campaign -----------------------------------------------------------------------------------------------------


class Original:
    """A shipped scene with the files of its robot, and a planned motion."""

    def __init__(self, name: str) -> None:
        scene = hdplan.load_scene(name)
        self.name, self.folder = name, find_scene(name).parent
        self.top = yaml.safe_load(find_scene(name).read_text(encoding="utf-8"))
        _, urdf, srdf, _ = description_of(scene.robot)
        self.urdf: Any = ElementTree.parse(urdf).getroot()
        self.srdf: Any = None if srdf is None else ElementTree.parse(srdf).getroot()
        self.meshes = meshes_of(urdf)
        with tempfile.TemporaryDirectory() as folder:
            hdplan.plan(scene, time_limit=60).save(Path(folder) / "motion.json")
            self.motion = json.loads((Path(folder) / "motion.json").read_text())

    def rewrite(self, rng: Random, folder: Path) -> tuple[Path, Path]:
        """Write all files in other words; return the scene's and the motion's."""
        top, names = reworded(rng, self.top), self.motion["joint_names"]
        for end in ("start", "goal"):
            values = top[end].get("joints")
            if isinstance(values, list) and len(values) == len(names) and rng.random() < 0.5:
                top[end] = {"joints": dict(zip(names, values, strict=True))}
        robot = {k: x for k, x in top["robot"].items() if k not in ("name", "urdf", "srdf")}
        top = {**top, "robot": {**robot, "urdf": "robot.urdf"}}
        urdf = ElementTree.fromstring(ElementTree.tostring(self.urdf))
        for i, (address, path) in enumerate(self.meshes.items()):
            copy, corners = folder / f"m{i}_{path.name}", triangles_of(path)
            if corners is None:
                shutil.copy(path, copy)
            else:
                copy = mesh_written(rng, corners, copy)
            for x in urdf.iterfind("link/collision/geometry/mesh"):
                if x.get("filename") == address:
                    x.set("filename", copy.name)
        for file in self.folder.glob("*.obj"):
            shutil.copy(file, folder)
        self.write(rng, folder / "robot.urdf", xml_text(rng, urdf, srdf=False))
        if self.srdf is not None:
            top["robot"]["srdf"] = "robot.srdf"
            srdf = ElementTree.fromstring(ElementTree.tostring(self.srdf))
            self.write(rng, folder / "robot.srdf", xml_text(rng, srdf, srdf=True))
        self.write(rng, folder / "scene.yaml", scene_text(rng, top))
        return folder / "scene.yaml", motion_written(rng, folder, self.motion)

    @staticmethod
    def write(rng: Random, path: Path, text: str) -> None:
        """Write a text with lines that end as on one of two systems."""
        path.write_text(text, encoding="utf-8", newline=str(rng.choice(["\n", "\r\n"])))


def main() -> None:
    """Run the campaign from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scene", action="append", help=f"by default {', '.join(SCENES)}")
    parser.add_argument("--keep", type=Path, help="a folder for the files of what is not accepted")
    options = parser.parse_args()
    names = options.scene or SCENES
    originals, found = [Original(x) for x in names], {x: Counter[str]() for x in names}
    for number in range(options.count):
        original = originals[number % len(originals)]
        with tempfile.TemporaryDirectory() as place:
            files = original.rewrite(np.random.default_rng([options.seed, number]), Path(place))
            verdict = proven(*files)
            found[original.name][verdict.partition(":")[0]] += 1
            if verdict != "accepted":
                print(number, original.name, verdict.replace(place, ""), file=sys.stderr, flush=True)
                if options.keep:
                    shutil.copytree(place, options.keep / str(number), dirs_exist_ok=True)
    print(table(found, ("accepted", "not written", "rejected"), "scene"))


if __name__ == "__main__":
    main()
