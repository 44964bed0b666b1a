"""C that CasADi generates, compiled once, kept on disk, and loaded: by the machine's own compiler, or not at all.

In: the source of some functions. Out: a loaded library; None where there is no compiler, and what needs it has another
way. No verdict rests on it: certificate and proof load none.
"""

from __future__ import annotations

import ctypes
import functools
import importlib.util
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from numpy.typing import NDArray

from hdplan.distance.compiled.cache import cache_dir, content_key, trusted, write_whole
from hdplan.distance.compiled.compile_time import compiling
from hdplan.distance.compiled.loops import C, warn_without_loops
from hdplan.scenes.deadline import check_time, most_seconds

Library = TypeVar("Library")

# None of these changes a value: without the last, machines with a fused multiply-add would round differently. With the
# first two loops run as fast as with -O3, which takes twice as long to compile. No interposition and no errno let the
# smallest helpers of the generated code (fmin, a square) be inlined, which halves the time.
FLAGS: tuple[str, ...] = (
    "-O2",
    "-ftree-vectorize",
    "-std=gnu89",
    "-fno-semantic-interposition",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-shared",
    "-fPIC",
    "-ffp-contract=off",
)


# For whole programs, which are a hundred times as long: half of the compiler's time for code that is as fast, as almost
# all of its work is done in loops.
QUICK_FLAGS = ("-O1", "-ftree-loop-vectorize", "-fno-ivopts")


# CasADi's product of dense matrices, whose innermost sum waits for itself; and the same sums, in the same order, of a
# column at a time, which is a loop for vectors.
WAITING = """\
      for (j=0; j<nrow_x; ++j) {
        for (k=0; k<ncol_x; ++k) {
          z[j + i*nrow_x] += x[j + k*nrow_x] * y[k + i*ncol_x];
        }
      }
"""
BY_COLUMNS = """\
      casadi_real* __restrict column = z + i*nrow_x;
      for (k=0; k<ncol_x; ++k) {
        const casadi_real by = y[k + i*ncol_x];
        for (j=0; j<nrow_x; ++j) column[j] += x[j + k*nrow_x] * by;
      }
"""

# Its smallest helpers (a square, fmin), which QUICK_FLAGS would call for every number of a loop.
HELPERS = re.compile(r"^casadi_real (casadi_\w+\(casadi_real x(?:, casadi_real y)?\) \{)", re.MULTILINE)
INLINED = r"static __inline__ __attribute__((always_inline)) casadi_real \1"


def quicker(source: str) -> str:
    """This C code with loops that run faster, to the same bits."""
    return HELPERS.sub(INLINED, source.replace(WAITING, BY_COLUMNS))


def _cached(home: Path, stem: str, load: Callable[[str], Library]) -> Library | None:
    """Return an intact library of this stem from the disk cache."""
    if not trusted():
        return None
    for found in sorted(home.glob(f"{stem}-*.so")):
        try:
            if found.stem.endswith(content_key(found.read_bytes())):
                return load(str(found))
        except OSError:  # unreadable, of another C library, or where nothing may be executed: ignored
            continue
    return None


@functools.cache
def compiler() -> tuple[str, ...] | None:
    """The C compiler's command: $CC, cc, gcc, clang or the `ziglang` wheel; None if there is none."""
    for name in (os.environ.get("CC"), "cc", "gcc", "clang"):
        if name and shutil.which(name):
            return (name,)
    return (sys.executable, "-m", "ziglang", "cc") if importlib.util.find_spec("ziglang") else None


@functools.cache
def _warn_once() -> None:
    if C is None:
        warn_without_loops()  # which says more
        return
    warnings.warn(
        "no C compiler found (cc, gcc, clang or `pip install ziglang`): functions that CasADi generates are "
        "interpreted, with the same values but about six times slower",
        stacklevel=3,
    )


@functools.cache
def _instructions() -> tuple[str, ...]:
    """Return the flags for this processor's widest vectors, where Linux reports them: loops run up to 1.5 times as
    fast."""
    try:
        found = set(re.findall(r"\bavx2\b|\bavx512vl\b", Path("/proc/cpuinfo").read_text(encoding="utf-8")))
    except OSError:
        return ()
    return tuple(f"-m{name}" for name in sorted(found))


def c_library(name: str, source: str) -> ctypes.CDLL | None:
    """Return the loaded library of a source, as `loaded` does."""
    return loaded(name, source, ctypes.CDLL)


def loaded(name: str, source: str, load: Callable[[str], Library], more: tuple[str, ...] = ()) -> Library | None:
    """Return the result of `load` for the path of a source's library, from the disk cache (keyed by source, flags,
    platform and compiler) or compiled now, with `more` flags; None without a compiler. The file may be gone afterwards.

    A cached file has its own checksum in its name: loading a damaged one would crash the process.
    """
    with compiling():
        return _loaded(name, quicker(source), load, more)


def address(array: NDArray[Any]) -> int:
    """Return the address of a contiguous array's values; for most in a fifth of the time that NumPy takes to tell."""
    if array.flags.writeable and array.size:
        return ctypes.addressof(ctypes.c_char.from_buffer(array.data))
    return int(array.__array_interface__["data"][0])


def _loaded(name: str, source: str, load: Callable[[str], Library], more: tuple[str, ...]) -> Library | None:
    flags = (*FLAGS, *_instructions(), *more)
    home, stem = cache_dir() / "compiled", f"{name}-{content_key(source, *flags, platform.machine(), sys.platform)}"
    command = compiler()
    if command is None:
        _warn_once()
        return None
    stem = f"{stem}-{content_key(*command)}"
    if found := _cached(home, stem, load):
        return found
    try:
        with tempfile.TemporaryDirectory() as folder:
            text, built = Path(folder) / "function.c", Path(folder) / "function.so"
            text.write_text(source)
            build = [*command, *flags, str(text), "-o", str(built), "-lm"]
            try:
                outcome = subprocess.run(build, capture_output=True, text=True, timeout=most_seconds())
            except subprocess.TimeoutExpired:
                check_time("compiling the distance")
                raise
            if outcome.returncode:
                reason = outcome.stderr.strip().splitlines()[-1:]
                warnings.warn(f"{command[0]} failed on {name}: {reason}; interpreting", stacklevel=2)
                return None
            data = built.read_bytes()
            write_whole(home / f"{stem}-{content_key(data)}.so", data)
            return load(str(built))  # stays loaded after its file is deleted
    except OSError as error:  # a full disk, or a folder from which nothing may be executed
        warnings.warn(f"nowhere to compile {name} ({error}); interpreting", stacklevel=2)
        return None
