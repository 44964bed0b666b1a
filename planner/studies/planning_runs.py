"""The benefit and the cost of each planner setting, measured: one setting at a time is changed from the defaults.

In: scenes. Out: one `Run` for each variant and scene. A variant changes one setting; all others that can be varied are
at their defaults, whatever the scene says, so that variants can be compared.

Clearance lost to conservativeness: at configurations near contact, the same ones for all variants, the exact distance d
from the robot's real meshes to the obstacles (the certificate's) less the nearest body pair's D̃, the lower bound that
the planner has of it: a passage seems narrower by that much. The penalty itself uses D, which is smooth, and differs
from D̃ depending on gamma and shaping length.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from hdplan.distance.studies.stopwatch import seconds_per_query
from hdplan.planner.build import build
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.plan import plan
from hdplan.planner.problem.problem import Problem
from hdplan.planner.result import PlanResult
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.goals import settled
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.planner_settings import PlannerSettings
from hdplan.scenes.scene import Scene, derived

Value = str | int | float

DEFAULTS: Mapping[str, Value] = {
    **{
        name: value
        for name, value in asdict(PlannerSettings()).items()
        if name in ("link_bodies", "normals", "gamma", "shaping_length", "waypoints", "swept")
    },
    "solver": "gauss_newton",
}
VALUES: Mapping[str, tuple[Value, ...]] = {
    "link_bodies": ("capsule", "outer-4", "box", "fitted", "outer-12", "hull"),
    "normals": ("faces", "box", "sphere"),
    "gamma": (1, 2, 4, 8),
    "shaping_length": (1e-4, 1e-3, 1e-2),  # [m]
    "waypoints": (16, 32, 64, 128),
    "swept": (False, True),
    "solver": ("gauss_newton", "chomp", "fatrop", "ipopt"),
}
QUICK_VALUES: Mapping[str, tuple[Value, ...]] = {
    "link_bodies": ("capsule", "box", "fitted", "hull"),
    "normals": ("faces", "box", "sphere"),
    "gamma": (1, 2, 4),
    "shaping_length": (1e-4, 1e-3, 1e-2),
    "waypoints": (16, 32, 64),
    "swept": (False, True),
    "solver": ("gauss_newton", "chomp", "fatrop"),
}
NEAR_CONTACT = 0.05  # [m] largest distance of the configurations at which lost clearance is measured
SCATTER = 0.3  # [rad] standard deviation of these about the straight line from start to goal
TRIED, WANTED, QUICK_WANTED = 500, 100, 50  # configurations drawn for that, and kept, of a scene
TIME_LIMIT = 10.0  # [s] for a plan
REPEATED_BELOW = 1.0  # [s] plans faster than this are timed again,
TIMES, QUICK_TIMES = 4, 2  # this often in all, and the fastest counts


@dataclass(frozen=True)
class Variant:
    """The defaults, with one of them changed."""

    factor: str = ""  # a key of DEFAULTS; none for the defaults themselves
    value: Value = ""

    @property
    def solver(self) -> str:
        """The solver of this variant."""
        return str(self.value if self.factor == "solver" else DEFAULTS["solver"])

    def applied(self, scene: Scene) -> Scene:
        """The scene, planned with these settings."""
        changed = {**DEFAULTS, **({self.factor: self.value} if self.factor else {})}
        del changed["solver"]
        return replace(scene, planner=replace(scene.planner, **changed))  # type: ignore[arg-type]


def variants(values: Mapping[str, Sequence[Value]]) -> tuple[Variant, ...]:
    """The defaults first, then what changes one of them."""
    changed = [Variant(factor, value) for factor, row in values.items() for value in row if value != DEFAULTS[factor]]
    return (Variant(), *changed)


@dataclass(frozen=True)
class Run:
    """One variant on one scene."""

    variant: Variant
    scene: str
    certified: bool  # within the time limit
    attempts: int  # first guesses tried
    iterations: int
    seconds: float  # processor time of the whole plan, warm [s]; what other programs take does not count
    solve: float  # [s] by the clock, all attempts together
    certify: float  # [s] likewise
    kernel: float | None  # [s] one body pair's D and derivative; None where no pair is near
    clearance: float | None  # [m] proven
    length: float | None  # of the path in joint space [rad]; None without a certified motion
    acceleration: float | None  # integrated squared, over a duration of one [rad²]; likewise
    lost: Array = field(repr=False)  # (K,) d − D̃ [m]
    off: Array = field(repr=False)  # (K',) |D − D̃| [m] of the deepest pair, where the penalty acts

    @property
    def first(self) -> bool:
        """True if the straight line, the first guess, led to a certified motion."""
        return self.certified and self.attempts == 1


@dataclass(frozen=True)
class Runs:
    """Measured figures."""

    scenes: tuple[str, ...]
    runs: tuple[Run, ...]  # by variant, the defaults first; each variant has all scenes
    refused: tuple[str, ...]  # scenes left out, and why
    complete: bool  # False after an interruption

    def of(self, variant: Variant) -> tuple[Run, ...]:
        """The runs of a variant, in the scenes' order; none if it was not measured."""
        return tuple(run for run in self.runs if run.variant == variant)

    @property
    def variants(self) -> tuple[Variant, ...]:
        """The variants measured, the defaults first."""
        return tuple(dict.fromkeys(run.variant for run in self.runs))


