"""Keeps viser's own messages out of the output stream, which belongs to the command's results."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Drop what is printed within."""
    with contextlib.redirect_stdout(io.StringIO()):
        yield
