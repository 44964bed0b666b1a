"""Laws of the border of the loops in C (`border.h`): every argument of every function is checked at every call. What is
refused is named, nothing has been written then, and nothing crashes; what is held is let go."""

from __future__ import annotations

import contextlib
import gc
import itertools
import multiprocessing
import pickle
import subprocess
import sys
import weakref
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdplan.distance.compiled.loops import C, Record
from hdplan.planner.build import build
from hdplan.planner.certificate.parts import Parts
from hdplan.planner.certificate.pose_curve import PoseCurve
from hdplan.planner.control.barrier_settings import BarrierSettings
from hdplan.planner.control.controller import Controller
from hdplan.planner.control.settings import ControlSettings
from hdplan.planner.control.tasks import standing
from hdplan.planner.geometry.cells_loop import cell_boxes
from hdplan.planner.job.layers_loop import steps_between
from hdplan.planner.plan import plan
from hdplan.planner.problem.assemble import exactly
from hdplan.planner.problem.clearance import Clearance
from hdplan.planner.problem.gravity_torque import static_torque
from hdplan.planner.problem.path_speed import PathSpeed
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.inverse_kinematics import inverse_kinematics
from hdplan.planner.search.tree_ways import tree_ways
from hdplan.planner.timing.time_optimal import GRID, PathRows, time_optimal
from hdplan.scenes.limits import Limits
from hdplan.scenes.path_constraints import Follow
from hdplan.scenes.poses import Pose
from hdplan.scenes.yaml_format.reader import load_scene
from tests.loops import needs_loops

pytestmark = needs_loops

# Together they call every function, with every optional argument there and not there.
SCENES = ("panda_grasp", "panda_camera", "panda_conveyor")
Call = tuple[Any, ...]


def functions() -> dict[str, Callable[..., Any]]:
    own = vars(C or object)
    return {name: f for name, f in own.items() if callable(f) and not isinstance(f, type) and name[0] != "_"}


NAMES = sorted(functions()) if C else []
# What may be None, and axes (argument, axis) of any length, with which nothing else has to agree.
OPTIONAL = {
    "intervals": {"drift_omega", "drift_velocity", "drift_first", "drift_second"},
    "close_rows": {"placements", "centres", "reach"},
    "side": {"parts"},
    "penalties": {"weight"},
    "term": {"solids"},
    "gravity_hinge": {"weight"},
    "barrier": {"solids"},
}
FREE = {
    "tables": {("planes", 0)},
    "term": {("moves", 1)},
    "world": {("vertices", 0)},
    "hdsdf_rows": {("placements", 0), ("placements", 1)},
    "solids": {("rows", 0)},
    "exact_rows": {("placements", 0), ("placements", 1)},
    "walk": {("stack", 0), ("open", 0)},
    "separation": {("vertices", 0)},
    "approach": {("q", 0)},
    "centre": {("q", 0)},
    "draw_near": {("q", 0)},
    "close_rows": {("placements", 0), ("placements", 1), ("centres", 1)},
    "penalties": {("placements", 1)},
    "grow_trees": {("targets", 0)},
    "gather_cells": {("balls", 0)},
    "extend_cells": {("points", 0)},
    "braked": {("found", 0)},
    "by_joints": {("columns", 0), ("moves", 0)},
    "lows_near": {("placements", 0), ("placements", 1), ("inside", 0)},
    "lows_among": {("placements", 0), ("placements", 1), ("inside", 0), ("at", 0)},
}


MADE: dict[int, tuple[str, Call]] = {}  # structs by their identity: the function, its arguments, and the struct


def fresh(given: Any) -> Any:
    return given.copy() if isinstance(given, np.ndarray) else given


