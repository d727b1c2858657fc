"""What section 4.3 says of each domain's features: exact task and domain relevance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import get_args

import numpy as np
import pandas as pd

from thesis_lib.chapter4.figure_4_1 import FEATURES
from thesis_lib.chapter4.runs import exact_solutions
from thesis_lib.domains import Domain, continuing_cliff, episodic_cliff, stock, triangle
from thesis_lib.domains.stock import RewardTiming
from thesis_lib.edition.criteria import judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, criterion
from thesis_lib.edition.words import several
from thesis_lib.relevance import domain_relevance, k_relevance, remove

ROUNDING = 1e-9
"""Relevance below this counts as none."""


@dataclass(frozen=True)
class Config:
    """Settings of the comparison."""

    global_factors: tuple[int, ...] = (1, 2, 3, 4, 5)
    """G of the stock domains."""


@dataclass(frozen=True)
class Relevance:
    """One feature of one domain."""

    domain: str
    """Name."""
    reading: str
    """For stock, when the reward is paid; for the triangle, its shape."""
    n_tasks: int
    """|M|."""
    n_pairs: int
    """|X|."""
    feature: str
    """Removed alone from the full set."""
    task_relevance: float
    """rho_1, squared reward."""
    domain_relevance: float
    """rho_infinity, squared reward."""
    share: float
    """Domain relevance over that of removing every feature."""


@experiment(
    "ch4-relevance",
    item="Section 4.3 (domains)",
    smoke=Config(global_factors=(1, 2)),
    book=Config(),
    seconds=0.3,
)
def relevances(config: Config, context: Context) -> list[Relevance]:
    """Exact task and domain relevance of every feature of the thesis's domains."""
    makers: Mapping[tuple[str, str], Callable[[], Domain]] = {
        ("triangle", "as used"): triangle,
        ("triangle", "on a line"): partial(triangle, shape="line"),
        ("continuing cliff", "as used"): continuing_cliff,
        ("episodic cliff", "as used"): partial(episodic_cliff, True),
        **{(f"stock G={g}", "after_next"): partial(stock, 1, 2, g) for g in config.global_factors},
        **{
            ("stock G=2", timing): partial(stock, 1, 2, 2, reward_timing=timing)
            for timing in get_args(RewardTiming)
            if timing != "after_next"
        },
    }
    records = []
    for (name, reading), make in makers.items():
        solutions = exact_solutions(make())
        total = domain_relevance(solutions, np.zeros(solutions.n_pairs, dtype=np.int64))
        for feature in solutions.feature_names:
            labels = remove(solutions, [feature])
            limit = max(domain_relevance(solutions, labels), 0.0)
            records.append(
                Relevance(
                    domain=name,
                    reading=reading,
                    n_tasks=solutions.n_tasks,
                    n_pairs=solutions.n_pairs,
                    feature=feature,
                    task_relevance=max(float(k_relevance(solutions, labels, 1)), 0.0),
                    domain_relevance=limit,
                    share=limit / total,
                )
            )
    return records


def _of(table: pd.DataFrame, domain: str, reading: str = "as used") -> pd.DataFrame:
    """The rows of one domain by feature."""
    own = table[(table.domain == domain) & (table.reading == reading)]
    return own.set_index("feature")


@criterion("4-triangle-features", relevances)
def triangle_features(table: pd.DataFrame) -> Finding:
    """Exact 1-relevance and domain relevance of the triangle's features, each removed alone."""
    own = _of(table, "triangle")
    task, domain = own.task_relevance > ROUNDING, own.domain_relevance > ROUNDING
    position = bool(task["x1"] and not domain["x1"])
    colour = bool(not task["x3"] and domain["x3"])
    listed = several(
        f"{own.task_relevance[f]:.2f} and {own.domain_relevance[f]:.2f} ({FEATURES[f]})"
        for f in ("x1", "x3", "x2")
    )
    return judged(
        position and colour and task["x2"] and domain["x2"],
        f"Task and domain relevance of a feature removed alone: {listed}. By (4.9) distance is "
        f"{'' if task['x2'] else 'not '}task relevant; within a task the position gives it away.",
        dict(own.task_relevance.add_suffix(" task")) | dict(own.domain_relevance),
        direction=position and colour,
    )


@criterion("4.3-triangle-relevance", relevances)
def triangle_relevance(table: pd.DataFrame) -> Finding:
    """Exact domain relevance of the triangle's features."""
    share = _of(table, "triangle").share
    line = _of(table, "triangle", "on a line").share
    listed = several(f"{v:.0%} ({FEATURES[f]})" for f, v in share.items())
    return judged(
        share["x1"] < ROUNDING and (share.drop("x1") > 0.05).all(),
        f"Share of what removing all features loses, on a ring of states: {listed}; on a line the "
        f"state number has {line['x1']:.0%}.",
        dict(share),
    )


