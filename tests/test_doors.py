"""Files in and out: hostile ones are refused at once in one line, results are there whole or not."""

from __future__ import annotations

import functools
import io
import os
import signal
import socket
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hdplan.planner.geometry.meshes import load_mesh
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.deadline import check_time, seconds_left, time_limit
from hdplan.scenes.errors import InputError, TimeLimitError
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.shapes import Mesh
from hdplan.scenes.timing import MOST_ROWS
from hdplan.scenes.yaml_format.reader import load_scene, shipped_scenes
from tests.commands import Command, refused
from tests.waiting import until

ARM = shipped_scenes()["planar_arm"]
LOADING = "hdplan: loading the robot's meshes ...\n"  # written where loading takes long
HEAD = "hdplan: 1\nrobot: {name: panda}\nstart: {state: default}\ngoal: {state: default}\n"
GOOD = Trajectory(("shoulder", "elbow"), np.array([[-0.8, 0.3], [0.1, 0.2], [1.0, 0.4]]), {}, np.array([0.0, 1.0, 2.0]))


def refusal(read: Callable[[], object]) -> str:
    with pytest.raises(InputError) as caught:
        read()
    assert "\n" not in str(caught.value)
    return str(caught.value)


def refusal_if_any(read: Callable[[], object]) -> str | None:
    """The message on a refused file; None if it is read."""
    try:
        read()
    except InputError as error:
        return str(error)
    return None


@pytest.mark.parametrize("name", ["a\nb", "a\r\nb", "a\tb", "a\x1b[31mb", "a\u2028b", "a\udcffb"])
def test_names_of_files_do_not_break_the_line(tmp_path: Path, name: str) -> None:
    """A name that does not print is written as an escape, and can be recognized by it."""
    scene, robot = load_scene(ARM), RobotSpec(urdf=tmp_path / name / "arm.urdf")
    for ending, calls in {
        "/m.json": (GOOD.save, Trajectory.load, load_scene),
        ".txt": (GOOD.save, Trajectory.load, scene.save),
        ".yaml": (load_scene, Trajectory.load),
        "/s.yaml": (scene.save, lambda path: load_scene(ARM, robot=path), lambda path: load_scene(path, robot="panda")),
        ".stl": (lambda path: load_mesh(Mesh(path), "shape"),),
        "": (lambda _: load_robot(robot),),
    }.items():
        for call in calls:
            words = refusal(lambda call=call, ending=ending: call(tmp_path / (name + ending)))
            assert words.isprintable()
            assert repr(name)[1:-1] in words


# --- documents --------------------------------------------------------------------------------------------------------

BOMB = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{name}: &{name} [{', '.join([f'*{below}'] * 10)}]\n" for below, name in zip("abcdefgh", "bcdefghi", strict=True)
)
DOCUMENTS = {
    "brackets": ("obstacles: " + "[" * 100_000, "nested more than 64 levels"),
    "braces": ("obstacles: " + "{a: " * 100_000, "nested more than 64 levels"),
    "dashes": ("obstacles:\n" + "- " * 100_000, "nested more than 64 levels"),
    "lines": ("\n".join(" " * i + "a:" for i in range(1000)), "nested more than 64 levels"),
    "closed brackets": ("obstacles: " + "[" * 70 + "]" * 70, "nested more than 64 levels"),
    "aliases of aliases": (BOMB, "more than 1000000 values"),
    "an alias of itself": ("obstacles: &a [*a]", "lies within its own anchor"),
    "a merge of itself": ("planner: &a {<<: *a}", "lies within its own anchor"),
    "an empty whole number": ("planner: {waypoints: !!int ''}", "line 5: '' is not a number in decimal digits"),
    "no time": ("planner: {waypoints: !!timestamp x}", "not of the type that its tag"),
    "no truth": ("planner: {swept: !!bool x}", "not of the type that its tag"),
    "a whole number of 6000 digits": ("planner: {waypoints: " + "9" * 6000 + "}", "4300 digits"),
    "the same in base 16": ("planner: {waypoints: 0x" + "f" * 6000 + "}", "is not a number in decimal digits"),
    "and as a length": ("planner: {clearance: 0x" + "f" * 6000 + "}", "is not a number in decimal digits"),
    "many waypoints": ("planner: {waypoints: 1000000000}", "whole number 3 to 1000"),
    "a high rate": ("timing: {duration: 1, rate: 1.0e+9}", "1 to 10000 [1/s]"),
    "a long motion": ("timing: {duration: 1.0e+6}", "1e+08 rows"),
}


