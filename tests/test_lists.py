"""Every list is complete: a shape, a motion of an obstacle, a path constraint, an objective, a field or a section that
somebody adds fails by name wherever such things are listed, and is passed over in silence nowhere.

The places are found in the source. Those that end in `assert_never`, or raise, are complete; every other one stands
below, with a call that must fail for a dummy, or with the reason why it may single one class out.
"""

from __future__ import annotations

import ast
import dataclasses
import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import pytest

import hdplan
from hdplan.planner.batch import sample
from hdplan.planner.certificate import coverage, exact_proximity, path_bounds, solids
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.collision import halfspace_bodies
from hdplan.planner.geometry import seen, shape_table, voxel_grids
from hdplan.planner.problem import path_terms
from hdplan.planner.proof import world_values
from hdplan.planner.robot import self_filter
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.goals import may_end
from hdplan.planner.terminal import explain, explain_effects
from hdplan.scenes.clouds import Ignored
from hdplan.scenes.lazy_imports import LazyModule
from hdplan.scenes.limits import QUANTITIES
from hdplan.scenes.obstacle_motion import ObstacleMotion
from hdplan.scenes.obstacles import Obstacle, Seen, SteadyMotion, TimedPoses, obstacles_of
from hdplan.scenes.path_constraints import PathConstraint, PathConstraints, Upright
from hdplan.scenes.planner_settings import OBJECTIVES, PlannerSettings
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box, Shape, Solid, Sphere
from hdplan.scenes.values import require_fields
from hdplan.scenes.yaml_format import writer
from hdplan.scenes.yaml_format.reader import load_scene
from hdplan.scenes.yaml_format.seen import seen_entry

picture: Any = LazyModule("hdplan.planner.pictures.scene")  # imports Matplotlib
ROOT = Path(__file__).resolve().parent.parent
FILES = sorted(path for folder in ("planner", "scenes") for path in (ROOT / folder).rglob("*.py"))


@functools.cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


# --- dummies ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, repr=False)
class Torus(Solid):
    radius: float = 0.1


@dataclass(frozen=True, repr=False)
class Rounded(Box):
    rounding: float = 0.01


@dataclass(frozen=True)
class Lidar:
    points: tuple[float, ...] = ()
    name: None = None
    pose: None = None


@dataclass(frozen=True)
class Swinging:
    length: float = 1.0


@dataclass(frozen=True)
class Level:
    link: str = "panda_hand"


@dataclass(frozen=True, repr=False)
class Magnetic(Scene):
    magnets: tuple[str, ...] = ()


def with_field(value: Any, name: str, held: object) -> Any:
    """A frozen value with a field that every check would refuse."""
    other = dataclasses.replace(value)
    object.__setattr__(other, name, held)
    return other


PLAIN = Obstacle("o", Box([0.1, 0.1, 0.1]))
ROUNDED = Rounded([0.1, 0.1, 0.1])
OBSTACLES = [with_field(PLAIN, "shape", shape) for shape in (Torus(), ROUNDED, Lidar())]
OF_TORUS, _, OF_LIDAR = OBSTACLES
SWINGING = with_field(PLAIN, "motion", Swinging())


# --- where classes are distinguished ----------------------------------------------------------------------------------

CLASSES = {
    **{name: "shape" for name in (*(kind.__name__ for kind in get_args(Shape)), "Solid")},
    **{name: "seen" for name in (*(kind.__name__ for kind in get_args(Seen)), "Seen", "Map")},
    **{name: "motion" for name in ("SteadyMotion", "TimedPoses")},
    **{kind.__name__: "path" for kind in get_args(PathConstraint)},
}
Fails = Callable[[], object]


def for_each(call: Callable[[Any], object], *dummies: object) -> tuple[Fails, ...]:
    return tuple(functools.partial(call, dummy) for dummy in dummies)


