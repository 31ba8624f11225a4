"""Runs pages in Chromium without a display, to get answers that need an engine's own code.

A process starts Chromium once for all its pages. A page that does not answer ends it, and the next page starts another.
"""

from __future__ import annotations

import atexit
import ctypes
import json
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import quote
from urllib.request import Request, urlopen

ROOT = Path(__file__).resolve().parents[2]
FILES = "/files/"

# No sandbox, because root has none; the page is our own.
CHROMIUM = [
    *("chromium", "--headless", "--no-sandbox", "--disable-gpu-sandbox", "--disable-dev-shm-usage"),
    *("--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--disable-quic", "--remote-debugging-port=0", "--use-gl=angle", "--enable-unsafe-webgpu"),
]
PROCESSOR = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--use-webgpu-adapter=swiftshader")
"""SwiftShader needs no graphics card and renders the same everywhere."""
CARD = ("--use-angle=gl-egl", "--ignore-gpu-blocklist")
"""The graphics card by EGL, which needs no display. By Vulkan an NVIDIA H100 lost its context in the first picture."""
START = 100.0
"""Maximum seconds until Chromium has started, or opened a page."""


class BrowserError(Exception):
    """The page failed, or did not answer in time. The message is one line, then the page's stack if any."""


class _Handler(SimpleHTTPRequestHandler):
    """HTTP handler that serves the repository, `files` under `FILES` and the question, and receives the answer."""

    def __init__(
        self, *args: Any, question: bytes, answers: queue.Queue[bytes], files: Path | None, **more: Any
    ) -> None:
        self.question, self.answers, self.files = question, answers, files
        super().__init__(*args, directory=str(ROOT), **more)

    def translate_path(self, path: str) -> str:
        if self.files is None or not path.startswith(FILES):
            return super().translate_path(path)
        self.directory = str(self.files)
        return super().translate_path(path.removeprefix(FILES[:-1]))

    def do_GET(self) -> None:
        if self.path != "/question":
            super().do_GET()
            return
        self.send_response(200)
        self.send_header("Content-Length", str(len(self.question)))
        self.end_headers()
        self.wfile.write(self.question)

    def do_POST(self) -> None:
        self.answers.put(self.rfile.read(int(self.headers["Content-Length"])))
        self.send_response(204)
        self.end_headers()

    def end_headers(self) -> None:
        """Keep nothing: other pages have other files at the same address."""
        self.send_header("Cache-Control", "no-store")
        super().end_headers()

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing."""


def ask(
    page: str, question: object, *, patience: float, files: Path | None = None, drawn_by: Sequence[str] = PROCESSOR
) -> Any:
    """Open `page`, a path in the repository, and return the JSON that it posts to /answer.

    The page reads `question` (JSON) from /question and the folder `files` under `FILES`. `drawn_by`: `PROCESSOR` or
    `CARD`. Raises `BrowserError` for an answer {"error": …}, and if there is no answer within `patience` seconds.
    """
    answers: queue.Queue[bytes] = queue.Queue()
    handler = partial(_Handler, question=json.dumps(question).encode(), answers=answers, files=files)
    browser = _started(tuple(drawn_by))
    try:
        with _serving(handler) as address, browser.opened(f"{address}/{page}"):
            answer = json.loads(_first(answers, browser.process, patience))
    except BaseException:
        browser.end()
        raise
    if "error" in answer:
        browser.end()  # Perhaps it has lost its graphics, and would draw no other page.
        raise BrowserError(f"{page} failed: {answer['error']}")
    return answer


def _first(answers: queue.Queue[bytes], browser: subprocess.Popen[bytes], patience: float) -> bytes:
    end = time.monotonic() + patience
    while time.monotonic() < end:
        try:
            return answers.get(timeout=1.0)
        except queue.Empty:
            if browser.poll() is not None:
                raise BrowserError(f"chromium ended with status {browser.returncode}") from None
    raise BrowserError(f"the page did not answer within {patience:.0f} s")


def _end_with_parent() -> None:
    """Let the system end this process when its parent is killed."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGTERM)  # PR_SET_PDEATHSIG


class _Browser:
    """A Chromium with a temporary profile. Its pages are opened and closed by the HTTP side of DevTools."""

    def __init__(self, drawn_by: Sequence[str]) -> None:
        self._profile = tempfile.TemporaryDirectory(prefix="leafcloud-chromium-", ignore_cleanup_errors=True)
        command = [*CHROMIUM, *drawn_by, f"--user-data-dir={self._profile.name}", "about:blank"]
        self.process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, preexec_fn=_end_with_parent
        )
        self._port = self._wait_for_port()

    def _wait_for_port(self) -> int:
        told, end = Path(self._profile.name) / "DevToolsActivePort", time.monotonic() + START
        while time.monotonic() < end and self.process.poll() is None:
            lines = told.read_text().splitlines() if told.exists() else []
            if len(lines) == 2:  # The port, and the address of the whole browser.
                return int(lines[0])
            time.sleep(0.02)
        self.end()
        raise BrowserError(f"chromium did not start within {START:.0f} s")

    @contextmanager
    def opened(self, address: str) -> Iterator[None]:
        """Show a page during the block."""
        page = json.loads(self._ask("PUT", f"new?{quote(address, safe='')}"))
        yield
        self._ask("GET", f"close/{page['id']}")

    def _ask(self, method: str, path: str) -> bytes:
        request = Request(f"http://127.0.0.1:{self._port}/json/{path}", method=method)
        with urlopen(request, timeout=START) as answer:
            return bytes(answer.read())

    def end(self) -> None:
        self.process.terminate()
        try:
            self.process.wait(timeout=10.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._profile.cleanup()


_browsers: dict[tuple[str, ...], _Browser] = {}


def _started(drawn_by: tuple[str, ...]) -> _Browser:
    """Return the running browser of this process."""
    known = _browsers.get(drawn_by)
    if known is None or known.process.poll() is not None:
        known = _browsers[drawn_by] = _Browser(drawn_by)
    return known


@atexit.register
def _end_all() -> None:
    for browser in _browsers.values():
        browser.end()


@contextmanager
def _serving(handler: Any) -> Iterator[str]:
    """Run a server during the block; yield its address."""
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()
