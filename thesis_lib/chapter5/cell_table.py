"""Tables of cells, ours beside the printed ones: what tables 5.2, 5.3 and C.1 to C.3 share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from thesis_lib.chapter5.cells import GROUPS, NETS, ROBOTS, as_published
from thesis_lib.chapter5.runs import DEFAULT, ENOUGH, PRINTED_STEPS
from thesis_lib.edition.criteria import LEVEL
from thesis_lib.edition.words import number, several
from thesis_lib.robustness import TRAINED_ON
from thesis_lib.stats import Comparison, Summary, leading, mean_ci, welch
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.plan import cost


@dataclass(frozen=True)
class Cell:
    """A printed cell, and runs of ours beside it."""

    task: str
    """Robot."""
    trained_on: str
    """Flat, or hill: ground it was trained on."""
    architecture: str
    """Architecture."""
    printed: float
    """Printed mean."""
    printed_error: float
    """Printed standard error."""
    leads: bool
    """Whether no net's printed mean on its row is significantly higher (Welch, p < .05)."""
    note: str
    """What is known of the printed cell: misprints, runs that were cut short."""
    ours: float
    """Mean over our seeds at the deepest budget there is."""
    error: float
    """Its standard error over seeds."""
    low: float
    """Lower end of its 95% Student interval over seeds."""
    high: float
    """Upper end."""
    best: float
    """Of the seed with the highest mean return over the last five iterations."""
    ours_leads: bool
    """As leads, of ours, by Kruskal-Wallis followed by Welch."""
    p_printed: float
    """Welch's test that our mean and the printed one are the same."""
    seeds: int
    """Seeds of ours; 0 where nothing has been run yet."""
    iterations: int
    """Iterations of our runs."""
    batch_steps: int
    """Control steps of an iteration."""
    printed_budget: bool
    """Whether that is as many steps as the thesis's 500 iterations of 50,000."""


def beside(table: str, ours: pd.DataFrame, printed_runs: int) -> list[Cell]:
    """The cells of a printed table with runs of ours.

    Parameters
    ----------
    table
        Id of the printed table.
    ours
        One row a run, with the columns of a store's runs, ``value``, ``last_return``,
        ``iterations`` and ``batch_steps``.
    printed_runs
        Runs behind a printed cell.
    """
    printed = as_published(table)
    own = ours[ours.variant == DEFAULT].assign(architecture=ours.architecture.str.upper())
    own = own.sort_values("seed")
    by_cell = dict(list(own.groupby(["task", "terrain", "architecture"])))
    rows = []
    for ground in TRAINED_ON:
        for robot in ROBOTS:
            row = printed.loc[ground].loc[robot]
            summaries = {
                net: Summary(r.value, r.standard_error * printed_runs**0.5, printed_runs)
                for net, r in row.iterrows()
            }
            mine = {n: by_cell[robot, ground, n] for n in NETS if (robot, ground, n) in by_cell}
            first = set(leading(summaries, LEVEL))
            ours_first = _leading(mine)
            rows += [
                _cell(
                    robot,
                    ground,
                    net,
                    row.loc[net],
                    summaries[net],
                    net in first,
                    mine.get(net, own.iloc[:0]),
                    net in ours_first,
                )
                for net in NETS
            ]
    return rows


def _leading(mine: dict[str, pd.DataFrame]) -> set[str]:
    """Leading nets of a row; none unless all have been run with enough seeds."""
    if len(mine) < len(NETS) or min(len(runs) for runs in mine.values()) < ENOUGH:
        return set()
    return set(leading({net: runs.value.to_numpy() for net, runs in mine.items()}, LEVEL))


def _cell(
    robot: str,
    ground: str,
    net: str,
    row: pd.Series,
    summary: Summary,
    first: bool,
    runs: pd.DataFrame,
    ours_first: bool,
) -> Cell:
    value, n = runs.value.to_numpy(), len(runs)
    mean = value.mean() if n else np.nan
    half = mean_ci(value).half_width if n > 1 else np.nan
    iterations, batch = (int(runs[c].min()) if n else 0 for c in ("iterations", "batch_steps"))
    return Cell(
        robot,
        ground,
        net,
        printed=row.value,
        printed_error=row.standard_error,
        leads=first,
        note=row.note,
        ours=mean,
        error=value.std(ddof=1) / n**0.5 if n > 1 else np.nan,
        low=mean - half,
        high=mean + half,
        best=runs.value.loc[runs.last_return.idxmax()] if n else np.nan,
        ours_leads=ours_first,
        p_printed=welch(value, summary).p_value if n > 1 else np.nan,
        seeds=n,
        iterations=iterations,
        batch_steps=batch,
        printed_budget=iterations * batch >= PRINTED_STEPS,
    )


