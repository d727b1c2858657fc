"""Tables 5.3 and C.1 to C.3: returns of fixed, greedy policies (section 5.5.2, appendix C)."""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy.stats import binomtest, norm, spearmanr, ttest_1samp

from thesis_lib import published
from thesis_lib.chapter5.cell_table import (
    Cell,
    beside,
    best_against_best,
    whole,
    whole_rows,
    wide,
)
from thesis_lib.chapter5.cells import GROUPS, NETS, TEST_RUNS
from thesis_lib.chapter5.contrasts import Config, comparisons
from thesis_lib.chapter5.judging import Evidence, Said, ahead, both, difference, of_rows, pick
from thesis_lib.chapter5.runs import CELL, plain
from thesis_lib.edition.criteria import LEVEL, exact, graded
from thesis_lib.edition.experiment import Context, Experiment, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.robustness import CONDITIONS, TRAINED_ON
from thesis_lib.stats import holm

ON_PAR = 0.1
"""Share of the best return by which a group may be behind another and be on a par with it."""

LIMIT = 0.99
"""Rank correlations of seven nets are taken as no nearer to 1 than this before Fisher's z."""


def _returns(table: str, condition: str, item: str) -> Experiment[Config]:
    """The experiment of one printed table of test returns."""

    def cells(config: Config, context: Context) -> list[Cell]:
        store = config.runs()
        tests = plain(store.returns())
        ends = store.learning()[[*CELL, "seed", "last_return"]]
        runs = (
            tests[tests.condition == condition]
            .merge(ends, on=[*CELL, "seed"])
            .rename(columns={"return": "value"})
        )
        return beside(table, runs, TEST_RUNS)

    cells.__doc__ = f"{published.TABLES[table]}, printed and ours, by robot, ground and net"
    return experiment(table, item=item, smoke=Config(), book=Config(), seconds=2)(cells)


table_5_3 = _returns("table-5.3", "base", "Table 5.3")
table_c_1 = _returns("table-c.1", "base", "Table C.1")
table_c_2 = _returns("table-c.2", "noise", "Table C.2")
table_c_3 = _returns("table-c.3", "switch", "Table C.3")


@both("5.5.2-no-single-best", table_c_1, comparisons)
def no_single_best(source: str, table: pd.DataFrame, both_units: pd.DataFrame) -> Evidence | None:
    """Winners of the rows, and whether one net is ahead of all others on average."""
    rows = whole_rows(table, source, TEST_RUNS, least=2)
    if rows.empty:
        return None
    winners = wide(rows, "value").idxmax(axis=1).value_counts()
    champions = [
        net
        for net in NETS
        if (found := ahead(both_units, source, "test", "all", [net], NETS, tasks=True))
        and found.verdict is Verdict.REPRODUCED
    ]
    one = len(winners) == 1 or bool(champions)
    listed = ", ".join(f"{net} {count}" for net, count in winners.items())
    return of_rows(
        rows,
        Verdict.REFUTED if one else Verdict.REPRODUCED,
        f"best in the regular test on {winners.sum()} rows: {listed}; ahead of all others on "
        f"average, with tasks as the unit too: {', '.join(champions) or 'none'}.",
    )


def _in_both(source: str, table: pd.DataFrame) -> pd.DataFrame:
    """FNNs against RNNs in learning and in the regular test, if both are there."""
    rows = [pick(table, source, what, "all", ["FNNs"], ["RNNs"]) for what in ("learning", "test")]
    return pd.concat(rows if all(map(len, rows)) else [table.iloc[:0]])


@both("5.5.2-fnn-drops", comparisons, rows=_in_both)
def fnn_drops(rows: pd.DataFrame) -> Said:
    """Lead of FNNs over RNNs in learning less that in the regular test."""
    learning, test = (row for _, row in rows.iterrows())
    drop = learning.difference - test.difference
    error = np.hypot(*((r.high - r.low) / (2 * norm.ppf(0.975)) for r in (learning, test)))
    p = 2 * norm.sf(abs(drop) / error)
    return (
        graded(drop > 0 and p < LEVEL, drop > 0, denied=p < LEVEL),
        f"FNNs less RNNs {difference(learning)} in learning and {difference(test)} in the "
        f"regular test, a fall of {drop:.3f} (p = {p:.2g}, intervals taken as normal).",
    )


