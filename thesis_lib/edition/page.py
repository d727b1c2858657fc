"""What a notebook of the book calls: the opening check, experiments, verdicts, tables.

A notebook's second code cell reads ::

    from thesis_lib.edition.page import start

    page = start(globals(), chapter3)

which stops on an unknown parameter or budget, sets the figure style, keeps numerical libraries
on one thread and prints which budget the page shows.  Nothing here depends on the working
directory, so that a notebook runs the same in Jupyter, under papermill and in the book's build.
"""

from __future__ import annotations

import os
import re
import sys
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pandas as pd
from IPython.core.getipython import get_ipython
from IPython.display import display
from threadpoolctl import threadpool_limits

from thesis_lib.checks import check_seed, one_of, positive_integer
from thesis_lib.edition import roots
from thesis_lib.edition.budgets import BUDGETS
from thesis_lib.edition.chapters import read_chapter
from thesis_lib.edition.deepest import deepest
from thesis_lib.edition.experiment import Experiment
from thesis_lib.edition.ledger import (
    SMOKE_TELLS_NOTHING,
    Claim,
    Difference,
    Finding,
    Judgement,
    OverRoots,
    Verdict,
    finding,
)
from thesis_lib.edition.parameters import check_injected
from thesis_lib.edition.plots import use_style
from thesis_lib.edition.words import brief, parted, plain, typeset

#: Environment variable by which the build says where tables go.
RESULTS_VARIABLE = "THESIS_RESULTS"

#: A number with its error, an interval or a pair, short enough for a line.
_NUMBERS = re.compile(r"[-−+±\d.,()%/–→ ]{1,16}")
_FREQUENCY = re.compile(r"\((\d+) of (\d+)")

#: Markdown of cells and captions, and what it is in HTML.
_MARKDOWN = (
    (r"\\\|", "|"),
    (r"\{[a-z:]+\}`([^`]+)`", r"\1"),
    (r"`([^`]+)`", r"<code>\1</code>"),
    (r"\*\*(.+?)\*\*", r"<strong>\1</strong>"),
)

_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class _Rendered:
    """One output in two forms: MyST for the book, HTML for Jupyter and Colab."""

    def __init__(self, myst: str, html: str) -> None:
        self.myst = myst
        self.html = html

    def _repr_mimebundle_(self, **_: Any) -> dict[str, str]:
        return {"text/markdown": self.myst, "text/html": self.html}

    def __repr__(self) -> str:
        return self.myst


def table(
    data: pd.DataFrame,
    *,
    name: str,
    caption: str,
    decimals: int | Mapping[str, int] = 2,
    index: bool = False,
) -> None:
    """Show a numbered table that the prose can refer to with ``{numref}`name```.

    Parameters
    ----------
    data
        A short table; column headings and strings may hold Markdown and mathematics.
    name
        Label, such as ``tbl-cliff-returns``; unique in the whole book.
    caption
        One sentence, which may hold mathematics.
    decimals
        Decimals of floating-point columns: one number, or one per column name; fewer where a
        number would have more than four digits, so that none has any from a thousand on.
    index
        Whether to show the index as the first column.
    """
    shown = data.reset_index() if index else data
    cells = pd.DataFrame(
        {
            column: [_cell(value, _places(decimals, str(column))) for value in shown[column]]
            for column in shown.columns
        }
    )
    numeric = [
        pd.api.types.is_numeric_dtype(shown[column])
        and not pd.api.types.is_bool_dtype(shown[column])
        for column in shown.columns
    ]
    judged = "verdict" in shown.columns
    rows = [
        _pipe(plain(str(column)) for column in shown.columns),
        _pipe("---:" if right else ":---" for right in numeric),
        *(_pipe(map(_badged, row) if judged else row) for row in cells.itertuples(index=False)),
    ]
    body = "\n".join(rows)
    look = ":class: verdicts\n" * judged  # cards on a phone
    display(
        _Rendered(
            f"::::{{table}} {caption}\n:name: {name}\n{look}\n{body}\n::::\n",
            _html(cells, numeric, caption),
        )
    )


def _html(cells: pd.DataFrame, numeric: Sequence[bool], caption: str) -> str:
    """A table for Jupyter, whose own style would set words to the right as well."""
    shown = cells.map(_as_html)
    shown.columns = pd.Index([_as_html(plain(str(column))) for column in cells.columns])
    sides = ["right" if right else "left" for right in numeric]
    style = shown.style.hide(axis="index").set_caption(_as_html(caption))
    style.set_table_styles(
        [
            {"selector": f"th.col{i}, td.col{i}", "props": f"text-align: {side}"}
            for i, side in enumerate(sides)
        ]
    )
    return style.to_html()


def _as_html(text: str) -> str:
    """A cell's or a caption's Markdown as HTML; a reference is shown by its label."""
    for mark, meant in _MARKDOWN:
        text = re.sub(mark, meant, text)
    return text