def column(source: str) -> tuple[str, str, str]:
    """Columns of mean, standard error and leading group in a table of cells, by source."""
    return (
        ("printed", "printed_error", "leads")
        if source == "printed"
        else ("ours", "error", "ours_leads")
    )


def wide(table: pd.DataFrame, value: str) -> pd.DataFrame:
    """One column of a table of cells, ground and robot down, nets across."""
    return table.pivot(index=["trained_on", "task"], columns="architecture", values=value)[
        list(NETS)
    ]


def whole_rows(
    asked: pd.DataFrame, source: str, printed_runs: int, *, errors: bool = False, least: int = 1
) -> pd.DataFrame:
    """Cells of the rows (ground and robot) on which a source has all nets.

    Parameters
    ----------
    asked
        Cells a claim is about.
    source
        ``printed`` or ``ours``.
    printed_runs
        Runs behind a printed cell.
    errors
        Whether standard errors are needed too, which takes two runs a cell.
    least
        Fewer rows than this are as good as none.

    Returns
    -------
    pandas.DataFrame
        The cells with ``value``, ``error``, ``leads`` and ``printed_budget`` of the source and
        the runs behind each (``units``); and of how many robots no row is missing (``tasks``), of
        how many asked for (``of_tasks``).
    """
    cells = asked.assign(
        **{
            to: asked[of]
            for to, of in zip(("value", "error", "leads"), column(source), strict=True)
        }
    )
    if source == "printed":
        cells = cells.assign(units=printed_runs, printed_budget=True)
    else:
        cells = cells.assign(units=cells.seeds)
    there = cells[["value", "error"] if errors else ["value"]].notna().all(axis=1)
    whole = there.groupby([asked.trained_on, asked.task]).transform("all")
    robots = asked.task.nunique()
    rows = cells[whole].assign(tasks=robots - asked.task[~whole].nunique(), of_tasks=robots)
    return rows if rows.groupby(["trained_on", "task"]).ngroups >= least else rows.iloc[:0]


def whole(
    printed_runs: int, where: str = "", **needs: Any
) -> Callable[[str, pd.DataFrame], pd.DataFrame]:
    """What finds a claim's rows, for :func:`~thesis_lib.chapter5.judging.both`.

    Parameters
    ----------
    printed_runs, **needs
        As of :func:`whole_rows`.
    where
        Query of the cells that the claim is about; all without.
    """
    return lambda source, table: whole_rows(
        table.query(where) if where else table, source, printed_runs, **needs
    )


def summary(row: pd.Series) -> Summary:
    """Mean, standard deviation over runs and their number of a cell of :func:`whole_rows`."""
    n = int(row.units)
    return Summary(row.value, row.error * n**0.5, n)


def best_against_best(row: pd.DataFrame) -> Comparison:
    """The best RNN's mean on a whole row against the best FNN's, by Welch's test."""
    by = row.set_index("architecture")
    rnn, fnn = (
        summary(by.loc[by.value[list(GROUPS[group])].idxmax()]) for group in ("RNNs", "FNNs")
    )
    return welch(rnn, fnn)


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """A table of cells as the thesis prints it, a row a robot: the printed row, and ours below.

    An entry is a mean and in brackets its standard error; bold ones lead, if not all do.
    """
    lines = []
    for (ground, robot), cells in table.groupby(["trained_on", "task"], sort=False):
        name = robot if ground == "flat" else f"{robot} {ground}"
        by_net = cells.set_index("architecture")
        lines.append({"robot": name, **_entries(by_net[list(column("printed"))])})
        lines.append({"robot": _runs(cells), **_entries(by_net[list(column("ours"))])})
    return pd.DataFrame(lines)


