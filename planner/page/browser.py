"""A browser without a screen that shows pages and is photographed: Chrome or Chromium, through a pipe.

It is driven by the DevTools protocol: JSON messages that end with a zero byte, on file descriptors 3 and 4.
Nothing is fetched, and no port is opened.
"""

from __future__ import annotations

import base64
import contextlib
import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import Any

from hdplan.planner.html_page import HtmlPage
from hdplan.scenes.errors import HdplanError

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge")
MAC = "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome"
OPTIONS = (
    *("--headless", "--remote-debugging-pipe", "--no-first-run", "--disable-extensions", "--hide-scrollbars"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),  # draws without a graphics card
)
AS_3_AND_4 = (
    "import os, sys; [os.dup2(int(own), number) for own, number in zip(sys.argv[1:3], (3, 4))];"
    "os.execv(sys.argv[3], sys.argv[3:])"
)
PATIENCE = 60.0  # [s] for an answer
QUALITY = 92  # of the photographs, of 100


class BrowserError(HdplanError):
    """A browser that does not obey."""


def find_browser() -> str | None:
    """Return a browser's program, if one is installed that can be driven."""
    if sys.platform == "win32":  # it has no such pipes
        return None
    return next(filter(None, map(shutil.which, (*NAMES, MAC))), None)


class Browser:
    """A browser that shows a page at a time; for a `with` block."""

    def __init__(self, program: str) -> None:
        """Take the program."""
        self._program = program
        self._stack = contextlib.ExitStack()
        self._answers = b""
        self._read, self._write = -1, -1  # pipes
        self._count = 0

    def __enter__(self) -> Browser:
        """Start it. Raises BrowserError if that fails."""
        with contextlib.ExitStack() as stack:
            self._folder = Path(stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True)))
            self._start(stack, self._folder)
            target = self._call("Target.createTarget", url="about:blank")["targetId"]
            self._session = self._call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
            self._stack = stack.pop_all()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """End it."""
        self._stack.close()

    def show(self, page: HtmlPage, size: tuple[int, int]) -> None:
        """Show a page in a window of a size [px], and wait until it is drawn. Raises BrowserError if that fails."""
        file = self._folder / f"page{self._count}.html"
        file.write_text(page.html, encoding="utf-8")
        width, height = size
        self._call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self._call("Page.navigate", url=f"{file.as_uri()}#film")
        until = time.monotonic() + PATIENCE
        while not self.run(f"location.pathname.endsWith({json.dumps(file.name)}) && Boolean(window.page)"):
            if time.monotonic() > until:
                raise BrowserError("the page was not drawn")
            time.sleep(0.1)

    def run(self, script: str) -> Any:
        """Run a script in the page, and return its value. Raises BrowserError."""
        answer = self._call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise BrowserError(f"the page failed: {answer['exceptionDetails'].get('text')}")
        return answer["result"].get("value")

    def photograph(self) -> bytes:
        """Return the page as it is shown, as JPEG. Raises BrowserError."""
        return base64.b64decode(self._call("Page.captureScreenshot", format="jpeg", quality=QUALITY)["data"])

    def _start(self, stack: contextlib.ExitStack, folder: Path) -> None:
        if sys.platform == "win32":
            raise BrowserError(f"{self._program}: cannot be driven on Windows")
        import fcntl

        ours, theirs = [], []
        for end in (0, 1):  # it reads from the first pipe, and writes to the second one
            pipe = os.pipe()
            theirs.append(fcntl.fcntl(pipe[end], fcntl.F_DUPFD_CLOEXEC, 10))  # out of the way of 3 and 4
            os.close(pipe[end])
            ours.append(pipe[1 - end])
        self._write, self._read = ours
        for descriptor in ours:
            stack.callback(os.close, descriptor)
        options = [*OPTIONS, f"--user-data-dir={folder / 'profile'}"]
        if os.geteuid() == 0:  # for which it has no sandbox
            options.append("--no-sandbox")
        try:
            process = subprocess.Popen(
                [sys.executable, "-S", "-c", AS_3_AND_4, *map(str, theirs), self._program, *options],
                pass_fds=theirs,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        except OSError as error:
            raise BrowserError(f"{self._program}: {error.strerror}") from None
        finally:
            for descriptor in theirs:
                os.close(descriptor)
        stack.callback(_end, process)

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command and return the answer."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if hasattr(self, "_session"):
            message["sessionId"] = self._session
        data = json.dumps(message).encode() + b"\0"
        try:
            while data:
                data = data[os.write(self._write, data) :]
        except OSError:
            raise BrowserError(f"{self._program} has ended") from None
        until = time.monotonic() + PATIENCE
        while True:
            answer = self._answer(until)
            if answer.get("id") == self._count:
                if "error" in answer:
                    raise BrowserError(f"{self._program}: {method}: {answer['error'].get('message')}")
                result: dict[str, Any] = answer["result"]
                return result

    def _answer(self, until: float) -> dict[str, Any]:
        """Return the next message: an answer, or what it reports by itself."""
        while b"\0" not in self._answers:
            ready, _, _ = select.select([self._read], [], [], max(until - time.monotonic(), 0.0))
            if not ready:
                raise BrowserError(f"{self._program} does not answer")
            data = os.read(self._read, 1 << 20)
            if not data:
                raise BrowserError(f"{self._program} has ended")
            self._answers += data
        message, _, self._answers = self._answers.partition(b"\0")
        answer: dict[str, Any] = json.loads(message)
        return answer


def _end(process: subprocess.Popen[bytes]) -> None:
    """End it, at once if need be."""
    process.terminate()
    try:
        process.wait(timeout=5.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