@pytest.mark.parametrize("case", DOCUMENTS)
def test_documents_that_never_end_are_refused_at_once(tmp_path: Path, case: str) -> None:
    text, words = DOCUMENTS[case]
    file = tmp_path / "scene.yaml"
    file.write_text(HEAD + text, encoding="utf-8")
    assert words in refusal(lambda: load_scene(file))


def test_a_document_cut_anywhere_is_read_or_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    names = list(shipped_scenes().values())
    for seed in range(150):
        data = bytearray(names[seed % len(names)].read_bytes())
        where = int(rng.integers(len(data)))
        match seed % 3:
            case 0:
                del data[where:]
            case 1:
                data[where] = int(rng.integers(256))
            case _:
                odd = [b"\x00", b"[", b"{", b"\xff\xfe", b"&a ", b"*a ", b"!!int ", b"1e999 ", b": "]
                data[where:where] = rng.choice(odd)
        file = tmp_path / "scene.yaml"
        file.write_bytes(bytes(data))
        words = refusal_if_any(functools.partial(load_scene, file))
        assert words is None or (words.startswith(f"{file}: ") and "\n" not in words)


# --- motions ----------------------------------------------------------------------------------------------------------


def npz(**arrays: object) -> bytes:
    data = io.BytesIO()
    np.savez(data, **arrays)
    return data.getvalue()