def measure(
    scenes: Sequence[Scene],
    quick: bool,
    *,
    report: Callable[[int, int, str], None] = lambda *_: None,
    stop: Callable[[], bool] = lambda: False,
) -> Runs:
    """Plan every scene with every variant; ends with the complete variants so far once ``stop`` says so."""
    chosen = variants(QUICK_VALUES if quick else VALUES)
    total = len(scenes) * (len(chosen) + 1)
    situations: list[_Situation] = []
    refused: list[str] = []
    for k, scene in enumerate(scenes):
        report(k, total, scene.name)
        if stop():
            return Runs((), (), tuple(refused), complete=False)
        try:
            situations.append(_situation(scene, QUICK_WANTED if quick else WANTED, stop))
        except InputError as error:
            refused.append(str(error))
    names = tuple(situation.scene.name for situation in situations)
    runs: list[Run] = []
    done = len(scenes)
    for variant in chosen:
        own: list[Run] = []
        for situation in situations:
            report(done, total, f"{variant.factor} {variant.value} {situation.scene.name}".strip())
            run = _run(variant, situation, QUICK_TIMES if quick else TIMES, stop)
            if stop():
                return Runs(names, tuple(runs), tuple(refused), complete=False)
            own.append(run)
            done += 1
        runs += own
    return Runs(names, tuple(runs), tuple(refused), complete=True)


@dataclass(frozen=True, eq=False)
class _Situation:
    """A scene with configurations near contact."""

    scene: Scene
    robot: Robot
    near: Array  # (K, n)
    distance: Array  # (K,) exact, 0 to NEAR_CONTACT [m]


def _situation(scene: Scene, wanted: int, stop: Callable[[], bool]) -> _Situation:
    """Draw configurations around the straight line and keep those that are free and near contact.

    Raises InputError for a scene that cannot be planned.
    """
    setup = settled(Setup.of(scene))
    scene, robot, query, certifier = setup.scene, setup.robot, setup.query, Certifier(setup)
    for end, q in (("start", query.start), ("goal", query.goal)):
        if touching := certifier.contacts(q):
            raise InputError(f"{scene.source}: {end}: in collision: {touching[0].link} and {touching[0].other}")
    rng = np.random.default_rng(0)
    near, distance = [], []
    for _ in range(TRIED):
        drawn = query.start + rng.uniform() * (query.goal - query.start) + SCATTER * rng.normal(size=robot.n)
        q = np.clip(drawn, robot.lower, robot.upper)
        place = certifier.nearest(q, NEAR_CONTACT)[0]
        if place is not None and 0 < place.distance < NEAR_CONTACT:
            near.append(q)
            distance.append(place.distance)
        if len(near) == wanted or stop():
            break
    return _Situation(scene, robot, np.array(near).reshape(-1, robot.n), np.array(distance))


