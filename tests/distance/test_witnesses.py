"""NumPy, CasADi and JAX compute one distance: values, separations, gradients and Hessians agree over every branch.

How far is stated at ``witnesses.agree``. And they share no formula: a test reads their imports.
"""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hdplan.distance
from hdplan.distance.bodies import ConvexBody
from hdplan.distance.normals import RUNGS
from hdplan.distance.studies.random_poses import touching_poses
from tests.distance.conftest import BODIES, PAIRS
from tests.distance.hard_cases import HARD
from tests.distance.witnesses import agree, evaluator

GAMMAS = (1, 2, 3, 4, 5, 6, 7, 8, 32)
SETS = (*RUNGS[:3], "paper+edges", "paper-multiset", "paper+centre+edges")
LENGTHS = (1e-9, 1e-3, 0.1, 1.0)  # [m]
BRANCHES = ("deep", "near", "apart", "touching")
COUNT = 6  # poses at once: one number, so that nothing is built again for another

EDGES = {"gamma": 2, "normals": "paper+edges"}
# JAX compiles for seconds each: aligned boxes, a flat body and a segment; a point, larger sets, large gammas
BATCHES: list[tuple[tuple[str, str], dict[str, Any]]] = [
    (("box", "box"), EDGES),  # whose Hessian test_properties needs too
    (("segment", "swept triangle"), {"gamma": 1, "shaping_length": 0.1}),
    (("segment", "swept triangle"), {"gamma": 1, "shaping_length": 0.1, "normals": "paper+edges"}),
    (("box", "box"), {"gamma": 2}),
    (("box", "capsule"), {"gamma": 3, "normals": "paper+centre+edges"}),
    (("sphere", "tetrahedron"), {"gamma": 32, "normals": "paper-multiset"}),
    (("plate", "point"), {"gamma": 4, "shaping_length": 1.0, "normals": "paper+centre"}),
    (("swept octahedron", "cylinder"), {"gamma": 8, "normals": "paper+sphere-26"}),
]
BATCH = [
    pytest.param(*row, id="-".join((*row[0], row[1].get("normals", "paper"))), marks=[pytest.mark.slow] * (k > 1))
    for k, row in enumerate(BATCHES)
]

FAMILY = {  # where each witness begins; what it may share with the others
    "numpy": {"numpy_reference.hdsdf"},
    "casadi": {"symbolic.compiled_pair", "symbolic.graph_distance", "symbolic.polytopes"},
    "jax": {"batch.distance"},
}
SHARED = {
    "bodies",
    "unions",
    "normals",
    "poses",
    "body_distance",
}  # types of bodies, sets and poses; how a distance is requested
SHARED_OF_HOLDER = {"check_gamma", "resolve_shaping_length"}


def _poses(branch, bodies, random_poses):
    if branch == "touching":
        return touching_poses(bodies[0], bodies[1], np.random.default_rng(5), COUNT)
    spread = {"deep": 0.05, "near": 0.4, "apart": 3.0}[branch]
    return random_poses(1, COUNT, spread), random_poses(2, COUNT, spread)


