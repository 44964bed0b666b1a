"""What a browser sends, without one."""

from __future__ import annotations

import asyncio
import inspect
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any


def heard(handle: Any, value: object, client: object = None) -> None:
    """Have a browser send a value of an input, and viser tell of it."""
    handle._impl.value = value
    for callback in handle._impl.update_cb:
        answer = callback(SimpleNamespace(client=client or object(), client_id=1, target=handle))
        if inspect.iscoroutine(answer):
            with ThreadPoolExecutor(1) as elsewhere:  # a browser's test may leave a loop running in this thread
                elsewhere.submit(asyncio.run, answer).result()
