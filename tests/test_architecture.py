"""The house: which room may import which, where heavy libraries live, what start-up may load."""

from __future__ import annotations

import ast
import functools
import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
FILES = sorted(path for folder in ("scenes", "distance", "planner") for path in (ROOT / folder).rglob("*.py"))

ROOMS = [  # from the ground up: a room imports rooms before it, so that nothing runs in a circle
    *("scenes", "scenes.robot_files", "scenes.moveit", "scenes.yaml_format"),
    *("distance.compiled", "distance", "distance.numpy_reference", "distance.symbolic", "distance.batch"),
    *("distance.baselines", "distance.studies", "planner.geometry.mesh_formats"),
    *("planner.geometry", "planner.robot", "planner.motion", "planner.certificate"),
    *("planner.kinematics", "planner.collision", "planner.timing", "planner.problem", "planner.solvers"),
    *("planner.symbolic", "planner.traced"),
    "planner.solvers.methods",
    "planner.proof",
    *("planner.search", "planner", "planner.replanning", "planner.control", "planner.pictures", "planner.terminal"),
    "planner.studies",
    *("planner.job", "planner.batch", "planner.view.drawing", "planner.page", "planner.view", "planner.commands"),
]

DOORS = ("distance.__init__", "planner.__init__", "scenes.__init__")  # give names of rooms behind them, on demand
# The allowed basis of a proof; the compiler is a tool, and no distance is in its room.
CERTIFICATE = {
    *("scenes", "scenes.robot_files", "planner.geometry", "planner.geometry.mesh_formats", "planner.robot"),
    *("planner.motion", "distance.compiled"),
}

HOMES = {  # of each heavy library
    "casadi": {"distance.symbolic", "planner.kinematics", "planner.problem", "planner.solvers", "planner.symbolic"},
    "jax": {"distance.batch", "planner.traced"},
    "fcl": {"distance.baselines"},
    "viser": {"planner.view", "planner.view.drawing"},
    "daqp": {"planner.control"},
    "mujoco": {"planner.control"},
    "av": {"planner.page"},
    "coacd": {"planner.collision"},
    "yaml": {"scenes"},
    "mcap": {"planner.motion"},
    "mcap_ros2": {"planner.motion"},
    **{name: {"planner.batch"} for name in ("dask", "distributed", "pyarrow")},
}


@functools.cache
def imports(path: Path) -> set[str]:
    """Names of modules that a file imports, at its head or within; hdplan's own without the prefix `hdplan.`."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.add(node.module or "")
    return {name.removeprefix("hdplan.") for name in found}


def name_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


MODULES = {name_of(path): path for path in FILES}

SOURCE = ROOT / "src" / "hdplan"
KNOWN = {name.removesuffix(".__init__"): path for name, path in MODULES.items()} | {
    ".".join(path.relative_to(SOURCE).with_suffix("").parts).removesuffix(".__init__"): path
    for path in (SOURCE / "cli.py", SOURCE / "control.py", SOURCE / "symbolic.py", *(SOURCE / "verify").glob("*.py"))
}


def room_of(module: str) -> str:
    """The room in which a module, or a room's own name, lies."""
    return module if module in ROOMS else module.rpartition(".")[0]


def imported(module: str) -> set[str]:
    """The other rooms that a module imports."""
    own = {
        name
        for name in imports(MODULES[module])
        if name.split(".")[0] in ("scenes", "distance", "planner", "cli", "hdplan")
    }
    return {room_of(name) for name in own} - {room_of(module)}


@pytest.mark.core
def test_every_arrow_points_down() -> None:
    upward = {}
    for module in set(MODULES) - set(DOORS):
        upward[module] = imported(module) - set(ROOMS[: ROOMS.index(room_of(module))])
    assert {module: rooms for module, rooms in upward.items() if rooms} == {}


def test_the_certificate_rests_on_nothing_of_the_solvers() -> None:
    rooms = {"planner.certificate"}
    while more := {room for module in MODULES if room_of(module) in rooms for room in imported(module)} - rooms:
        rooms |= more
    assert rooms - {"planner.certificate"} == CERTIFICATE


@pytest.mark.parametrize("page", ["architecture", "certificate"])
def test_the_pages_say_what_the_certificate_rests_on(page: str) -> None:
    """The sentence that says so names just these rooms."""
    text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    (sentence,) = re.findall(r"(?:It imports|it may import only)([^.]*?(?:`[^`]*`[^.`]*)*)\.\s", text)
    assert set(re.findall(r"`([^`]*)`", sentence)) == CERTIFICATE


def test_the_list_of_places_in_architecture_is_true() -> None:
    """Every file of the list is there, with the functions named beside it; a name alone lies beside the file before."""
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (.+) \| (.+) \|$", text.partition("## Where is …?")[2], re.MULTILINE)
    assert len(rows) > 25
    for what, where in rows:
        path = ROOT / "README.md"  # a bare first name is at the top
        for name in re.findall(r"`([^`]+)`", where):
            if "/" in name or "." in name:
                path = ROOT / name if "/" in name else path.parent / name
                assert path.is_file(), f"{what}: {name}"
            else:
                assert re.search(rf"\b{name}\(", path.read_text(encoding="utf-8")), f"{what}: {name}"


