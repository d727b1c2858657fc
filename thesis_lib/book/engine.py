"""Papermill's engine for this book: it evaluates the expressions in a notebook's prose.

Importing this module makes it the default.  Papermill imports it by itself where this library
is installed, through an entry point, so that plain ``papermill`` writes the values too; run as
a program it is papermill.
"""

from __future__ import annotations

from typing import Any

from papermill.clientwrap import PapermillNotebookClient
from papermill.engines import NBClientEngine, papermill_engines
from papermill.log import logger
from papermill.utils import merge_kwargs, remove_args

from thesis_lib.book.inline import expressions, fill, keep, shown


class _Client(PapermillNotebookClient):
    """Runs cells as papermill does, and evaluates the expressions of each as it passes."""

    def execute_cell(self, cell: Any, cell_index: int, *arguments: Any, **options: Any) -> Any:
        done = super().execute_cell(cell, cell_index, *arguments, **options)
        if asked := expressions(cell):
            self._evaluate(cell, asked)
        return done

    def _evaluate(self, cell: Any, asked: list[str]) -> None:
        wanted = {str(i): expression for i, expression in enumerate(asked)}
        sent = self.kc.execute("", silent=True, store_history=False, user_expressions=wanted)
        found = self.wait_for_reply(sent)["content"]["user_expressions"]
        known = {text: shown(found[i], text, cell.id) for i, text in wanted.items()}
        keep(cell, known)
        fill(cell, known)


class Engine(NBClientEngine):
    """Papermill's own engine, with expressions in prose."""

    @classmethod
    def execute_managed_notebook(
        cls,
        nb_man: Any,
        kernel_name: str,
        log_output: bool = False,
        stdout_file: Any = None,
        stderr_file: Any = None,
        start_timeout: int = 60,
        execution_timeout: int | None = None,
        **options: Any,
    ) -> None:
        """Run a notebook; the arguments are those of papermill's engine."""
        settings = merge_kwargs(
            remove_args(["input_path", "timeout", "startup_timeout"], **options),
            timeout=execution_timeout or options.get("timeout"),
            startup_timeout=start_timeout,
            kernel_name=kernel_name,
            log=logger,
            log_output=log_output,
            stdout_file=stdout_file,
            stderr_file=stderr_file,
        )
        _Client(nb_man, **settings).execute()


papermill_engines.register(None, Engine)

if __name__ == "__main__":
    from papermill.cli import papermill

    papermill()
