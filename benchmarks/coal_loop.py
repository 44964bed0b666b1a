"""coal in a C++ loop (`coal_loop.cpp`), built where a C++ compiler is: against the library and headers of pin's wheels.

Where something is missing, `build` names it, and the benchmark leaves the loop out.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import casadi
import coal
import numpy as np

from hdplan.distance.baselines.surface import triangles
from hdplan.distance.bodies import ConvexBody
from hdplan.scenes.array_types import Array

SOURCE = Path(__file__).with_name("coal_loop.cpp")


def build(folder: Path) -> tuple[Path | None, str]:
    """Return the program, or None and why there is none."""
    names = (os.environ.get("CXX"), "c++", "g++", "clang++")
    compiler = next((name for name in names if name and shutil.which(name)), "")
    if not compiler:
        return None, "no C++ compiler (c++, g++, clang++)"
    prefix = next((path for path in Path(coal.__file__).parents if (path / "include/coal/distance.h").exists()), None)
    places = (Path(casadi.__file__).parent / "include" / "eigen3", Path("/usr/include/eigen3"))
    eigen = next((path for path in places if path.exists()), None)
    if prefix is None or eigen is None:
        return None, f"no headers of {'coal' if prefix is None else 'Eigen'}"
    program = folder / "coal_loop"
    includes = [f"-I{prefix / 'include'}", f"-I{eigen}"]
    library = [f"-L{prefix / 'lib'}", "-lcoal", f"-Wl,-rpath,{prefix / 'lib'}"]
    command = [compiler, "-O3", "-std=c++17", *includes, str(SOURCE), "-o", str(program), *library]
    outcome = subprocess.run(command, capture_output=True, text=True)
    if outcome.returncode:
        return None, f"{compiler} failed: {outcome.stderr.strip().splitlines()[-1]}"
    return program, ""


class CoalLoop:
    """Two bodies at many poses, for the program."""

    def __init__(self, program: Path, body_a: ConvexBody, a: Array, body_b: ConvexBody, b: Array) -> None:
        """Write the program's input beside it."""
        self._program, self._file = program, program.with_name("poses.bin")
        parts: list[Array] = []
        for body in (body_a, body_b):
            faces = triangles(body).astype(float)
            parts += [np.array([len(body.vertices), len(faces)], float), body.vertices.ravel(), faces.ravel()]
        rows = [part.reshape(len(a), -1) for x in (a, b) for part in (x[:, :3, :3], x[:, :3, 3])]
        np.concatenate([*parts, [len(a)], np.hstack(rows).ravel()]).tofile(self._file)

    def seconds(self) -> tuple[float, float]:
        """Return the processor time of a query [s] in a round that follows another, and the mean distance [m]."""
        command = [str(self._program), str(self._file), "2"]
        out = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        taken, total = map(float, out.splitlines()[-1].split())
        return taken, total
