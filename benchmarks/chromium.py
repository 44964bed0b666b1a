"""A browser without a screen, driven by playwright, for benchmarks of the viewer."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from hdplan.planner.page.browser import find_browser

SELDOM = """{  // pictures, 5 a second; each is cancelled by its own number, as another's would end the page's drawing
  const request = requestAnimationFrame, cancel = cancelAnimationFrame, frames = new Map();
  requestAnimationFrame = (draw) => {
    const number = setTimeout(() => frames.set(number, request((now) => { frames.delete(number); draw(now); })), 200);
    return number;
  };
  cancelAnimationFrame = (number) => { clearTimeout(number); cancel(frames.get(number)); frames.delete(number); };
}"""
SOFTWARE = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


@contextmanager
def browser() -> Iterator[Any]:
    """Start the browser that is there; without one, or without playwright, the program ends."""
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        sys.exit("a page needs playwright: pip install playwright")
    program = find_browser()
    if program is None:
        sys.exit("a page needs chromium")
    with sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=program, args=SOFTWARE)
        yield found
        found.close()
