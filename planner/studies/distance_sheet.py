"""The picture of accuracy against time: it shows at a glance which setting to take.

Above, both questions of a user over the time of value and gradient: how often is a gap taken for contact, and how far
off is the distance near contact. Below, what each of the three knobs does by itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from hdplan.distance.studies.accuracy import BANDS, Entry, Study, pareto_front
from hdplan.planner.pictures.style import CONTACT, FIXED, FRAME, GOOD, GREY, INK, OTHER_RUNG, RC, RUNG_STYLES
from hdplan.planner.studies.report import length_text
from hdplan.scenes.planner_settings import PlannerSettings

GAP = 1e-2  # [m] at which false positives are compared
GAMMAS = {1: "#CFE3F2", 2: "#7FB2D9", 4: "#2F78B7", 8: "#0B3A6B"}  # light to dark: distinct in grey, too
FRONTS: dict[str, dict[str, Any]] = {
    "float64": {"linewidth": 6, "alpha": 0.25, "solid_capstyle": "round"},
    "float32": {"linewidth": 1.2, "linestyle": (0, (4, 2))},
}
BAND_STYLES = {"apart": (INK, "o"), "near": (CONTACT, "s"), "deep": (FIXED, "D")}
DEFAULTS = PlannerSettings()
DECADES = 200.0  # ratio of the ends of a logarithmic scale, above which only powers of ten have numbers
PAPER_LENGTH = 1e-2  # [m] the paper's epsilon, 1e-4, at gamma 2


def study_sheet(found: Study, choice: Entry) -> Figure:
    """Return the figure; ``choice`` is the setting to take."""
    entries = found.means()
    with rc_context(RC):
        figure = Figure(figsize=(11.7, 8.3), dpi=150, facecolor="white")
        _title(figure, found, choice)
        above = figure.add_gridspec(1, 2, left=0.06, right=0.985, bottom=0.435, top=0.815, wspace=0.17)
        below = figure.add_gridspec(1, 3, left=0.06, right=0.985, bottom=0.065, top=0.32, wspace=0.24)
        none = any(e.false_positives[GAP] == 0 for e in entries)
        lengths = sorted(e.setting.shaping_length for e in entries)
        _against_time(
            figure.add_subplot(above[0]), entries, choice, lambda e: 100.0 * e.false_positives[GAP],
            "Is it free?", f"gaps over {length_text(GAP)} taken for contact [%]",
            "lowest row: none at all" if none else "",
        )  # fmt: skip
        _against_time(
            figure.add_subplot(above[1]), entries, choice, lambda e: 1e3 * e.median_error["near"],
            "How far is it, near contact?", "median |D − d| within 5 cm of contact [mm]",
            f"whiskers: shaping lengths of {length_text(lengths[0])} to {length_text(lengths[-1])}",
        )  # fmt: skip
        _by_gap(figure.add_subplot(below[0]), entries)
        _by_gamma(figure.add_subplot(below[1]), entries, choice)
        _bylength_text(figure.add_subplot(below[2]), entries, choice)
        _keys(figure, entries)
        return figure


def _title(figure: Figure, found: Study, choice: Entry) -> None:
    figure.text(0.02, 0.968, "What accuracy of the distance costs in time", fontsize=15, weight="bold", va="center")
    s, rate = choice.setting, 100.0 * choice.false_positives[GAP]
    take = (
        f"take {s.normals}, gamma {s.gamma}, shaping length {length_text(s.shaping_length)}: {rate:.2g} % of gaps over "
        f"{length_text(GAP)} taken for contact, value and gradient in {1e6 * choice.seconds['gradient']:.2g} µs"
    )
    figure.text(0.02, 0.932, take, color=GOOD, fontsize=10, weight="bold", va="center")
    pairs = len(found.bodies)
    about = f"mean of {pairs} pairs of bodies" if pairs > 1 else found.bodies[0]
    part = "" if found.complete else ", interrupted: what was measured until then"
    figure.text(0.985, 0.968, about + part, ha="right", va="center", color=FIXED)


def _against_time(
    axis: Any, entries: Sequence[Entry], choice: Entry, loss: Callable[[Entry], float],
    title: str, label: str, footnote: str,
) -> None:  # fmt: skip
    """Draw every set of normals and gamma at its time and loss; whiskers are the range over the shaping length."""
    floor = min((loss(e) for e in entries if loss(e) > 0), default=1e-3) / 2.5

    def place(entry: Entry) -> tuple[float, float]:
        return 1e6 * entry.seconds["gradient"], max(loss(entry), floor)

    shown = [e for e in entries if e.setting.shaping_length == DEFAULTS.shaping_length]
    marks = _marks(entries, choice)
    for entry in [*shown, *(entry for entry, *_ in marks if entry not in shown)]:
        s = entry.setting
        reach = [place(e)[1] for e in entries if replace(e.setting, shaping_length=s.shaping_length) == s]
        axis.plot([place(entry)[0]] * 2, [min(reach), max(reach)], color=FRAME, linewidth=1.0, zorder=2)
        color, marker = GAMMAS.get(s.gamma, INK), RUNG_STYLES.get(s.normals, OTHER_RUNG)[1]
        double = s.precision == "float64"
        axis.plot(
            *place(entry), marker, markersize=10 if marker == "*" else 6.5, zorder=4 if double else 3,
            mfc=color if double else "white", mec=INK if double else color, mew=0.6 if double else 1.2,
        )  # fmt: skip
    for precision, style in FRONTS.items():
        some = [e for e in shown if e.setting.precision == precision]
        front = [some[k] for k in pareto_front([e.seconds["gradient"] for e in some], [loss(e) for e in some])]
        if front:
            axis.step(*zip(*map(place, front), strict=True), where="post", color=GOOD, zorder=1, **style)
    axis.set(xscale="log", yscale="log", title=title, xlabel="time of value and gradient, per query [µs]", ylabel=label)
    low, high = axis.get_ylim()  # room for labels
    axis.set_ylim(low * (low / high) ** 0.16, high * (high / low) ** 0.16)
    left, right = axis.get_xlim()
    axis.set_xlim(left * (left / right) ** 0.12)
    for entry, words, color, offset, align in marks:
        axis.plot(*place(entry), "o", markersize=15, mfc="none", mec=color, mew=1.6, zorder=5)
        axis.annotate(
            words, place(entry), offset, textcoords="offset points", color=color, weight="bold", ha=align,
            arrowprops={"arrowstyle": "-", "color": color, "shrinkB": 8, "shrinkA": 0}, zorder=6,
        )  # fmt: skip
    plain(axis)
    axis.text(0.985, 0.025, footnote, transform=axis.transAxes, ha="right", color=FIXED, fontsize=7.5)


def _marks(entries: Sequence[Entry], choice: Entry) -> list[tuple[Entry, str, str, tuple[int, int], str]]:
    """Return the settings that are named, with words, colour and where these stand: the one to take, and the defaults
    of hdsdf and of the paper."""
    marks = [(choice, "take this", GOOD, (-16, -24), "right")]
    for length, words, color, offset, align in (
        (PAPER_LENGTH, "the paper's", CONTACT, (-10, 18), "right"),
        (DEFAULTS.shaping_length, "hdplan's default", INK, (16, 18), "left"),
    ):
        marks += [
            (e, words, color, offset, align)
            for e in entries
            if _is(e, normals="paper", gamma=DEFAULTS.gamma, shaping_length=length)
        ]
    return marks


def _by_gap(axis: Any, entries: Sequence[Entry]) -> None:
    """Panel of the false positives over the gap, for every set of normals."""
    at_default = [e for e in entries if _is(e, gamma=2, shaping_length=DEFAULTS.shaping_length)]
    for entry in at_default:
        color, marker = RUNG_STYLES.get(entry.setting.normals, OTHER_RUNG)
        known = [(100.0 * gap, 100.0 * rate) for gap, rate in entry.false_positives.items() if rate > 0]
        axis.plot(*zip(*known, strict=True), color=color, marker=marker, markersize=4.5, linewidth=1.3)
    axis.set(xscale="log", yscale="log", title="Normals: how often a gap is missed", xlabel="gap [cm]")
    axis.set_ylabel("larger gaps taken for contact [%]")
    plain(axis)


def _by_gamma(axis: Any, entries: Sequence[Entry], choice: Entry) -> None:
    """Panel of the error over gamma, apart, near and deep, for the normals to take."""
    rung = [e for e in entries if _is(e, normals=choice.setting.normals, shaping_length=DEFAULTS.shaping_length)]
    for band in BANDS:
        color, marker = BAND_STYLES[band]
        error = [1e3 * e.median_error[band] for e in rung]
        axis.plot([e.setting.gamma for e in rung], error, color=color, marker=marker, markersize=4.5, label=band)
    axis.set_xscale("log", base=2)
    axis.set(yscale="log", title="Gamma: how far off", xlabel="gamma", ylabel="median |D − d| [mm]")
    axis.legend(loc="best")
    plain(axis)
    axis.set_xticks([e.setting.gamma for e in rung])


def _bylength_text(axis: Any, entries: Sequence[Entry], choice: Entry) -> None:
    """Panel of the error near contact over the shaping length, for every gamma."""
    rung = [e for e in entries if _is(e, normals=choice.setting.normals)]
    for gamma in sorted({e.setting.gamma for e in rung}):
        some = [e for e in rung if e.setting.gamma == gamma]
        axis.plot(
            [1e3 * e.setting.shaping_length for e in some], [1e3 * e.median_error["near"] for e in some],
            color=GAMMAS.get(gamma, INK), marker="o", markersize=4.5, mec=INK, mew=0.5,
        )  # fmt: skip
    axis.set(xscale="log", title="Shaping length: how flat at contact", xlabel="shaping length [mm]")
    axis.set_ylabel("median |D − d| near contact [mm]")
    plain(axis)


def _keys(figure: Figure, entries: Sequence[Entry]) -> None:
    """One key for the two panels above."""
    handles = []
    for name in dict.fromkeys(e.setting.normals for e in entries):
        marker = RUNG_STYLES.get(name, OTHER_RUNG)[1]
        handles.append(Line2D([], [], linestyle="", marker=marker, markersize=7, mfc="white", mec=INK, label=name))
    for gamma in sorted({e.setting.gamma for e in entries}):
        handles.append(_dot(GAMMAS.get(gamma, INK), INK, f"gamma {gamma}"))
    if len({e.setting.precision for e in entries}) > 1:
        handles.append(_dot("white", GAMMAS[4], "float32 (JAX)"))
    handles.append(Line2D([], [], color=GOOD, label="Pareto front", **FRONTS["float64"]))
    figure.legend(
        handles=handles, loc="upper left", bbox_to_anchor=(0.012, 0.918), ncols=(len(handles) + 1) // 2,
        columnspacing=1.4, handletextpad=0.7,
    )  # fmt: skip


def _dot(fill: str, edge: str, words: str) -> Line2D:
    return Line2D([], [], linestyle="", marker="o", markersize=7, mfc=fill, mec=edge, label=words)


def _is(entry: Entry, **wanted: object) -> bool:
    wanted.setdefault("precision", "float64")
    return all(getattr(entry.setting, name) == value for name, value in wanted.items())


def plain(axis: Any) -> None:
    """Show numbers as numbers, on a light grid; of logarithmic scales over few decades 2 and 5 as well."""
    for one in (axis.xaxis, axis.yaxis):
        one.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        one.set_minor_formatter(NullFormatter())
        if one.get_scale() == "log":
            low, high = one.get_view_interval()
            one.set_major_locator(LogLocator(subs=(1, 2, 5) if high < DECADES * low else (1,)))
    axis.grid(color=GREY, linewidth=0.6)
    axis.set_axisbelow(True)
