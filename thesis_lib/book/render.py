"""Run Sphinx on the staged book, in a process of its own.

``python -m thesis_lib.book.render SOURCE HTML DOCTREES [--strict]`` does what
``jupyter-book build`` does, with its output where we want it; ``--strict`` turns every warning
and every unresolved reference into a failure.
"""

from __future__ import annotations

import sys
from pathlib import Path

import yaml


def render(source: Path, html: Path, doctrees: Path, *, strict: bool) -> int:
    """Build the staged book; returns the exit status.

    Parameters
    ----------
    source, html, doctrees
        The staged book, where its pages go, and where Sphinx keeps what it read.
    strict
        Whether a warning, an unresolved reference among them, makes the build fail.
    """
    from jupyter_book.sphinx import build_sphinx
    from sphinx.util.console import color_terminal, nocolor

    if not color_terminal():
        nocolor()  # Sphinx's own command does so; a log file is for reading
    config = source / "_config.yml"
    status = build_sphinx(
        str(source),
        str(html),
        noconfig=True,
        path_config=str(config),
        doctreedir=str(doctrees),
        confoverrides={"nitpicky": True, "latex_individualpages": False},
        warningiserror=strict,
        keep_going=True,
        quiet=True,
    )
    if not isinstance(status, int):
        print(f"the book could not be built: {status}", file=sys.stderr)
        return 2
    root = yaml.safe_load((source / "_toc.yml").read_text(encoding="utf-8"))["root"]
    title = yaml.safe_load(config.read_text(encoding="utf-8"))["title"]
    redirect = Path(__file__).with_name("redirect.html").read_text(encoding="utf-8")
    (html / "index.html").write_text(
        redirect.format(title=title, page=f"{root}.html"), encoding="utf-8"
    )
    return status


if __name__ == "__main__":
    folders = [Path(argument) for argument in sys.argv[1:4]]
    sys.exit(render(*folders, strict="--strict" in sys.argv[4:]))