def claiming(shape: str) -> bytes:
    """An archive whose array says that it is larger than it is."""
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        archive.writestr("positions.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode())
        archive.writestr("joint_names.npy", npz_part(np.array(["shoulder", "elbow"])))
    return data.getvalue()


def npz_part(array: np.ndarray) -> bytes:
    data = io.BytesIO()
    np.save(data, array)
    return data.getvalue()


def bomb() -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("positions.npy", bytes(200_000_000))
    return data.getvalue()


ONE_JOINT = b'{"hdplan_trajectory": 1, "joint_names": ["a"], "positions": [[0], [1]]'
MOTIONS: dict[str, Callable[[], tuple[str, bytes, str]]] = {
    "objects": lambda: ("m.npz", npz(joint_names=["a"], positions=np.array([[object()]])), "plain arrays"),
    "a claim of terabytes": lambda: ("m.npz", claiming("(1000000000000, 2)"), "that its header says"),
    "a claim beyond all": lambda: ("m.npz", claiming(f"({10**30}, 2)"), "that its header says"),
    "a bomb": lambda: ("m.npz", bomb(), "200 MB large when unpacked"),
    "cut": lambda: ("m.npz", npz(joint_names=["a"], positions=[[1.0]])[:150], "plain arrays"),
    "many rows": lambda: ("m.npz", npz(joint_names=["a"], positions=[[0]] * (MOST_ROWS + 1)), f"at most {MOST_ROWS}"),
    "a key twice": lambda: ("m.json", ONE_JOINT + b', "positions": [[0], [2]]}', "the key 'positions' appears twice"),
    "a key misspelt": lambda: ("m.json", ONE_JOINT + b', "velocites": [[0], [2]]}', "(did you mean 'velocities'?)"),
    "deep": lambda: ("m.json", b'{"hdplan_trajectory": ' + b"[" * 100_000, "not JSON"),
    "a long number": lambda: ("m.json", b'{"hdplan_trajectory": ' + b"9" * 10_000 + b"}", "not JSON"),
    "underscores": lambda: ("m.csv", b"a\n1_0\n2\n", "'1_0' is not a number"),
    "null bytes": lambda: ("m.csv", b"a\n0\n\x00\n", "m.csv: "),
    "a long field": lambda: ("m.csv", b"a\n" + b"1" * 1_000_000, "not CSV"),
    "UTF-16": lambda: ("m.csv", "a\n0\n1\n".encode("utf-16"), "not CSV"),
}


@pytest.mark.parametrize("case", MOTIONS)
def test_hostile_motions_are_refused_by_name(tmp_path: Path, case: str) -> None:
    name, data, words = MOTIONS[case]()
    file = tmp_path / name
    file.write_bytes(data)
    found = refusal(lambda: Trajectory.load(file))
    assert found.startswith(f"{file}: ")
    assert words in found


@pytest.mark.parametrize("ending", ["json", "csv", "npz"])
def test_a_motion_cut_or_changed_anywhere_is_read_or_refused(tmp_path: Path, ending: str) -> None:
    file, rng = tmp_path / f"m.{ending}", np.random.default_rng(2)
    GOOD.save(file)
    whole = file.read_bytes()
    for seed in range(100):
        data = bytearray(whole)
        where = int(rng.integers(len(data)))
        if seed % 2:
            data = data[:where]
        else:
            data[where] = int(rng.integers(256))
        file.write_bytes(bytes(data))
        words = refusal_if_any(functools.partial(Trajectory.load, file))
        assert words is None or (words.startswith(f"{file}: ") and "\n" not in words)
        if words is None:
            assert np.isfinite(Trajectory.load(file).positions).all()


# --- what is no file --------------------------------------------------------------------------------------------------


@pytest.fixture
def no_files(tmp_path: Path) -> dict[str, Path]:
    """A pipe that nobody writes to, a socket, a device without end and a directory, by the word for each."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "directory").mkdir()
    server = socket.socket(socket.AF_UNIX)
    before = Path.cwd()
    os.chdir(tmp_path)  # names of sockets are short
    server.bind("socket")
    os.chdir(before)
    server.close()
    (tmp_path / "device").symlink_to("/dev/zero")
    return {f"a {kind}": tmp_path / kind for kind in ("pipe", "socket", "device", "directory")}


@pytest.mark.parametrize("kind", ["a pipe", "a socket", "a device", "a directory"])
def test_paths_that_are_not_files_are_refused_at_once(
    no_files: dict[str, Path], kind: str, tmp_path: Path, hdplan: Command
) -> None:
    path = no_files[kind]
    assert refusal(lambda: load_scene(path)) == f"{path}: is {kind}, not a file"
    for ending in (".json", ".csv", ".npz"):
        motion = path.rename(path.with_name(f"m{ending}"))
        assert refusal(lambda motion=motion: Trajectory.load(motion)) == f"{motion}: is {kind}, not a file"
        path = motion
    assert f"is {kind}" in refusal(lambda: load_robot(RobotSpec(urdf=path)))
    assert f"is {kind}" in refusal(lambda: load_robot(RobotSpec(urdf=ARM.with_suffix(".urdf"), srdf=path)))
    scene = tmp_path / "scene.yaml"
    scene.write_text(HEAD + f"obstacles: [{{shape: {{type: mesh, file: '{path}'}}}}]\n", encoding="utf-8")
    assert "is not a file" in refusal(lambda: load_scene(scene))
    assert f"is {kind}" in refusal(lambda: load_scene(ARM, robot=path))
    if kind != "a device":  # a link to a device is replaced as any link is
        before = len(os.listdir(tmp_path))
        target = path.rename(path.with_suffix(".json"))
        wanted = "is a folder" if kind == "a directory" else "is not a regular file"
        refused(hdplan("plan", "planar_arm", "-o", target), wanted)
        assert len(os.listdir(tmp_path)) == before


LINKED = """<robot name="r"><link name="a"><collision><geometry><mesh filename="{}"/></geometry></collision></link>
<link name="b"/><joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.mark.parametrize("name", ["x" * 300, "a/" * 3000 + "a", "circle"])
def test_names_that_the_system_refuses_are_refused_in_one_line(tmp_path: Path, name: str) -> None:
    """Names too long for a file and for a path, and a link that leads to itself, wherever a file is named."""
    for ending in (".yaml", ".json", ".urdf", ".stl"):
        (tmp_path / f"circle{ending}").symlink_to(tmp_path / f"circle{ending}")
    refusal(lambda: load_scene(tmp_path / f"{name}.yaml"))
    refusal(lambda: load_scene(ARM, robot=tmp_path / f"{name}.yaml"))
    refusal(lambda: Trajectory.load(tmp_path / f"{name}.json"))
    refusal(lambda: GOOD.save(tmp_path / f"{name}/m.json"))
    refusal(lambda: load_robot(RobotSpec(urdf=tmp_path / f"{name}.urdf")))
    refusal(lambda: load_mesh(Mesh(tmp_path / f"{name}.stl"), "mesh"))
    robot = tmp_path / "robot.urdf"
    for address in (f"{name}.stl", f"file://{tmp_path}/{name}.stl", f"package://{name}.stl"):
        robot.write_text(LINKED.format(address), encoding="utf-8")
        refusal(lambda: load_robot(RobotSpec(urdf=robot, package_dirs=(tmp_path,))))
    scene = tmp_path / "scene.yaml"
    for line in (f"obstacles: [{{shape: {{type: mesh, file: '{name}.stl'}}}}]", f"robot: {{urdf: '{name}.urdf'}}"):
        scene.write_text(f"hdplan: 1\nstart: {{state: a}}\ngoal: {{state: a}}\n{line}\n", encoding="utf-8")
        refusal(lambda: load_scene(scene))


# --- results, whole or not at all -------------------------------------------------------------------------------------


def test_a_disk_that_is_full_leaves_what_was_there(tmp_path: Path) -> None:
    file = tmp_path / "m.npz"
    GOOD.save(file)
    before = file.read_bytes()
    code = (
        "import resource, signal, sys, numpy as np\n"
        "from hdplan.planner.motion.trajectory import Trajectory\n"
        "from hdplan.scenes.errors import InputError\n"
        "motion = Trajectory(('a',), np.zeros((5000, 1)))\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        "try:\n motion.save(sys.argv[1])\n"
        "except InputError as error:\n print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(file)], capture_output=True, text=True)
    assert done.stdout.startswith(f"{file}: cannot be written (File too large)"), done
    assert file.read_bytes() == before
    assert os.listdir(tmp_path) == ["m.npz"]


def test_a_fault_of_ours_is_one_line_and_exit_code_3(hdplan: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("by\nzero")

    monkeypatch.setattr("hdplan.scenes.yaml_format.reader.read_document", broken)
    code, out, err = hdplan("plan", "planar_arm")
    assert (code, out) == (3, "")
    assert err.startswith("hdplan: internal error, please report it")
    assert "ZeroDivisionError: by zero (reader, line " in err
    assert err.count("\n") == 1


def test_kill_ends_in_order(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "hdplan.cli", "view", "planar_arm", "--port", "8231"]
    pytest.importorskip("viser")
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path)
    assert child.stdout is not None
    assert "until Ctrl-C" in child.stdout.readline()
    child.send_signal(signal.SIGTERM)
    _, err = child.communicate(timeout=60)
    assert (child.returncode, err.replace(LOADING, "")) == (143, "")
    assert not os.listdir(tmp_path)


# --- time -------------------------------------------------------------------------------------------------------------


def test_a_limit_holds_within_and_the_tighter_one_counts() -> None:
    assert seconds_left() == float("inf")
    with time_limit(1000.0):
        assert 999.0 < seconds_left() <= 1000.0
        with time_limit(1e9):
            assert seconds_left() <= 1000.0
        with time_limit(1e-9):
            until(lambda: seconds_left() == 0.0, "time stands still")
            words = r"time limit of 1e-09 s reached while waiting; nothing .* more time may help \(--time-limit\)"
            with pytest.raises(TimeLimitError, match=words):
                check_time("waiting")
        check_time("waiting")
    assert seconds_left() == float("inf")


def test_a_plan_without_time_ends_with_one_line_and_exit_code_1(hdplan: Command, tmp_path: Path) -> None:
    code, out, err = hdplan("plan", "panda_cage", "--time-limit", "1e-6", "-o", "m.json")
    assert (code, out) == (1, "")
    assert err.startswith("hdplan: time limit of 1e-06 s reached while ")
    assert err.count("\n") == 1
    assert not os.listdir(tmp_path)


def test_a_certificate_without_time_claims_no_more() -> None:
    import hdplan
    from hdplan.planner.certificate.certifier import Certifier

    scene = load_scene(ARM)
    certifier = Certifier(Setup.of(scene))
    motion = hdplan.plan(scene, time_limit=10).trajectory
    calm = certifier.certify(motion)
    with time_limit(1e-9):
        until(lambda: seconds_left() == 0.0, "time stands still")
        hurried = certifier.certify(motion)
    assert calm.certified
    assert hurried.configurations <= calm.configurations
    if hurried.certified:
        assert (hurried.clearance or 0.0) <= (calm.clearance or 0.0) + 1e-3
    else:
        assert hurried.text.startswith("not proven: ")
