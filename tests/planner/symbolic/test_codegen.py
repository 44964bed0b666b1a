"""The C of a scene: it compiles without a warning, gives hdplan's numbers, allocates nothing, and is written whole."""

from __future__ import annotations

import ctypes
import dataclasses
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import hdplan
from hdplan import symbolic
from hdplan.planner.commands.codegen import run_codegen
from hdplan.planner.robot.setup import Setup
from hdplan.planner.symbolic.c_code import c_files, c_name
from hdplan.planner.symbolic.pairs import all_movable
from hdplan.planner.terminal.declared import GivenScene
from hdplan.scenes.array_types import Array
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.output import write_folder
from tests.threads import together

from ..linkage import linkage_urdf

ROOT = Path(__file__).resolve().parents[3]
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O1"]
COMPILERS = [name for name in ("gcc", "clang", "cc") if shutil.which(name)]
needs_compiler = pytest.mark.skipif(not COMPILERS, reason="no C compiler: what is generated cannot be compiled")


def written(scene: hdplan.Scene, folder: Path) -> str:
    """Write a scene's C, and return the beginning of its names."""
    for name, text in c_files(all_movable(Setup.of(scene))).items():
        (folder / name).write_text(text, encoding="ascii")
    return c_name(scene.name)


def run(*command: str | Path, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(list(map(str, command)), cwd=folder, capture_output=True, text=True, check=False)


def passes(scene: hdplan.Scene, folder: Path, compiler: str) -> str:
    """Compile a scene's C and its test, which must pass."""
    prefix = written(scene, folder)
    built = run(compiler, *STRICT, f"{prefix}.c", f"{prefix}_test.c", "-o", "test", "-lm", folder=folder)
    assert (built.returncode, built.stderr) == (0, "")
    done = run("./test", folder=folder)
    assert done.returncode == 0, done.stdout
    errors = [float(error) for error in re.findall(r"\d\.\de[-+]\d\d", done.stdout)]
    assert len(errors) == 5
    assert max(errors) < 1e-9
    return prefix


@pytest.mark.sampled(2)
@needs_compiler
@pytest.mark.parametrize("name", ["planar_arm", "panda_carry", "panda_table_pick"])
def test_the_generated_test_passes(name: str, tmp_path: Path) -> None:
    passes(hdplan.load_scene(name), tmp_path, COMPILERS[-1])


@pytest.mark.slow
@needs_compiler
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize(
    "name", ["empty", "panda_cage", "panda_conveyor", "ur5_ceiling", "panda_camera", "tiago_shelf"]
)
def test_every_kind_of_scene(name: str, compiler: str, tmp_path: Path) -> None:
    passes(hdplan.load_scene(name), tmp_path, compiler)


@needs_compiler
def test_joints_that_follow_and_a_base_that_hangs(tmp_path: Path) -> None:
    hanging = hdplan.Pose((0.3, 0.2, 2.0), (0.0, 1.0, 0.0, 0.0))
    scene = hdplan.Scene(
        robot=hdplan.RobotSpec(urdf=linkage_urdf(tmp_path), base=hanging),
        obstacles=[hdplan.Cylinder(0.2, 0.5, name="what? ??/ */", pose=[0.9, 0.2, 1.0])],
        start=[0.0] * 5,
        goal=[0.5] * 5,
        name="8 % of */ it",
    )
    assert passes(scene, tmp_path, COMPILERS[0]) == "scene_8_of_it"


@needs_compiler
def test_a_robot_that_nothing_can_touch_in_an_empty_world(
    stick_scene: Callable[[Obstacle], hdplan.Scene], tmp_path: Path
) -> None:
    scene = stick_scene(Obstacle("ball", hdplan.Sphere(0.1), hdplan.Pose((9.0, 0.0, 0.0))))
    passes(dataclasses.replace(scene, obstacles=()), tmp_path, COMPILERS[0])


@needs_compiler
def test_a_number_that_is_wrong_fails_the_test(tmp_path: Path) -> None:
    prefix = written(hdplan.load_scene("planar_arm"), tmp_path)
    source = (tmp_path / f"{prefix}.c").read_text()
    body = re.search(r"bodies_0\[\d+\]\[\d+\] = \{\{([-.\de]+)", source)
    assert body is not None
    changed = source[: body.start(1)] + str(float(body[1]) + 1e-6) + source[body.end(1) :]
    refused = run(COMPILERS[0], "-ffast-math", "-c", f"{prefix}.c", folder=tmp_path)
    assert "without -ffast-math" in refused.stderr
    for text, code in (
        (source, 0),
        (changed, 1),
        (source.replace("+= distance * slope", "+= 1.001 * distance * slope"), 1),
    ):
        (tmp_path / f"{prefix}.c").write_text(text)
        assert (
            run(COMPILERS[0], f"{prefix}.c", f"{prefix}_test.c", "-o", "test", "-lm", folder=tmp_path).returncode == 0
        )
        assert run("./test", folder=tmp_path).returncode == code


@needs_compiler
def test_threads_get_the_numbers_of_symbolic_and_nan_for_nan(tmp_path: Path) -> None:
    scene = hdplan.load_scene("planar_arm")
    prefix, found = written(scene, tmp_path), symbolic.clearance(scene, movable=["ball", "prism"])
    run(COMPILERS[0], *STRICT, "-shared", "-fPIC", f"{prefix}.c", "-o", "arm.so", "-lm", folder=tmp_path)
    library, count = ctypes.CDLL(str(tmp_path / "arm.so")), len(found.pairs)
    poses = np.array(np.split(found.poses, 2, axis=1))

    def clearance(q: Array, obstacles: Array) -> tuple[int, Array, Array]:
        distance, gradient = np.zeros(count), np.zeros((count, 2))
        given = (np.ascontiguousarray(each, dtype=np.float64) for each in (q, obstacles, distance, gradient))
        arrays = list(given)
        code = library.planar_arm_clearance(*(each.ctypes.data_as(ctypes.c_void_p) for each in arrays))
        return code, arrays[2], arrays[3]

    def many(seed: int) -> list[tuple[int, bytes, bytes]]:
        rows = np.random.default_rng(0).uniform(-2, 2, (300, 2))
        return [(code, value.tobytes(), slope.tobytes()) for code, value, slope in (clearance(q, poses) for q in rows)]

    first, *others = together(many, 4)
    assert all(each == first for each in others)
    for q in np.random.default_rng(1).uniform(-2, 2, (5, 2)):
        code, distance, _ = clearance(q, poses)
        assert code == 0
        np.testing.assert_allclose(distance, np.array(found.function(q, found.poses))[:, 0], rtol=1e-12, atol=1e-13)
    scaled, mirrored, slanted = poses * 1.1, poses @ np.diag([1, 1, -1, 1]), poses.transpose(0, 2, 1)
    for q, obstacles in (
        ([np.nan, 0.0], poses),
        ([0.0, np.inf], poses),
        *(([0.0, 0.0], wrong) for wrong in (scaled, mirrored, slanted, np.full_like(poses, np.nan))),
    ):
        code, distance, gradient = clearance(np.array(q), obstacles)
        assert code == 1
        assert np.isnan(distance).all()
        assert np.isnan(gradient).all()


def test_nothing_is_allocated_or_kept(tmp_path: Path) -> None:
    prefix = written(hdplan.load_scene("planar_arm"), tmp_path)
    source = (tmp_path / f"{prefix}.c").read_text()
    assert re.findall(r"#include (\S+)", source) == [f'"{prefix}.h"', "<math.h>", "<stddef.h>", "<math.h>"]
    assert "alloc" not in source
    variables = re.findall(r"^(?:static )?(?! |static|const|typedef)[\w *]+\[[^;(]*\] = ", source, re.MULTILINE)
    assert variables == []  # all tables are constant
    assert not re.search(r"^ +static ", source, re.MULTILINE)


@needs_compiler
def test_the_example_in_cpp_runs(tmp_path: Path) -> None:
    if shutil.which("c++") is None:
        pytest.skip("no C++ compiler")
    assert run_codegen(GivenScene("planar_arm"), output=tmp_path / "c", as_json=True) == 0
    example = ROOT / "docs" / "examples" / "control_loop.cpp"
    run(COMPILERS[0], *STRICT, "-c", "c/planar_arm.c", "-o", "arm.o", folder=tmp_path)
    command = ["c++", "-std=c++17", "-Wall", "-Wextra", "-Werror", "-O1", "-Ic", example, "arm.o", "-o", "loop", "-lm"]
    built = run(*command, folder=tmp_path)
    assert (built.returncode, built.stderr) == (0, "")
    done = run("./loop", folder=tmp_path)
    assert done.returncode == 0
    reached = re.match(r"at (\S+) (\S+) rad; least D 0\.018", done.stdout)
    assert reached is not None
    turned_in_a_cycle = 1e-3  # [rad] it stands between goal and ball by a step to and fro, so rounding decides which
    np.testing.assert_allclose(
        [float(each) for each in reached.groups()], [1.072, 0.438], rtol=0, atol=1.5 * turned_in_a_cycle
    )


# --- the folder -------------------------------------------------------------------------------------------------------


def test_a_folder_is_written_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_folder(tmp_path / "new", {"a": b"1", "b": b"2"})
    assert {each.name: each.read_bytes() for each in (tmp_path / "new").iterdir()} == {"a": b"1", "b": b"2"}
    write = Path.write_bytes

    def full(path: Path, data: bytes) -> int:
        if path.name == "b":
            raise OSError(28, "No space left on device")
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(hdplan.InputError, match="No space left"):
        write_folder(tmp_path / "other", {"a": b"1", "b": b"2"})
    assert sorted(each.name for each in tmp_path.iterdir()) == ["new"]


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ("full", "exists already"),
        ("full/file", "exists already"),
        ("none/new", "not exist"),
        ("link", "exists already"),
    ],
)
def test_a_folder_that_cannot_be_written_is_refused_before_the_work(target: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    with pytest.raises(hdplan.InputError, match=message) as caught:
        run_codegen(GivenScene("no such scene"), output=tmp_path / target, as_json=False)
    assert "\n" not in str(caught.value)
    assert (tmp_path / "full" / "file").read_text() == "mine"


def test_names_in_c() -> None:
    names = {"panda_cage": "panda_cage", "Cell 4": "cell_4", "4": "scene_4", "ä": "scene", "test": "scene_test"}
    assert {name: c_name(name) for name in names} == names
