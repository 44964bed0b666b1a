"""Reports of measurements: tables whole, pictures drawn, interruptions reported; on invented numbers."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from hdplan.distance.studies import accuracy as measuring, unions as cutting
from hdplan.distance.studies.accuracy import BANDS, FULL_PLAN, GAPS, NORMALS, Entry, Plan, Setting, Study
from hdplan.distance.studies.conservativeness import Conservativeness, RungAlarms
from hdplan.distance.studies.query_time import METHODS, PairTimes, QueryTimes
from hdplan.distance.studies.unions import BODIES, PIECES, Cut
from hdplan.planner.studies.distance import FILES, UNIONS_FILE, study_distance
from hdplan.planner.studies.report import check_report, csv_text, markdown_text, png, short, write_report
from hdplan.scenes.errors import InputError
from tests.extras import needs

pytestmark = needs("matplotlib")


def made_up(plan: Plan) -> Iterator[Entry]:
    """Numbers like those that are measured."""
    rungs = list(dict.fromkeys(normals for normals, _, _ in plan.kernels))
    for bodies, (normals, gamma, precision), length in product(plan.bodies, plan.kernels, plan.shaping_lengths):
        rung = rungs.index(normals)
        rates = {gap: max(0.01 / 4**rung - 0.1 * gap, 0.0) for gap in GAPS}
        error = {band: 0.02 / gamma + length for band in BANDS}
        time = 1e-6 * (1 + rung**2) * gamma**0.3
        yield Entry(
            Setting(normals, gamma, length, precision), bodies, rates, 1e-3 * (precision == "float32"),
            error, error, {band: 3 * value for band, value in error.items()}, gamma / length,
            {order: time * factor for order, factor in zip(plan.orders, (1, 2, 6), strict=False)},
        )  # fmt: skip


def made_up_cuts() -> Iterator[Cut]:
    for body, count in product(BODIES, PIECES):
        yield Cut(
            body, count, dict.fromkeys(GAPS[:3], 0.01 / count), 0, 0.6 / count, 1e-3 * count,
            {order: 1e-6 * count for order in FULL_PLAN.orders},
        )  # fmt: skip


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> Study:
    """The results of `study` and `study_unions`, without measuring."""
    found = Study(FULL_PLAN, tuple(made_up(FULL_PLAN)), complete=True)
    monkeypatch.setattr(measuring, "study", lambda plan, **_: found)
    monkeypatch.setattr(cutting, "study_unions", lambda **_: list(made_up_cuts()))
    return found


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """The picture, which takes the most, is laid out and no more."""
    monkeypatch.setattr("hdplan.planner.studies.distance.png", lambda figure: b"")


def nothing(*_: object) -> bool:
    return False


def assert_drawn(data: bytes) -> None:
    from matplotlib.image import imread

    image = np.asarray(imread(io.BytesIO(data)))[..., :3]
    assert image.shape[0] > 800
    assert image.shape[1] > 1200
    assert image.std() > 0.05
    assert len(np.unique((255 * image).astype(int) @ [65536, 256, 1])) > 100  # colours


def test_files_hold_the_whole_study(measured: Study, tmp_path: Path) -> None:
    report = study_distance(tmp_path / "out", False, nothing, nothing)
    assert report.complete
    assert [path.name for path in report.files] == [*FILES, UNIONS_FILE]
    with report.files[0].open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    settings = len(FULL_PLAN.kernels) * len(FULL_PLAN.shaping_lengths)
    assert len(rows) == settings * (len(FULL_PLAN.bodies) + 1)
    assert all(cell != "" for row in rows for cell in row.values())
    table = report.files[1].read_text(encoding="utf-8")
    assert sum(line.startswith("| paper") for line in table.splitlines()) == settings
    assert table.count("| ring |") == len(PIECES)
    assert_drawn(report.files[2].read_bytes())
    with report.files[3].open(encoding="utf-8") as file:
        cuts = list(csv.DictReader(file))
    assert [(row["body"], int(row["pieces"])) for row in cuts] == list(product(BODIES, PIECES))
    assert float(cuts[-1]["median_ratio"]) == pytest.approx(0.6 / PIECES[-1])


@pytest.mark.usefixtures("undrawn")
def test_interrupted_unions_are_written_and_reported(
    measured: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cutting, "study_unions", lambda **_: list(made_up_cuts())[:3])
    report = study_distance(tmp_path, False, nothing, nothing)
    assert not report.complete
    assert len(report.tables["unions of pieces"]) == 3
    assert "interrupted" in report.files[1].read_text(encoding="utf-8")


@pytest.mark.usefixtures("undrawn")
def test_the_summary_has_a_line_per_rung_and_the_advice(measured: Study, tmp_path: Path) -> None:
    report = study_distance(tmp_path, False, nothing, nothing)
    rows, cuts = report.tables.values()
    assert [row["pieces"] for row in cuts] == [*PIECES, *PIECES]
    assert [row["normals"] for row in rows] == list(NORMALS)
    notes = dict(report.notes)
    assert notes["take"].startswith("paper+")
    assert "gamma 2" in notes["take"]
    assert "float32" in notes["sign of D"]


@pytest.mark.core
@pytest.mark.usefixtures("undrawn")
def test_an_interrupted_study_is_written_and_says_so(
    measured: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    partial = replace(measured, entries=measured.entries[:40], complete=False)
    monkeypatch.setattr(measuring, "study", lambda plan, **_: partial)
    report = study_distance(tmp_path, False, nothing, nothing)
    assert not report.complete
    assert "interrupted" in report.files[1].read_text(encoding="utf-8")
    monkeypatch.setattr(measuring, "study", lambda plan, **_: replace(partial, entries=()))
    with pytest.raises(KeyboardInterrupt):
        study_distance(tmp_path, False, nothing, nothing)


def test_a_study_stopped_before_the_first_gamma_to_take_has_nothing_to_show(
    measured: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    partial = replace(measured, entries=measured.entries[:3], complete=False)
    monkeypatch.setattr(measuring, "study", lambda plan, **_: partial)
    with pytest.raises(KeyboardInterrupt):
        study_distance(tmp_path, False, nothing, nothing)
    assert not list(tmp_path.iterdir())


def test_pictures_of_the_papers_figures() -> None:
    from hdplan.planner.studies.conservativeness_sheet import conservativeness_sheet
    from hdplan.planner.studies.query_time_sheet import time_sheet

    rng = np.random.default_rng(0)
    rungs = tuple(RungAlarms(name, np.sort(rng.exponential(0.05, 40))) for name in ("paper", "paper+edges"))
    rungs += (RungAlarms("paper+centre", np.empty(0)),)
    found = Conservativeness(10_000, np.sort(rng.uniform(0, 3, 9_000)), 0, rungs, 0, 0.0)
    assert_drawn(png(conservativeness_sheet(found, np.geomspace(1e-4, 0.3, 30))))
    pairs = tuple(
        PairTimes(("cube", "cube"), size, {name: 1e-6 * (k + 1) for k, name in enumerate(METHODS)})
        for size in (128, 16_000)
    )
    assert_drawn(png(time_sheet(QueryTimes(15, pairs))))
    assert_drawn(png(time_sheet(QueryTimes(15, pairs[:1]))))


def test_tables_read_back() -> None:
    rows = [{"name": "a, b", "x [m]": 1.5, "n": 3, "gone": None}, {"name": "c", "x [m]": 1e-7, "n": 0, "gone": 2.0}]
    back = list(csv.DictReader(io.StringIO(csv_text(rows))))
    assert back[0] == {"name": "a, b", "x [m]": "1.5", "n": "3", "gone": ""}
    assert float(back[1]["x [m]"]) == 1e-7
    assert markdown_text(rows).splitlines()[2] == "| a, b | 1.5 | 3 | - |"


@pytest.mark.parametrize(
    ("number", "text"), [(12345.6, "12 300"), (0.012345, "0.0123"), (1e-9, "1e-09"), (0.0, "0"), (7, "7"), (None, "-")]
)
def test_numbers_for_reading(number: float | None, text: str) -> None:
    assert short(number) == text


def test_reports_are_whole_or_not_there(tmp_path: Path) -> None:
    paths = check_report(tmp_path / "new", ("a.csv", "b.md"))
    write_report(paths, ["1", b"2"])
    assert [path.read_text() for path in paths] == ["1", "2"]
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "a.csv").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        check_report(tmp_path / "taken", ("a.csv",))
    with pytest.raises(InputError, match="cannot be made"):
        check_report(paths[0], ("a.csv",))
