"""The runs of chapter 5's benchmark, as the results store holds them.

A store is a folder.  Each folder in it (a *layer*) holds what runs of one budget produced:
``curves.csv`` (or ``.parquet``), the learning curves, and where the policies have been tested
``tests.parquet`` (or ``.csv``), in it or in folders of its own.  Runs of one layer stop at the
same iteration; one that has not come so far is left out.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from thesis_lib.checkout import repository_root

RUN_COLUMNS = ("task", "terrain", "architecture", "seed", "variant")
"""Columns that tell runs apart, of :data:`~thesis_lib.training.grid.GRID_COLUMNS`; a file may have
more."""

CURVE_COLUMNS = (*RUN_COLUMNS, "iteration", "steps", "mean_return")
"""Columns of ``curves``, of :data:`~thesis_lib.training.curves.CURVES_COLUMNS`, one row an
iteration of a run."""

_OF_A_TEST = ("condition", "correlation", "intervention", "policy", "test", "return")
TEST_COLUMNS = (*RUN_COLUMNS, *_OF_A_TEST)
"""Columns of ``tests``, of :data:`thesis_lib.training.suite.COLUMNS`, one row a test run of a
policy; ``correlation`` and ``intervention`` may be left out where there is none, and ``policy``
where it is the last."""

TESTED_ALIKE = ("steps", "termination", "noise", "onset", "difficulty", "switch_at", "seed")
"""Settings of :class:`~thesis_lib.training.suite.SuiteConfig` that ``tests`` has no column for:
in one store they are the same for all."""

PRINTED_STEPS = 500 * 50_000
"""Control steps of a run of table 5.2: 500 iterations of 50,000."""

ENOUGH = 3
"""Seeds from which on an interval over seeds is given."""

CELL = ["task", "terrain", "architecture", "variant"]
DEFAULT = "default"


@dataclass(frozen=True)
class Runs:
    """Runs of a store.

    Attributes
    ----------
    curves
        Columns of :data:`CURVE_COLUMNS` and ``layer``; finished runs only.
    tests
        Columns of :data:`TEST_COLUMNS` and ``layer``.
    """

    curves: pd.DataFrame
    tests: pd.DataFrame

    def only(
        self,
        tasks: Collection[str] = (),
        architectures: Collection[str] = (),
        seeds: Collection[int] = (),
    ) -> Runs:
        """The runs of some robots, nets and seeds; of all where none are named."""
        chosen = {"task": tasks, "architecture": architectures, "seed": seeds}
        parts = [self.curves, self.tests]
        for name, values in chosen.items():
            if values:
                parts = [part[part[name].isin(values)] for part in parts]
        return Runs(*parts)

    def in_full(self) -> Runs:
        """The runs as long as the thesis's (:data:`PRINTED_STEPS`)."""
        lengths = self.depths()
        long = lengths.loc[lengths.steps >= PRINTED_STEPS, [*CELL, "layer"]]
        return Runs(*(part.merge(long) for part in (self.curves, self.tests)))

    def depths(self, *, enough: int = ENOUGH, across: Sequence[str] = ()) -> pd.DataFrame:
        """The budgets there are for each cell, the one that counts first.

        That is the deepest, in control steps a run, of those with enough seeds; without one, the
        deepest.

        Parameters
        ----------
        enough
            Seeds that a budget needs to count.
        across
            Which of :data:`CELL` differ between cells that are compared: of those the layer that
            most have counts for all.  ``["terrain"]``, say, where hill-trained policies are held
            against flat-trained ones.

        Returns
        -------
        pandas.DataFrame
            One row a cell (task, terrain, architecture, variant) and layer, with ``iterations``,
            ``batch_steps``, ``steps`` and ``seeds``.
        """
        last = self.curves.groupby([*CELL, "layer", "seed"], as_index=False).agg(
            iterations=("iteration", "max"), steps=("steps", "max"), first=("steps", "min")
        )
        # A batch overshoots what was asked for by less than an episode.
        last["batch_steps"] = last["first"] // 1000 * 1000
        found = last.groupby([*CELL, "layer"], as_index=False).agg(
            iterations=("iterations", "max"),
            batch_steps=("batch_steps", "min"),
            seeds=("seed", "nunique"),
        )
        found["steps"] = found.iterations * found.batch_steps
        found["enough"] = found.seeds >= enough
        compared = [*(c for c in CELL if c not in across), "layer"]
        found["shared"] = found.groupby(compared).enough.transform("sum")
        order = ["shared", "enough", "steps", "seeds"]
        found = found.sort_values([*CELL, *order], ascending=[True] * 4 + [False] * 4)
        return found.drop(columns=["enough", "shared"])

    def deepest(self, *, enough: int = ENOUGH, across: Sequence[str] = ()) -> pd.DataFrame:
        """The budget that counts for each cell; parameters and columns as :meth:`depths`."""
        return self.depths(enough=enough, across=across).drop_duplicates(CELL)

    def learning(self, *, across: Sequence[str] = ()) -> pd.DataFrame:
        """Mean return over learning, the measure of table 5.2, by run at the budget that counts.

        Parameters
        ----------
        across
            Which that is (:meth:`depths`).

        Returns
        -------
        pandas.DataFrame
            Columns of :data:`RUN_COLUMNS`, ``mean_return``, ``last_return`` (mean of the last five
            iterations), ``iterations``, ``batch_steps``.
        """
        chosen = self._chosen(self.curves, self.deepest(across=across))
        chosen = chosen.sort_values("iteration")
        by = chosen.groupby([*CELL, "seed", "iterations", "batch_steps"]).mean_return
        runs = by.agg(["mean", lambda r: r.tail(5).mean()])
        return runs.set_axis(["mean_return", "last_return"], axis=1).reset_index()

    def returns(
        self, *, enough: int = ENOUGH, across: Sequence[str] = (), policy: str = "last"
    ) -> pd.DataFrame:
        """Mean return of each policy in each test, at the budget that counts.

        Parameters
        ----------
        enough, across
            Which that is (:meth:`depths`).
        policy
            ``last``, or ``best``: that of a run's best batch.

        Returns
        -------
        pandas.DataFrame
            Columns of :data:`TEST_COLUMNS` less ``test`` and ``policy``, ``return`` (mean over its
            test runs), ``iterations``, ``batch_steps``.
        """
        keys = ["seed", "condition", "correlation", "intervention", "iterations", "batch_steps"]
        tests = self.tests[self.tests.policy == policy]
        chosen = self._chosen(tests, self.deepest(enough=enough, across=across))
        return chosen.groupby([*CELL, *keys], as_index=False)["return"].mean()

    @staticmethod
    def _chosen(table: pd.DataFrame, budgets: pd.DataFrame) -> pd.DataFrame:
        columns = [*CELL, "layer", "iterations", "batch_steps"]
        return table.merge(budgets[columns], on=[*CELL, "layer"])


