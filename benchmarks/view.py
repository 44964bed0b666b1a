"""How fast `hdplan view` follows its slider, measured on the server: python benchmarks/view.py [SCENE ...]

For each scene: the time until it is served (meshes read and smoothed, the first time in a process), the time of one
frame (kinematics, closest pair, panels, all messages; no browser is connected), and frames a second.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from hdplan.planner.plan import plan
from hdplan.planner.view.server import open_viewer
from hdplan.scenes.yaml_format.reader import load_scene

FRAMES = 200


def main(names: list[str]) -> None:
    print("| scene | until served [s] | frame median / p95 [ms] | frames a second |")
    print("|---|---|---|---|")
    for name in names or ["panda_cage", "panda_table_pick", "ur5_table"]:
        scene = load_scene(name)
        trajectory = plan(scene).trajectory
        began = time.perf_counter()
        viewer = open_viewer(scene, [("found", trajectory)], port=8380)
        served = time.perf_counter() - began
        spent = []
        for now in np.linspace(0.0, 1.0, FRAMES).round(3).tolist():
            before = time.perf_counter()
            viewer.show(now)
            spent.append(time.perf_counter() - before)
        viewer.close()
        median, p95 = np.percentile(spent, [50, 95])
        print(f"| {name} | {served:.1f} | {1e3 * median:.1f} / {1e3 * p95:.1f} | {FRAMES / sum(spent):.0f} |")


if __name__ == "__main__":
    main(sys.argv[1:])
