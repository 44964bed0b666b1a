"""The editors' schema says what the reader says: of shipped scenes, and of scenes broken at random."""

from __future__ import annotations

import copy
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from jsonschema import Draft7Validator

from hdplan.scenes.errors import InputError
from hdplan.scenes.yaml_format.reader import SECTIONS, load_scene, shipped_jobs, shipped_scenes
from hdplan.scenes.yaml_format.schema import scene_schema, schema_text

SHIPPED = shipped_scenes()
FILE = SHIPPED["empty"].parents[1] / "scene.schema.json"
VALIDATOR = Draft7Validator(scene_schema())

# What the reader refuses and a schema cannot say: numbers and sections together, files, keys that JSON does not have.
ABOUT_MEANING = re.compile(
    r"must be a unit quaternion|must be points that span|is not physical|must increase|with low < high|is taken by an"
    r"|(torque|duration|acceleration) is missing|must be a (file|directory), but|must be as many as|has no meaning"
    r"|stands beside|has no orientation|rows at a rate of|must name two different links|is infinite along"
    r"|which has a length above 0|a whole number .* found -?[0-9]+\.0|keys must be names"
    r"|the first smaller|two different bodies|must be another link than|unknown obstacle|names no link"
    r"|has a pose already"
)

FULL = """
hdplan: 1
robot: {urdf: planar_arm.urdf, srdf: planar_arm.srdf, package_dirs: [.], group: arm,
  locked: {j: 0.5}, ignore_pairs: [[a, b]]}
obstacles:
  - {name: a, shape: {type: box, size: [1, 1, 1]}, pose: {position: [0, 0, 9], rpy: [0, 0, 1]}, clearance: 0.1}
  - {shape: {type: cylinder, radius: 1, length: 2}, motion: {velocity: [0, 0, 1], spin: [0, 0, 1]}}
  - {shape: {type: capsule, radius: 1, length: 2}, motion: {times: [0, 1],
    poses: [{position: [0, 0, 1]}, {position: [0, 0, 2]}]}}
  - {shape: {type: points, points: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]}}
  - {shape: {type: mesh, file: hook.obj, scale: [1, 2, 1]}, pose: {quaternion_xyzw: [0, 0, 0, 1]}}
  - {name: view, cloud: {file: hook.obj, radius: 0.01, voxel: 0.02, drop_nan: true, ignore_robot: 0.02}}
  - {name: more, cloud: {points: [[1, 0, 0], [0, 1, 0]], radius: 0.01,
    ignore: [{obstacle: a, margin: 0.1}, {link: b, margin: 0}]}}
  - {name: depth, depth: {file: hook.obj, intrinsics: [1, 1, 0, 0], scale: 0.01, range: [0, 1], radius: 0.1}}
  - {name: here, depth: {image: [[1, 2], [3, .nan]], intrinsics: [1, 1, 0, 0], ignore: {obstacle: a, margin: 0.1}}}
  - {name: map, octomap: {file: hook.obj, unknown: occupied}}
  - {name: held, octomap: {content: AQI=}}
  - {name: grid, voxels: {file: hook.obj, size: 0.1, origin: [0, 0, 1]}}
  - {name: cell, voxels: {occupied: [[[1, 0]]], size: 0.1}}
  - {name: last, cloud: {points: [[1, 0, 0]], radius: 0.01, ignore: {link: b, margin: 0.1}}, clearance: 0.1}
attached: [{link: tool, shape: {type: sphere, radius: 0.1}, touch_links: [a], mass: 2}]
start: {joints: {a: 1, b: 2}}
goal: {poses: [{link: tool, position: [1, 0, 0], rpy: [0, 0, 0], position_tolerance: 0.01, free_rotation: x}]}
self_collision: {clearance: 0.01}
limits: {position: {a: [-1, 1]}, velocity: urdf, acceleration: 4, jerk: [1, 2, 3], torque: {a: 5}}
payload: {link: tool, mass: 5, com: [0, 0, 0.08], inertia: [0.01, 0, 0, 0.01, 0, 0.01]}
path:
  upright: {link: tool, axis: -z, tolerance: 0.1}
  position: {link: tool, size: [1, .inf, 1], position: [0, 0, 0]}
  relative: {link: tool, to: a, pose: {position: [0, 0, 1], rpy: [0, 0, 1]}, position_tolerance: 0.01}
timing: {duration: 2, rate: 50}
planner: {waypoints: 40, clearance: 0.005, gamma: 3, swept: true, normals: sphere, distance: fcl}
"""