def run_scenes() -> None:
    """Plans and certificates, and what they do not call."""
    for name in SCENES:
        plan(load_scene(name), seed=1)
    problem = build(load_scene("panda_cage"))
    kinematics = problem.placed(problem.polyline())
    for term in (*problem.terms, *exactly(problem).terms):
        if isinstance(term, Clearance):
            term.inside(kinematics)
            term.depth(kinematics)
            term.pairs.close_between(kinematics)
    assert any(way is not None for way in itertools.islice(tree_ways(exactly(problem), 0.0, 0), 9))
    tree, n = problem.kinematics.tree, problem.robot.n
    corners, wide = np.eye(3), np.full(n, 0.1)
    heavy = static_torque(Setup(replace(problem.scene, limits=Limits(torque=(1.0,) * n)), problem.robot))
    assert heavy is not None
    heavy.at_samples(problem.placed(problem.samples.configurations(problem.polyline())), problem.samples)
    heavy.depth(kinematics)
    PathSpeed(np.ones(n)).value(problem.polyline())
    slope = np.ones((GRID + 1, n))
    time_optimal([PathRows.both(slope, 0.0 * slope, 0.0 * slope, np.ones(n))])
    inverse_kinematics(replace(problem.robot), [0.4, 0.1, 0.5])  # one whose closed form is not kept
    corners_of_parts = np.random.default_rng(0).normal(size=(20, 3, 3))
    _ = Parts.of(corners_of_parts, np.zeros(20)).record.struct  # meshes of earlier tests keep theirs
    C.separation(tree.struct, n, corners, 1, corners + 3.0, 0.1, np.ones(n), -wide, wide, 0.0, 0.9, 9)
    cell_boxes(corners, np.full(3, 0.01), 0.04, np.tile([0.0, 0.0, 0.0, 9.0], (2, 1)))
    steps_between(corners[:2], corners, np.ones(3), np.array([True, False, True]), 0.1)
    followed = Follow("panda_hand", [Pose((0.1 * i, 0.0, 0.5)) for i in range(4)])
    curve = PoseCurve.of(problem.robot, followed)
    curve.places(curve.rotations, curve.origins, 0.0, 3.0)
    exact = ControlSettings(BarrierSettings("euclidean", growth=0.0, self_growth=0.0), 0.01, 0.005)
    for controller in (Controller.of(load_scene("panda_cage"), settings) for settings in (ControlSettings(), exact)):
        for q in problem.robot.draw(np.random.default_rng(0), 4):
            controller.step(q, standing(q))