def _run(variant: Variant, situation: _Situation, times: int, stop: Callable[[], bool]) -> Run:
    scene = variant.applied(situation.scene)
    lost, kernel = _lost(scene, situation)  # this also compiles what the plan needs
    off = _off(build(scene, situation.robot), situation)
    plans = [_timed_plan(scene, variant, situation, stop)]
    while len(plans) < times and plans[0][0] < REPEATED_BELOW and not stop():
        plans.append(_timed_plan(scene, variant, situation, stop))
    seconds, result = min(plans, key=lambda each: each[0])
    good = result.certified
    return Run(
        variant=variant,
        scene=scene.name,
        certified=good,
        attempts=result.attempts,
        iterations=result.iterations,
        seconds=seconds,
        solve=result.times.solve,
        certify=result.times.certify,
        kernel=kernel,
        clearance=result.certificate.clearance if good else None,
        length=path_length(result.trajectory) if good else None,
        acceleration=squared_acceleration(result.trajectory) if good else None,
        lost=lost,
        off=off,
    )


def _timed_plan(
    scene: Scene, variant: Variant, situation: _Situation, stop: Callable[[], bool]
) -> tuple[float, PlanResult]:
    begin = time.process_time()
    result = plan(scene, solver=variant.solver, time_limit=TIME_LIMIT, robot=situation.robot, stop=stop)
    return time.process_time() - begin, result


def _lost(scene: Scene, situation: _Situation) -> tuple[Array, float | None]:
    """Return d − D̃ (K,) and the time of one pair's D and derivative, from a problem whose penalty reaches as far as
    NEAR_CONTACT."""
    settings = replace(scene.planner, clearance=NEAR_CONTACT)
    problem = build(derived(scene, planner=settings), situation.robot)
    term = problem.terms.obstacles
    if term is None or not len(situation.near):
        return np.empty(0), None
    kinematics = problem.placed(situation.near)
    sample, pair = term.pairs.close(kinematics)
    separation = np.full(len(situation.near), np.inf)
    np.minimum.at(separation, sample, term.distance(kinematics, sample, pair)[2])
    seconds = seconds_per_query(lambda: term.distance(kinematics, sample, pair), len(sample))
    return situation.distance - (separation + NEAR_CONTACT + settings.activation), seconds


def _off(problem: Problem, situation: _Situation) -> Array:
    """Return |D − D̃| (K',) of the deepest pair at each configuration where the penalty acts."""
    term = problem.terms.obstacles
    if term is None or not len(situation.near):
        return np.empty(0)
    inside = term.inside(problem.placed(situation.near))
    order = np.lexsort((inside.distance, inside.sample))
    _, deepest = np.unique(inside.sample[order], return_index=True)
    rows = order[deepest]
    return np.abs(inside.separation[rows] - inside.distance[rows])


def path_length(trajectory: Trajectory) -> float:
    """Return the length of the path in joint space [rad]: Σ |q_{k+1} − q_k|."""
    return float(np.linalg.norm(np.diff(trajectory.positions, axis=0), axis=1).sum())


def squared_acceleration(trajectory: Trajectory) -> float:
    """Return ∫ |q̈|² dt over a duration of one [rad²]: Σ_k h |(q_{k+1} − 2 q_k + q_{k−1})/h²|², h = 1/(N − 1)."""
    h = 1 / (len(trajectory) - 1)
    return float(np.sum(np.diff(trajectory.positions, n=2, axis=0) ** 2) / h**3)
