"""Laws of the study of planning: what it measures is what it says, every file is whole, names cover nothing."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hdplan import Box, InputError, Obstacle, Scene, Trajectory, load_scene
from hdplan.planner.studies import planning_runs
from hdplan.planner.studies.planning import FILES, by_guesses, label, study_planning, summaries
from hdplan.planner.studies.planning_runs import (
    DEFAULTS,
    NEAR_CONTACT,
    VALUES,
    Run,
    Runs,
    Variant,
    measure,
    path_length,
    squared_acceleration,
    variants,
)
from hdplan.scenes.targets import JointTarget
from tests.extras import needs

pytestmark = needs("matplotlib")

FEW = {"link_bodies": ("capsule", "fitted", "hull"), "normals": ("box", "sphere"), "solver": ("gauss_newton", "chomp")}
ROUNDING = 2e-6  # [m] by which bodies of no radius of their own are enlarged


def nothing(*_: object) -> bool:
    return False


def made_up(scenes: int = 3) -> Runs:
    """Numbers like those that are measured; the last variant fails once."""
    rng = np.random.default_rng(0)
    runs = []
    for k, variant in enumerate(variants(VALUES)):
        for scene in range(scenes):
            good = scene > 0 or variant.value != "ipopt"
            run = Run(
                variant=variant, scene=f"scene {scene}", certified=good, attempts=1 + scene % 2, iterations=30,
                seconds=0.1 * 1.1**k, solve=0.08, certify=0.02, kernel=2e-6, clearance=0.01 if good else None,
                length=3.0 + 0.01 * k if good else None, acceleration=20.0 + k if good else None,
                lost=rng.exponential(0.01, 40), off=rng.exponential(1e-3, 9),
            )  # fmt: skip
            runs.append(run)
    return Runs(
        tuple(f"scene {scene}" for scene in range(scenes)), tuple(runs), ("far.yaml: start: in collision",), True
    )


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> Callable[[Runs], None]:
    def give(found: Runs) -> None:
        monkeypatch.setattr(planning_runs, "measure", lambda *_, **__: found)

    return give


# --- what is measured ---------------------------------------------------------------------------------------------


def test_guesses_are_counted_until_nothing_more_is_certified() -> None:
    runs = made_up().of(Variant())
    (first, second), none = by_guesses(runs), by_guesses([replace(run, certified=False) for run in runs])
    assert (first["guesses"], first["certified"]) == (1, "2 of 3")
    assert (second["guesses"], second["certified"], second["time [ms]"]) == (2, "3 of 3", "100 / 100")
    assert [row["certified"] for row in none] == ["0 of 3"]


def test_variants_change_one_thing_each() -> None:
    scene = load_scene("panda_cage")
    scene = replace(scene, planner=replace(scene.planner, waypoints=50, clearance=0.003))
    first, *others = variants(VALUES)
    plain = first.applied(scene)
    assert plain.planner.clearance == 0.003
    assert plain.planner.waypoints == DEFAULTS["waypoints"]
    assert len(others) == sum(len(row) - 1 for row in VALUES.values())
    for variant in others:
        changed = variant.applied(scene)
        different = {
            name for name in vars(plain.planner) if getattr(plain.planner, name) != getattr(changed.planner, name)
        }
        if variant.factor == "solver":
            assert (different, variant.solver) == (set(), variant.value)
        else:
            assert different == {variant.factor}
            assert (getattr(changed.planner, variant.factor), variant.solver) == (variant.value, first.solver)
    assert len({label(variant) for variant in variants(VALUES)}) == len(others) + 1


def test_length_and_acceleration_of_a_parabola() -> None:
    """q = (t², 0) over one second: length 1, acceleration 2 throughout, its square 4."""
    for count in (11, 201):
        t = np.linspace(0, 1, count)
        motion = Trajectory(("a", "b"), np.stack([t**2, 0 * t], axis=1), {})
        assert path_length(motion) == pytest.approx(1.0)
        assert squared_acceleration(motion) == pytest.approx(4.0 * (count - 2) / (count - 1))


@pytest.fixture(scope="module")
def planar() -> Runs:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planning_runs, "QUICK_VALUES", FEW)
        patch.setattr(planning_runs, "QUICK_WANTED", 20)
        return measure([load_scene("planar_arm")], quick=True)


def test_every_variant_is_measured_and_no_clearance_is_invented(planar: Runs) -> None:
    assert planar.complete
    assert planar.variants == variants(FEW)
    for run in planar.runs:
        assert run.certified
        assert run.kernel is not None
        assert run.kernel > 0
        assert len(run.lost) == 20
        assert np.all(run.lost >= -ROUNDING), "D̃ is a lower bound"
        assert np.all(run.lost < NEAR_CONTACT + 0.2)
        assert np.isfinite(run.off).all()


def test_tighter_bodies_and_more_normals_lose_less(planar: Runs) -> None:
    rows = {label(row.variant): row for row in summaries(planar)}
    assert rows["hull"].lost[0] < rows["defaults"].lost[0] < rows["capsule"].lost[0] + ROUNDING
    assert rows["normals: sphere"].lost[1] <= rows["defaults"].lost[1] + ROUNDING
    assert rows["chomp"].lost == rows["defaults"].lost
    assert rows["defaults"].acceleration == rows["defaults"].length == pytest.approx(1.0)


def test_a_scene_that_cannot_be_planned_is_left_out_with_a_word() -> None:
    scene = load_scene("planar_arm")
    wrong = replace(scene, goal=JointTarget("goal", (0.0,)))
    buried = replace(scene, obstacles=(Obstacle("rock", Box((9.0, 9.0, 9.0))),))
    found = measure([wrong, buried], quick=True)
    assert found.runs == ()
    assert "1 values, but" in found.refused[0]
    assert "start: in collision" in found.refused[1]


def test_stopping_keeps_whole_variants() -> None:
    looked = itertools.count()
    seen: list[str] = []

    def report(done: int, of: int, what: str) -> None:
        seen.append(what)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planning_runs, "QUICK_VALUES", FEW)
        found = measure(
            [load_scene("planar_arm")], quick=True, report=report, stop=lambda: len(seen) > 3 and next(looked) > 0
        )
    assert not found.complete
    assert 0 < len(found.variants) < len(variants(FEW))


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """The pictures, which take the most, are laid out and no more."""
    monkeypatch.setattr("hdplan.planner.studies.planning.png", lambda figure: b"")


# --- what is written ----------------------------------------------------------------------------------------------


def test_three_files_hold_the_whole_study(measured: Callable[[Runs], None], tmp_path: Path) -> None:
    found = made_up()
    measured(found)
    report = study_planning(tmp_path / "out", [], False, nothing, nothing)
    assert report.complete
    assert [path.name for path in report.files] == list(FILES[:3]), "without scenes there is no quality over time"
    with report.files[0].open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(found.runs)
    assert [row["setting"] for row in rows[:3]] == ["defaults"] * 3
    text = report.files[1].read_text(encoding="utf-8")
    assert text.count("\n| ") == len(variants(VALUES)) + 2 + len(by_guesses(found.of(Variant()))) + 2
    assert "left out" in text
    assert "ipopt 2 of 3" in text, "who certifies fewer is named"
    assert report.files[2].read_bytes().startswith(b"\x89PNG")


@pytest.mark.usefixtures("undrawn")
def test_an_interrupted_study_is_written_and_says_so(measured: Callable[[Runs], None], tmp_path: Path) -> None:
    whole = made_up()
    measured(replace(whole, runs=whole.runs[:12], complete=False))
    report = study_planning(tmp_path, [], False, nothing, nothing)
    assert not report.complete
    assert "interrupted" in report.files[1].read_text(encoding="utf-8")
    measured(replace(whole, runs=(), complete=False))
    with pytest.raises(KeyboardInterrupt):
        study_planning(tmp_path, [], False, nothing, nothing)


def test_the_defaults_alone_are_drawn_too(measured: Callable[[Runs], None], tmp_path: Path) -> None:
    whole = made_up()
    measured(replace(whole, runs=whole.runs[:3], complete=False))
    assert study_planning(tmp_path, [], False, nothing, nothing).files[2].stat().st_size > 10_000


def test_nothing_to_plan_is_reported(measured: Callable[[Runs], None], tmp_path: Path) -> None:
    measured(Runs((), (), ("a.yaml: start: in collision",), complete=True))
    with pytest.raises(InputError, match=r"no scene can be planned: a\.yaml"):
        study_planning(tmp_path, [], False, nothing, nothing)


# --- names in the picture -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_names_cover_neither_each_other_nor_the_points(seed: int) -> None:
    from matplotlib.figure import Figure
    from matplotlib.transforms import Bbox

    from hdplan.planner.pictures.labels import name_points

    rng = np.random.default_rng(seed)
    points = rng.normal(size=(20, 2)) * [0.3, 1.0]
    figure = Figure(figsize=(6, 4), dpi=150)
    axis = figure.add_subplot()
    axis.plot(*points.T, "o")
    name_points(axis, [tuple(point) for point in points.tolist()], [f"setting {k}" for k in range(20)], bold=2)
    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in axis.texts if text.get_text()]
    assert len(boxes) > 10
    assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))
    dots = [Bbox([place - 3, place + 3]) for place in axis.transData.transform(points)]
    assert not any(box.overlaps(dot) for box in boxes for dot in dots)
    frame = axis.get_window_extent()
    assert all(np.all(frame.min <= box.min) and np.all(box.max <= frame.max) for box in boxes)


@pytest.mark.usefixtures("undrawn")
def test_scenes_are_named_in_the_report(measured: Callable[[Runs], None], tmp_path: Path) -> None:
    measured(made_up())
    scenes: list[Scene] = []
    notes = dict(study_planning(tmp_path, scenes, True, nothing, nothing).notes)
    assert notes["scenes"] == "3: scene 0, scene 1, scene 2"
    assert notes["defaults"].startswith("3 of 3 certified")
