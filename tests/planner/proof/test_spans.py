"""Laws of the fast bounds in the search for planes: they equal the kernel's, but for rounding."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import hdplan
from hdplan.planner.certificate import interval_bounds
from hdplan.planner.certificate.interval_bounds import Items
from hdplan.planner.proof.planes import Planes, unit
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.yaml_format.reader import find_scene
from hdplan.verify.kernel import Motion
from tests.loops import in_numpy
from tests.planner.proof.worlds import read


@pytest.mark.parametrize("scene", ["panda_cage", "panda_conveyor", "planar_arm", "panda_corridor"])
def test_spans_equal_the_kernels(scene: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Spans of any length lie within a row or over many, of lines and of timed curves, with what moves around."""
    setup = Setup.of(hdplan.load_scene(scene))
    rng = np.random.default_rng(0)
    ends = np.stack([setup.query.start, setup.query.goal])
    rows = np.concatenate([ends[:1], rng.uniform(*np.sort(ends, axis=0), (3, setup.robot.n)), ends[1:]])
    times = np.arange(5.0) if setup.scene.timed else None
    rates = rng.normal(size=rows.shape) if setup.scene.timed else None
    motion = hdplan.Trajectory(setup.robot.joint_names, rows, dict(setup.robot.locked), times, rates)
    motion.save(tmp_path / "m.json")
    world = read(find_scene(scene), tmp_path / "m.json")
    count, planes = len(world.control.mid), Planes(world)
    low = rng.uniform(0, count, 40)
    high = np.minimum(low + count * 10.0 ** rng.uniform(-5, 0, 40), count)
    node, pair = rng.integers(40, size=400), rng.integers(len(world.pairs), size=400)
    normal = np.rint(1e3 * rng.normal(size=(400, 3)))
    nodes, slow = planes.spans.on(low, high), Motion(world, np.stack([low, high], axis=1))
    items = Items(node, pair, np.full(400, -np.inf), normal)
    found = planes.spans.bounds.by_plane(nodes, items, unit(normal))[1]
    kernel = slow.gaps(node, world.pairs[pair], normal)
    kernel = np.where(kernel < 0, kernel / 2, kernel)  # what does not suffice is not computed closely
    assert np.abs(found - kernel).max() < 1e-8
    in_numpy(monkeypatch, interval_bounds)  # without loops of C
    assert np.abs(planes.spans.bounds.by_plane(nodes, items, unit(normal))[1] - found).max() < 1e-10