@criterion("4.3-cliff-relevance", relevances)
def cliff_relevance(table: pd.DataFrame) -> Finding:
    """Exact domain relevance of the cliff's position features."""
    by = {name: _of(table, name) for name in ("continuing cliff", "episodic cliff")}
    listed = "; ".join(
        f"{name}: {own.domain_relevance['x']:.3f} for x, {own.domain_relevance['y']:.3f} for y, "
        f"{own.domain_relevance['cliff']:,.0f} for the sensor"
        for name, own in by.items()
    )
    shares = pd.concat([own.share[["x", "y"]] for own in by.values()])
    return judged(
        shares.between(0, 1e-3, inclusive="neither").all(),
        f"Exact domain relevance, {listed}.",
        {"largest share": float(shares.max())},
    )


@criterion("4-cliff-sensor-both", relevances)
def cliff_sensor(table: pd.DataFrame) -> Finding:
    """Exact 1-relevance and domain relevance of the cliff sensor, removed alone."""
    by = {name: _of(table, name).loc["cliff"] for name in ("continuing cliff", "episodic cliff")}
    task, domain = (
        all(own[f"{kind}_relevance"] > ROUNDING for own in by.values())
        for kind in ("task", "domain")
    )
    listed = several(
        f"{own.task_relevance:,.2g} and {own.domain_relevance:,.0f} ({name})"
        for name, own in by.items()
    )
    return judged(
        task and domain,
        f"Task and domain relevance of the sensor, removed alone: {listed}. What counts as none is "
        f"below {ROUNDING:.0g}; within a task the position may give it away.",
        {
            f"{name} {kind}": float(own[f"{kind}_relevance"])
            for name, own in by.items()
            for kind in ("task", "domain")
        },
        direction=domain,
    )


def _statements(own: pd.DataFrame) -> list[bool]:
    """Whether each of the four statements on the stock domain's features holds."""
    factors = [f for f in own.index if f.startswith("g")]
    others = [*(f for f in own.index if "e" in f), "a"]
    task, domain = own.task_relevance, own.domain_relevance
    return [
        bool(task["s1"] < ROUNDING and domain["s1"] < ROUNDING),
        bool((domain[others] > ROUNDING).all()),
        bool((domain[factors] < ROUNDING).all()),
        bool(task[factors].min() > task[others].max()),
    ]


@criterion("4.3-stock-relevance", relevances)
def stock_relevance(table: pd.DataFrame) -> Finding:
    """The four statements on relevance in the stock domain, and which reading meets them."""
    readings = table[table.domain == "stock G=2"].reading.unique()
    met = {r: _statements(_of(table, "stock G=2", r)) for r in readings}
    sizes = [g for g in range(1, 6) if (table.domain == f"stock G={g}").any()]
    strong = [g for g in sizes if _statements(_of(table, f"stock G={g}", "after_next"))[3]]
    counts = several(
        f"{sum(m)} with ownership {when} the action and the {which} stocks"
        for (when, _, which), m in ((r.partition("_"), m) for r, m in met.items())
    )
    return judged(
        all(met["after_next"]) and len(strong) == len(sizes),
        "Of the four statements (ownership irrelevant, stocks and action relevant, factors "
        "irrelevant across tasks, factors more task relevant than the rest) at G = 2 so many hold, "
        f"by what the reward counts: {counts}. With the reading used a single factor is more task "
        "relevant than anything else at G = "
        f"{several(map(str, strong)) if strong else 'none'} of {several(map(str, sizes))}.",
        {reading: sum(m) for reading, m in met.items()},
        direction=all(met["after_next"]),
    )


@criterion("4.3-stock-sizes", relevances)
def stock_sizes(table: pd.DataFrame) -> Finding:
    """|X| and |M| of the stock domains."""
    own = table[table.domain.str.startswith("stock")].drop_duplicates("domain")
    sizes = {int(r.domain[-1]): (r.n_pairs, r.n_tasks) for r in own.itertuples()}
    right = all(size == (16 * 2**g, 3 * 2**g) for g, size in sizes.items())
    listed = "; ".join(f"G = {g}: |X| = {x}, |M| = {m}" for g, (x, m) in sorted(sizes.items()))
    return judged(right and sizes.get(5) == (512, 96), f"{listed}.")


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Task and domain relevance on the triangle, the continuing cliff, stock with few factors."""
    domains = ("triangle", "continuing cliff", "stock G=1", "stock G=2")
    own = table[table.domain.isin(domains) & table.reading.isin(("as used", "after_next"))]
    return pd.DataFrame(
        {
            "domain": own.domain,
            "feature": own.feature,
            "task relevance": own.task_relevance,
            "domain relevance": own.domain_relevance,
            "share": own.share.map("{:.1%}".format),
        }
    )
