"""The viewer from Python: serve two motions side by side, and write them as one page that needs no server."""

from pathlib import Path

import hdplan
from hdplan.planner.view.server import open_viewer

scene = hdplan.load_scene("planar_arm")
motions = [(solver, hdplan.plan(scene, solver=solver).trajectory) for solver in ("gauss_newton", "chomp")]

viewer = open_viewer(scene, motions)  # on this machine alone; the next free port if 8080 is taken
try:
    print(f"{scene.name} at {viewer.address()}")
    viewer.record(Path("show_it.html"))  # opens in any browser, without a server
    # Your program continues here; the viewer serves until it is closed.
finally:
    viewer.close()
print(f"show_it.html: {Path('show_it.html').stat().st_size / 1e6:.1f} MB")