@pytest.fixture(scope="module")
def recorded() -> dict[str, list[Call]]:
    """The first call of every function for each pattern of Nones, with arrays that are not empty where there are."""
    found: dict[tuple[Any, ...], Call] = {}

    def recording(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def called(*given: Any) -> Any:
            before = tuple(map(fresh, given))
            empty = tuple(isinstance(each, np.ndarray) and each.size == 0 for each in given)
            found.setdefault((name, tuple(each is None for each in given), any(empty)), before)
            returned = function(*given)
            if type(returned).__name__ == "Struct":
                MADE[id(returned)] = name, (*before, returned)  # which keeps it
            return returned

        return called

    with pytest.MonkeyPatch.context() as patch:
        for name, function in functions().items():
            patch.setattr(C, name, recording(name, function))
        run_scenes()
    kept: dict[str, list[Call]] = {}
    for (name, nones, empty), given in found.items():
        if not empty or (name, nones, False) not in found:
            kept.setdefault(name, []).append(given)
    return kept


def names_of(function: Callable[..., Any], given: Call) -> list[str]:
    """Each argument's name, from the border's words on a call that ends before it."""
    names = []
    for count in range(len(given)):
        with pytest.raises(TypeError, match=r"^\w+: \w+ is missing$") as caught:
            function(*map(fresh, given[:count]))
        names.append(str(caught.value).split()[1])
    return names


def wrong_arrays(x: np.ndarray) -> Iterator[np.ndarray]:
    """The same values in every other type and layout."""
    others = (np.int64, np.uint64) if x.dtype == np.float64 else (np.float64, np.uint64)
    for dtype in (
        *others,
        np.float32,
        np.int32,
        np.complex128,
        np.bool_,
        object,
        "S8",
        "M8[s]",
        x.dtype.newbyteorder(),
    ):
        yield np.zeros(x.shape, dtype)
    yield np.repeat(x, 2, axis=-1)[..., ::2]
    yield x[..., ::-1]
    yield np.asfortranarray(x)
    yield np.repeat(x, 2, axis=0)[::2]
    memory = np.zeros(x.nbytes + 1, np.uint8)[1:].view(x.dtype).reshape(x.shape)
    memory[...] = x
    yield memory
    yield from (x[None], x[..., None], x.ravel() if x.ndim > 1 else x[0])


def is_wrong(x: np.ndarray, like: np.ndarray) -> bool:
    same = x.dtype == like.dtype and x.shape == like.shape
    return not (same and x.flags.c_contiguous and x.flags.aligned)


def longer(x: np.ndarray, axis: int, by: int) -> np.ndarray:
    shape = list(x.shape)
    shape[axis] = max(shape[axis] + by, 0)
    return np.resize(x, shape) if x.size else np.zeros(shape, x.dtype)


def wrong_values(given: Any, optional: bool, others: Sequence[Any]) -> Iterator[Any]:
    """Values that every function must refuse as an argument."""
    if not optional:
        yield None
    yield from ("text", b"12345678", object(), [[1.0]], {}, np.float64)
    if isinstance(given, np.ndarray):
        yield from (each for each in wrong_arrays(given) if is_wrong(each, given))
        yield from (given.tolist(), 1, 1.5)
    elif isinstance(given, int):
        yield from (-1, 1 << 62, 1 << 70, 1.5, float("nan"), np.zeros(2))
    elif isinstance(given, float):
        yield from (np.zeros(2), 1j)
    elif isinstance(given, tuple):
        yield from (list(given), (*given, None), (*given, object()), (*given, others[0]))
    elif given is not None:
        yield from (*others, 1, np.zeros(3), (given,))


def refusal(function: Callable[..., Any], given: Sequence[Any]) -> str:
    """The words with which a call is refused, once it is sure that nothing was written; none if it is not."""
    arrays = [each for each in given if isinstance(each, np.ndarray)]
    before = [each.tobytes() for each in arrays]
    try:
        function(*given)
    except (TypeError, ValueError) as error:
        assert [each.tobytes() for each in arrays] == before
        return str(error)
    return ""


def refused(function: Callable[..., Any], given: Sequence[Any]) -> str:
    """The words of a call that must be refused."""
    words = refusal(function, given)
    assert words
    return words


def with_one(given: Call, place: int, value: Any) -> list[Any]:
    return [*map(fresh, given[:place]), value, *map(fresh, given[place + 1 :])]


@pytest.mark.parametrize("name", NAMES)
def test_a_wrong_argument_is_named(name: str, recorded: dict[str, list[Call]]) -> None:
    assert name in recorded, f"no scene of SCENES calls {name}"
    function = functions()[name]
    for given in recorded[name]:
        names, structs = names_of(function, given), other_structs(recorded, given)
        assert len(set(names)) == len(names) - (2 if name == "separation" else 0)
        assert (
            refused(function, [*map(fresh, given), None])
            == f"{name}: takes {len(given)} arguments, not {len(given) + 1}"
        )
        for place, argument in enumerate(names):
            for value in wrong_values(given[place], argument in OPTIONAL.get(name, ()), structs[place]):
                words = refused(function, with_one(given, place, value))
                assert words.startswith(f"{name}: {argument} "), (argument, value, words)
                assert len(words) < 300


def other_structs(recorded: dict[str, list[Call]], given: Call) -> list[list[Any]]:
    """For each argument, structs of every other kind than its own."""
    kinds: dict[str, Any] = {}
    for calls in recorded.values():
        for each in (
            each for call in calls for part in call for each in (part if isinstance(part, tuple) else (part,))
        ):
            if type(each).__name__ == "Struct":
                kinds.setdefault(kind_of(each), each)
    own = [each[0] if isinstance(each, tuple) and each else each for each in given]
    return [[each for kind, each in kinds.items() if kind != kind_of(one)] for one in own]


def kind_of(struct: Any) -> str:
    """Kind of a struct, from its `repr`."""
    return repr(struct) if type(struct).__name__ == "Struct" else ""


@pytest.mark.parametrize("name", NAMES)
def test_every_axis_has_its_length(name: str, recorded: dict[str, list[Call]]) -> None:
    function, free = functions()[name], set()
    for given in recorded[name]:
        for place, argument in enumerate(names_of(function, given)):
            array = given[place]
            for axis in range(array.ndim if isinstance(array, np.ndarray) else 0):
                for by in (1, -1):
                    changed = longer(array, axis, by)
                    words = refusal(function, with_one(given, place, changed))
                    assert not words or words.startswith(f"{name}: ")
                    if not words and changed.shape != array.shape:
                        free.add((argument, axis))
    assert free == FREE.get(name, set())


def is_written(name: str, given: Call, place: int, argument: str) -> bool:
    """True if an array must be writable; if not, it stays as it is."""
    closed = given[place].copy()
    closed.setflags(write=False)
    words = refusal(functions()[name], with_one(given, place, closed))
    assert closed.tobytes() == given[place].tobytes()
    if words:
        assert words.startswith(f"{name}: {argument} must be ")
        assert " and writable, not " in words
    return words != ""


@pytest.mark.parametrize("name", NAMES)
def test_only_what_must_be_writable_is_written(name: str, recorded: dict[str, list[Call]]) -> None:
    function = functions()[name]
    for given in recorded[name]:
        names, after = names_of(function, given), list(map(fresh, given))
        function(*after)
        for place, argument in enumerate(names):
            if isinstance(given[place], np.ndarray) and not is_written(name, given, place, argument):
                assert after[place].tobytes() == given[place].tobytes()


@pytest.mark.parametrize("name", NAMES)
def test_rows_that_are_not_there_are_refused(name: str, recorded: dict[str, list[Call]]) -> None:
    function, rng = functions()[name], np.random.default_rng(0)
    for given in recorded[name]:
        for place, argument in enumerate(names_of(function, given)):
            array = given[place]
            if not isinstance(array, np.ndarray) or array.dtype != np.int64 or is_written(name, given, place, argument):
                continue
            for value in (-1, np.iinfo(np.int64).min, np.iinfo(np.int64).max):
                spoiled = array.copy()
                spoiled.flat[rng.integers(array.size)] = value
                assert refused(function, with_one(given, place, spoiled)).startswith(f"{name}: {argument} ")


@pytest.mark.parametrize("name", NAMES)
def test_outputs_overlap_nothing(name: str, recorded: dict[str, list[Call]]) -> None:
    function = functions()[name]
    for given in recorded[name]:
        arrays = [place for place, each in enumerate(given) if isinstance(each, np.ndarray) and each.size]
        for place in arrays:
            for other in arrays:
                if place == other:
                    continue
                array, beside = given[place], given[other]
                memory = np.zeros(array.size + beside.size - 1)  # the last of one is the first of the other
                spoiled = list(map(fresh, given))
                spoiled[place] = memory[: array.size].view(array.dtype).reshape(array.shape)
                spoiled[other] = memory[array.size - 1 :].view(beside.dtype).reshape(beside.shape)
                spoiled[place][...], spoiled[other][...] = array, beside
                before = memory.copy()
                words = refusal(function, spoiled)
                assert not words or words.startswith(f"{name}: ")
                np.testing.assert_array_equal(memory, before)


def test_trees_have_no_cycles_and_every_place_is_there(recorded: dict[str, list[Call]]) -> None:
    """Values that no type and no range excludes, with which a loop would not end, or read what is not there."""
    spoils: list[tuple[str, str, Callable[[np.ndarray], object]]] = [
        ("tree", "parents", lambda x: x.put(0, 1)),
        ("chain", "parents", lambda x: x.put(1, 1)),
        ("parts", "last", lambda x: x.put(0, 2)),
        ("parts", "first", lambda x: x.put(-1, len(x) - 1)),
        ("tables", "width", lambda x: x.put(0, 6)),
        ("tables", "first", lambda x: x.put(0, 1 << 30)),
        ("tables", "order", lambda x: x.put(0, len(x))),
        ("world", "number", lambda x: x.put(-1, x[-1] + 1)),
        ("motion", "counts", lambda x: x.put(0, x[0] + 1)),
        ("to_waypoints", "counts", lambda x: x.put(0, (1 << 39) + x[0])),
        ("walk", "place", lambda x: x.put(0, 1 << 40)),
        ("walk", "place", lambda x: x.put(1, 1 << 40)),
        ("walk", "stack", lambda x: x.put(0, 1 << 40)),
    ]
    for name, argument, spoil in spoils:
        given, function = recorded[name][0], functions()[name]
        place = names_of(function, given).index(argument)
        spoil(spoiled := given[place].copy())
        assert refused(function, with_one(given, place, spoiled)).startswith(f"{name}: ")


def test_places_that_overflow_are_refused(recorded: dict[str, list[Call]]) -> None:
    """More intervals than any memory holds, of no coordinates; a step that would wrap around."""
    world, intervals, by_ball = (functions()[name] for name in ("world", "intervals", "by_ball"))
    none, one, rows = np.zeros(0, np.int64), np.zeros(1), np.zeros(1, np.int64)
    moved, point, step = np.zeros((1, 0), np.int64), np.zeros((1, 3)), np.full(1, (1 << 40) - 1)
    of = world(none, rows, step, rows, rows, moved, moved, point, rows, rows + 1, one, one, point, point, one)
    for count in (2, 1 << 24, 1 << 25, 1 << 58):
        moves, axes = np.zeros((count, 0)), np.zeros((count, 0, 3))
        during = intervals(np.eye(3)[None], point, point, np.zeros((1, 0)), moves, moves, axes, axes, *[None] * 4)
        words = refused(by_ball, [of, during, rows, rows, one, point])
        assert words == "by_ball: intervals must be those in which the bodies of the world have places"


def tree_of(recorded: dict[str, list[Call]]) -> tuple[Call, Callable[[Any], bytes]]:
    """The arguments of a struct, and what a loop makes of it."""
    given = recorded["tree"][0]
    q = np.random.default_rng(1).normal(size=(5, given[1]))

    def placed(struct: Any) -> bytes:
        placements, columns = np.empty((5, given[0], 12)), np.empty((5, given[1], 6))
        functions()["forward"](struct, q, placements, columns)
        return placements.tobytes() + columns.tobytes()

    return given, placed


def test_structs_keep_what_they_are_made_of(recorded: dict[str, list[Call]]) -> None:
    given, placed = tree_of(recorded)
    copies = list(map(fresh, given))
    alive = [weakref.ref(each) for each in copies if isinstance(each, np.ndarray)]
    struct = functions()["tree"](*copies)
    expected = placed(struct)
    with pytest.raises(ValueError, match="resize"):
        copies[2].resize(1000, refcheck=False)  # its memory would move
    del copies
    gc.collect()
    assert all(each() is not None for each in alive)
    assert placed(struct) == expected
    rest = np.zeros((0, given[1]))
    goal = functions()["goal"](
        *(struct, rest[:, 0].astype(np.int64), rest[:, 0].astype(np.int64), rest.astype(np.int64)),
        *(np.zeros((0, 12)), np.zeros((0, 12)), np.zeros(0), np.zeros(given[1]), np.zeros(given[1]), np.ones(3)),
    )
    del struct
    assert all(each() is not None for each in alive)
    del goal
    assert all(each() is None for each in alive)


def test_structs_are_made_by_their_functions_alone(recorded: dict[str, list[Call]]) -> None:
    struct = functions()["tree"](*recorded["tree"][0])
    kind = type(struct)
    attempts: tuple[Callable[[], object], ...] = (
        kind,
        lambda: object.__new__(kind),
        lambda: type("Own", (kind,), {}),
        lambda: pickle.dumps(struct),
    )
    for attempt in attempts:
        with pytest.raises(TypeError):
            attempt()


@pytest.fixture(scope="module")
def frozen() -> Iterator[None]:
    """Objects that stand already are left out of collections, each of which would take half a second with them."""
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()


@pytest.mark.usefixtures("frozen")
@pytest.mark.parametrize("name", NAMES)
def test_calls_of_the_c_loops_leak_no_memory(name: str, recorded: dict[str, list[Call]]) -> None:
    """Five hundred calls, most of them refused: for want of an argument, for the last one, for one too many."""
    function, given = functions()[name], tuple(map(fresh, recorded[name][0]))
    calls = (given, given[:-1], (*given[:-1], object()), (*given, None))
    held = [each for each in given if isinstance(each, np.ndarray) or type(each).__name__ == "Struct"]

    def run(times: int) -> None:
        for _ in range(times):
            for each in calls:
                try:
                    function(*each)
                except (TypeError, ValueError):
                    continue

    run(5)
    gc.collect()
    blocks, counts = sys.getallocatedblocks(), list(map(sys.getrefcount, held))
    run(120)  # more than the blocks that may come, if one call loses one
    gc.collect()
    assert list(map(sys.getrefcount, held)) == counts
    assert sys.getallocatedblocks() - blocks < 100


def results(name: str, calls: Sequence[Call]) -> list[bytes]:
    """All that functions write and return."""
    found = []
    for given in calls:
        copies = list(map(fresh, given))
        returned = functions()[name](*copies)
        written = b"".join(each.tobytes() for each in copies if isinstance(each, np.ndarray))
        found.append(written if type(returned).__name__ == "Struct" else written + repr(returned).encode())
    return found


@pytest.mark.parametrize("name", NAMES)
def test_threads_do_not_meet(name: str, recorded: dict[str, list[Call]]) -> None:
    expected = results(name, recorded[name])
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(lambda _: results(name, recorded[name]), range(8))) == [expected] * 8