PLACES: dict[tuple[str, str, str], str | tuple[Fails, ...]] = {
    ("planner/batch/sample.py", "_moved", "seen"): "what was measured keeps its size",
    ("planner/certificate/coverage.py", "", "motion"): (lambda: coverage.required_of(of(SWINGING), robot()),),
    ("planner/certificate/coverage.py", "", "path"): (lambda: coverage.required_of(along(Level()), robot()),),
    ("planner/certificate/coverage.py", "", "seen"): (lambda: coverage.required_of(of(OF_LIDAR), robot()),),
    ("planner/certificate/exact_proximity.py", "", "shape"): for_each(exact_proximity.obstacle_pieces, *OBSTACLES),
    ("planner/certificate/solids.py", "obstacle_bodies", "seen"): for_each(  # others: `obstacle_pieces` fails
        solids.obstacle_bodies, OF_TORUS, OF_LIDAR
    ),
    ("planner/collision/halfspace_bodies.py", "enclosed_loosely", "seen"): "asks for what can be enclosed again",
    ("planner/collision/halfspace_bodies.py", "from_obstacle", "seen"): for_each(
        halfspace_bodies.from_obstacle, *OBSTACLES
    ),
    ("planner/collision/halfspace_bodies.py", "from_shape", "shape"): (
        lambda: halfspace_bodies.from_shape("o", Torus(), np.eye(4)),
    ),
    (
        "planner/control/barriers.py",
        "setup_barriers",
        "seen",
    ): "asks for clouds; `from_obstacle` knows all others, or fails",
    ("planner/control/controller.py", "_as_left", "seen"): "keeps all points of what is no cloud",
    ("planner/geometry/opened.py", "_read", "seen"): "reads files; what stays unread is refused wherever it is used",
    ("planner/geometry/opened.py", "_read", "shape"): "reads files; what stays unread is refused wherever it is used",
    ("planner/geometry/shape_table.py", "", "shape"): for_each(shape_table.operations, Torus(), ROUNDED),
    ("planner/job/world.py", "shape_of", "shape"): "refuses whatever is no shape",
    ("planner/job/world.py", "_as_seen", "seen"): "clouds alone ignore points",
    ("planner/pictures/scene.py", "_bodies", "seen"): for_each(lambda it: picture._bodies(it), OF_TORUS, OF_LIDAR),
    ("planner/problem/assemble.py", "with_seen_points", "seen"): "asks for clouds: they alone are seen again",
    ("planner/proof/world_values.py", "plain_shape", "shape"): for_each(world_values.plain_shape, Torus(), ROUNDED),
    ("planner/proof/world_values.py", "plain_shape", "seen"): for_each(world_values.plain_shape, Lidar()),
    ("planner/replanning/picture.py", "Sighting.frozen", "motion"): "for ways alone; pictures refuse other motions",
    ("planner/replanning/picture.py", "Sightings.updated", "seen"): "a cloud alone is given as one",
    ("planner/replanning/picture.py", "_named", "seen"): "a cloud alone is given as one",
    ("planner/replanning/picture.py", "_refuse_timed", "motion"): "refuses all others",
    ("planner/robot/self_filter.py", "_solids", "seen"): for_each(
        lambda it: self_filter._solids(Ignored(0.1, obstacle="o"), of(it), None, "f"), OF_TORUS, OF_LIDAR
    ),
    ("planner/robot/self_filter.py", "self_filtered", "seen"): "asks for clouds: they alone say what to ignore",
    ("planner/terminal/explain.py", "_words", "seen"): for_each(lambda it: explain._words(it, it), OF_TORUS, OF_LIDAR),
    ("planner/view/drawing/clouds.py", "CloudNode.__init__", "seen"): "asserts that it is given a cloud",
    ("planner/view/drawing/skins.py", "obstacle_mesh", "seen"): for_each(
        lambda it: skins().obstacle_mesh(it), OF_TORUS, OF_LIDAR
    ),
    ("planner/view/drawing/skins.py", "obstacle_parts", "seen"): for_each(
        lambda it: skins().obstacle_parts(it), OF_TORUS, OF_LIDAR
    ),
    ("planner/view/scene_edits.py", "passing", "motion"): "refuses all but timed poses in words for the user",
    ("planner/view/obstacle_fields.py", "ObstacleFields._build", "motion"): "others go to `_rates`, which is complete",
    ("planner/view/obstacle_fields.py", "ObstacleFields.update", "motion"): "tells whether fields are built anew",
    ("planner/view/obstacle_fields.py", "_duration", "motion"): "asserts that it is given timed poses",
    ("planner/view/drawing/standing.py", "Standing._node", "seen"): "other nodes are drawn by `skins.obstacle_mesh`",
    ("planner/view/things.py", "turns", "shape"): "a ball alone looks the same when it is turned",
    ("scenes/moveit/constraints.py", "_within", "shape"): "refuses all but boxes in words for the user",
    ("scenes/moveit/planning_scene.py", "_attached", "seen"): "chooses solids among what messages hold",
    ("scenes/obstacles.py", "Obstacle._check_whole", "motion"): "timed poses alone say where an obstacle begins",
    ("scenes/obstacles.py", "_obstacle_of.made", "seen"): (lambda: obstacles_of([Lidar()]),),
    ("scenes/obstacles.py", "_obstacle_of.made", "shape"): (lambda: obstacles_of([Torus()]),),
    ("scenes/scene.py", "Scene._check_whole", "seen"): "asks for clouds: they alone name other obstacles",
    ("scenes/yaml_format/reader.py", "_obstacles", "motion"): "timed poses alone say where an obstacle begins",
    ("scenes/yaml_format/writer.py", "", "path"): (lambda: writer.scene_text(along(Level())),),
    ("scenes/yaml_format/writer.py", "", "seen"): (lambda: writer.scene_text(of(OF_LIDAR)),),
    ("scenes/yaml_format/writer.py", "_obstacle", "motion"): (lambda: writer.scene_text(of(SWINGING)),),
    ("scenes/yaml_format/writer.py", "_obstacle", "seen"): for_each(lambda it: writer.scene_text(of(it)), *OBSTACLES),
}
"""(file, function, what is distinguished) -> calls that must fail, or why it is no list of them."""


