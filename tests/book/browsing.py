"""What the tests of a built book in a browser share."""

import functools
import http.server
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

HEIGHT = "document.documentElement.scrollHeight"
TALLEST = 20_000
"""Pixels of a page of a notebook, on a wide screen."""


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: Any) -> None:
        """Say nothing."""


@contextmanager
def served(html: Path) -> Iterator[str]:
    """A built book on a local web server; its address."""
    handler = functools.partial(_Quiet, directory=str(html))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


class Tab:
    """A browser tab that records what it asks for and what goes wrong."""

    def __init__(self, browser: Any, site: str, **options: Any) -> None:
        self.site = site
        self.context = browser.new_context(**{"reduced_motion": "reduce", **options})
        self.page = self.context.new_page()
        self.asked: list[str] = []
        self.errors: list[str] = []
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", self._note)

    def _note(self, message: Any) -> None:
        if message.type == "error":
            self.errors.append(message.text)

    def open(self, name: str, until: str = "load") -> Any:
        self.page.goto(f"{self.site}/{name}")  # an idle network alone need not mean a read page
        self.page.wait_for_load_state(until)
        self.page.evaluate("window.MathJax?.startup?.promise")
        return self.page

    def close(self) -> None:
        self.context.close()