JOB = """
hdplan: 1
robot: {name: panda}
start: {state: default}
limits: {acceleration: 4}
job:
  - {name: above, move: {state: default}, path: {upright: {link: a}}, limits: {jerk: 5}, speed: 0.5}
  - {line: {by: [0, 0, 1], frame: tool, link: a, position_tolerance: 0.01}, touch: [[a, b], [a, [c, d]]]}
  - {line: {to: [0, 0, 1]}}
  - {grip: {object: can, joints: {a: 1}, link: b, mass: 2}}
  - {release: {joints: {a: 1}}}
  - {wait: 0.5}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files that scenes name."""
    found = tmp_path_factory.mktemp("scenes")
    for file in ("hook.obj", "planar_arm.urdf", "planar_arm.srdf"):
        shutil.copy(SHIPPED["empty"].with_name(file), found)
    return found


def messages(content: Any, folder: Path) -> tuple[str | None, str | None]:
    """Objections of reader and schema to a scene; None: none."""
    file = folder / "scene.yaml"
    file.write_text(yaml.dump(content, Dumper=yaml.CSafeDumper), encoding="utf-8")
    refused = None
    try:
        load_scene(file)
    except InputError as error:
        refused = str(error).removeprefix(f"{file}: ")
    wrong = next(VALIDATOR.iter_errors(content), None)
    return refused, wrong and f"{wrong.json_path}: {wrong.message}"


def test_the_file_is_fresh() -> None:
    """`hdplan schema > scenes/scene.schema.json` writes it."""
    Draft7Validator.check_schema(scene_schema())
    assert FILE.read_text(encoding="utf-8") == schema_text()


def test_every_section_is_described() -> None:
    assert list(scene_schema()["properties"]) == list(SECTIONS)
    assert all(scene_schema()["properties"].values())


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenes_keep_to_it_and_say_so_to_editors(name: str) -> None:
    written = SHIPPED[name].read_text(encoding="utf-8")
    assert written.startswith("# yaml-language-server: $schema=../scene.schema.json\n")
    assert (SHIPPED[name].parent / "../scene.schema.json").resolve() == FILE.resolve()
    assert not list(VALIDATOR.iter_errors(yaml.safe_load(written)))


@pytest.mark.parametrize("name", shipped_jobs())
def test_shipped_jobs_keep_to_it(name: str) -> None:
    written = shipped_jobs()[name].read_text(encoding="utf-8")
    assert written.startswith("# yaml-language-server: $schema=../../scene.schema.json\n")
    assert not list(VALIDATOR.iter_errors(yaml.safe_load(written)))


def test_a_scene_with_everything_keeps_to_it(folder: Path) -> None:
    assert messages(yaml.safe_load(FULL), folder) == (None, None)
    assert messages(yaml.safe_load(JOB), folder) == (None, None)


def test_both_refuse_the_same_broken_scenes(folder: Path) -> None:
    """Unknown and missing keys, other types, numbers out of range, lists too long and too short: 200 that both refuse,
    none that the schema alone does, and what the reader alone does is about what values mean together."""
    rng = np.random.default_rng(14)
    whole = [yaml.safe_load(file.read_text(encoding="utf-8")) for file in SHIPPED.values()]
    whole += 20 * [yaml.safe_load(FULL)] + 10 * [yaml.safe_load(JOB)]
    both = 0
    while both < 200:
        broken = copy.deepcopy(whole[int(rng.integers(len(whole)))])
        what = break_at_random(broken, rng)
        refused, wrong = messages(broken, folder)
        if refused is None or ABOUT_MEANING.search(refused):
            assert wrong is None or refused is not None, (what, wrong)
        else:
            assert wrong is not None, (what, refused)
            both += 1