def _settings(number):
    return {
        "gamma": GAMMAS[number % len(GAMMAS)],
        "shaping_length": LENGTHS[number % len(LENGTHS)],
        "normals": SETS[(number + number // len(SETS)) % len(SETS)],
    }


@pytest.mark.sampled(25)
@pytest.mark.parametrize("branch", BRANCHES)
@pytest.mark.parametrize("number", range(len(PAIRS)), ids=lambda k: "-".join(PAIRS[k]))
def test_casadi_agrees_with_numpy(number, branch, random_poses):
    bodies = [BODIES[name] for name in PAIRS[number]]
    settings = _settings(5 * number + BRANCHES.index(branch))
    poses = _poses(branch, bodies, random_poses)
    found = [evaluator(name, *bodies, **settings)(*poses) for name in ("numpy", "casadi")]
    agree(found[0], found[1], poses, bodies, settings["gamma"], smooth=branch != "touching")


@pytest.mark.parametrize(("names", "settings"), BATCH)
def test_batch_agrees_with_numpy(names, settings, random_poses):
    bodies = [BODIES[name] for name in names]
    for branch in BRANCHES:
        poses = _poses(branch, bodies, random_poses)
        found = [evaluator(name, *bodies, **settings)(*poses) for name in ("numpy", "jax")]
        agree(found[0], found[1], poses, bodies, settings["gamma"], smooth=branch != "touching")


@pytest.mark.parametrize("name", ["casadi", pytest.param("jax", marks=pytest.mark.slow)])
def test_witness_normals_agree(name, random_poses):
    bodies = BODIES["box"], BODIES["capsule"]
    poses = random_poses(3, COUNT, 0.7), random_poses(4, COUNT, 0.7)
    normals = np.random.default_rng(6).normal(size=(COUNT, 2, 3))
    found = [evaluator(witness, *bodies, witness_count=2)(*poses, normals) for witness in ("numpy", name)]
    agree(found[0], found[1], poses, bodies, gamma=2)


def test_compiled_agrees_with_interpreted_at_hard_poses():
    """The boxes' hard poses at once."""
    bodies = HARD[0].body_a, HARD[0].body_b
    cases = [case for case in HARD if (case.body_a, case.body_b) == bodies]
    poses = [np.array([getattr(case, name) for case in cases]) for name in ("pose_a", "pose_b")]
    found = [evaluator(name, *bodies)(*poses) for name in ("casadi", "compiled")]
    agree(found[0], found[1], poses, bodies, gamma=2)


@pytest.mark.parametrize("name", ["compiled", "jax"])
def test_value_and_gradient_are_those_that_come_with_the_hessian(name, random_poses):
    if name == "jax":
        pytest.importorskip("jax")
    build = getattr(hdplan.distance, {"compiled": "hdsdf_compiled", "jax": "hdsdf_batch"}[name])
    distance = build(BODIES["box"], BODIES["capsule"], shaping_length=0.1)  # which other tests compile, too
    poses = random_poses(7, 8, 0.7), random_poses(8, 8, 0.7)
    whole = distance.hessian(*poses)
    for part in (distance.value(*poses), distance.gradient(*poses)):
        for x, y in zip(part, whole[: len(part)], strict=True):
            np.testing.assert_allclose(x, y, rtol=1e-12)


def test_a_merged_multiset_is_the_set_for_a_body_without_parallel_edges():
    tetrahedron = ConvexBody.platonic("tetrahedron")
    poses = np.eye(4), np.eye(4)
    poses[0][0, 3] = 2.0
    one, other = (
        evaluator("numpy", tetrahedron, tetrahedron, normals=name)(*poses) for name in ("paper", "paper-multiset")
    )
    np.testing.assert_allclose(one.value, other.value, rtol=1e-15)


def _names(path):
    """Return which names a file imports from which module of the folder and its rooms."""
    found = {}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("hdplan.distance."):
            module = node.module.removeprefix("hdplan.distance.")
            found.setdefault(module, set()).update(alias.name for alias in node.names)
            found.update({f"{module}.{alias.name}": {"*"} for alias in node.names})  # where it is a module of a room
        elif isinstance(node, ast.Import):
            found.update({a.name.removeprefix("hdplan.distance."): {"*"} for a in node.names if "hdplan.dis" in a.name})
        elif isinstance(node, ast.ImportFrom) and node.module == "hdplan.distance":
            found.update({alias.name: {"*"} for alias in node.names})
    return found


@pytest.mark.core
def test_the_witnesses_share_no_formula():
    """Each one's modules, down to what is shared: bodies, candidate normals, the checks of poses and parameters."""
    folder = Path(hdplan.distance.__file__).parent
    files = {".".join(path.relative_to(folder).with_suffix("").parts): path for path in folder.rglob("*.py")}
    imports = {name: _names(path) for name, path in files.items() if not name.endswith("__init__")}
    modules = {}
    for name, start in FAMILY.items():
        assert start <= set(imports)
        seen, waiting = set(), set(start)
        while waiting:
            module = waiting.pop()
            seen.add(module)
            names = {other for other, taken in imports[module].items() if not taken <= SHARED_OF_HOLDER}
            waiting |= (names & set(imports)) - SHARED - seen
        modules[name] = seen
    for name, other in (("numpy", "casadi"), ("numpy", "jax"), ("casadi", "jax")):
        assert not modules[name] & modules[other], f"{name} and {other} share {modules[name] & modules[other]}"
    assert "holder" in modules["numpy"]
