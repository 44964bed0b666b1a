"""Libraries of the optional extras: tests are skipped without one, and collecting them does not import it."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import pytest

from hdplan.scenes.lazy_imports import LazyModule

jax: Any = LazyModule("jax")
mujoco: Any = LazyModule("mujoco")


def needs(library: str) -> pytest.MarkDecorator:
    return pytest.mark.skipif(find_spec(library) is None, reason=f"{library} is not installed")


def quick_jit(function: Callable[..., Any]) -> Any:
    """JAX's jit of a function, quick to compile and not to run."""
    return jax.jit(function, compiler_options={"xla_backend_optimization_level": 0})