def test_a_pickled_record_makes_its_struct_again(recorded: dict[str, list[Call]]) -> None:
    given, placed = tree_of(recorded)
    record = Record("tree", *given)
    expected = placed(record.struct)
    again = pickle.loads(pickle.dumps(record))
    assert "struct" not in vars(again)
    assert placed(again.struct) == expected
    assert not any(each.flags.writeable for each in again.fields if isinstance(each, np.ndarray))
    with pytest.raises(ValueError, match=r"^tree: placed must be float64"):
        _ = Record("tree", *given[:5], given[5][:, :11], given[6]).struct


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork on this system")
def test_structs_outlive_a_fork(recorded: dict[str, list[Call]], tmp_path: Path) -> None:
    """A process of its own forks: this one may have threads, which do not survive a fork."""
    given, placed = tree_of(recorded)
    program = """
import os, pickle, sys
import numpy as np
from hdplan import _loops
given = pickle.load(open(sys.argv[1], "rb"))
struct = _loops.tree(*given)
if os.fork():
    sys.exit(os.waitstatus_to_exitcode(os.wait()[1]))
q = np.random.default_rng(1).normal(size=(5, given[1]))
placements, columns = np.empty((5, given[0], 12)), np.empty((5, given[1], 6))
_loops.forward(struct, q, placements, columns)
open(sys.argv[2], "wb").write(placements.tobytes() + columns.tobytes())
"""
    (tmp_path / "given").write_bytes(pickle.dumps(given))
    subprocess.run([sys.executable, "-c", program, str(tmp_path / "given"), str(tmp_path / "found")], check=True)
    assert (tmp_path / "found").read_bytes() == placed(functions()["tree"](*given))


