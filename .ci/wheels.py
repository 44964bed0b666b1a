"""Builds hdplan's wheels for all systems on one Linux machine, with zig as the C compiler.

    python .ci/wheels.py FOLDER [PLATFORM ...]

It needs `ziglang`, `abi3info`, `build` and what pyproject.toml builds with. `.ci/release` checks the wheels, and tries
those that this machine can run. What is for other systems has been compiled, not tried: a maintainer starts
cibuildwheel there (`[tool.cibuildwheel]` in pyproject.toml).
"""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import tempfile
from dataclasses import dataclass
from pathlib import Path

import abi3info

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from hatch_build import FLAGS, HIDDEN, sources  # noqa: E402


@dataclass(frozen=True)
class Target:
    """A system for which loops are compiled."""

    name: str  # as zig has it
    flags: tuple[str, ...] = ("-shared", "-fPIC")
    binary: str = "_loops.abi3.so"


MAC = ("-shared", "-fPIC", "-Wl,-undefined,dynamic_lookup")  # Python's functions are those of the process
PLATFORMS = {
    "manylinux_2_17_x86_64": Target("x86_64-linux-gnu.2.17"),
    "manylinux_2_17_aarch64": Target("aarch64-linux-gnu.2.17"),
    "macosx_11_0_arm64": Target("aarch64-macos.11.0", MAC),
    "macosx_11_0_x86_64": Target("x86_64-macos.11.0", MAC),
    "win_amd64": Target("x86_64-windows-gnu", ("-shared",), "_loops.pyd"),
}
# What Python's pyconfig.h says on 64-bit Windows, as far as its stable interface asks.
WINDOWS = """\
#define MS_WINDOWS
#define MS_WIN64
#define SIZEOF_VOID_P 8
#define SIZEOF_SIZE_T 8
#define SIZEOF_INT 4
#define SIZEOF_LONG 4
#define SIZEOF_LONG_LONG 8
#define SIZEOF_WCHAR_T 2
#define HAVE_DECLSPEC_DLL
#define Py_ENABLE_SHARED
typedef long long Py_ssize_t;
#define HAVE_PY_SSIZE_T
#define PY_SSIZE_T_MAX 0x7fffffffffffffffLL
"""


def zig(*arguments: str) -> None:
    """Run zig. Raises CalledProcessError if it fails."""
    subprocess.run([sys.executable, "-m", "ziglang", *arguments], cwd=ROOT, check=True)


def loops(platform: str, folder: Path) -> Path:
    """Compile the loops for a system, into a folder."""
    target, built = PLATFORMS[platform], folder / PLATFORMS[platform].binary
    include = [f"-I{sysconfig.get_path('include')}"]
    links = []
    if platform.startswith("win"):
        (folder / "pyconfig.h").write_text(WINDOWS, encoding="utf-8")
        include = [f"-I{folder}", f"-I{copied_headers(folder)}"]
        links = [str(stable_interface(folder))]
    flags = ["-target", target.name, *target.flags, *FLAGS, *HIDDEN, "-s"]
    zig("cc", *flags, *include, *sources(ROOT), *links, "-o", str(built))
    return built


def copied_headers(folder: Path) -> Path:
    """Return Python's headers without its pyconfig.h, which is of this system."""
    headers = folder / "headers"
    for path in Path(sysconfig.get_path("include")).rglob("*.h"):
        if path.name != "pyconfig.h":
            place = headers / path.relative_to(sysconfig.get_path("include"))
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(path.read_bytes())
    return headers


def stable_interface(folder: Path) -> Path:
    """Make the library that stands for python3.dll when the loops are linked: all names of the stable interface."""
    names = [each.name for each in abi3info.FUNCTIONS] + [f"{each.name} DATA" for each in abi3info.DATAS]
    (folder / "python3.def").write_text("\n".join(["LIBRARY python3.dll", "EXPORTS", *names, ""]), encoding="utf-8")
    zig("dlltool", "-m", "i386:x86-64", "-d", str(folder / "python3.def"), "-l", str(folder / "python3.lib"))
    return folder / "python3.lib"


def main(into: str, *platforms: str) -> None:
    """Build the wheels of these platforms, or of all."""
    for platform in platforms or PLATFORMS:
        with tempfile.TemporaryDirectory() as folder:
            env = {**os.environ, "HDPLAN_LOOPS": str(loops(platform, Path(folder))), "HDPLAN_PLATFORM": platform}
            command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", into, str(ROOT)]
            subprocess.run(command, env=env, check=True, stdout=subprocess.DEVNULL)


if __name__ == "__main__":
    main(*sys.argv[1:])