def _entries(cells: pd.DataFrame) -> dict[str, str | None]:
    """Entries of a row by net, from its means, standard errors and who leads."""
    entries = {}
    for net, mean, error, leads in cells.itertuples():
        text = f"{mean:.0f}" if np.isnan(error) else f"{mean:.0f} ({error:.0f})"
        bold = f"**{text}**" if leads and not cells.iloc[:, 2].all() else text
        entries[net] = None if np.isnan(mean) else bold
    return entries


def _runs(cells: pd.DataFrame) -> str:
    """Heading of our row: how many seeds there are; not the same for all nets, a range."""
    seeds = cells.seeds[cells.seeds > 0]
    low, high = seeds.min(), seeds.max()
    return "not run" if seeds.empty else f"ours, n = {low if low == high else f'{low} to {high}'}"


def run_length(table: pd.DataFrame) -> str:
    """How long our runs in a table of cells are, and on which rows they are longer or shorter."""
    run = table[table.seeds > 0]
    if run.empty:
        return "no iteration"
    row = run.task + " " + run.trained_on
    mixed = (run.iterations * 1e9 + run.batch_steps).groupby(row).transform("nunique") > 1
    row = row.where(~mixed, row + " " + run.architecture)
    by_budget = row.groupby([run.iterations, run.batch_steps]).unique()
    by_budget = by_budget.sort_values(
        key=lambda rows: rows.map(len), ascending=False, kind="stable"
    )
    (usual, *others) = (
        (f"{iterations:,} iterations of {batch:,} steps", rows)
        for (iterations, batch), rows in by_budget.items()
    )
    apart = [f"; on {', '.join(rows)} {length}" for length, rows in others]
    return usual[0] + "".join(apart)


def budgets(table: pd.DataFrame) -> pd.DataFrame:
    """How long our runs behind each cell are: million control steps, and in brackets seeds.

    Bold where they are as long as the thesis's with enough seeds; a row a robot and ground.
    """
    lines = []
    for (ground, robot), own in table.groupby(["trained_on", "task"], sort=False):
        line = {"robot": robot if ground == "flat" else f"{robot} {ground}"}
        for cell in own.itertuples():
            length = f"{cell.iterations * cell.batch_steps / 1e6:.3g} ({cell.seeds})"
            whole = cell.printed_budget and cell.seeds >= ENOUGH
            line[cell.architecture] = f"**{length}**" if whole else length
            if not cell.seeds:
                line[cell.architecture] = None
        lines.append(line)
    return pd.DataFrame(lines, columns=["robot", *NETS])


def misprints(tables: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """What is known of printed entries, one line for those of a table with the same note.

    Parameters
    ----------
    tables
        Cells by the number of their table, such as ``C.1``.
    """
    lines = []
    for name, cells in tables.items():
        for note, own in cells[cells.note != ""].groupby("note", sort=False):
            nets = several(own.architecture.unique())
            rows = several(dict.fromkeys(own.task + " " + own.trained_on))
            lines.append(
                {
                    "table": name,
                    "entry": f"{rows}, {nets}" if len(own) < 3 else f"all {len(own)} of {nets}",
                    "printed": several(own.printed.map("{:.1f}".format)) if len(own) < 3 else None,
                    "what is known": f"{note[0].upper()}{note[1:]}.",
                }
            )
    return pd.DataFrame(lines, columns=["table", "entry", "printed", "what is known"])


def left_to_run(table: pd.DataFrame) -> str:
    """Which rows of a table of cells have no run, and what is left at the printed length."""
    rows = table.task + " " + table.trained_on
    none = table.seeds.groupby(rows, sort=False).max() == 0
    words = f"Nothing has been run on {several(none.index[none])}. " if none.any() else ""
    left = table[~(table.printed_budget & (table.seeds >= ENOUGH))]
    if left.empty:
        return f"{words}Every cell has been run at the printed length."
    nets = left.architecture.str.lower()
    seconds = sum(
        cost(TrainConfig(task=robot, terrain=ground, architecture=net))
        for robot, ground, net in zip(left.task, left.trained_on, nets, strict=True)
    )
    return (
        f"{words}Of {len(table)} cells {len(left)} have not been run at the printed length with "
        f"{ENOUGH} seeds; that takes about {number(ENOUGH * seconds / 3600)} processor hours."
    )