ODD = (np.nan, np.inf, -np.inf, 5e-324, -5e-324, 1e308, -1e308, 0.0, -0.0)  # subnormal, about to overflow


def spoiled_values(array: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The same with some of its numbers odd ones, or rows that may or may not be there."""
    changed, some = array.copy(), rng.random(array.shape) < rng.choice([0.02, 0.3, 1.0])
    if array.dtype == np.float64:
        changed[some] = rng.choice(ODD, some.sum())
    elif array.size:
        changed[some] = rng.integers(array.min(), array.max() + 2, some.sum())
    return changed


@pytest.mark.parametrize("name", NAMES)
def test_no_value_crashes(name: str, recorded: dict[str, list[Call]]) -> None:
    """Odd numbers and rows at random: a call ends, with what is not a number or in words, and leaves what it reads;
    the same call with structs that are made of such values as well."""
    rng, function = np.random.default_rng(NAMES.index(name)), functions()[name]
    for given in recorded[name]:
        written = [
            isinstance(each, np.ndarray) and is_written(name, given, place, argument)
            for place, (each, argument) in enumerate(zip(given, names_of(function, given), strict=True))
        ]
        for _ in range(12):
            values = [
                spoiled_values(each, rng)
                if isinstance(each, np.ndarray) and (own or rng.random() < 0.5)
                else fresh(each)
                for each, own in zip(given, written, strict=True)
            ]
            before = list(map(fresh, values))
            with contextlib.suppress(TypeError, ValueError):
                function(*values)
            for value, old, own in zip(values, before, written, strict=True):
                assert own or not isinstance(value, np.ndarray) or value.tobytes() == old.tobytes()


@pytest.mark.parametrize("name", NAMES)
def test_no_struct_crashes(name: str, recorded: dict[str, list[Call]]) -> None:
    """Loops on structs that are made of odd numbers, and of rows that passed."""
    rng, function = np.random.default_rng(1 + NAMES.index(name)), functions()[name]

    def remade(given: Any, made_by: dict[int, tuple[str, Call]]) -> Any:
        if isinstance(given, tuple):
            return tuple(remade(each, made_by) for each in given)
        if id(given) not in made_by:
            return fresh(given)
        maker, parts = made_by[id(given)]
        new = [
            spoiled_values(x, rng) if isinstance(x, np.ndarray) and rng.random() < 0.3 else remade(x, made_by)
            for x in parts[:-1]
        ]
        try:
            return functions()[maker](*new)
        except (TypeError, ValueError):
            return given

    for given in recorded[name]:
        for _ in range(12):
            with contextlib.suppress(TypeError, ValueError):
                function(*remade(given, MADE))
