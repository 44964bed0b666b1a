"""Draw docs/proof.png: what a proof holds about one link and one obstacle, leaf by leaf.

    python benchmarks/proof_picture.py

The motion is planned with the command's defaults, and its proof is written and checked. Everything is seen from above:
the bar is vertical, so that the planes are too. The bar stands still, so that each leaf says that the link never enters
a strip beside the bar, as wide as the distance proven.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.collections import PolyCollection
from scipy.spatial import ConvexHull

import hdplan
from hdplan.planner.pictures.style import BETWEEN, FRAME, GOOD, INK, OBSTACLE, RC, START
from hdplan.planner.proof.reading import ReadProof
from hdplan.scenes.array_types import Array
from hdplan.scenes.yaml_format.reader import find_scene
from hdplan.verify.kernel import NARROWEST, Motion

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # after the choice of a backend

SCENE, LINK, OBSTACLE_NAME = "panda_cage", "panda_hand", "bar4"
LEAVES = (7, 8, 9, 10)  # that are drawn: from when the hand comes until it has passed
POSES = 7  # of the link in each
SIDES, BELOW, OVER = 0.17, 0.06, 0.135  # [m] that a panel shows beside the bar, in front of it and behind it
LONG = 1.0  # [m] half the length of a strip
FILE = Path(__file__).resolve().parent.parent / "docs" / "proof.png"


def main() -> None:
    """Plan, prove, draw."""
    with tempfile.TemporaryDirectory() as folder:
        scene, motion = find_scene(SCENE), Path(folder) / "motion.json"
        hdplan.plan(hdplan.load_scene(SCENE)).save(motion)
        proof = hdplan.prove(scene, motion)
        read = ReadProof(scene, motion, proof.data)
    (pair,) = read.pairs(LINK, OBSTACLE_NAME, to_obstacle=True)
    spans = read.spans(pair)
    with plt.rc_context(RC):
        figure, axes = plt.subplots(1, len(LEAVES), figsize=(10.5, 2.35), layout="constrained")
        for axis, leaf in zip(axes, LEAVES, strict=True):
            draw_leaf(axis, read, pair, leaf)
        name_things(axes[0])
        title = "On each interval of the motion, one plane keeps the hand away from the bar"
        figure.suptitle(title, fontsize=11, weight="bold")
        figure.savefig(FILE, dpi=150)
    print(f"{len(spans)} leaves: {FILE}")


def draw_leaf(axis: Any, read: ReadProof, pair: int, leaf: int) -> None:
    """Draw the link along one leaf, the obstacle, and the strip between them."""
    low, high = read.spans(pair)[leaf]
    link, bar = read.world.pairs[pair].tolist()
    rows = np.linspace(low, high - NARROWEST, POSES)
    plane = read.planes([pair], float(rows[0]))[0]
    normal = plane.normal[:2] / np.linalg.norm(plane.normal[:2])
    (section,) = outlines(read, bar, rows[:1])
    face = float((section @ normal).max())
    along = np.array([-normal[1], normal[0]])
    ends = LONG * np.array([[-1.0], [1.0]]) * along
    strip = np.concatenate([ends + face * normal, ends[::-1] + (face + plane.bound) * normal])
    axis.add_collection(PolyCollection([strip], facecolors=GOOD, alpha=0.25, linewidths=0))
    middle = ends + (face + 0.5 * plane.bound) * normal
    axis.plot(*middle.T, color=GOOD, linewidth=1.2)
    hands = outlines(read, link, rows)
    axis.add_collection(PolyCollection(hands, facecolors=BETWEEN, alpha=0.16, linewidths=0))
    axis.add_collection(PolyCollection([hands[0], hands[-1]], facecolors="none", edgecolors=START, linewidths=0.8))
    axis.add_collection(PolyCollection([section], facecolors=OBSTACLE, edgecolors=INK, linewidths=0.8))
    (x, y), (low, high) = section.mean(axis=0), (low / read.rows, high / read.rows)
    axis.set(xlim=(x - SIDES, x + SIDES), ylim=(y - BELOW, y + OVER), xticks=[], yticks=[], aspect="equal")
    axis.spines[:].set(visible=True, color=FRAME)
    where = f"{low:.2f} to {high:.2f} of the motion"
    axis.set_title(f"{where}: ≥ {plane.bound * 1e3:.0f} mm", fontsize=8.5, weight="normal")


def name_things(axis: Any) -> None:
    """Say in one panel what is drawn in all."""
    for text, where, color in (
        ("hand, as it\nmoves along", (0.02, 0.93), START),
        ("bar", (0.56, 0.33), INK),
        ("plane, in a strip\nthat neither enters", (0.47, 0.2), GOOD),
    ):
        axis.text(*where, text, transform=axis.transAxes, color=color, fontsize=8, va="top")


def outlines(read: ReadProof, body: int, rows: Array) -> list[Array]:
    """Return a piece's outline (m, 2) [m] from above at rows of the motion."""
    motion = Motion(read.world, np.stack([rows, rows + NARROWEST], axis=1))
    piece, turns = read.world.pieces[body], np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    round_ = np.stack([np.cos(turns), np.sin(turns), 0.0 * turns], axis=1) * piece.sweep  # of a bar that stands upright
    corners = (piece.corners[:, None] + round_).reshape(-1, 3)
    found = []
    for turn, at in zip(motion.turn.mid[:, piece.joint], motion.at.mid[:, piece.joint], strict=True):
        points = (corners @ piece.pose[0].mid.T + piece.pose[1].mid) @ turn.T + at
        found.append(points[ConvexHull(points[:, :2]).vertices, :2])
    return found


if __name__ == "__main__":
    main()
