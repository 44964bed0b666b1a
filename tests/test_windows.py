"""Nothing that is imported, and no plan, calls what Windows lacks: a process without all of it, on any system.

That no other line does either is mypy's word, `mypy --platform win32` in .ci/run. Windows itself is not tried.
"""

from __future__ import annotations

import subprocess
import sys

MODULES = ("fcntl", "grp", "pwd", "pty", "resource", "syslog", "termios", "tty")
NAMES = {  # what Python's own modules do not look up again once they are loaded
    "os": (
        *("fork", "forkpty", "geteuid", "getgid", "getpgid", "getuid", "killpg", "mkfifo", "pread", "pwrite"),
        *("register_at_fork", "sched_getaffinity", "setsid", "sysconf", "uname", "O_CLOEXEC", "O_NONBLOCK"),
    ),
    "signal": ("ITIMER_REAL", "SIGALRM", "SIGHUP", "SIGKILL", "SIGQUIT", "alarm", "pause", "setitimer", "sigwait"),
}
OPTIONAL = (  # left out: they look at the system themselves
    *("jax", "distributed", "pyarrow", "viser", "matplotlib", "mcap", "av", "fcl", "flint", "mpmath", "uaibot"),
    *("dask", "PIL", "laspy", "pypcd4", "xacro", "IPython"),
)
CODE = f"""
import asyncio, concurrent.futures, ctypes, logging, multiprocessing, pathlib, platform, random, shutil, socket
import subprocess, tarfile, tempfile, threading, urllib.request, uuid, webbrowser, zipfile
import signal, os, sys, importlib, pkgutil, types
import numpy, casadi, pinocchio, coal, trimesh, scipy.spatial, scipy.optimize, rich.console, typer, platformdirs

for name in {MODULES + OPTIONAL}:
    sys.modules[name] = None
for module, names in {NAMES}.items():
    for name in names:
        delattr(sys.modules[module], name)
sys.platform = "win32"

import hdplan

lost = []
def walk(package):
    for found in pkgutil.iter_modules(package.__path__, package.__name__ + "."):
        try:
            module = importlib.import_module(found.name)
        except ImportError as error:
            if (error.name or "").partition(".")[0] not in {OPTIONAL}:
                lost.append((found.name, str(error)))
        else:
            if found.ispkg:
                walk(module)
for name in ("scenes", "distance", "planner", "verify"):
    walk(importlib.import_module("hdplan." + name))
print(len([name for name in sys.modules if name.startswith("hdplan.")]), lost)
from hdplan import cli
sys.argv = ["hdplan", "plan", "panda_cage"]
cli.main()
"""


def test_without_what_windows_lacks_all_is_imported_and_a_plan_is_made() -> None:
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True)
    first, _, rest = done.stdout.partition("\n")
    count, _, lost = first.partition(" ")
    assert lost == "[]", done.stderr[-2000:]
    assert int(count) > 300
    assert (done.returncode, rest.split(":")[0]) == (0, "certified"), done.stderr[-2000:]