def _folded(evidence: str) -> str:
    """Evidence of which all but its first numbers unfolds; the Scoreboard has what is cut here."""
    head, rest = parted(short := brief(evidence), 4, sentences=True)
    return f"<details><summary>{head}</summary>{rest}</details>" if len(rest) > 40 else short


def _pipe(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _badged(cell: str) -> str:
    """A cell of a table of verdicts, in colour where it is one: ``refuted (8 of 8)``."""
    words = cell.partition(" (")[0]
    return Verdict(words).badge + cell[len(words) :] if words in [*Verdict] else cell


def _places(decimals: int | Mapping[str, int], column: str) -> int:
    return decimals if isinstance(decimals, int) else decimals.get(column, 2)


def _cell(value: object, places: int) -> str:
    """One table cell as text: a missing value is a dash, a boolean yes or no; no number breaks."""
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if value is None or value is pd.NaT or value is pd.NA:
        return "–"
    if isinstance(value, (float, np.floating)):
        if np.isnan(value):
            return "–"
        size = abs(float(value))
        if 1 <= size < np.inf:
            places = max(0, min(places, 4 - len(str(int(size)))))
        return f"{value:,.{places}f}".replace("-", "−")
    text = typeset(str(value)).replace("|", "\\|")
    text = _FREQUENCY.sub("(\\1\u00a0of\u00a0\\2", text)
    return text.replace(" ", "\u00a0") if _NUMBERS.fullmatch(text) else text


@dataclass(frozen=True)
class Page:
    """What a notebook was asked to do.

    Attributes
    ----------
    budget
        ``smoke``, ``book`` or ``thesis``.
    seed
        Root of every random number of the page, a nonnegative integer.
    workers
        Number of threads an experiment may use; it never changes a result.
    chapter
        The package whose claims the page judges, such as ``thesis_lib.chapter3``; those of the
        modules that the notebook has imported, as a chapter has several notebooks.
    claims, differences
        Of these modules, by id.
    tables
        What verdicts rest on, by experiment id: what :meth:`run` has made so far, or the committed
        table at the thesis's budget where the page's has fewer runs.
    over
        Committed verdicts over roots, by claim.
    chosen
        By class of configs, the fields in which they differ from the budget's (:meth:`choose`).
    """

    budget: str
    seed: int = 0
    workers: int = 1
    chapter: ModuleType | None = None
    claims: dict[str, Claim] = field(default_factory=dict, repr=False)
    differences: dict[str, Difference] = field(default_factory=dict, repr=False)
    tables: dict[str, pd.DataFrame] = field(default_factory=dict, repr=False)
    over: Mapping[str, OverRoots] = field(default_factory=dict, repr=False)
    chosen: dict[type, dict[str, Any]] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        one_of("budget", self.budget, BUDGETS)
        check_seed(self.seed)
        positive_integer("workers", self.workers)

    def choose(self, config: type, **values: Any) -> None:
        """Replace fields in the configs of one class, from here on.

        What is run with other values than the budget's is shown and judged here, and not stored.

        Parameters
        ----------
        config
            Class of the configs, such as ``contrasts.Config``.
        values
            By the name of the field.
        """
        self.chosen.setdefault(config, {}).update(values)

    def _config(self, experiment: Experiment[Any]) -> Any:
        """The budget's config with the fields chosen; None where they change nothing."""
        usual = experiment.config(self.budget)
        chosen = self.chosen.get(type(usual), {})
        changed = {name: value for name, value in chosen.items() if value != vars(usual)[name]}
        return replace(usual, **changed) if changed else None

    def run(self, experiment: Experiment[Any], config: Any = None) -> pd.DataFrame:
        """Run an experiment at the page's budget, seed and workers, and return its table.

        In the book's build the table is stored as well, for the ledger, so that the page and
        the verdicts rest on the same run.

        Parameters
        ----------
        experiment
            Imported from its chapter; the import tells the build on what the page depends.
        config
            Replaces the budget's config; such a run is shown and not stored.
        """
        chosen = self._config(experiment) if config is None else config
        result = experiment.run(self.budget, config=chosen, seed=self.seed, workers=self.workers)
        # Outside a build nothing is stored: a reader's run with another seed must not become
        # the evidence of the shipped ledger.
        if config is None and chosen is not None:
            self.tables[experiment.id] = result.table
        elif config is None:
            self.tables[experiment.id], _ = deepest(result.table, result.provenance)
            if directory := os.environ.get(RESULTS_VARIABLE):
                result.save(directory)
        return result.table

    def finding(self, claim: str) -> Finding:
        """Judge a claim of this chapter on the tables of this page.

        Raises
        ------
        ValueError
            If there is no such claim, or an experiment it rests on has not been run above.
        """
        self._read()
        if claim not in self.claims:
            raise ValueError(
                f"the modules imported above have no claim {claim!r}; see claims.toml."
            )
        self._need(claim, self.claims[claim].experiments)
        return finding(self.claims[claim], self.tables, self.budget)

    def _read(self) -> None:
        """Learn of the claims and differences of the modules imported by now."""
        if self.chapter is not None:
            package = f"{self.chapter.__name__}."
            loaded = [n.removeprefix(package) for n in sys.modules if n.startswith(package)]
            found = read_chapter(self.chapter, loaded)
            self.claims.update({claim.id: claim for claim in found.claims})
            self.differences.update({row.id: row for row in found.differences})

    def _need(self, name: str, experiments: Sequence[str]) -> None:
        missing = [e for e in experiments if e not in self.tables]
        if missing:
            raise ValueError(f"{name!r} rests on {', '.join(missing)}: run it above first.")

    def effect(self, difference: str) -> str:
        """What a difference from the thesis changes, told from the tables of this page."""
        self._read()
        row = self.differences[difference]
        if isinstance(row.effect, str):
            return row.effect
        self._need(difference, row.experiments)
        return SMOKE_TELLS_NOTHING if self.budget == "smoke" else row.effect(self.tables)

    def _judged(self, claim: str) -> Judgement:
        """A claim judged on this page's tables, and over roots where that is told."""
        found = self.finding(claim)
        over = None if self.budget == "smoke" else self.over.get(claim)
        return Judgement(self.claims[claim], found, self.budget, over)

    def verdict(self, claim: str) -> str:
        """The verdict on a claim, for a sentence: ``{eval}`page.verdict("3.3.1-bound")```.

        It is the one over roots where that is committed, with its frequency and with that of
        this page's tables if they say another; else the latter.
        """
        return self._judged(claim).in_words()

    def evidence(self, claim: str) -> str:
        """The evidence for the verdict on a claim, in sentences without their longest lists."""
        return brief(self.finding(claim).evidence)

    table = staticmethod(table)

    def verdicts(self, *prefixes: str) -> pd.DataFrame:
        """Claims whose ids start so: columns ``claim``, ``verdict``, ``evidence``.

        Without prefixes, all for which the page has run the experiments.  The verdict is the
        one over roots, with its frequency; the evidence that of this page, of which all but the
        beginning unfolds.

        Raises
        ------
        ValueError
            If no claim starts with one of the prefixes, or one that does cannot be judged yet.
        """
        self._read()
        for prefix in prefixes:
            if not any(name.startswith(prefix) for name in self.claims):
                raise ValueError(
                    f"no claim of the modules imported above starts with {prefix!r}; see "
                    "claims.toml."
                )
        wanted = [
            name
            for name, claim in self.claims.items()
            if (
                name.startswith(prefixes)
                if prefixes
                else self.tables.keys() >= {*claim.experiments}
            )
        ]
        found = [self._judged(name) for name in wanted]
        return pd.DataFrame(
            [(j.claim.statement, j.in_words(), _folded(j.finding.evidence)) for j in found],
            columns=["claim", "verdict", "evidence"],
        )


def start(
    namespace: Mapping[str, Any],
    chapter: ModuleType | None = None,
) -> Page:
    """Check the parameters of the running notebook and prepare its session.

    Parameters
    ----------
    namespace
        The notebook's ``globals()``, which holds ``budget``, ``seed`` and ``workers`` from the
        parameters cell, and IPython's record of the cells run so far.
    chapter
        The chapter whose claims the page judges, such as ``thesis_lib.chapter3``.

    Returns
    -------
    Page
        The checked parameters.

    Raises
    ------
    ValueError
        If papermill was given a parameter the notebook does not have, or a value is not allowed.
    """
    missing = [name for name in ("budget", "seed", "workers") if name not in namespace]
    if missing:
        raise ValueError(
            f"the parameters cell did not set {', '.join(missing)}; run it before this cell."
        )
    check_injected(namespace.get("In", ()))
    page = Page(
        *(namespace["budget"], namespace["seed"], namespace["workers"], chapter),
        over=roots.read(),
    )

    for variable in _THREAD_VARIABLES:  # for libraries and processes that start later
        os.environ[variable] = "1"
    threadpool_limits(limits=1)  # for libraries that are loaded already
    if (shell := get_ipython()) is not None:
        # MPLBACKEND, as containers and clusters set it, would draw every figure to nowhere.
        shell.run_line_magic("matplotlib", "inline")
    use_style()

    words = Path(__file__).with_name("banners.toml").read_text(encoding="utf-8")
    banner = tomllib.loads(words)[page.budget]
    title, text = banner["title"], f"{banner['text']} Seed {page.seed}."
    display(
        _Rendered(
            f":::{{admonition}} {title}\n:class: {banner['kind']}\n{text}\n:::\n",
            f"<p><strong>{title}.</strong> {text.replace('`', '')}</p>",
        )
    )
    return page
