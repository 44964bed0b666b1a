"""Builds the loops of C, `hdplan._loops`, into the wheel, or into src/hdplan for an editable install.

Without a C compiler, or where one fails, hdplan is installed without them, and says so when it runs.
"""

from __future__ import annotations

import os
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

SOURCES = ("src/hdplan", "distance", "planner")
# None of these changes a value: with fused products, machines that have them would round differently.
FLAGS = ("-std=c11", "-O2", "-g0", "-ftree-vectorize", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=off")
HIDDEN = ("-fvisibility=hidden",)


class LoopsHook(BuildHookInterface[Any]):
    """Compiles before a wheel is made; what it makes is the same for Python 3.11 and all later ones.

    HDPLAN_BUILD_LOOPS=0 leaves the loops out; HDPLAN_LOOPS and HDPLAN_PLATFORM name a file that holds them already, and
    whose they are (`.ci/wheels.py`).
    """

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and tell the wheel what was made."""
        root, editable = Path(self.root), version == "editable"
        if not editable:
            build_data["force_include"][str(root / "cli.py")] = "hdplan/cli.py"
        if os.environ.get("HDPLAN_BUILD_LOOPS") == "0":
            return
        ready = os.environ.get("HDPLAN_LOOPS")
        built = Path(ready) if ready else compiled(root, root / "src/hdplan" if editable else None)
        if built is None:
            return
        platform = os.environ.get("HDPLAN_PLATFORM") or sysconfig.get_platform()
        build_data["pure_python"] = False
        build_data["tag"] = f"cp311-abi3-{platform.replace('-', '_').replace('.', '_')}"
        if not editable:
            build_data["force_include"][str(built)] = f"hdplan/{built.name}"


def sources(root: Path) -> list[str]:
    """The files of C, from the checkout's top."""
    return sorted(path.relative_to(root).as_posix() for each in SOURCES for path in (root / each).rglob("*.c"))


def compiled(root: Path, into: Path | None = None) -> Path | None:
    """Compile the loops into a folder, by default a temporary one; None, and a line that says why, without a
    compiler."""
    from setuptools import Distribution, Extension
    from setuptools.command.build_ext import build_ext

    os.chdir(root)
    msvc = sys.platform == "win32" and "CC" not in os.environ
    flags = ["/O2", "/std:c11", "/fp:precise"] if msvc else [*FLAGS, *HIDDEN]
    extension = Extension("_loops", sources(root), extra_compile_args=flags, py_limited_api=True)
    command = build_ext(Distribution({"ext_modules": [extension]}))
    folder = Path(tempfile.mkdtemp(prefix="hdplan-"))
    command.build_temp, command.build_lib, command.verbose = str(folder / "objects"), str(into or folder), False
    try:
        command.ensure_finalized()
        command.run()
    except Exception as error:  # what the compiler, or the lack of one, says
        print(f"hdplan: built without its loops of C, so plans take 10 to 30 times as long: {error}", file=sys.stderr)
        return None
    return Path(command.get_ext_fullpath("_loops"))


if __name__ == "__main__":  # into src/hdplan, after a change of C
    sys.exit(compiled(Path(__file__).parent, Path(__file__).parent / "src/hdplan") is None)