def plain(tests: pd.DataFrame) -> pd.DataFrame:
    """Tests of nets with the default settings and nothing done to them, all noise white."""
    white = (tests.correlation == 0) & (tests.intervention == "none")
    return tests[white & (tests.variant == DEFAULT)]


def read_runs(folder: Path | str | None = None) -> Runs:
    """Read the runs of a results store.

    Parameters
    ----------
    folder
        Of the store; default ``results/study`` of the checkout.  One that does not exist holds no
        runs.

    Raises
    ------
    ValueError
        When a file lacks a column, or tests were made under conditions that differ.
    """
    root = Path(folder) if folder else repository_root() / "results" / "study"
    curves = _read(root, "curves", CURVE_COLUMNS)
    tests = _read(root, "tests", TEST_COLUMNS)
    _check_tested_alike(root)
    longest = curves.groupby([*CELL, "layer"]).iteration.transform("max")
    reached = curves.groupby([*CELL, "layer", "seed"]).iteration.transform("max")
    return Runs(curves[reached == longest], tests)


def _check_tested_alike(root: Path) -> None:
    """Raise ValueError where records of tests (``tests.json``) differ in their conditions."""
    files = sorted(root.glob("**/tests.json"))
    records = {path: json.loads(path.read_text(encoding="utf-8")) for path in files}
    known = {path: made["config"] for path, made in records.items() if "config" in made}
    for name in TESTED_ALIKE:
        given = {path: config[name] for path, config in known.items() if name in config}
        for path, value in given.items():
            first = next(iter(given))
            if value != given[first]:
                raise ValueError(
                    f"tests in {str(path.parent)!r} were made with {name} {value!r} and those in "
                    f"{str(first.parent)!r} with {given[first]!r}, which one table would mix up: "
                    "keep those of other conditions outside the store."
                )


def _read(root: Path, name: str, columns: Sequence[str]) -> pd.DataFrame:
    parts = [pd.DataFrame(columns=[*columns, "layer"])]
    for path in sorted(p for s in (".csv", ".parquet") for p in root.glob(f"**/{name}{s}")):
        table = pd.read_csv(path) if path.suffix == ".csv" else pd.read_parquet(path)
        if name == "tests":
            missing = {"correlation": 0.0, "intervention": "none", "policy": "last"}
            table = table.assign(**{k: v for k, v in missing.items() if k not in table})
        if lacking := [c for c in columns if c not in table]:
            raise ValueError(
                f"{path.name} of the layer {path.parent.name!r} lacks the columns "
                f"{', '.join(lacking)}: make it again with `thesis sweep` or `thesis "
                "test-policies`."
            )
        layer = path.relative_to(root).parts[0]
        parts.append(table[list(columns)].assign(layer=layer))
    # A run of a test that two folders hold is one.
    whole = pd.concat([p for p in parts if len(p)] or parts)
    return whole.drop_duplicates(ignore_index=True)
