"""Laws of the compiled rows: the same numbers as the interpreter, row by row, whatever the cache or the compiler."""

from __future__ import annotations

import errno
import functools
import importlib.util
import shutil
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from hdplan.distance.compiled import c_library
from hdplan.distance.compiled.c_library import compiler
from hdplan.distance.symbolic.halfspaces import halfspace_distance
from hdplan.distance.symbolic.row_function import RowFunction
from hdplan.scenes.array_types import Array

SAME = 1e-15  # relative; both ways run the same instructions in the same order

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler here")


pytestmark = pytest.mark.usefixtures("cache")


def small() -> ca.Function:
    """A function of two inputs and two outputs that compiles in no time; one output is a matrix, column-major."""
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y", 2)
    return ca.Function("small", [x, y], [ca.sin(x) * y[0], ca.dot(x, x) ** (1 / 3) * (x @ y.T)])


def small_in_numpy(x: Array, y: Array) -> tuple[Array, Array]:
    return np.sin(x) * y[0], (np.dot(x, x) ** (1 / 3) * np.outer(x, y)).ravel(order="F")


def some_rows(seed: int, count: int = 20) -> tuple[list[Array], list[NDArray[np.int64]]]:
    rng = np.random.default_rng(seed)
    tables = [rng.normal(size=(7, 3)), rng.normal(size=(4, 2))]
    return tables, [rng.integers(0, len(table), count) for table in tables]


def interpreted(function: ca.Function) -> RowFunction:
    rows = RowFunction(function)
    rows.is_compiled = False
    return rows


@functools.cache
def made_of_small(make: Callable[[ca.Function], RowFunction]) -> RowFunction:
    return make(small())


def without_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(c_library, "compiler", compiler.__wrapped__)  # what a fresh process would find
    c_library._warn_once.cache_clear()


@pytest.mark.parametrize("make", [RowFunction, interpreted], ids=["compiled", "interpreted"])
def test_rows_are_the_function_at_the_picked_rows(make: Callable[[ca.Function], RowFunction]) -> None:
    tables, rows = some_rows(1)
    first, second = make(small())(tables, rows)
    assert (first.shape, second.shape) == ((20, 3), (20, 6))
    for k, (i, j) in enumerate(zip(*rows, strict=True)):
        one, other = small_in_numpy(tables[0][i], tables[1][j])
        np.testing.assert_allclose(first[k], one, rtol=1e-14)
        np.testing.assert_allclose(second[k], other, rtol=1e-14)


@needs_compiler
def test_compiled_and_interpreted_give_the_same_numbers() -> None:
    """For the planner's distance, in all its branches: apart, in contact, deep, with idle slots."""
    function = halfspace_distance(2, 6, 2, 1e-3)
    rng = np.random.default_rng(2)
    rotations = np.linalg.qr(rng.normal(size=(30, 3, 3)))[0].reshape(30, 9)
    placements = np.hstack([rotations, rng.uniform(-0.6, 0.6, (30, 3))])
    bodies = np.hstack([rng.normal(size=(5, 6)) * 0.2, np.tile([1.0, 1.0], (5, 1)), rng.uniform(0, 0.1, (5, 1))])
    bodies[0, 3:6], bodies[0, 7] = bodies[0, :3], 0.0
    normals = np.vstack([np.eye(3), -np.eye(3)]).ravel()
    planes = np.hstack([np.tile(normals, (4, 1)), rng.uniform(0.1, 0.3, (4, 6))])
    rows = [rng.integers(0, count, 300) for count in (30, 30, 5, 4)]
    fast = RowFunction(function)
    assert fast.is_compiled
    tables = [placements, placements, bodies, planes]
    distance = fast(tables, rows)[0]
    assert (distance > 0).any()
    assert (distance < 0).any()
    for one, other in zip(fast(tables, rows), interpreted(function)(tables, rows), strict=True):
        np.testing.assert_allclose(one, other, rtol=SAME, atol=0)


