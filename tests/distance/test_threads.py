"""Every distance measured by eight threads at once, from one object and from objects of their own, equals the distance
measured alone bit for bit; slow objects are made once."""

from __future__ import annotations

import copy
import functools
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from hdplan.distance import (
    ConvexBody,
    hdsdf,
    hdsdf_compiled,
    hdsdf_derivatives,
    hdsdf_function,
    separation,
    signed_distance,
    signed_distances,
)
from hdplan.distance.baselines.coal import CoalPair
from hdplan.distance.baselines.gdf import gdf
from hdplan.distance.baselines.gdf_batch import gdf_boxes
from hdplan.distance.compiled.c_library import compiler
from hdplan.distance.compiled.compile_time import compile_time
from hdplan.distance.studies.random_poses import paper_poses
from hdplan.distance.symbolic.box_kernel import box_distance
from hdplan.distance.symbolic.halfspaces import halfspace_distance, swept_halfspace_distance
from hdplan.distance.symbolic.row_function import RowFunction
from hdplan.scenes.array_types import Array
from hdplan.scenes.once import made_once
from tests.threads import THREADS, together

Query = Callable[[Array], list[Array]]  # of some rows of the poses

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")

POSES = 80
FEW = 8  # poses of what takes long for each
FEW_THREADS = 2  # of what starts a process each time
A, B = ConvexBody.platonic("dodecahedron"), ConvexBody.box([0.7, 0.4, 1.1])
POSE_A, POSE_B = paper_poses(np.random.default_rng(3), POSES)


def arrays(found: Any) -> list[Array]:
    """Results as arrays to compare."""
    return [np.asarray(part) for part in (found if isinstance(found, tuple | list) else (found,))]


def each(run: Callable[[Array, Array], Any]) -> Query:
    """Query pose by pose."""

    def query(rows: Array) -> list[Array]:
        one_by_one = [arrays(run(POSE_A[k], POSE_B[k])) for k in rows]
        return [np.array(parts) for parts in zip(*one_by_one, strict=True)]

    return query


def at_once(run: Callable[[Array, Array], Any]) -> Query:
    """Query of all poses in one call."""
    return lambda rows: arrays(run(POSE_A[rows], POSE_B[rows]))


def rows_of(function: ca.Function, interpreted: bool = False) -> Query:
    """Query of random rows of random tables by a kernel."""
    kernel = RowFunction(function)
    kernel.is_compiled = kernel.is_compiled and not interpreted
    rng = np.random.default_rng(5)
    tables = []
    for name, width in zip(function.name_in(), kernel.widths, strict=True):
        table = rng.normal(size=(POSES, width))
        if name.startswith(("placement", "first", "second")):
            table[:, :9] = np.linalg.qr(rng.normal(size=(POSES, 3, 3)))[0].reshape(-1, 9)
        tables.append(table)
    return lambda rows: kernel(tables, [rows] * len(tables))


def boxes(rows: Array) -> list[Array]:
    half = np.tile([0.35, 0.2, 0.55], (len(rows), 1))
    placed = [(half, pose[rows, :3, :3], pose[rows, :3, 3]) for pose in (POSE_A, POSE_B)]
    return list(gdf_boxes(*placed[0], *placed[1]))


def batch(order: str, dtype: str) -> Query:
    pytest.importorskip("jax")
    from hdplan.distance import hdsdf_batch

    return at_once(getattr(hdsdf_batch(A, B, dtype=dtype), order))


def fcl_children(rows: Array) -> list[Array]:
    pytest.importorskip("fcl")
    from hdplan.distance.baselines.fcl import fcl_distances

    found = fcl_distances(A, POSE_A[rows], B, POSE_B[rows])
    return [found.distances, found.points_a, found.points_b, found.normals]


def fcl_pair() -> Query:
    pytest.importorskip("fcl")
    from hdplan.distance.baselines.fcl import FclPair

    return each(FclPair(A, B).distance)


def fields(proximity: Any) -> list[Any]:
    return [proximity.distance, proximity.point_a, proximity.point_b]


