"""The picture of accuracy against time: one look says which setting to take.

Above, both questions of a user over the time of value and gradient: how often is a gap taken for contact, and how far
off is the distance near contact. Below, what each of the three knobs does by itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, NullFormatter

from hdplan.distance.study import BANDS, Entry, Study, pareto_front
from hdplan.planner.plot_style import CONTACT, FIXED, FRAME, GOOD, GREY, INK, RC, RUNG_STYLES
from hdplan.scenes.model import PlannerSettings

GAP = 1e-2  # [m] at which false positives are compared
GAMMAS = {1: "#CFE3F2", 2: "#7FB2D9", 4: "#2F78B7", 8: "#0B3A6B"}  # light to dark: told apart in grey, too
LENGTH_DASHES = {1e-4: (0, (1, 1.5)), 1e-3: "-", 1e-2: (0, (5, 2))}
BAND_STYLES = {"apart": (INK, "o"), "near": (CONTACT, "s"), "deep": (FIXED, "D")}
DEFAULTS = PlannerSettings()
PAPER_LENGTH = 1e-2  # [m] the paper's epsilon, 1e-4, at gamma 2


def study_sheet(found: Study, choice: Entry) -> Figure:
    """Return the figure; ``choice`` is the setting to take."""
    entries = found.means()
    with rc_context(RC):
        figure = Figure(figsize=(11.7, 8.3), dpi=150, facecolor="white")
        _title(figure, found, choice)
        above = figure.add_gridspec(1, 2, left=0.06, right=0.985, bottom=0.435, top=0.83, wspace=0.17)
        below = figure.add_gridspec(1, 3, left=0.06, right=0.985, bottom=0.065, top=0.32, wspace=0.24)
        _against_time(
            figure.add_subplot(above[0]), entries, choice, lambda e: 100.0 * e.false_positives[GAP],
            "Is it free?", f"gaps over {GAP * 100:g} cm taken for contact [%]", lengths=False,
        )  # fmt: skip
        _against_time(
            figure.add_subplot(above[1]), entries, choice, lambda e: 1e3 * e.median_error["near"],
            "How far is it, near contact?", "median |D − d| within 5 cm of contact [mm]", lengths=True,
        )  # fmt: skip
        _by_gap(figure.add_subplot(below[0]), entries)
        _by_gamma(figure.add_subplot(below[1]), entries, choice)
        _by_length(figure.add_subplot(below[2]), entries, choice)
        _keys(figure, entries)
        return figure


def _title(figure: Figure, found: Study, choice: Entry) -> None:
    figure.text(0.02, 0.968, "What accuracy of the distance costs in time", fontsize=15, weight="bold", va="center")
    s = choice.setting
    take = (
        f"take {s.normals}, gamma {s.gamma}, shaping length {_length(s.shaping_length)}: "
        f"{100 * choice.false_positives[GAP]:.2g} % at {1e6 * choice.seconds['gradient']:.2g} µs"
    )
    figure.text(0.02, 0.932, take, color=GOOD, fontsize=11, weight="bold", va="center")
    about = f"{len(found.plan.bodies)} pairs of bodies" if len(found.plan.bodies) > 1 else found.plan.bodies[0]
    part = "" if found.complete else ", interrupted: of what was measured"
    figure.text(0.985, 0.968, about + part, ha="right", va="center", color=FIXED)


def _against_time(
    axis: Any, entries: Sequence[Entry], choice: Entry, loss: Callable[[Entry], float], title: str, label: str,
    *, lengths: bool,
) -> None:  # fmt: skip
    """Draw every set of normals and gamma at its time and loss; whiskers are the range over the shaping length."""
    floor = min((loss(e) for e in entries if loss(e) > 0), default=1e-3) / 2.0
    shown = [e for e in entries if e.setting.shaping_length == DEFAULTS.shaping_length]
    rungs = _rungs(entries)
    for entry in shown:
        time = 1e6 * entry.seconds["gradient"]
        if lengths:
            range_ = [loss(e) for e in entries if _but_length(e) == _but_length(entry)]
            axis.plot([time] * 2, [min(range_), max(range_)], color=FRAME, linewidth=1.0, zorder=2)
        color, marker = GAMMAS.get(entry.setting.gamma, INK), RUNG_STYLES[rungs.index(entry.setting.normals)][1]
        double = entry.setting.precision == "float64"
        axis.plot(
            time, max(loss(entry), floor), marker, markersize=8 if marker == "*" else 6.5, zorder=4 if double else 3,
            mfc=color if double else "white", mec=INK if double else color, mew=0.6 if double else 1.2,
        )  # fmt: skip
    exact = [e for e in shown if e.setting.precision == "float64"]
    front = [exact[k] for k in pareto_front([e.seconds["gradient"] for e in exact], [loss(e) for e in exact])]
    axis.step(
        [1e6 * e.seconds["gradient"] for e in front], [max(loss(e), floor) for e in front], where="post",
        color=GOOD, linewidth=5, alpha=0.3, zorder=1, solid_capstyle="round",
    )  # fmt: skip
    for entry, words, color, place in _marks(entries, choice):
        axis.annotate(
            words, (1e6 * entry.seconds["gradient"], max(loss(entry), floor)), place, textcoords="offset points",
            color=color, weight="bold", ha="center", arrowprops={"arrowstyle": "-", "color": color, "shrinkB": 6},
            zorder=6,
        )  # fmt: skip
        axis.plot(
            1e6 * entry.seconds["gradient"], max(loss(entry), floor), "o", markersize=15, mfc="none", mec=color,
            mew=1.6, zorder=5,
        )  # fmt: skip
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_title(title)
    axis.set_xlabel("time of value and gradient, per query [µs]")
    axis.set_ylabel(label)
    _plain(axis)


def _marks(entries: Sequence[Entry], choice: Entry) -> list[tuple[Entry, str, str, tuple[int, int]]]:
    """Return the settings that are named: the one to take, the product's default, and the paper's."""
    marks = [(choice, "take this", GOOD, (0, -38))]
    for length, words, color, place in (
        (PAPER_LENGTH, "the paper's", CONTACT, (-26, 30)),
        (DEFAULTS.shaping_length, "hdsdf's default", INK, (40, 34)),
    ):
        for e in entries:
            s = e.setting
            if (s.normals, s.gamma, s.shaping_length, s.precision) == ("paper", 2, length, "float64"):
                marks.append((e, words, color, place))
    return marks


def _by_gap(axis: Any, entries: Sequence[Entry]) -> None:
    """How false positives fall with the gap, for every set of normals."""
    at_default = [e for e in entries if _is(e, gamma=2, shaping_length=DEFAULTS.shaping_length)]
    for k, entry in enumerate(at_default):
        color, marker = RUNG_STYLES[k % len(RUNG_STYLES)]
        gaps, rates = zip(
            *((gap, 100.0 * rate) for gap, rate in entry.false_positives.items() if rate > 0), strict=True
        )
        axis.plot(gaps, rates, color=color, marker=marker, markersize=4.5, linewidth=1.3)
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_title("Normals decide how often")
    axis.set_xlabel("gap [m]")
    axis.set_ylabel("larger gaps taken for contact [%]")
    _plain(axis)


def _by_gamma(axis: Any, entries: Sequence[Entry], choice: Entry) -> None:
    """How the error falls with gamma, apart, near and deep, for the normals to take."""
    rung = [e for e in entries if _is(e, normals=choice.setting.normals, shaping_length=DEFAULTS.shaping_length)]
    for band in BANDS:
        color, marker = BAND_STYLES[band]
        error = [1e3 * e.median_error[band] for e in rung]
        axis.plot([e.setting.gamma for e in rung], error, color=color, marker=marker, markersize=4.5, label=band)
    axis.set_xscale("log", base=2)
    axis.set_yscale("log")
    axis.set_title("Gamma decides how far off")
    axis.set_xlabel("gamma")
    axis.set_ylabel("median |D − d| [mm]")
    axis.legend(loc="best")
    _plain(axis)


def _by_length(axis: Any, entries: Sequence[Entry], choice: Entry) -> None:
    """How the error near contact grows with the shaping length, for every gamma."""
    rung = [e for e in entries if _is(e, normals=choice.setting.normals)]
    for gamma in sorted({e.setting.gamma for e in rung}):
        some = [e for e in rung if e.setting.gamma == gamma]
        axis.plot(
            [1e3 * e.setting.shaping_length for e in some], [1e3 * e.median_error["near"] for e in some],
            color=GAMMAS.get(gamma, INK), marker="o", markersize=4.5, mec=INK, mew=0.5,
        )  # fmt: skip
    axis.set_xscale("log")
    axis.set_title("The shaping length decides how flat contact is")
    axis.set_xlabel("shaping length [mm]")
    axis.set_ylabel("median |D − d| near contact [mm]")
    _plain(axis)


def _keys(figure: Figure, entries: Sequence[Entry]) -> None:
    """One key for the two panels above."""
    handles = [
        Line2D([], [], linestyle="", marker=RUNG_STYLES[k][1], markersize=7, mfc="white", mec=INK, label=name)
        for k, name in enumerate(_rungs(entries))
    ]
    handles += [
        Line2D(
            [], [], linestyle="", marker="o", markersize=7, mfc=GAMMAS.get(gamma, INK), mec=INK, label=f"gamma {gamma}"
        )
        for gamma in sorted({e.setting.gamma for e in entries})
    ]
    figure.legend(
        handles=handles, loc="upper left", bbox_to_anchor=(0.012, 0.915), ncols=len(handles), columnspacing=1.2
    )


def _rungs(entries: Sequence[Entry]) -> list[str]:
    return list(dict.fromkeys(entry.setting.normals for entry in entries))


def _is(entry: Entry, **wanted: object) -> bool:
    wanted.setdefault("precision", "float64")
    return all(getattr(entry.setting, name) == value for name, value in wanted.items())


def _but_length(entry: Entry) -> tuple[object, ...]:
    s = entry.setting
    return s.normals, s.gamma, s.precision


def _plain(axis: Any) -> None:
    """Numbers as numbers, a light grid."""
    for one in (axis.xaxis, axis.yaxis):
        one.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        one.set_minor_formatter(NullFormatter())
    axis.grid(color=GREY, linewidth=0.6)
    axis.set_axisbelow(True)


def _length(metres: float) -> str:
    return f"{metres * 1e3:g} mm" if metres < 0.01 else f"{metres * 1e2:g} cm"
