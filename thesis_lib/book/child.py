"""Processes of the build that end when the build does, with all that they started.

``python -m thesis_lib.book.child MODULE [ARGUMENT ...]`` runs a module as ``python -m MODULE``
would.  Its standard input is a pipe that nobody writes to and that the build holds open: when
the build is gone, however it went, reading it comes to an end, and the process ends its own
children (a notebook's kernel lives in a session of its own) and itself.
"""

from __future__ import annotations

import os
import runpy
import subprocess
import sys
import threading
from collections.abc import Sequence
from typing import Any

import psutil


class Children:
    """Processes under way, which an interrupt can end."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._running: set[subprocess.Popen[str]] = set()
        self.stopped = False

    def run(self, module: str, arguments: Sequence[str], **options: Any) -> tuple[int, str]:
        """Run a module to its end; returns its exit status and what it printed, if captured.

        Parameters
        ----------
        module, arguments
            As after ``python -m``.
        **options
            Of ``subprocess.Popen``.
        """
        with self._lock:
            if self.stopped:
                return 130, "interrupted"
            child = subprocess.Popen(
                [sys.executable, "-m", __name__, module, *arguments],
                stdin=subprocess.PIPE,
                text=True,
                encoding="utf-8",
                errors="replace",
                # Ctrl-C on a terminal is for the build, which then ends its children.
                start_new_session=True,
                **options,
            )
            self._running.add(child)
        try:
            printed = child.stdout.read() if child.stdout else ""
            return child.wait(), printed
        finally:
            child.stdin.close()  # type: ignore[union-attr]
            child.wait()
            with self._lock:
                self._running.discard(child)

    def stop(self) -> None:
        """End every process under way, with those they started, and start no other."""
        with self._lock:
            self.stopped = True
            for child in self._running:
                child.stdin.close()  # type: ignore[union-attr]


def end_with_the_build() -> None:
    """End this process, and those it started, when its standard input comes to an end."""
    while os.read(0, 1):
        pass
    for descendant in psutil.Process().children(recursive=True):
        descendant.kill()
    os._exit(1)


if __name__ == "__main__":
    threading.Thread(target=end_with_the_build, daemon=True).start()
    name, sys.argv[1:] = sys.argv[1], sys.argv[2:]
    runpy.run_module(name, run_name="__main__", alter_sys=True)