def robot() -> Any:
    return Setup.of(load_scene("empty")).robot


def skins() -> Any:
    pytest.importorskip("viser", reason="the viewer is optional")
    from hdplan.planner.view.drawing import skins

    return skins


def of(obstacle: Obstacle) -> Scene:
    """A scene with an obstacle that every check would refuse."""
    return with_field(load_scene("empty"), "obstacles", (obstacle,))


def along(constraint: object) -> Scene:
    """A scene with a path constraint that every check would refuse."""
    return with_field(load_scene("empty"), "path", with_field(PathConstraints(), "upright", constraint))


def distinguished(path: Path) -> Iterator[tuple[str, str, bool]]:
    """(function, family, whether everything else fails there) for all of a file that tells classes apart."""

    def families(node: ast.AST) -> set[str]:
        return {CLASSES[each.id] for each in ast.walk(node) if isinstance(each, ast.Name) and each.id in CLASSES}

    def visit(node: ast.AST, function: str) -> Iterator[tuple[str, str, bool]]:
        for child in ast.iter_child_nodes(node):
            inner = function
            match child:
                case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                    inner = f"{function}.{name}".strip(".")
                case ast.Call(func=ast.Name(id="isinstance"), args=[_, kinds]):
                    yield from ((function, family, False) for family in families(kinds))
                case ast.Match(cases=cases):
                    patterns = [
                        each.cls
                        for case in cases
                        for each in ast.walk(case.pattern)
                        if isinstance(each, ast.MatchClass)
                    ]
                    found = {family for pattern in patterns for family in families(pattern)}
                    yield from ((function, family, _fails_otherwise(cases[-1])) for family in found)
                case ast.Dict(keys=keys):
                    yield from (
                        (function, family, False)
                        for key in keys
                        if isinstance(key, ast.Name)
                        for family in families(key)
                    )
                case ast.Compare(left=left, comparators=others):
                    compared = [each for each in (left, *others) if isinstance(each, ast.Name)]
                    yield from ((function, family, False) for each in compared for family in families(each))
            yield from visit(child, inner)

    yield from visit(parsed(path), "")