@pytest.mark.parametrize("make", [RowFunction, interpreted], ids=["compiled", "interpreted"])
def test_a_row_does_not_depend_on_the_others(make: Callable[[ca.Function], RowFunction]) -> None:
    function = make(small())
    tables, rows = some_rows(3)
    together = function(tables, rows)
    order = np.random.default_rng(4).permutation(len(rows[0]))
    shuffled = function(tables, [row[order] for row in rows])
    for k in range(len(order)):
        alone = function(tables, [row[k : k + 1] for row in rows])
        for all_, one, turned in zip(together, alone, shuffled, strict=True):
            np.testing.assert_array_equal(one[0], all_[k])
            np.testing.assert_array_equal(turned[k], all_[order[k]])


@pytest.mark.parametrize("make", [RowFunction, interpreted], ids=["compiled", "interpreted"])
def test_tables_of_any_layout_are_read_alike(make: Callable[[ca.Function], RowFunction]) -> None:
    function = make(small())
    tables, rows = some_rows(5)
    plain = function(tables, rows)
    odd = function(
        [np.asfortranarray(tables[0]), np.repeat(tables[1], 2, axis=1)[:, ::2]],
        [rows[0].astype(np.int32), np.repeat(rows[1], 2)[::2]],
    )
    for one, other in zip(plain, odd, strict=True):
        np.testing.assert_array_equal(one, other)


def test_no_rows_give_no_results() -> None:
    none = np.zeros(0, np.int64)
    first, second = RowFunction(small())([np.zeros((1, 3)), np.zeros((0, 2))], [none, none])
    assert (first.shape, second.shape) == ((0, 3), (0, 6))


@pytest.mark.parametrize("make", [RowFunction, interpreted], ids=["compiled", "interpreted"])
@pytest.mark.parametrize(
    ("tables", "rows"),
    [
        ([np.zeros((7, 4)), np.zeros((4, 2))], [[0, 1], [0, 1]]),  # too wide
        ([np.zeros(3), np.zeros((4, 2))], [[0], [0]]),  # one dimension
        ([np.zeros((7, 3)), np.zeros((4, 2))], [[0, 1], [0]]),  # rows of different lengths
        ([np.zeros((7, 3)), np.zeros((4, 2))], [[[0]], [[0]]]),  # rows of two dimensions
        ([np.zeros((7, 3)), np.zeros((4, 2))], [[0, 7], [0, 1]]),  # beyond the table
        ([np.zeros((7, 3)), np.zeros((4, 2))], [[0, 1], [0, -1]]),  # before it
        ([np.zeros((7, 3)), np.zeros((0, 2))], [[0], [0]]),  # an empty table
        ([np.zeros((7, 3))], [[0]]),  # an input is missing
        ([np.zeros((7, 3)), np.zeros((4, 2))], [[0]]),  # the rows of an input are missing
        ([np.zeros((7, 3)), np.zeros((4, 2)), np.zeros((1, 1))], [[0], [0], [0]]),  # one too many
        ([], []),
    ],
)
def test_wrong_shapes_and_rows_are_refused(
    make: Callable[[ca.Function], RowFunction], tables: list[Array], rows: list[object]
) -> None:
    with pytest.raises(ValueError, match=r"^small: "):
        made_of_small(make)(tables, [np.array(row, dtype=np.int64) for row in rows])


@needs_compiler
def test_compiled_once_and_found_again(cache: Path, runs: list[int]) -> None:
    tables, rows = some_rows(6)
    first = RowFunction(small())(tables, rows)
    assert len(runs) == 1
    again = RowFunction(small())
    assert again.is_compiled
    assert len(runs) == 1
    for one, other in zip(first, again(tables, rows), strict=True):
        np.testing.assert_array_equal(one, other)
    assert [file.suffix for file in (cache / "compiled").iterdir()] == [".so"]


