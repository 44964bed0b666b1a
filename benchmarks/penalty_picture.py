"""The picture of `penalties`: cost against iteration, problems found against iteration, and the kink between faces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from penalty_faces import EDGE, GAP, Tilted

from hdplan.planner.pictures.style import GOAL, INK, RC, START
from hdplan.planner.solvers.solution import Iteration
from hdplan.scenes.array_types import Array

STYLES = {
    "hdsdf": ("HD-SDF", START, "-"),
    "hdsdf, gamma 12": ("HD-SDF, gamma 12: nearly kinked", INK, ":"),
    "fcl": ("FCL: the exact distance", GOAL, "--"),
}
BANDS = ("hdsdf", "fcl")  # whose quartiles are shown
WEIGHT = 1e6  # [1/m²] of the penalty in the picture, whatever the solver's weight is at that iteration
SHOWN, FAR = 40, 1000  # iterations: of the cost, and until found

Attempts = Sequence[Sequence[Sequence[Iteration]]]  # problem, attempt, iteration


def draw(attempts: Mapping[str, Attempts], certified: dict[str, list[bool]], tilted: Tilted, file: Path) -> None:
    """Draw three panels."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    with plt.rc_context(RC):
        figure, (left, middle, right) = plt.subplots(1, 3, figsize=(10.5, 3.8), layout="constrained")
        figure.suptitle("The HD-SDF and the exact distance as the planner's penalty", fontsize=12, weight="bold")
        iterations = np.arange(1, SHOWN + 1)
        for name, (label, colour, dash) in STYLES.items():
            costs = np.array([_cost(problem[0]) for problem in attempts[name] if problem and problem[0]])
            low, half, high = np.quantile(costs, [0.25, 0.5, 0.75], axis=0)
            if name in BANDS:
                left.fill_between(iterations, low, high, color=colour, alpha=0.2, linewidth=0)
            left.plot(iterations, half, dash, color=colour, label=label)

            both = zip(attempts[name], certified[name], strict=True)
            needed = [sum(map(len, problem)) if found else np.inf for problem, found in both]
            shares = 100 * np.mean(np.array(needed)[:, None] <= np.arange(1, FAR + 1), axis=0)
            middle.plot(np.arange(1, FAR + 1), shares, dash, color=colour, label=label)
            right.plot(np.rad2deg(tilted.tilts), 1e3 * tilted.torques[name], dash, color=colour, label=label)
        left.set(title="Cost while solving from the first guess", ylabel="smoothness + 10⁶ m⁻² × own penalty")
        left.set(xlabel="iteration", yscale="log", xlim=(1, SHOWN))
        left.text(0.98, 0.68, f"median and quartiles\nof {len(attempts['hdsdf'])} problems", **_words(left, "right"))
        middle.set(
            title="Problems certified", xlabel="iterations, over all first guesses", ylabel="of all problems [%]"
        )
        middle.set(xscale="log", xlim=(1, FAR), ylim=(0, 102))
        right.set(title="A box tilted above a wall", xlabel="tilt [°]", ylabel="derivative of D by the tilt [mm/rad]")
        right.set(xlim=(-3, 3))
        right.axhline(0, color=INK, linewidth=0.5)
        words = f"box of {1e3 * EDGE:.0f} mm,\n{1e3 * GAP:.0f} mm above the wall"
        right.text(0.03, 0.05, words, **_words(right, "left"))
        left.legend(loc="upper right")
        figure.savefig(file, dpi=160)
        plt.close(figure)


def _words(axes: object, side: str) -> dict[str, object]:
    return {"transform": axes.transAxes, "ha": side, "fontsize": 7.5, "color": INK}  # type: ignore[attr-defined]


def _cost(steps: Sequence[Iteration]) -> Array:
    """Cost (SHOWN,) at one weight, the last one held once the solver has ended."""
    costs = [step.smoothness + WEIGHT * (step.cost - step.smoothness) / step.weight for step in steps[:SHOWN]]
    return np.array(costs + [costs[-1]] * (SHOWN - len(costs)))