@both("5.5.2-best-rnn", table_c_1, rows=whole(TEST_RUNS, errors=True))
def best_rnn(rows: pd.DataFrame) -> Said:
    """Rows on which the best RNN earns more than the best FNN: one of five against one of two."""
    tests = {at: best_against_best(row) for at, row in rows.groupby(["trained_on", "task"])}
    pairs = len(GROUPS["RNNs"]) * len(GROUPS["FNNs"])
    p = holm([min(1.0, pairs * test.p_value) for test in tests.values()])
    more = pd.Series({at: test.difference > 0 for at, test in tests.items()})
    sure = more & (p < LEVEL)
    by, clear, of = (
        part.groupby(level=0).sum().reindex(list(TRAINED_ON), fill_value=0)
        for part in (more, sure, more | True)
    )
    chance = len(GROUPS["RNNs"]) / len(NETS)
    by_chance = binomtest(int(more.sum()), len(more), chance, alternative="greater").pvalue
    verdict = graded(2 * sure.sum() > len(sure), by_chance < LEVEL)
    sentence = (
        f"the best RNN earns more than the best FNN on {by['flat']} of {of['flat']} rows trained "
        f"on the flat ({clear['flat']} significantly, Welch, corrected for the choice of the two "
        f"and for the rows) and {by['hill']} of {of['hill']} trained on hills ({clear['hill']}); "
        f"of seven equal nets an RNN would be best on {chance:.0%} of rows (p = {by_chance:.2g})."
    )
    return verdict, sentence


def _on_hills(source: str, table: pd.DataFrame) -> pd.DataFrame:
    return pick(table, source, "test", "hill", ["FNNs"], ["RNNs"])


@both("5.5.2-fnn-rugged", comparisons, rows=_on_hills)
def fnn_rugged(rows: pd.DataFrame) -> Said:
    """FNNs against RNNs after training on hills: not below."""
    row = rows.iloc[0]
    below = row.difference < 0 and row.p_runs < LEVEL
    verdict = graded(row.low > -ON_PAR, denied=below, otherwise=Verdict.INCONCLUSIVE)
    return verdict, f"FNNs less RNNs {difference(row)} of the best return on a task."


@criterion("table-5.3-is-c.1", table_5_3, table_c_1)
def same_table(short: pd.DataFrame, full: pd.DataFrame) -> Finding:
    """Cells of the two printed tables that differ."""
    keys = ["trained_on", "task", "architecture"]
    pair = short.merge(full, on=keys, suffixes=("", "_c"))
    apart = pair[(pair.printed != pair.printed_c) | (pair.printed_error != pair.printed_error_c)]
    listed = "; ".join(
        f"{r.task} {r.trained_on}, {r.architecture}: {r.printed:.1f} and {r.printed_c:.1f}"
        for r in apart.itertuples()
    )
    return exact(
        apart.empty,
        f"{len(apart)} of {len(pair)} cells differ{': ' + listed if listed else ''}.",
    )


@criterion("5.4-regular-test", table_c_1, table_c_3)
def regular_test(base: pd.DataFrame, switch: pd.DataFrame) -> Finding:
    """Hill-trained swimmers in the regular test and where hills come after the switch."""
    both_tests = [
        t[(t.task == "Swimmer") & (t.trained_on == "hill")].set_index("architecture").printed
        for t in (base, switch)
    ]
    ratio = both_tests[0] / both_tests[1]
    return Finding(
        graded((ratio <= 1).all(), denied=(ratio > 2).all()),
        f"Hill-trained swimmers earn {both_tests[0].min():.0f} to {both_tests[0].max():.0f} in the "
        f"regular test, {ratio.min():.1f} to {ratio.max():.1f} times what they earn where hills "
        "begin some way ahead. On hills from the start they would earn no more than there; the "
        "captions of tables 5.3 and C.1 say flat terrain.",
    )


def _in_every_test(source: str, *tables: pd.DataFrame) -> pd.DataFrame:
    """Cells of flat-trained robots of which every net has been tested in all conditions."""
    tests = [t.assign(condition=name) for name, t in zip(CONDITIONS, tables, strict=True)]
    asked = pd.concat(tests, ignore_index=True)
    return whole_rows(asked[asked.trained_on == "flat"], source, TEST_RUNS, least=2)


@both("5.5.2-gait-quality", table_c_1, table_c_2, table_c_3, rows=_in_every_test)
def gait_quality(rows: pd.DataFrame) -> Said:
    """Rank correlation over nets of base and perturbed return, by robot, flat-trained."""
    regular, noisy, hilly = (
        wide(rows[rows.condition == name], "value").to_numpy() for name in CONDITIONS
    )
    with_noise, with_hills = (
        np.array([spearmanr(a, b).statistic for a, b in zip(regular, other, strict=True)])
        for other in (noisy, hilly)
    )
    gap = np.arctanh(np.clip(with_hills, -LIMIT, LIMIT))
    gap -= np.arctanh(np.clip(with_noise, -LIMIT, LIMIT))
    p = float(ttest_1samp(gap, 0).pvalue)
    return (
        graded(gap.mean() > 0 and p < LEVEL, gap.mean() > 0),
        "rank correlation over nets between the regular return and the perturbed one, mean of "
        f"the robots: {with_hills.mean():.2f} under the switch and {with_noise.mean():.2f} "
        f"under noise; higher under the switch for {(gap > 0).sum()} of {len(gap)} robots "
        f"(paired t-test of Fisher's z, p = {p:.2g}).",
    )