# how a thread comes by the distance, and for how many poses
WITNESSES: dict[str, tuple[Callable[[], Query], int]] = {
    "hdsdf": (lambda: each(lambda a, b: hdsdf(A, a, B, b)), FEW),
    "separation": (lambda: each(lambda a, b: separation(A, a, B, b)), FEW),
    "derivatives": (lambda: each(lambda a, b: list(vars(hdsdf_derivatives(A, a, B, b)).values())), 3),
    "compiled value": (lambda: at_once(hdsdf_compiled(A, B).value), POSES),
    "compiled gradient": (lambda: at_once(hdsdf_compiled(A, B).gradient), POSES),
    "compiled hessian": (lambda: at_once(hdsdf_compiled(A, B).hessian), POSES),
    "compiled, one by one": (lambda: each(hdsdf_compiled(A, B).hessian), POSES),
    "function": (lambda: each(functools.partial(_call, hdsdf_function(A, B))), FEW),
    "batch": (lambda: batch("gradient", "float64"), POSES),
    "batch, float32": (lambda: batch("value", "float32"), POSES),
    "signed_distance": (lambda: each(lambda a, b: fields(signed_distance(A, a, B, b))), FEW),
    "signed_distances": (lambda: at_once(lambda a, b: signed_distances(A, a, B, b)), POSES),
    "coal": (lambda: each(CoalPair(A, B).distance), POSES),
    "gdf": (lambda: each(lambda a, b: fields(gdf(A, a, B, b))), FEW),
    "gdf of boxes": (lambda: boxes, POSES),
    "half-spaces": (lambda: rows_of(halfspace_distance(4, 26, 2, 1e-3)), POSES),
    "half-spaces, interpreted": (lambda: rows_of(halfspace_distance(4, 26, 2, 1e-3), interpreted=True), FEW),
    "swept": (lambda: rows_of(swept_halfspace_distance(4, 26, 2, 1e-3)), POSES),
    "boxes": (lambda: rows_of(box_distance(2, 1e-3, "paper")), POSES),
    "fcl": (fcl_pair, POSES),
    "fcl's children": (lambda: fcl_children, FEW),
}


def _call(function: ca.Function, a: Array, b: Array) -> Array:
    return np.array(function(a, b))


@pytest.mark.sampled(5)
@pytest.mark.parametrize("name", WITNESSES)
def test_threads_get_what_one_gets_alone(name: str) -> None:
    """Each takes the poses in an order of its own, from an object that all share, and again from one of its own."""
    make, count = WITNESSES[name]
    shared = make()
    alone = shared(np.arange(count))
    assert len(alone[0]) == count

    def work(index: int) -> None:
        order = np.random.default_rng(index).permutation(count)
        for query in dict.fromkeys((shared, make())):  # one, of what keeps nothing
            for part, expected in zip(query(order), alone, strict=True):
                np.testing.assert_array_equal(part, expected[order])

    together(work, FEW_THREADS if name == "fcl's children" else THREADS)


@needs_compiler
def test_bodies_of_their_own_are_no_different() -> None:
    alone = hdsdf_compiled(A, B).gradient(POSE_A, POSE_B)

    def work(index: int) -> tuple[Array, ...]:
        own_a, own_b = ConvexBody.platonic("dodecahedron"), ConvexBody.box([0.7, 0.4, 1.1])
        return hdsdf_compiled(own_a, own_b).gradient(POSE_A, POSE_B)

    for found in together(work):
        for part, expected in zip(found, alone, strict=True):
            np.testing.assert_array_equal(part, expected)


@needs_compiler
def test_a_compiled_kernel_does_not_hold_pythons_lock() -> None:
    """A thread that waits for its turn gets it while a kernel runs, though Python makes nobody let go."""
    x = ca.SX.sym("x")
    long = RowFunction(ca.Function("step", [x], [ca.sin(x) + x]).fold(10**6))
    assert long.is_compiled
    begun, done = threading.Event(), threading.Event()

    def wait() -> None:
        begun.wait()
        done.set()

    before = sys.getswitchinterval()
    beside = threading.Thread(target=wait)
    beside.start()
    sys.setswitchinterval(1e3)  # [s]
    try:
        begun.set()
        long.once(np.ones(1))
        assert done.is_set()
    finally:
        sys.setswitchinterval(before)
        beside.join()


# --- making -----------------------------------------------------------------------------------------------------------


@needs_compiler
def test_threads_that_ask_for_one_kernel_compile_it_once(cache: Path, runs: list[int]) -> None:
    own = ConvexBody.box([0.3, 0.31, 0.32]), ConvexBody.box([0.2, 0.21, 0.22])
    found = together(lambda _: hdsdf_compiled(*own).value(POSE_A, POSE_B)[0])
    assert len(runs) == 1
    for values in found[1:]:
        np.testing.assert_array_equal(values, found[0])


