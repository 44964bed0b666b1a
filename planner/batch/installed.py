"""The packages that many problems need beside one: dask for the workers, pyarrow for the tables."""

from __future__ import annotations

import importlib.util

from hdplan.scenes.errors import InputError


def check_installed() -> None:
    """Raise InputError, saying what to install, if one of both is missing."""
    for name in ("distributed", "pyarrow"):
        if importlib.util.find_spec(name) is None:
            raise InputError(f"many problems need {name}, which is not installed: pip install distributed pyarrow")
