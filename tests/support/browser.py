"""Runs a page in Chromium without a display, to get answers that need an engine's own code."""

from __future__ import annotations

import json
import queue
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

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
    with _serving(handler) as address, _browser(f"{address}/{page}", drawn_by) as browser:
        answer = json.loads(_first(answers, browser, patience))
    if "error" in answer:
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


@contextmanager
def _serving(handler: Any) -> Iterator[str]:
    """Run a server during the block; yield its address."""
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()


@contextmanager
def _browser(address: str, drawn_by: Sequence[str]) -> Iterator[subprocess.Popen[bytes]]:
    """Run Chromium at `address` during the block, with a temporary profile."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [*CHROMIUM, *drawn_by, f"--user-data-dir={profile}", address]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as browser:
            try:
                yield browser
            finally:
                _end(browser)


def _end(browser: subprocess.Popen[bytes]) -> None:
    browser.terminate()
    try:
        browser.wait(timeout=10.0)
    except subprocess.TimeoutExpired:
        browser.kill()