@needs_compiler
def test_threads_may_compile_different_kernels_at_once(cache: Path, runs: list[int]) -> None:
    def work(index: int) -> Array:
        x = ca.SX.sym("x", 2)
        kernel = RowFunction(ca.Function("several", [x], [(index + 1) * ca.sin(x)]))
        return kernel([np.ones((1, 2))], [np.zeros(1, np.int64)])[0]

    found = together(work)
    assert len(runs) == THREADS
    for index, values in enumerate(found):
        np.testing.assert_allclose(values, (index + 1) * np.sin(1.0), rtol=1e-14)


def test_a_thread_s_time_to_compile_is_its_own() -> None:
    x = ca.SX.sym("x")

    def work(index: int) -> tuple[float, float]:
        with compile_time() as whole:
            RowFunction(ca.Function(f"timed_{index}", [x], [ca.cos(x)]))
            with compile_time() as part:
                RowFunction(ca.Function(f"timed_again_{index}", [x], [ca.sin(x)]))
        RowFunction(ca.Function(f"untimed_{index}", [x], [ca.tan(x)]))
        return whole.seconds, part.seconds

    with compile_time() as here:
        assert all(whole > part > 0.0 for whole, part in together(work, 3))
    assert here.seconds == 0.0


def test_made_once_makes_each_value_once_and_keeps_the_latest() -> None:
    made: list[int] = []

    @made_once(2)
    def slow(number: int) -> object:
        made.append(number)
        threading.Event().wait(0.02)
        return object()

    found = together(lambda index: slow(index % 2))
    assert sorted(made) == [0, 1]
    assert len(set(map(id, found))) == 2
    assert slow(0) is slow(0)
    slow(2)  # one too many: 1 was used last
    assert slow(0) is slow(0)
    slow(1)
    assert made[2:] == [2, 1]


def test_a_failure_is_not_kept() -> None:
    tries: list[int] = []

    @made_once(2)
    def fails_first(number: int) -> int:
        tries.append(number)
        if len(tries) == 1:
            raise ValueError("once")
        return number

    def work(index: int) -> int:
        try:
            return fails_first(7)
        except ValueError:
            return -1

    assert sorted(together(work)) == [-1] + [7] * (THREADS - 1)
    assert tries == [7, 7]


def test_after_a_failure_a_newcomer_waits_beside_those_who_waited() -> None:
    tries, waiting, second_in, go_on = [], threading.Event(), threading.Event(), threading.Event()

    @made_once(2)
    def fails_first(number: int) -> int:
        tries.append(number)
        if len(tries) == 1:
            second.start()
            waiting.wait(10)
            second.join(0.05)  # long enough to reach the lock, where the second waits
            raise ValueError("once")
        second_in.set()
        go_on.wait(10)
        return number

    def call() -> None:
        waiting.set()
        fails_first(7)

    second, newcomer = threading.Thread(target=call), threading.Thread(target=call)
    with pytest.raises(ValueError, match="once"):
        fails_first(7)
    assert second_in.wait(10)
    newcomer.start()
    newcomer.join(0.05)
    assert tries == [7, 7]  # the failure and the second; the newcomer waits for its value
    go_on.set()
    for thread in (second, newcomer):
        thread.join(10)
    assert tries == [7, 7]


FORKED = """
import os, signal, threading, warnings
from hdplan.scenes.once import ForkSafeLock, made_once

inside, leave, turn = threading.Event(), threading.Event(), ForkSafeLock()

@made_once(4)
def slow(number):
    with turn:
        if threading.current_thread() is not threading.main_thread():
            inside.set()
            leave.wait()
    return number

thread = threading.Thread(target=slow, args=(7,))
thread.start()
inside.wait()
warnings.simplefilter("ignore")
child = os.fork()
if not child:
    signal.alarm(20)
    os._exit(slow(7))
status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
leave.set()
thread.join()
print(status)
"""


def test_a_forked_process_waits_for_no_thread_that_it_has_not() -> None:
    """The thread that was making a value when a process was forked is not there to hand it over."""
    done = subprocess.run([sys.executable, "-c", FORKED], capture_output=True, text=True, timeout=60)
    assert (done.stdout.strip(), done.stderr) == ("7", "")


@pytest.mark.parametrize("again", [lambda it: pickle.loads(pickle.dumps(it)), copy.deepcopy], ids=["pickle", "copy"])
def test_a_distance_that_was_used_goes_to_another_process(again: Callable[[Any], Any]) -> None:
    distance, pose = hdsdf_compiled(ConvexBody.box([1.0, 1.0, 1.0]), ConvexBody.sphere(0.2)), np.eye(4)
    right = distance.value(pose, pose)
    np.testing.assert_array_equal(again(distance).value(pose, pose), right)