def _fails_otherwise(case: ast.match_case) -> bool:
    any_other = isinstance(case.pattern, ast.MatchAs) and case.pattern.pattern is None
    calls = [each for part in case.body for each in ast.walk(part)]
    never = [each for each in calls if isinstance(each, ast.Call) and ast.unparse(each.func) == "assert_never"]
    return any_other and bool(never or [each for each in calls if isinstance(each, ast.Raise)])


def test_every_place_that_tells_classes_apart_is_known() -> None:
    """A new one is complete, by `assert_never`, or stands in PLACES."""
    found = {
        (str(path.relative_to(ROOT)), function, family)
        for path in FILES
        if any(name in path.read_text(encoding="utf-8") for name in CLASSES)
        for function, family, complete in distinguished(path)
        if not complete
    }
    assert found - PLACES.keys() == set(), "passes over what it does not know? end it in assert_never, or say why here"
    assert PLACES.keys() - found == set(), "is gone, or complete"


@pytest.mark.parametrize(
    ("place", "call"),
    [(place, call) for place, calls in PLACES.items() if not isinstance(calls, str) for call in calls],
    ids=lambda each: "-".join(each) if isinstance(each, tuple) else "",
)
def test_places_fail_for_what_they_do_not_know(
    place: tuple[str, str, str], call: Fails, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A kind of sensor that the union has already fails there, too."""
    modules = ("planner.terminal.explain", "planner.pictures.scene", "planner.robot.self_filter")
    for module in (*modules, "planner.proof.world_values", "scenes.yaml_format.writer"):
        monkeypatch.setattr(f"hdplan.{module}.Seen", Seen | Lidar)
    named = r"Torus|Rounded|Lidar|Swinging|Level|must be an Obstacle|obstacles.o: is a map|'o' has no shape"
    with pytest.raises(Exception, match=named):
        call()


@pytest.mark.parametrize(
    "call",
    [
        lambda: path_bounds._held(Setup.of(load_scene("empty")), Level()),
        lambda: path_terms._measure(Level(), "path.level", Setup.of(load_scene("empty")), np.zeros((9, 7))),
        lambda: explain_effects._kept_all_along(Level()),
        lambda: along(Level()).path.regions,
        lambda: ObstacleMotion.of(SWINGING),
        lambda: seen.seen_mesh(Lidar()),
        lambda: seen.seen_parts(Lidar()),
        lambda: seen.seen_words(Lidar(), Lidar()),
        lambda: voxel_grids.boxes_in(Lidar()),
        lambda: voxel_grids.map_words(Lidar()),
        lambda: seen_entry(Lidar()),
    ],
)
def test_complete_places_fail_too(call: Fails) -> None:
    with pytest.raises((AssertionError, TypeError), match=r"Level|Swinging|Lidar"):
        call()


def test_obstacles_are_resized_by_what_is_known_of_their_shapes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sample, "load_scene", lambda _: of(OF_TORUS))
    with pytest.raises(TypeError, match="Torus"):
        list(sample._moved(Path("x"), np.random.default_rng(0), 0.0, 0.1))


# --- sections and fields ----------------------------------------------------------------------------------------------


def test_a_section_that_nobody_knows_fails_wherever_a_scene_is_certified_planned_or_written() -> None:
    plain = load_scene("empty")
    scene = Magnetic(**{each.name: getattr(plain, each.name) for each in dataclasses.fields(plain)}, magnets=("m",))
    for fails in (lambda: Certifier(Setup.of(scene)), lambda: hdplan.plan(scene)):
        with pytest.raises(coverage.UncheckedError, match="Magnetic"):
            fails()


@dataclass
class Fields:
    """The dummy of a class with one more field."""

    known: str

    def __call__(self, kind: type) -> type:
        return dataclasses.make_dataclass(kind.__name__, [*self.known.split(), "dummy"])


@pytest.mark.parametrize("kind", writer.WRITTEN, ids=lambda kind: kind.__name__)
def test_the_writer_knows_every_field(kind: type) -> None:
    known = writer.WRITTEN[kind]
    assert known.split() == [each.name for each in dataclasses.fields(kind)]
    with pytest.raises(TypeError, match=f"{kind.__name__} has fields that are not dealt with here: dummy"):
        require_fields(Fields(known)(kind), known)


def test_every_class_of_a_scene_is_known_to_certificate_and_writer() -> None:
    """All classes that fields of a scene can hold, from their annotations; shapes have tables of their own."""
    met: set[type] = set()

    def meet(kind: Any) -> None:
        for part in (*get_args(kind), *(get_args(kind.__value__) if hasattr(kind, "__value__") else ())):
            meet(part)
        if dataclasses.is_dataclass(kind) and kind not in met and not issubclass(kind, Solid):
            met.add(kind)
            from typing import get_type_hints

            for hint in get_type_hints(kind).values():
                meet(hint)

    meet(Scene)
    assert met == set(coverage.FIELDS)
    by_their_fields = (
        "AllOf Along Attached Calibration Circle FixedArray Follow Goals Grip Ignored Job Limits Line PathConstraints "
        "Payload PlanarBase PlannerSettings Pose Relative Release RobotSpec SteadyMotion TimedPoses Tracking "
        "Uncertainty Upright"
    )
    assert {kind.__name__ for kind in met - writer.WRITTEN.keys()} == set(by_their_fields.split())


def test_readers_of_scenes_declare_their_known_fields() -> None:
    found = {}
    for path in (ROOT / "planner").rglob("*.py"):
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "require_fields":
                assert ast.unparse(node.args[0]) == "Scene"
                found[path.stem] = ast.literal_eval(node.args[1])
    assert {*found} == {"assemble", "controller", "diagnosis", "explain_effects"}
    for known in found.values():
        require_fields(Scene, known)
        with pytest.raises(TypeError, match="magnets"):
            require_fields(Magnetic, known)


# --- limited quantities, and objectives, by their words ---------------------------------------------------------------

NAMED = {  # files that name one of them, and why no other one is passed over there
    "planner/certificate/certifier.py": "a note on masses that torques need",
    "planner/certificate/limit_checks.py": "the certificate compares what was checked with what is required",
    "planner/certificate/path_check.py": "statements on a tool's speed need accelerations",
    "planner/certificate/rate_check.py": "joints may be off by velocities alone",
    "planner/certificate/torque_check.py": "is about torques",
    "planner/control/braking.py": "keeps velocities, accelerations and jerks, and takes no torques",
    "planner/control/controller.py": "keeps velocities; what was executed is certified",
    "planner/control/simulation.py": "torques are measured in the execution; all others come from the checks",
    "planner/job/stage_scenes.py": "accelerations are needed; no torques are required of fingers",
    "planner/job/world.py": "accelerations are needed",
    "planner/pictures/rates.py": "the first panel has the legend",
    "planner/plan.py": "an order of motions that are improved; others improve the first that is found",
    "planner/problem/assemble.py": "terms where there is one; the timing keeps the others, or fails",
    "planner/problem/velocity_penalty.py": "is about velocities",
    "planner/proof/world.py": "torques alone need masses",
    "planner/replanning/replanner.py": "needs accelerations, and compares measured velocities",
    "planner/robot/joint_limits.py": "what URDFs hold; others are refused without numbers",
    "planner/robot/loads.py": "words of an error",
    "planner/search/goals.py": "an order of goals",
    "planner/search/objective.py": "ends in an error for others",
    "planner/search/polish.py": "a weight of the penalty",
    "planner/search/search.py": "touches shorten nothing but paths; others are bettered in rounds",
    "planner/search/space_time.py": "a bound by velocities",
    "planner/search/touches.py": "a weight of the penalty",
    "planner/studies/anytime.py": "is about time",
    "planner/terminal/explain_cost.py": "sizes of compiled functions",
    "planner/terminal/explain_effects.py": "more words for torques; others have a line of their own",
    "planner/terminal/tables.py": "torques have a table of their own; others stand with the rates",
    "planner/timing/limits.py": "ends in an error for others",
    "planner/timing/moving_ends.py": "braking takes three of them; each limit checks whether it is kept",
    "planner/timing/retiming.py": "accelerations bound the fastest motion, velocities a first guess of it",
    "planner/timing/torque_limit.py": "is about torques",
    "scenes/limits.py": "the table",
    "scenes/moveit/planning_scene.py": "words of MoveIt's messages",
    "scenes/scene.py": "what one section needs of another",
    "planner/job/certify.py": "a torque's words say when it is largest: kept ones would say another time",
}


def names_words(path: Path) -> bool:
    """True if a file tells limited quantities or objectives apart."""
    words = {*QUANTITIES, *OBJECTIVES}

    def is_word(node: ast.AST) -> bool:
        return isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value in words

    for node in ast.walk(parsed(path)):
        match node:
            case ast.Compare(left=left, comparators=others):
                kinds = ("objective", "quantity", "what", "name")
                found = is_word(left) or (
                    any(map(is_word, others)) and any(kind in ast.unparse(left) for kind in kinds)
                )
            case ast.MatchValue(value=key):
                found = is_word(key)
            case ast.Subscript(slice=key):
                found = is_word(key) and ast.literal_eval(key) in QUANTITIES
            case ast.Attribute(value=value, attr=name):
                found = name in QUANTITIES and ast.unparse(value).endswith("limits")
            case _:
                found = False
        if found:
            return True
    return False


def test_every_place_that_names_a_limited_quantity_or_an_objective_is_known() -> None:
    assert {str(path.relative_to(ROOT)) for path in FILES if names_words(path)} == {*NAMED}


# --- objectives, distances --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("field", "word"), [("objective", "quietness"), ("distance", "norm")])
def test_an_objective_or_a_distance_that_nobody_measures_is_no_other_one(field: str, word: str) -> None:
    plain = load_scene("panda_cage")
    scene = with_field(plain, "planner", with_field(PlannerSettings(), field, word))
    with pytest.raises(ValueError, match=word):
        hdplan.plan(scene)


def test_the_controller_knows_its_distances() -> None:
    from hdplan.planner.control.pair_level import _distance

    nothing: Any = None
    settings: Any = SimpleNamespace(distance="norm")
    with pytest.raises(ValueError, match="norm"):
        _distance(nothing, [], [], settings)


# --- what tells motions apart -----------------------------------------------------------------------------------------


def test_dragging_and_fields_of_the_viewer_know_every_motion() -> None:
    pytest.importorskip("viser", reason="the viewer is optional")
    from hdplan.planner.view import obstacle_fields, things

    for call in (lambda: things.moved(SWINGING, Pose()), lambda: obstacle_fields._rates(SWINGING)):
        with pytest.raises(AssertionError, match="Swinging"):
            call()
    timed = Obstacle("o", Sphere(0.1), motion=TimedPoses([0.0, 1.0], [Pose(), Pose((1.0, 0.0, 0.0))]))
    assert obstacle_fields._rates(timed) == (SteadyMotion().velocity, SteadyMotion().spin)


def test_sampled_ends_are_judged_by_the_same_certificate() -> None:
    """A scene that it does not know whole is not drawn."""
    scene = with_field(load_scene("empty"), "path", with_field(PathConstraints(), "upright", Level()))
    with pytest.raises((AssertionError, coverage.UncheckedError), match="Level"):
        may_end(Certifier(Setup.of(scene)), np.zeros(7))
    assert Upright("panda_hand").link == Level().link
