"""Which policy is "the best learned" one: what the regular test says by three rules (section 5.4).

All seeds: the last policy of every run, the mean of which our tables have.  Best seed: the last
policy of the run that earned most over its last iterations.  Best batch: of every run the policy
that collected its best batch, tested by ``thesis test-policies results/study/LAYER/policies.pt
--rule all --policy best --conditions base --out results/study/LAYER/best-batch``.
"""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd

from thesis_lib.chapter5.cells import NETS
from thesis_lib.chapter5.contrasts import Config
from thesis_lib.chapter5.runs import CELL, Runs, plain
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.words import several

ALL, SEED, BATCH = "all seeds", "best seed", "best batch"


@dataclass(frozen=True)
class Tested:
    """The regular test of one net by one rule."""

    rule: str
    """All seeds, best seed or best batch."""
    task: str
    """Robot."""
    trained_on: str
    """Flat or hill."""
    architecture: str
    """Net."""
    value: float
    """Mean 1000-step return on flat ground."""
    seeds: int
    """Runs of training that the rule chose among: those of which both policies were tested."""


@experiment("ch5-best-policy", item="Section 5.4", smoke=Config(), book=Config(), seconds=2)
def by_rule(config: Config, context: Context) -> list[Tested]:
    """Regular returns by the rule that says which policy is the best learned one."""
    store = config.runs()
    last, best = (_regular(store, policy) for policy in ("last", "best"))
    ends = store.learning()[[*CELL, "seed", "last_return"]]
    runs = last.merge(best, on=[*CELL, "seed"], suffixes=("", "_best"))
    runs = runs.merge(ends, on=[*CELL, "seed"])
    rows = []
    for (robot, ground, net), own in runs.groupby(["task", "terrain", "architecture"]):
        values = {
            ALL: own["return"].mean(),
            SEED: own["return"].loc[own.last_return.idxmax()],
            BATCH: own.return_best.mean(),
        }
        rows += [
            Tested(rule, robot, ground, net.upper(), float(value), len(own))
            for rule, value in values.items()
        ]
    return rows


def _regular(store: Runs, policy: str) -> pd.DataFrame:
    """Returns of the regular test, one row a run of training."""
    tests = plain(store.returns(policy=policy))
    return tests[tests.condition == "base"][[*CELL, "seed", "return"]]


def _whole(table: pd.DataFrame) -> pd.DataFrame:
    """Returns on the rows with every net: rule, ground and robot down, nets across."""
    wide = table.pivot(index=["rule", "trained_on", "task"], columns="architecture", values="value")
    return wide.reindex(columns=list(NETS)).dropna()


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Mean share of the best net's return by rule, and who is best on how many rows."""
    by = _whole(table)
    columns: dict[str, list[str]] = {"net": list(NETS)}
    if by.empty:
        return pd.DataFrame(columns)
    share = by.div(by.max(axis=1), axis=0).groupby("rule").mean()
    won = by.idxmax(axis=1).groupby("rule").value_counts().unstack(fill_value=0)
    won = won.reindex(columns=list(NETS), fill_value=0)
    for rule in (ALL, SEED, BATCH):
        if rule in share.index:
            pairs = zip(share.loc[rule], won.loc[rule], strict=True)
            columns[rule] = [f"{value:.2f} ({count})" for value, count in pairs]
    return pd.DataFrame(columns)


def reading(table: pd.DataFrame) -> str:
    """What changes with the rule."""
    by = _whole(table)
    if by.empty:
        return "No row has tests of every net's last policy and of that of its best batch yet."
    usual, best = by.loc[ALL], by.idxmax(axis=1)
    told = []
    for rule in (SEED, BATCH):
        ratio = (by.loc[rule] / usual).stack()
        other = best.loc[rule] != best.loc[ALL]
        rows = [f"{robot} {ground}" for ground, robot in other[other].index]
        told.append(
            f"By the {rule} the regular return is {ratio.median():.2f} times that over all seeds "
            f"in the median of cells, and another net is best on {len(rows)} of {len(other)} rows"
            f"{f' ({several(rows)})' if rows else ''}."
        )
    return " ".join(told)
