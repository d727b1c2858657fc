"""Features that depend on one another: what sections 4.1 and 4.2 say of them, on small examples.

"ABCD" is footnote 2's: the target depends on A and B, and C and D together say what B says.  In
"xor" two features matter only together.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
import pandas as pd

from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.edition.criteria import EXACT, exact, judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.words import number, several
from thesis_lib.relevance import Solutions, domain_relevance, keep, remove
from thesis_lib.selection import IBKR


@dataclass(frozen=True)
class Config:
    """How many targets of each example are drawn, and how many features are removed one by one."""

    targets: int = 100
    """Random targets of ABCD."""
    features: tuple[int, ...] = (2, 4, 8, 16)
    """Numbers P of features, all irrelevant."""


@dataclass(frozen=True)
class Subset:
    """One set of features of one example."""

    example: str
    """ABCD, xor; or "all removed", where every feature but one is irrelevant."""
    target: int
    """Which random target; the number of features for "all removed"."""
    features: str
    """The set F."""
    relevance: float
    """Relevance of removing it, as a share of removing all features."""
    strength: float
    """Relevance that it has by itself, forward, in the same unit."""
    kept: str
    """What is kept in the end by backward elimination that removes, of what is marked, the
    feature weakest by itself."""
    tests: int
    """How many features that elimination tested, over all its rounds."""


def _rows(example: str, target: int, q: FloatArray, features: IntArray, names: str) -> list[Subset]:
    n = len(q)
    solutions = Solutions(q[None], np.full((1, n), 1 / n), features, tuple(names))
    total = domain_relevance(solutions, np.zeros(n, dtype=np.int64))
    selector = IBKR().fit(solutions)
    kept = "".join(selector.get_feature_names_out())
    tests = sum(len(r.checks) for r in selector.history_)
    sets = [
        *names,
        *("".join(c) for r in (2, 3) for c in combinations(names, r) if len(names) <= 4),
    ]
    return [
        Subset(
            *(example, target, chosen),
            domain_relevance(solutions, remove(solutions, chosen)) / total,
            domain_relevance(solutions, keep(solutions, chosen), direction="forward") / total,
            *(kept, tests),
        )
        for chosen in sets
    ]


@experiment(
    "ch4-interdependence",
    item="Sections 4.1 and 4.2 (interdependence)",
    smoke=Config(2, (2, 4)),
    book=Config(),
    seconds=0.5,
)
def subsets(config: Config, context: Context) -> list[Subset]:
    """Relevance of sets of features that depend on one another, and what elimination keeps."""
    bits = (np.arange(8)[:, None] >> np.arange(3)) & 1
    a, c, d = bits.T
    b = 2 * c + d
    rows = []
    for i, seed in enumerate(context.seeds(config.targets, 41)):
        values = np.random.default_rng(seed).normal(size=(2, 4))
        rows += _rows("ABCD", i, values[a, b], np.stack([a, b, c, d], axis=1), "ABCD")
    rows += _rows("xor", 0, (a[:4] ^ c[:4]).astype(float), np.stack([a, c], axis=1)[:4], "AB")
    for p in config.features:
        # What is irrelevant repeats what the relevant feature says.
        copies = np.repeat(np.arange(2)[:, None], p, axis=1)
        names = "".join(chr(ord("a") + i) for i in range(p))
        rows += _rows("all removed", p, np.array([0.0, 1.0]), copies, names)
    return rows


def _by_set(table: pd.DataFrame, column: str) -> pd.DataFrame:
    """One column of ABCD, one row a target, one column a set."""
    return table[table.example == "ABCD"].pivot(index="target", columns="features", values=column)


@criterion("4.1-not-additive", subsets)
def not_additive(table: pd.DataFrame) -> Finding:
    """Whether the relevance of two sets together is that of the one plus that of the other."""
    by = _by_set(table, "relevance")
    gap = (by.BCD - by.B - by.CD).abs()
    return judged(
        (gap > EXACT).all(),
        f"Relevance of {{B, C, D}} less that of {{B}} and that of {{C, D}}: {gap.min():.2f} to "
        f"{gap.max():.2f} of that of all features, over {len(by)} targets.",
        {"least": float(gap.min())},
        otherwise=Verdict.REFUTED,
    )


@criterion("4.2-abcd", subsets)
def forward_removes_the_weaker(table: pd.DataFrame) -> Finding:
    """Relevance of B, C and D, how strong each is alone, and what is kept."""
    relevance, strength = _by_set(table, "relevance"), _by_set(table, "strength")
    none = (relevance[["B", "C", "D"]].abs() < EXACT).all(axis=None)
    weaker = strength[["C", "D"]].max(axis=1) < strength.B
    kept = table[table.example == "ABCD"].groupby("target").kept.first().value_counts()
    told = ", ".join(f"{{{', '.join(s)}}} for {n}" for s, n in kept.items())
    largest = float(relevance[["B", "C", "D"]].abs().max(axis=None))
    return judged(
        none and weaker.all() and set(kept.index) == {"AB"},
        f"Relevance of B, C and D, each removed alone: at most {number(largest)}. C and D are both "
        f"weaker than B by themselves for {weaker.mean():.0%} of {len(relevance)} targets; kept "
        f"are {told}.",
        {"weaker": float(weaker.mean())},
        otherwise=Verdict.REFUTED,
    )


@criterion("4.2-smaller-subset")
def forward_choice_keeps_fewer() -> Finding:
    """What is kept of ABCD where forward relevance chooses what goes, and where the order does."""
    bits = (np.arange(8)[:, None] >> np.arange(3)) & 1
    a, c, d = bits.T
    columns = dict(zip("ABCD", (a, 2 * c + d, c, d), strict=True))
    q, p = (a + 2.0 * c + d)[None], np.full((1, 8), 1 / 8)
    forward, first = [], []
    for order in permutations("ABCD"):
        features = np.stack([columns[name] for name in order], axis=1)
        solutions = Solutions(q, p, features, order)
        forward.append(_named(IBKR().fit(solutions).get_feature_names_out()))
        first.append(_named(_first_marked_goes(solutions)))
    sizes, others = (np.array([len(kept) for kept in own]) for own in (forward, first))
    by_forward, by_order = (
        several(f"{{{', '.join(kept)}}} in {n}" for kept, n in Counter(own).items())
        for own in (forward, first)
    )
    return exact(
        (sizes <= others).all() and (sizes < others).any(),
        f"Kept of ABCD with the target A + B, over the {len(forward)} orders of the features: "
        f"{by_forward} where the feature weakest by itself goes of those that are marked; "
        f"{by_order} where the first of them goes.",
    )


def _named(kept: Iterable[str]) -> str:
    return "".join(sorted(kept))


def _first_marked_goes(solutions: Solutions) -> list[str]:
    """What is kept where, of the features whose removal loses nothing, the first one goes."""
    removed, names = list[str](), solutions.feature_names
    while True:
        left = [name for name in names if name not in removed]
        marked = (
            name for name in left
            if domain_relevance(solutions, remove(solutions, [*removed, name])) < EXACT
        )  # fmt: skip
        if (gone := next(marked, None)) is None:
            return left
        removed.append(gone)


@criterion("4.2-interdependence", subsets)
def alone_and_together(table: pd.DataFrame) -> Finding:
    """Strength alone of features that matter together only, and relevance once another is gone."""
    xor = table[table.example == "xor"].set_index("features")
    hidden = (
        xor.strength[["A", "B"]].abs().max() < EXACT and xor.relevance[["A", "B"]].min() > EXACT
    )
    by = _by_set(table, "relevance")
    wakes = (by.B.abs() < EXACT) & (by.BC > EXACT)
    return judged(
        hidden and wakes.all(),
        f"In xor each feature has strength {number(xor.strength[['A', 'B']].abs().max())} by "
        f"itself and relevance {number(xor.relevance[['A', 'B']].min())} beside the other. In ABCD "
        f"B is irrelevant, and relevant once C is gone, for {wakes.mean():.0%} of {len(by)} "
        "targets.",
        {"wakes": float(wakes.mean())},
        otherwise=Verdict.REFUTED,
    )


@criterion("4.2-quadratic", subsets)
def tests_are_quadratic(table: pd.DataFrame) -> Finding:
    """Features tested until all but one of P are removed, beside P(P + 1)/2."""
    own = table[table.example == "all removed"].groupby("target").tests.first()
    printed = own.index * (own.index + 1) / 2
    told = several(f"{n} for P = {p}" for p, n in own.items())
    return judged(
        (own == printed).all(),
        f"Features tested, over all rounds: {told}; P(P + 1)/2 is "
        f"{several(f'{n:.0f}' for n in printed)}.",
        {f"P = {p}": float(n) for p, n in own.items()},
        otherwise=Verdict.REFUTED,
    )
