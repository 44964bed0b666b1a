"""COLLADA: what is written is what is read, as another reader has it, too; whatever else is refused by name."""

from __future__ import annotations

import itertools
import math
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from hdplan.planner.geometry.mesh_formats.collada import read_collada
from hdplan.scenes.errors import InputError
from tests.planner.geometry.other_readers import SAME, apart, by_assimp, by_trimesh, judged, read as read_file

SPACE = "http://www.collada.org/2005/11/COLLADASchema"
Part = tuple[np.ndarray, list[list[int]]]  # points and polygons


class Writer:
    """A COLLADA file made at random: legal, as odd as exporters are, and what its scene holds."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng, self.odd = rng, set[str]()
        self.kind = self.one(["flat", "chain", "any"])  # of the scene: what Assimp, through coal, knows, and more
        self.most = 2 if self.kind == "any" else 1
        meshes = [self.mesh(f"g{i}") for i in range(rng.integers(1, 4))]
        self.shared = ("", np.empty((0, 3, 3)))
        if self.kind == "any" and rng.random() < 0.4:
            self.shared = self.node(meshes, "shared", 1)
        depth = {"flat": 1, "chain": int(rng.integers(1, 5)), "any": 3}[self.kind]
        tops = [self.node(meshes, f"n{i}", depth) for i in range(1 if self.kind == "chain" else rng.integers(1, 4))]
        other = self.node(meshes, "elsewhere", 1)[0]  # in a scene that is not shown
        units = [(1.0, '<unit name="meter" meter="1"/>'), (0.001, '<unit meter="1e-3" name="mm"/>'), (1.0, "")]
        self.meter, unit = units[rng.choice(3, p=[0.63, 0.27, 0.1])]
        axis = self.one(["", *(f"<up_axis>{a}_UP</up_axis>" for a in "XYZ")])
        looks = self.one(["", '<library_cameras><camera id="g0"><optics/></camera></library_cameras>'])
        looks += self.one(["", '<library_materials><material id="m"/></library_materials><library_controllers/>'])
        scenes = [f'<visual_scene id="s">{"".join(text for text, _ in tops)}</visual_scene>']
        scenes.insert(rng.integers(0, 2), f'<visual_scene id="t">{other}</visual_scene>')
        libraries = [
            f"<library_geometries>{''.join(text for text, _ in meshes)}{self.extra()}</library_geometries>",
            f"<library_nodes>{self.shared[0]}</library_nodes>" if self.shared[0] else "",
            f"<library_visual_scenes>{''.join(scenes)}</library_visual_scenes>",
        ]
        if rng.random() < 0.3:
            self.odd.add("order")
            rng.shuffle(libraries)
        version = self.one(["1.4.0", "1.4.1"])
        self.text = (
            f'<?xml version="1.0"{self.one(["", " encoding=" + chr(34) + "utf-8" + chr(34)])}?>\n'
            f'<COLLADA xmlns="{SPACE}" version="{version}"><asset><contributor><author>é</author></contributor>{unit}'
            f"{axis}</asset>{looks}{''.join(libraries)}<scene><instance_visual_scene url='#s'/>{self.extra()}</scene>"
            "</COLLADA>"
        )
        if self.most > 1:
            self.odd.add("several")
        self.triangles = self.meter * np.concatenate([each for _, each in tops])

    def one(self, of: list[str]) -> str:
        return of[self.rng.integers(len(of))]

    def extra(self) -> str:
        if self.rng.random() < 0.02:
            self.odd.add("comment")
            return "<!-- <p>1</p> -->"
        return self.one(["", "<extra><technique profile='X'><p>1 2 x</p></technique></extra>"])

    def number(self, x: float) -> str:
        text = self.one([repr(float(x)), f"{x:.17g}", f"{x:.16e}", f"{x:+.17g}", f"{x:.16E}"])
        return text.replace("0.", ".", 1) if re.match(r"[-+]?0\.\d", text) and self.rng.random() < 0.2 else text

    def words(self, of: list[str]) -> str:
        return self.one(["", " ", "\n\t"]) + self.one([" ", "\n", "  ", "\t"]).join(of) + self.one(["", "\r\n"])

    def part(self) -> Part:
        """A prism, its ends polygons: flat also in single precision."""
        n, turn = int(self.rng.integers(3, 7)), self.rng.random()
        ring = [(math.cos(turn + 2 * math.pi * k / n), math.sin(turn + 2 * math.pi * k / n)) for k in range(n)]
        points = np.array([(x, y, z) for z in (-0.5, 0.5) for x, y in ring]) * self.rng.uniform(0.2, 2.0)
        sides = [[k, (k + 1) % n, n + (k + 1) % n, n + k] for k in range(n)]
        return points + self.rng.uniform(-2, 2, 3), [list(range(n))[::-1], list(range(n, 2 * n)), *sides]

    def mesh(self, name: str) -> tuple[str, np.ndarray]:
        points, polygons = self.part()
        elements, found = "", []
        for _ in range(self.rng.integers(1, self.most + 1)):
            text, rows = self.element(name, len(points), polygons)
            elements, found = elements + text + self.extra(), found + rows
        vertices = f'<vertices id="{name}v"><input semantic="POSITION" source="#{name}p"/></vertices>'
        sources = self.source(f"{name}p", points, True) + self.source(f"{name}n", points, False)
        text = f'<geometry id="{name}" name="a"><mesh>{sources}{vertices}{elements}</mesh></geometry>'
        return text, points[np.array(found).reshape(-1, 3)]

    def source(self, name: str, points: np.ndarray, odd: bool) -> str:
        """The points: their order, stride and offset as the accessor says."""
        order, stride, first = [0, 1, 2], 3, 0
        params = ["X", "Y", "Z"]
        if odd and self.rng.random() < 0.15:
            self.odd.add("accessor")
            order = self.rng.permutation(3).tolist()
            stride, first = int(self.rng.integers(4, 7)), int(self.rng.integers(0, 3))
            params = ["XYZ"[k] for k in order]
            params.insert(int(self.rng.integers(0, 4)), "")
        rows = self.rng.uniform(-9, 9, (len(points), stride))
        rows[:, [params.index(axis) for axis in "XYZ"]] = points
        numbers = [self.number(x) for x in (*np.zeros(first), *rows.ravel())]
        parameters = "".join(f'<param{f" name={chr(34)}{p}{chr(34)}" if p else ""} type="float"/>' for p in params)
        offset = f' offset="{first}"' if first else ""
        return (
            f'<source id="{name}"><float_array id="{name}a" count="{len(numbers)}">{self.words(numbers)}</float_array>'
            f'<technique_common><accessor source="#{name}a" count="{len(points)}" stride="{stride}"{offset}>'
            f"{parameters}</accessor></technique_common></source>"
        )

    def element(self, name: str, count: int, polygons: list[list[int]]) -> tuple[str, list[list[int]]]:
        """Some triangles of a mesh, as one of the elements that hold them."""
        tag = self.one(["triangles", "triangles", "polylist", "polylist", "polygons", "tristrips", "trifans"])
        self.odd.add(tag)
        fans = [[p[0], b, c] for p in polygons for b, c in itertools.pairwise(p[1:])]
        runs = polygons
        if tag == "triangles":
            runs = fans
        elif tag in ("tristrips", "trifans"):
            runs = [self.rng.permutation(count)[: self.rng.integers(3, 7)].tolist() for _ in range(3)]
            if tag == "trifans":
                fans = [[run[0], b, c] for run in runs for b, c in itertools.pairwise(run[1:])]
            else:
                strips = [(run[k : k + 3], k % 2) for run in runs for k in range(len(run) - 2)]
                fans = [[a, c, b] if turned else [a, b, c] for (a, b, c), turned in strips]
        at, others = int(self.rng.integers(0, 2)), int(self.rng.integers(0, 2))
        width = 1 + max(at, others)
        inputs = [f'<input semantic="VERTEX" source="#{name}v" offset="{at}"/>']
        inputs += [f'<input semantic="NORMAL" source="#{name}n" offset="{others}"/>']
        self.rng.shuffle(inputs)
        filled = [[str(i if k == at else 0) for i in run for k in range(width)] for run in runs]
        held = "".join(f"<p>{self.words(run)}</p>" for run in filled)
        if tag in ("triangles", "polylist"):
            sizes = f"<vcount>{self.words([str(len(run)) for run in runs])}</vcount>" if tag == "polylist" else ""
            held = f"{sizes}<p>{self.words([i for run in filled for i in run])}</p>"
        return f'<{tag} count="{len(runs)}" material="m">{"".join(inputs)}{held}</{tag}>', fans

    def node(self, meshes: list[tuple[str, np.ndarray]], name: str, depth: int) -> tuple[str, np.ndarray]:
        steps, matrix = "", np.eye(4)
        for _ in range(self.rng.integers(0, 4)):
            text, own = self.step()
            steps, matrix = steps + text, matrix @ own
        inside = self.one(["", '<instance_camera url="#c"/>', '<instance_light url="#l"/>'])
        found = [np.empty((0, 3, 3))]
        own_meshes = {"flat": 1, "chain": int(depth == 1), "any": self.rng.integers(depth // 3, 3)}[self.kind]
        for k in self.rng.integers(len(meshes), size=own_meshes):
            looks = self.one(["", "<bind_material><technique_common/></bind_material>"])
            inside += f'<instance_geometry url="#g{k}">{looks}</instance_geometry>'
            found.append(meshes[k][1])
        if depth > 1:
            text, triangles = self.node(meshes, f"{name}_", depth - 1)
            inside, found = inside + text, [*found, triangles]
        if self.shared[0] and self.rng.random() < 0.5:
            inside, found = inside + '<instance_node url="#shared"/>', [*found, self.shared[1]]
        placed = np.concatenate(found) @ matrix[:3, :3].T + matrix[:3, 3]
        if np.linalg.det(matrix[:3, :3]) < 0:
            self.odd.add("mirrored")
            placed = placed[:, ::-1]
        return f'<node id="{name}" name="a" type="NODE" layer="L">{steps}{inside}{self.extra()}</node>', placed

    def step(self) -> tuple[str, np.ndarray]:
        own, tag = np.eye(4), self.one(["translate", "rotate", "scale", "matrix"])
        if tag == "translate":
            own[:3, 3] = numbers = self.rng.uniform(-2, 2, 3)
        elif tag == "scale":
            numbers = self.rng.uniform(0.3, 2, 3) * (1 if self.rng.random() < 0.9 else np.array([1, -1, 1]))
            own[:3, :3] = np.diag(numbers)
        elif tag == "rotate":
            axis, angle = np.eye(3)[self.rng.integers(3)], self.rng.uniform(-400, 400)
            u, v = np.roll(axis, 1), np.roll(axis, 2)
            own[:3, :3] = np.outer(axis, axis) + math.cos(math.radians(angle)) * (np.outer(u, u) + np.outer(v, v))
            own[:3, :3] += math.sin(math.radians(angle)) * (np.outer(v, u) - np.outer(u, v))
            numbers = np.array([*axis, angle])
        else:
            own[:3] = self.rng.uniform(-0.7, 0.7, (3, 4)) + np.eye(4)[:3]
            numbers = own.ravel()
        return f"<{tag} sid='t'>{self.words([self.number(x) for x in numbers])}</{tag}>", own


# What in a file other readers read otherwise than it is meant. Assimp through coal leaves unit and axes out, both
# rightly and wrongly, and gives parts of a node, or of nodes below others, the vertices of the first part.
FAULTS = {
    by_assimp: {"accessor", "trifans", "mirrored", "any"},  # fans are cut as polygons, mirrored parts not turned
    by_trimesh: {"accessor", "trifans", "tristrips", "order", "comment"},  # all left out in silence
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("first", [0, 170, 340])
def test_170_files_are_read_as_written_and_as_others_read_them(first: int, tmp_path: Path) -> None:
    confirmed = Counter[str]()
    for seed in range(first, first + 170):
        made, path = Writer(np.random.default_rng(seed)), tmp_path / "a.dae"
        path.write_text(made.text, encoding="utf-8")
        ours = read_file(path)
        assert ours.shape == made.triangles.shape
        np.testing.assert_allclose(ours, made.triangles, rtol=0, atol=1e-12 * np.abs(ours).max(initial=0))
        reader = next((each for each, faults in FAULTS.items() if not faults & {*made.odd, made.kind}), None)
        if reader is not None:
            theirs = reader(path)
            assert theirs is not None
            assert apart(ours, made.meter * theirs) <= SAME, (seed, reader.__name__)
            confirmed[reader.__name__] += 1
    assert confirmed["by_assimp"] > 40
    assert confirmed["by_trimesh"] > 6


def spoilt(text: str, rng: np.random.Generator) -> str:
    """A file with one thing changed: an element, an attribute, a number or a letter."""
    tags, numbers = list(re.finditer(r"<[^>]*>", text)), list(re.finditer(r"(?<=[\s>])[-+.0-9eE]+(?=[\s<])", text))
    match rng.integers(7):
        case 0:  # an element is named otherwise, everywhere
            name = str(rng.choice(sorted(set(re.findall(r"<(\w+)", text)))))
            return re.sub(rf"(</?){name}\b", rf"\1{name}{rng.choice(['s', '_', 'A'])}", text)
        case 1:  # an attribute is named otherwise, or lost
            found = list(re.finditer(r' \w+="[^"]*"', text))
            one = found[rng.integers(len(found))]
            return text[: one.start()] + rng.choice(["", one[0].replace("=", "_=", 1)]) + text[one.end() :]
        case 2:  # another value
            found = list(re.finditer(r'="[^"]*"', text))
            one, other = (found[i] for i in rng.integers(len(found), size=2))
            return text[: one.start()] + other[0] + text[one.end() :]
        case 3:  # a number
            one = numbers[rng.integers(len(numbers))]
            words = ["1_0", "inf", "nan", "0x1", "1e999", "1,5", "٣", "", "7", "-1", "1.5", "1 2", "1e", "1e5"]
            word = rng.choice(words)
            return text[: one.start()] + word + text[one.end() :]
        case 4:  # something more
            one = tags[rng.integers(len(tags))]
            more = ["<skew>1 0 0 0 1 0 0</skew>", "<lookat>1 2 3 0 0 0 0 0 1</lookat>", "<scale>2 2 2</scale>"]
            more += ['<instance_controller url="#c"/>', '<instance_geometry url="#g0"/>']
            more += ["<ph><p>0 1 2</p></ph>", "<p>0 1 2</p>", "x"]
            return text[: one.end()] + str(rng.choice(more)) + text[one.end() :]
        case 5:  # a letter
            at = int(rng.integers(len(text)))
            return text[:at] + str(rng.choice(list('0123456789.- <>/"e'))) + text[at + 1 :]
        case _:  # cut short
            return text[: rng.integers(len(text))]


def test_spoilt_files_are_refused_or_read_as_others_read_them(tmp_path: Path) -> None:
    """A change is refused in one line, or changes no geometry, or Assimp sees the same change."""
    counts, path = Counter[str](), tmp_path / "a.dae"
    for seed in range(400):
        made = Writer(np.random.default_rng(seed % 100))
        if FAULTS[by_assimp] & {*made.odd, made.kind}:
            continue
        text = spoilt(made.text, np.random.default_rng([1, seed]))
        path.write_text(text, encoding="utf-8")
        unit = re.search(r'<unit[^>]* meter="([^"]*)"', text)

        def others(meter: str = unit[1] if unit else "1") -> list[np.ndarray]:
            theirs = by_assimp(path)
            assert theirs is not None
            return [theirs * float(meter)]

        counts[judged(path, made.triangles, others)] += 1
    assert counts["refused"] > 40
    assert counts["as others have it"] > 2


def points(name: str, numbers: str = "0 0 0 1 0 0 0 1 0 0 0 1") -> str:
    """A source of four points."""
    params = "".join(f'<param name="{axis}" type="float"/>' for axis in "XYZ")
    return (
        f'<source id="{name}p"><float_array id="{name}a" count="12">{numbers}</float_array><technique_common><accessor '
        f'source="#{name}a" count="4" stride="3">{params}</accessor></technique_common></source><vertices id="{name}v">'
        f'<input semantic="POSITION" source="#{name}p"/></vertices>'
    )


FACES = (
    '<triangles count="4"><input semantic="VERTEX" source="#gv" offset="0"/><p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles>'
)
PLAIN = (
    f'<COLLADA xmlns="{SPACE}" version="1.4.1"><asset><unit name="meter" meter="1"/><up_axis>Z_UP</up_axis></asset>'
    f'<library_geometries><geometry id="g"><mesh>{points("g")}{FACES}</mesh></geometry></library_geometries>'
    '<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/></node></visual_scene>'
    '</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>'
)


def read(text: str) -> np.ndarray:
    vertices, corners = read_collada(text.encode())
    return vertices[corners]


def test_units_are_kept_and_axes_stand_as_they_are_written() -> None:
    """RViz reads them so, and the placements in URDFs rely on it."""
    plain = read(PLAIN)
    assert np.array_equal(read(PLAIN.replace('meter="1"', 'meter="0.001"')), 0.001 * plain)
    assert np.array_equal(read(PLAIN.replace('<unit name="meter" meter="1"/>', "")), plain)
    for axis in ("X_UP", "Y_UP"):
        assert np.array_equal(read(PLAIN.replace("Z_UP", axis)), plain)


def test_coordinates_keep_double_precision() -> None:
    text = PLAIN.replace("0 0 0 1 0 0 0 1 0 0 0 1", "5000.0001 0 0 1 0 0 0 1 0 0 0 1.00000000000000022")
    assert read(text).max() == 5000.0001
    assert 1.0000000000000002 in read(text)


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        (SPACE, "http://example.org", "not COLLADA in a namespace of COLLADA"),
        ('version="1.4.1"', 'version="1.5.0"', r"version is '1.5.0' \(allowed in its namespace: 1.4.0, 1.4.1\)"),
        ("<COLLADA", '<!DOCTYPE a [<!ENTITY b "1">]><COLLADA', "document types"),
        ("<up_axis>Z_UP</up_axis>", "<up_axis>z</up_axis>", "up_axis is 'z'"),
        ('meter="1"', 'meter="0"', "meter is 0; a length above 0"),
        ('meter="1"', 'meter="1_0"', "meter: '1_0' is not a number"),
        ('meter="1"', "", "meter: '' is not a number"),
        ("</asset>", "</asset><library_x/>", "<COLLADA> holds <library_x>: it is not known here"),
        ('<geometry id="g">', '<geometry id="g"><asset><unit meter="2"/></asset>', "says its own <unit>"),
        ("<mesh>", "<mesh><spline/>", "<mesh> holds <spline>: curves are not read"),
        ("mesh>", "convex_mesh>", "<geometry> 'g' holds <convex_mesh>: hulls are not read"),
        ("mesh>", "brep>", "<brep>: curved surfaces are not read"),
        ("<triangles", "<trianglez/><triangles", r"<trianglez>: it is not known here \(did you mean 'triangles'\?\)"),
        ("<p>0", "<ph/><p>0", "<ph>: polygons with holes"),
        ("0 3 2 1", "0 3 2 <!-- 9 -->1", "<p> holds other things than text"),
        ("0 3 2 1", "0 3 2 4", "has vertex 4 .* there are 4 vertices"),
        ("0 3 2 1", "0 3 -2 1", "has vertex -2"),
        ("0 3 2 1", "0 3 2. 1", "'2.' is not a whole number"),
        ("0 3 2 1", "0 3 2", "do not have the stated corners"),
        ('triangles count="4"', 'triangles count="3"', "do not have the stated corners"),
        ('offset="0"', 'offset="1"', "ends within a corner|do not have the stated corners"),
        ('offset="0"', 'offset="0" more="1"', "the attribute 'more', which is not known"),
        ('semantic="VERTEX"', 'semantic="VERTICES"', "an <input> 'VERTICES', which is not known"),
        ('count="12"', 'count="11"', "says 11 numbers and holds 12"),
        ('count="4" stride', 'count="5" stride', "reaches beyond the 12 numbers"),
        ('name="Y"', 'name="Z"', "its parameters are 'X Z Z'; X, Y and Z are needed"),
        ('name="Y"', 'name="Y" semantic="Z"', "the attribute 'semantic'"),
        ("0 1 0 0 0 1<", "0 1 0 0 0 inf<", "'inf' is not a number"),
        ("0 1 0 0 0 1<", "0 1 0 0 0 ٣<", "characters that are in no number"),
        ("<instance_geometry", '<instance_controller url="#c"/><instance_geometry', "skins and morphs are not read"),
        ("<instance_geometry", "<skew>0 0 0 0 0 0 0</skew><instance_geometry", "<skew>: is not read"),
        ("<instance_geometry", "<lookat/><instance_geometry", "<lookat>: is not read"),
        ("<instance_geometry", "<scale>1 1</scale><instance_geometry", "<scale>: 3 numbers are needed"),
        ("<instance_geometry", "<rotate>0 0 2 1</rotate><instance_geometry", "its axis has length 2"),
        ("<instance_geometry", "<matrix>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 2</matrix><instance_geometry", "its last row"),
        ("<instance_geometry", '<instance_node url="#n"/><instance_geometry', "<node> 'n' instances itself"),
        ('url="#g"', 'url="other.dae#g"', "url 'other.dae#g' is not in this file"),
        ('url="#g"', 'url="#h"', "is that of no <geometry>"),
        ("</library_geometries>", '<geometry id="g"/></library_geometries>', "is that of 2 <geometry>"),
        ("</visual_scene>", '<x:node xmlns:x="u"/></visual_scene>', "<{u}node>: it is not known here"),
        ("<scene>", "<scene><instance_physics_scene/>", "what physics moves is not read"),
        ("<scene>", "<scene><instance_kinematics_scene/>", "what joints move is not read"),
        ('<scene><instance_visual_scene url="#s"/></scene>', "", "<COLLADA> has no <scene>; one is needed"),
        ("<library_visual", "<library_animations><animation/></library_animations><library_visual", "parts that move"),
        ("</COLLADA>", "", "not well-formed XML, or is cut short"),
    ],
)
def test_unsupported_content_is_refused_by_name(before: str, after: str, words: str) -> None:
    assert before in PLAIN
    with pytest.raises(InputError, match=words):
        read(PLAIN.replace(before, after))


def test_instances_cannot_cost_more_than_a_mesh_may_hold() -> None:
    """Nodes that instance each other twice, thirty levels deep."""
    twice = '<node id="n{0}"><instance_node url="#n{1}"/><instance_node url="#n{1}"/></node>'
    nodes = "".join(twice.format(i, i + 1) for i in range(30))
    library = f'<library_nodes>{nodes}<node id="n30"><instance_geometry url="#g"/></node></library_nodes>'
    text = PLAIN.replace("<library_visual", f"{library}<library_visual")
    with pytest.raises(InputError, match="places more than 100000 geometries"):
        read(text.replace('url="#g"/></node></visual', 'url="#g"/><instance_node url="#n0"/></node></visual'))


def test_a_camera_that_looks_at_something_or_an_unused_curve_is_no_matter() -> None:
    more = '<geometry id="h"><spline/></geometry></library_geometries>'
    more += "<library_controllers><controller/></library_controllers>"
    text = PLAIN.replace("<node", "<node><lookat/><instance_camera/></node><node")
    assert np.array_equal(read(text.replace("</library_geometries>", more)), read(PLAIN))