def test_null_is_the_same_as_leaving_out_and_both_say_so(folder: Path) -> None:
    """Reader and schema agree on it at every place in turn; and on an empty mapping at every third."""
    every = [
        (part, row, name)
        for part, known in [*parts(yaml.safe_load(FULL)), (yaml.safe_load(JOB), 0)]
        for row, (_, name) in enumerate(containers(part))
        if row >= known
    ]
    for part, row, name in every:
        for value in (None, {})[: 1 + (row % 3 == 0)]:
            changed = copy.deepcopy(part)
            place, key = list(containers(changed))[row]
            place[key] = value
            refused, wrong = messages(changed, folder)
            if (name, value) == ("robot", None):  # which may come from --robot
                assert wrong is None
            elif refused is None or not ABOUT_MEANING.search(refused):
                assert (refused is None) == (wrong is None), (name, value, refused, wrong)


@pytest.mark.parametrize(
    ("section", "right"),
    [
        ({"robot": {"name": "panda", "urdf": None, "srdf": None, "package_dirs": None}}, True),
        ({"robot": {"name": None, "urdf": "planar_arm.urdf"}}, True),
        ({"robot": {"name": "panda", "srdf": "planar_arm.srdf"}}, False),
        ({"robot": {"name": None, "urdf": None}}, False),
        ({"robot": {"name": "panda", "group": ["a", "a"]}}, False),
        ({"start": {"joints": [1, 2], "state": None}}, True),
        ({"goal": {"joints": None, "state": None}}, False),
        ({"goal": {"joints": [1, 2], "state": "there"}}, False),
        ({"timing": {"duration": 2, "scale": None}}, True),
        ({"timing": {"duration": 2, "scale": 1.0}}, False),
        ({"timing": {"rate": None}}, False),
        ({"self_collision": {"clearance": None}}, False),
        ({"obstacles": [{"shape": {"type": "sphere", "radius": 1}, "motion": {"velocity": None}}]}, False),
        ({"goal": {"pose": {"link": "a", "position": [1, 0, 0], "rpy": None, "quaternion_xyzw": [0, 0, 0, 1]}}}, True),
        ({"goal": {"pose": {"link": "a", "position": [1, 0, 0], "rpy": [0, 0, 0], "quaternion_xyzw": None}}}, True),
    ],
)
def test_both_count_what_is_given_and_not_null(section: dict[str, Any], right: bool, folder: Path) -> None:
    refused, wrong = messages({**yaml.safe_load(FULL), **section}, folder)
    assert (refused is None, wrong is None) == (right, right), (refused, wrong)


def break_at_random(content: Any, rng: np.random.Generator) -> str:
    """Change one place of a scene; return what was done."""
    places = list(containers(content))
    place, key = places[int(rng.integers(len(places)))]
    value = place[key]
    others: list[Any] = ["word", "", " ", "a\nb", 3, 0, -1, 2.5, -0.0, 1e7, -1e7, 1e-200, float("inf"), True, None]
    others += [[], {}, [1], ["a"], [1, 2, 3], [[1, 2]], {"a": 1}, {"a": "b"}, {1: 2}]
    match int(rng.integers(4)):
        case 0 if isinstance(value, dict):
            value["unknown"] = 1
        case 1 if isinstance(value, dict) and value:
            value.pop([*value][int(rng.integers(len(value)))])
        case 2 if isinstance(value, list) and value:
            value.append(value[0]) if rng.integers(2) else value.pop()
        case _:
            place[key] = others[int(rng.integers(len(others)))]
    return f"{key}: {value} -> {place[key]}"


def parts(whole: dict[str, Any]) -> Iterator[tuple[dict[str, Any], int]]:
    """Scenes that a small scene makes of a large one's sections, each with one of them or with one of its obstacles,
    and how many of its places are those of the small scene."""
    small = {name: whole[name] for name in ("hdplan", "robot", "start", "goal")}
    yield small, 0
    known = sum(1 for _ in containers(small))
    for name, section in whole.items():
        for row in section if name == "obstacles" else [section]:
            if name not in small:
                yield {**small, name: [row] if name == "obstacles" else row}, known


def containers(content: Any) -> Iterator[tuple[Any, Any]]:
    """All places of a scene below its top: what holds them, and the key."""
    keys = content if isinstance(content, dict) else range(len(content))
    for key in keys:
        yield content, key
        if isinstance(content[key], dict | list):
            yield from containers(content[key])
