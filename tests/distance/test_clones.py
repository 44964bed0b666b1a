"""The loops have the same bits on every processor: built without clones for three generations of x86-64, they write
what the clones write that this processor runs."""

from __future__ import annotations

import platform
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from hdplan.distance.compiled.loops import C

ROOT = Path(__file__).parents[2]
# As in `hatch_build.py`, but for the clones.
FLAGS = ("-std=c11", "-O2", "-ftree-vectorize", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=off")
NEEDED = {"x86-64": "sse2", "x86-64-v3": "avx2", "x86-64-v4": "avx512vl"}  # what Linux calls the instructions

pytestmark = [
    pytest.mark.slow,  # compiles
    pytest.mark.skipif(C is None or not shutil.which("gcc"), reason="no C compiler"),
    pytest.mark.skipif(sys.platform != "linux" or platform.machine() != "x86_64", reason="another kind of processor"),
]


def built_for(generation: str, folder: Path) -> Path:
    """The loops without clones, for one generation of processors."""
    if NEEDED[generation] not in Path("/proc/cpuinfo").read_text(encoding="utf-8"):
        pytest.skip(f"this processor is no {generation}")
    sources = [*(ROOT / "src/hdplan").glob("*.c"), *ROOT.glob("distance/**/*.c"), *ROOT.glob("planner/**/*.c")]
    into = folder / "_loops.abi3.so"
    flags = (*FLAGS, f"-march={generation}", "-DHDPLAN_NO_CLONES", "-shared", "-fPIC")
    include = f"-I{sysconfig.get_paths()['include']}"
    subprocess.run(["gcc", *flags, include, *map(str, sources), "-o", str(into), "-lm"], check=True)
    return into


def written_by(*file: Path) -> tuple[str, str]:
    """The file of the loops, and a digest of what they write."""
    child = [sys.executable, str(Path(__file__).with_name("clones_child.py")), *map(str, file)]
    loops, digest = subprocess.run(child, check=True, capture_output=True, text=True).stdout.split()
    return loops, digest


@pytest.mark.parametrize("generation", NEEDED)
def test_same_bits(generation: str, tmp_path: Path) -> None:
    file = built_for(generation, tmp_path)
    (own, expected), (other, found) = written_by(), written_by(file)
    assert own != other == str(file)
    assert found == expected
