"""The house's one-way streets: which folder may import which, where heavy libraries live, what start-up may load."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = ("scenes", "distance", "planner")
FILES = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py"))

MAY_IMPORT = {
    "scenes": {"scenes"},
    "distance": {"distance", "scenes.deadline", "scenes.errors", "scenes.model", "scenes.values"},
    "planner": {
        "planner",
        "distance",
        "scenes.deadline",
        "scenes.description",
        "scenes.errors",
        "scenes.files",
        "scenes.model",
        "scenes.moving",
        "scenes.robot_library",
        "scenes.values",
        "scenes.writer",
    },
}

# Each heavy library has few homes.
HOMES = {
    "casadi": {
        "distance/axis.py",
        "distance/axis_motion.py",
        "distance/pair_distance.py",
        "distance/axes.py",
        "distance/symbolic.py",
        "distance/boxes.py",
        "distance/graph_distance.py",
        "distance/graph_poses.py",
        "distance/halfspaces.py",
        "distance/compiled.py",
        "planner/dynamics.py",
        "planner/kinematics.py",
        "planner/nlp.py",
        "planner/solvers/ipopt.py",
    },
    "jax": {"distance/batch.py", "distance/batch_axes.py", "distance/batch_kernel.py", "distance/batch_traced.py"},
    "fcl": {"distance/fcl.py"},
    "viser": {
        "planner/view/nodes.py",
        "planner/view/planning.py",
        "planner/view/player.py",
        "planner/view/plots.py",
        "planner/view/server.py",
        "planner/view/viewer.py",
    },
    "daqp": {"planner/control_program.py"},
    "coacd": {"planner/convex_task.py"},
    "toppra": {"planner/timing.py", "planner/torque_timing.py"},
    "yaml": {"scenes/fields.py"},
}

SOLVER_SIDE = (
    "planner.problem",
    "planner.terms",
    "planner.swept_clearance",
    "planner.fcl_pairs",
    "planner.hdsdf_pairs",
    "planner.outline",
    "planner.separation",
    "planner.reach",
    "planner.pairs",
    "planner.path_terms",
    "planner.plane_bodies",
    "planner.link_bodies",
    "planner.kinematics",
    "planner.dynamics",
    "planner.hinge",
    "planner.static_torque",
    "planner.torque_timing",
    "planner.nlp",
    "planner.samples",
    "planner.seeds",
    "planner.timing",
    "planner.time_laws",
    "planner.solvers",
    "planner.plan",
    "planner.search",
    "planner.ends",
    "planner.goal_search",
    "planner.barrier_rules",
    "planner.barriers",
    "planner.box_pairs",
    "planner.control",
    "planner.control_run",
    "planner.control_tasks",
    "planner.corridor",
    "planner.follow",
    "distance.axis",
    "distance.axis_motion",
    "distance.batch",
    "distance.jets",
    "distance.pair_distance",
    "distance.axes",
    "distance.projections",
    "distance.symbolic",
    "distance.reference",
    "distance.halfspaces",
    "distance.boxes",
    "distance.gdf_batch",
    "distance.compiled",
    "distance.holder",
)


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
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


@pytest.mark.parametrize("path", FILES, ids=name_of)
def test_folders_import_one_way(path: Path) -> None:
    allowed = MAY_IMPORT[path.relative_to(ROOT).parts[0]]
    for module in imports(path):
        if module.split(".")[0] in (*FOLDERS, "cli", "hdplan"):
            assert any(module == name or module.startswith(f"{name}.") for name in allowed), f"{path} imports {module}"


@pytest.mark.parametrize("library", HOMES)
def test_heavy_libraries_stay_at_home(library: str) -> None:
    users = {str(path.relative_to(ROOT)) for path in FILES if any(m.split(".")[0] == library for m in imports(path))}
    assert users <= HOMES[library]


def test_the_certificate_shares_nothing_with_the_solver() -> None:
    graph = {name_of(path): imports(path) for path in FILES}
    seen, waiting = set(), {"planner.certificate"}
    while waiting:
        module = waiting.pop()
        seen.add(module)
        waiting |= {name for name in graph.get(module, set()) if name in graph and name not in seen}
    guilty = {module for module in seen for part in SOLVER_SIDE if module == part or module.startswith(f"{part}.")}
    assert not guilty


def test_import_and_help_load_nothing_heavy() -> None:
    code = (
        "import sys, hdplan, hdplan.cli;"
        "heavy = {'casadi', 'pinocchio', 'coal', 'jax', 'matplotlib', 'trimesh', 'scipy', 'viser'};"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_modules_open_with_a_docstring() -> None:
    for path in FILES:
        source = path.read_text(encoding="utf-8")
        assert not source.strip() or ast.get_docstring(ast.parse(source)), path