@needs_compiler
@pytest.mark.sampled(2)
@pytest.mark.parametrize("damage", [b"", b"not a library", None], ids=["empty", "text", "cut short"])
def test_a_damaged_entry_is_compiled_again(cache: Path, runs: list[int], damage: bytes | None) -> None:
    """Functions of the same name have another content here, so that no library is loaded already."""
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y", 2)
    number = {b"": 2.0, b"not a library": 3.0, None: 4.0}[damage]
    function = ca.Function("damaged", [x, y], [number * ca.sin(x) * y[0]])
    # made by another process: a library that this one has loaded must not be changed under its feet
    subprocess.Popen(
        [sys.executable, "-c", "import sys, casadi as ca; from hdplan.distance.symbolic import row_function; "
         "row_function.RowFunction(ca.Function.deserialize(sys.stdin.read()))"],
        stdin=subprocess.PIPE, text=True,
    ).communicate(function.serialize())  # fmt: skip
    (entry,) = (cache / "compiled").iterdir()
    whole = entry.read_bytes()
    entry.write_bytes(whole[: len(whole) // 2] if damage is None else damage)
    tables, rows = some_rows(7)
    again = RowFunction(function)
    assert again.is_compiled
    assert len(runs) == 1
    (result,) = again(tables, rows)
    np.testing.assert_allclose(result, number * np.sin(tables[0][rows[0]]) * tables[1][rows[1], :1], rtol=1e-14)
    assert any(len(file.read_bytes()) > len(whole) // 2 for file in (cache / "compiled").iterdir())


@needs_compiler
def test_works_where_the_cache_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file stands where the folder should be."""
    blocked = tmp_path / "blocked"
    blocked.write_text("")
    monkeypatch.setenv("HDPLAN_CACHE", str(blocked))
    tables, rows = some_rows(8)
    with pytest.warns(UserWarning, match=r"blocked cannot be written \(Not a directory\)"):
        function = RowFunction(small())
    assert function.is_compiled
    np.testing.assert_allclose(function(tables, rows)[0], interpreted(small())(tables, rows)[0], rtol=SAME)


def test_works_without_a_compiler(monkeypatch: pytest.MonkeyPatch, cache: Path) -> None:
    tables, rows = some_rows(9)
    expected = RowFunction(small())(tables, rows)
    without_compiler(monkeypatch)
    monkeypatch.setenv("HDPLAN_CACHE", str(cache / "empty"))
    with pytest.warns(UserWarning, match="no C compiler found") as words:
        function = RowFunction(small())
    assert len(words) == 1
    assert not function.is_compiled
    for one, other in zip(function(tables, rows), expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=SAME)


def test_a_missing_compiler_is_reported_once(monkeypatch: pytest.MonkeyPatch, cache: Path) -> None:
    without_compiler(monkeypatch)
    with pytest.warns(UserWarning, match="no C compiler found"):
        RowFunction(small())
    RowFunction(small())  # warnings are errors here


def test_a_failing_compiler_is_named_and_its_last_words(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    broken = tmp_path / "broken-cc"
    broken.write_text("#!/bin/sh\necho 'cannot do that' >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setattr(c_library, "compiler", lambda: (str(broken),))
    with pytest.warns(UserWarning, match="broken-cc failed on small: .*cannot do that"):
        function = RowFunction(small())
    assert not function.is_compiled
    tables, rows = some_rows(10)
    np.testing.assert_allclose(function(tables, rows)[0][0], np.sin(tables[0][rows[0][0]]) * tables[1][rows[1][0], 0])


def test_a_full_disk_is_named(monkeypatch: pytest.MonkeyPatch, cache: Path) -> None:
    """Nowhere to write the C code: the distance is interpreted, and says so."""

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.warns(UserWarning, match=r"nowhere to compile .*No space left on device.*; interpreting"):
        assert not RowFunction(small()).is_compiled


def test_cc_names_the_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "my-own-cc")
    monkeypatch.setattr(shutil, "which", lambda name: f"/bin/{name}")
    assert compiler.__wrapped__() == ("my-own-cc",)


@needs_compiler
def test_processes_may_write_at_once(cache: Path) -> None:
    """All processes get a whole library, the first one and the others, and only whole libraries remain."""
    code = (
        "import numpy as np, casadi as ca; from hdplan.distance.symbolic.row_function import RowFunction\n"
        "x = ca.SX.sym('x', 3); f = RowFunction(ca.Function('raced', [x], [ca.sin(x)]))\n"
        "assert f.is_compiled; print(f([np.ones((1, 3))], [np.zeros(4, np.int64)])[0].sum().hex())"
    )
    command = [sys.executable, "-W", "error", "-c", code]
    racing = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(3)]
    printed = {process.communicate()[0] for process in racing}
    assert all(process.returncode == 0 for process in racing)
    assert len(printed) == 1
    last = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert printed == {last}
    assert all(not file.name.startswith(".") for file in (cache / "compiled").iterdir())
