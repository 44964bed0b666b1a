"""The recipes of docs/contributing.md, followed in a copy of the tree: what a step leaves undone fails by name.

A child process adds a dummy of each kind (`NAMES` and others), with a fresh hdplan after each step.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
CHILD = Path(__file__).with_name("recipes_child.py")
NAMES = {
    "A limit": "torque_rate",
    "A shape": "",
    "An objective": "",
    "A trajectory file": "words",
    "A language of robots": "chain",
    "A layer of the viewer": "",
    "A solver": "straight",
    "A command": "hello",
}
COUNTS = {"One": 1, "Two": 2, "Three": 3, "Five": 5}  # of files, as the page says
Found = dict[tuple[str, tuple[str, ...], str], str]


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Found:
    """(recipe, files done, probe) -> what came of it."""
    tree = tmp_path_factory.mktemp("tree")
    ignore = shutil.ignore_patterns("__pycache__")
    for folder in ("planner", "scenes"):
        shutil.copytree(ROOT / folder, tree / folder, ignore=ignore)
    shutil.copytree(ROOT / "src" / "hdplan", tree / "src" / "hdplan", symlinks=True, ignore=ignore)
    for name in ("cli.py", "hatch_build.py"):
        shutil.copy(ROOT / name, tree)
    (tree / "distance").symlink_to(ROOT / "distance")
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run([sys.executable, str(CHILD), str(tree)], capture_output=True, text=True, env=env)
    assert done.returncode == 0, done.stderr[-2000:]
    return {(recipe, tuple(files), probe): outcome for recipe, files, probe, outcome in json.loads(done.stdout)}


def section(recipe: str) -> str:
    """A recipe of the page."""
    text = (ROOT / "docs" / "contributing.md").read_text(encoding="utf-8")
    return text.partition(f"### {recipe}\n")[2].partition("\n#")[0]


def steps(recipe: str) -> list[str]:
    """The files that a recipe names first in each of its steps; of one without steps, the first that it names."""
    files = re.findall(r"^\d+\. [^`]*`([\w./]+\.py)`", section(recipe), re.MULTILINE)
    files = files or re.findall(r"`([\w./]+\.py)`", section(recipe))[:1]
    return [file.replace("NAME", NAMES[recipe]) for file in files]


@pytest.mark.parametrize("recipe", NAMES)
def test_the_recipes_are_those_of_the_page(found: Found, recipe: str) -> None:
    whole = max((files for name, files, _ in found if name == recipe), key=len)
    assert list(whole) == steps(recipe)
    count = re.match(r"\s*(\w+) files?\b", section(recipe))
    assert count is not None, f"{recipe}: the page does not say how many files"
    assert COUNTS[count[1]] == len(whole)


def test_a_limit_is_certified_once_it_is_checked_and_never_before(found: Found) -> None:
    check = "planner/certificate/limit_checks.py"
    tried = {key: outcome for key, outcome in found.items() if key[0] == "A limit"}
    assert len({files for _, files, _ in tried}) == 6  # five steps, and all but the one that names the check
    for (_, files, probe), outcome in tried.items():
        if probe.startswith("certify") and check not in files:
            assert outcome.startswith("UncheckedError: no certificate: the scene requires limits.torque_rate"), files
        elif probe == "certify":
            assert outcome.startswith("certified"), files
        elif probe == "certify tightly":
            assert outcome.startswith("overloaded: torque_rate"), files
        elif probe == "plan" and len(files) < 5:
            assert re.match("(UncheckedError|LookupError): no .*limits.torque_rate", outcome), files
        elif probe == "plan":
            assert outcome.startswith("certified: ")
            assert "torque_rate up to" in outcome
    assert "limits: the checker does not know 'torque_rate' there" in tried["A limit", (*steps("A limit"),), "at last"]


def test_a_shape_is_planned_around_once_all_know_it_and_never_before(found: Found) -> None:
    whole = tuple(steps("A shape"))
    for (recipe, files, _), outcome in found.items():
        if recipe == "A shape" and files == whole:
            assert outcome.startswith("certified: at least ")
        elif recipe == "A shape":
            assert re.search("shape Octahedron (is not supported by the certificate|with radii)", outcome), files


def test_an_objective_is_planned_by_once_it_has_a_measure(found: Found) -> None:
    word, whole = steps("An objective")
    assert found["An objective", (word,), "plan"].startswith("ValueError: no measure is known as 'length'")
    assert found["An objective", (word, whole), "plan"].startswith("length [rad]: certified")


def test_a_robot_in_another_language_is_planned_once_it_is_in_the_table(found: Found) -> None:
    module, table = steps("A language of robots")
    refused = found["A language of robots", (module,), "plan"]
    assert refused.startswith("InputError: ")
    assert refused.endswith("the root element is <chain>, expected <robot> or <mujoco>")
    assert found["A language of robots", (module, table), "plan"].startswith("certified")


def test_a_layer_is_seen_once_it_has_a_row_and_a_call(found: Found) -> None:
    pytest.importorskip("viser", reason="the viewer is optional")
    module, table = steps("A layer of the viewer")
    assert found["A layer of the viewer", (module,), "switch"] == "KeyError: 'ball'"
    assert found["A layer of the viewer", (module, table), "switch"] == "seen: [True, False]; hint: at the origin"


def test_a_solver_and_a_command_are_there_at_once(found: Found) -> None:
    assert found["A solver", tuple(steps("A solver")), "plan"].startswith("certified")
    module, whole = steps("A command")
    assert found["A command", (module,), "run"].startswith("2: hdplan: No such command 'hello'")
    assert found["A command", (module, whole), "run"] == "0: hello"


def test_a_trajectory_file_is_written_and_read_once_it_is_in_the_tables(found: Found) -> None:
    module, tables = steps("A trajectory file")
    assert "'.words'" in found["A trajectory file", (module,), "save"]
    assert found["A trajectory file", (module,), "save"].startswith("InputError: ")
    assert found["A trajectory file", (module, tables), "save"].startswith("InputError: ")
    assert found["A trajectory file", (module, tables), "save"].endswith("no times: write .json")