@pytest.mark.parametrize("library", HOMES)
def test_heavy_libraries_stay_at_home(library: str) -> None:
    users = {
        room_of(name) for name, path in MODULES.items() if library in {each.split(".")[0] for each in imports(path)}
    }
    assert users == HOMES[library]


def test_names_of_modules_in_strings_exist() -> None:
    """Modules that tests and benchmarks block, replace or look up by name: one that is gone would be tested no more."""
    named = re.compile(r"""["'](?:hdplan\.)((?:planner|scenes|distance|cli|control|symbolic|verify)(?:\.\w+)*)""")
    for path in [*(ROOT / "tests").rglob("*.py"), *(ROOT / "benchmarks").rglob("*.py")]:
        for name in named.findall(path.read_text(encoding="utf-8")):
            module = name
            while module and module not in KNOWN:
                module = module.rpartition(".")[0]
            rest = name.removeprefix(module).strip(".").split(".")[0]
            source = KNOWN.get(module)
            assert source is not None, f"{path}: {name}"
            assert not rest or re.search(rf"\b{rest}\b", source.read_text(encoding="utf-8")), f"{path}: {name}"


def test_rooms_and_doors_exist() -> None:
    assert {room_of(module) for module in MODULES} == set(ROOMS)
    assert set(MODULES) >= set(DOORS)


def test_import_and_help_load_nothing_heavy() -> None:
    code = (
        "import sys, hdplan, hdplan.cli;"
        "heavy = {'casadi', 'pinocchio', 'coal', 'jax', 'matplotlib', 'trimesh', 'scipy', 'viser'};"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_missing_loops_warn_once_and_not_at_import() -> None:
    code = (
        "import sys, warnings; sys.modules['hdplan._loops'] = None; warnings.simplefilter('always');"
        "words = []; warnings.showwarning = lambda word, *_: words.append(str(word));"
        "from hdplan.distance.compiled.loops import Record; before = len(words);"
        "Record('tree'); Record('tree'); print(before, len(words), 'without its C loops' in words[0])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "0 1 True"


def test_a_plan_with_a_known_arm_loads_only_what_it_needs() -> None:
    """Hulls, graphs, optimizers, splines, readers of mesh formats and checkers of types cost a start more than planning
    does; what they found of a robot is kept."""
    code = (
        "import contextlib, io, sys, hdplan.cli;"
        "sys.argv = ['hdplan', 'plan', 'panda_corridor'];"
        "output = io.StringIO();"
        "code = 1\n"
        "try:\n    with contextlib.redirect_stdout(output): hdplan.cli.main()\n"
        "except SystemExit as end: code = end.code\n"
        "rare = {'scipy', 'pydantic', 'trimesh', 'fcl', 'jax', 'matplotlib', 'viser', 'daqp', 'coacd',"
        " 'rich.progress', 'numpy.ma'};"
        "print(code, 'certified' in output.getvalue(), sorted(rare & set(sys.modules)))"
    )
    for _ in range(2):  # the first may have to compute what is kept
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "0 True []"


def test_docstrings_begin_with_what_they_describe() -> None:
    """Each module has one; all begin with a noun, or "Return ..." and its object: not with "What", "How", "It"."""
    opening = re.compile(r"(What|Whether|Where|Which|Who|How|Such|Those|Its|Of|Return it|It|That)\b")
    for path in [*FILES, *(ROOT / "src").rglob("*.py"), ROOT / "cli.py"]:
        source = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                text = ast.get_docstring(node) or ""
                assert text or not isinstance(node, ast.Module) or not source.strip(), path
                assert not opening.match(text), f"{path}: {text.splitlines()[0]}"


def test_the_picture_of_the_house_is_fresh() -> None:
    spec = importlib.util.spec_from_file_location("house", ROOT / "benchmarks" / "house.py")
    assert spec is not None
    assert spec.loader is not None
    house = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(house)
    drawn = house.picture(*house.measured())
    assert drawn == house.PICTURE.read_text(encoding="utf-8"), "draw it again: python benchmarks/house.py"


PASSING_TIME = {  # tests about time itself, random pauses, and the one wait of all others
    *("waiting.py", "test_peers.py", "planner/test_plan.py", "planner/terminal/test_interrupts.py"),
    *("planner/solvers/test_interior_point.py", "planner/search/test_idle_core.py", "planner/batch/test_run.py"),
    *("planner/proof/test_verify_reading.py", "planner/view/in_browser.py", "planner/view/test_live.py"),
}


def test_tests_wait_for_conditions() -> None:
    sleeping = re.compile(r"\btime\.sleep\(|\bwait_for_timeout\(")
    found = set()
    for path in (ROOT / "tests").rglob("*.py"):
        if path != Path(__file__) and sleeping.search(path.read_text(encoding="utf-8")):
            found.add(path.relative_to(ROOT / "tests").as_posix())
    assert found <= PASSING_TIME


TESTS = sorted({path.parent for path in (ROOT / "tests").rglob("test_*.py")})


@pytest.mark.core
@pytest.mark.parametrize("folder", TESTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_every_room_has_a_law_in_the_core(folder: Path) -> None:
    assert any("@pytest.mark.core\n" in path.read_text(encoding="utf-8") for path in folder.glob("test_*.py"))
