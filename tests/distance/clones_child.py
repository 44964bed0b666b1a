"""Prints a digest of what the loops of C write, those of a file if one is given, at motions in contact."""

import hashlib
import importlib.util
import sys

import numpy as np

if len(sys.argv) > 1:
    spec = importlib.util.spec_from_file_location("hdplan._loops", sys.argv[1])
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    sys.modules["hdplan._loops"] = module

from hdplan.distance.compiled.loops import C
from hdplan.planner.build import build
from hdplan.planner.solvers.newton_step import newton_step
from hdplan.scenes.yaml_format.reader import load_scene

digest = hashlib.sha256()
for name in ("panda_corridor", "planar_arm"):  # obstacles of few planes, and of many
    problem, rng = build(load_scene(name)), np.random.default_rng(7)
    for share in (0.0, 0.2, 0.6):
        line = problem.polyline()
        motion = problem.clip(line + share * rng.normal(size=line.shape))
        state = problem.evaluate(motion, 1e4)
        step = newton_step(problem, motion, state, 1e-3)
        for part in (state.cost, state.gradient, state.diagonal, state.coupling, state.depth, step):
            digest.update(np.asarray(part).tobytes())
print(getattr(C, "__file__", None), digest.hexdigest())
