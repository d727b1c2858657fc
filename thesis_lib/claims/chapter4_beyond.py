"""Claims of chapter 4 on value functions (task relevance) and on functions that are no tables."""

from __future__ import annotations

import pandas as pd

from thesis_lib.claims import Claim, Difference, Finding, Tables, Verdict


def triangle_features(tables: Tables) -> Finding:
    """Exact 1-relevance and domain relevance of the triangle's features, each removed alone."""
    table = tables["section-4.3-relevance"]
    own = table[(table.domain == "triangle") & (table.reading == "as used")].set_index("feature")
    tiny = 1e-9
    task, domain = own.task_relevance > tiny, own.domain_relevance > tiny
    holds = {
        "position": bool(task["x1"] and not domain["x1"]),
        "colour": bool(not task["x3"] and domain["x3"]),
        "distance": bool(task["x2"] and domain["x2"]),
    }
    told = ", ".join(
        f"{name} {own.task_relevance[f]:.2f} and {own.domain_relevance[f]:.2f}"
        for name, f in (("position", "x1"), ("colour", "x3"), ("distance", "x2"))
    )
    evidence = (
        f"Task and domain relevance of removing it alone: {told}. By (4.9) distance is not task "
        "relevant, because within a task the position gives it away."
    )
    if all(holds.values()):
        return Finding(Verdict.REPRODUCED, evidence)
    most = holds["position"] and holds["colour"]
    return Finding(Verdict.DIRECTION if most else Verdict.NOT_REPRODUCED, evidence)


def _once(table: pd.DataFrame, method: str, n: int) -> pd.DataFrame:
    own = table[(table.method == method) & (table.tasks_seen == n)]
    return own.drop_duplicates("domain").set_index("domain")


def smaller_table(tables: Tables) -> Finding:
    """How many times fewer steps the task-relevant table takes than the full one."""
    table = tables["task-relevance-learning"]
    n = sorted(table.tasks_seen.unique())[-2]
    own = _once(table, "table", n)
    full = _once(table, "full", n)
    told = "; ".join(
        f"{domain}: {row.pairs:.0f} entries instead of {full.pairs[domain]:.0f}, "
        f"{row.factor:.1f} times fewer steps (95% interval {row.factor_low:.1f} to "
        f"{row.factor_high:.1f})"
        for domain, row in own.iterrows()
    )
    evidence = f"After {n} tasks, to 90% of the full table's gain. {told}."
    if (own.factor_low > 1).all():
        return Finding(Verdict.REPRODUCED, evidence)
    faster = bool((own.factor > 1).all())
    return Finding(Verdict.DIRECTION if faster else Verdict.NOT_REPRODUCED, evidence)


def negligible_error(tables: Tables) -> Finding:
    """Whether the table lacks what new tasks need, and what it earns in the end."""
    table = tables["task-relevance-learning"]
    end = table[table.step > 0.75 * table.groupby("domain").step.transform("max")]
    reward = end.groupby(["domain", "tasks_seen", "method"]).reward.mean()
    most, fewest = table.tasks_seen.max(), table.tasks_seen.min()
    own, early = _once(table, "table", most), _once(table, "table", fewest)
    gap = {d: float(reward[d, most, "table"] - reward[d, most, "full"]) for d in own.index}
    told = "; ".join(
        f"{d}: a feature that matters is missing in {early.hidden[d]:.0%} of the new tasks after "
        f"{fewest} and in {own.hidden[d]:.1%} after {most}, when the last quarter earns "
        f"{gap[d]:+.3f} a step relative to the full table"
        for d in own.index
    )
    holds = bool((own.hidden <= 0.05).all()) and min(gap.values()) >= 0
    shrinks = bool((own.hidden <= early.hidden).all())
    return Finding(
        Verdict.REPRODUCED if holds else (Verdict.DIRECTION if shrinks else Verdict.NOT_REPRODUCED),
        f"{told[0].upper()}{told[1:]}.",
    )


def weights_extrapolate(tables: Tables) -> Finding:
    """Whether weights of a linear function, and their squares, change with k by the law."""
    table = tables["function-law"]
    squares = table[table.function == "squared weight"]
    weights = table[(table.function == "weight")]
    change = float(weights.groupby("feature").value.agg(lambda v: v.max() - v.min()).max())
    falls = {f: (own.value.iloc[0], own.value.iloc[-1]) for f, own in squares.groupby("feature")}
    exact = float(squares.misfit.max())
    told = ", ".join(f"without {f} from {a:.4f} to {b:.4f}" for f, (a, b) in falls.items())
    evidence = (
        f"Expected weights do not change with k at all (by {change:.0e} at most), so there is "
        f"nothing to extrapolate in them. Expected squared weights fall by the law, to "
        f"{exact:.0e}, up to k = {int(table.k.max())}: {told.replace('without ', 'for ')}."
    )
    squared = exact < 1e-12
    if squared and change > 1e-9:
        return Finding(Verdict.REPRODUCED, evidence)
    return Finding(Verdict.DIRECTION if squared else Verdict.NOT_REPRODUCED, evidence)


def other_approximators(tables: Tables) -> Finding:
    """Rates of selection by networks and on tables after the most tasks, on every domain."""
    table = tables["function-selection"]
    own = table[table.tasks_seen == table.tasks_seen.max()]
    by = own.set_index(["domain", "method"])
    domains = list(dict.fromkeys(own.domain))
    told = "; ".join(
        f"{d}: tables {by.fpr[d, 'table']:.2f}/{by.tpr[d, 'table']:.2f}, linear "
        f"{by.fpr[d, 'linear']:.2f}/{by.tpr[d, 'linear']:.2f}, networks "
        f"{by.fpr[d, 'network']:.2f}/{by.tpr[d, 'network']:.2f}"
        for d in domains
    )
    nets = [(by.fpr[d, "network"], by.tpr[d, "network"]) for d in domains]
    good = all(fpr <= 0.15 and tpr >= 0.8 for fpr, tpr in nets)
    fails = bool((by.tpr[:, "linear"] < 0.85).any())
    return Finding(
        Verdict.REPRODUCED if good else Verdict.NOT_REPRODUCED,
        f"FPR/TPR after {int(table.tasks_seen.max())} tasks. {told}."
        + (" A linear function misses what it has no column for." if fails else ""),
    )


CLAIMS: tuple[Claim, ...] = (
    Claim(
        "4-triangle-features",
        "4",
        "On the triangle position is task relevant only, colour domain relevant only, and "
        "distance both.",
        ("section-4.3-relevance",),
        "Exact relevance of removing each alone, above or below 1e-9.",
        triangle_features,
    ),
    Claim(
        "4-smaller-table",
        "4",
        "A task-relevant representation, defined from earlier tasks before a new one, can help "
        "to learn it more quickly.",
        ("task-relevance-learning",),
        "The 95% interval of the factor in steps above 1 on both domains, at the second largest "
        "number of tasks.",
        smaller_table,
    ),
    Claim(
        "4.1.1-near-irrelevant",
        "4.1.1",
        "An abstraction that is (near-)irrelevant by (4.9) is a sensible one for the value "
        "function: the expected error on a new task's values is negligible.",
        ("task-relevance-learning",),
        "After the most tasks a feature that matters is missing in at most 5% of the new tasks, "
        "and the return in the end is not below the full table's.",
        negligible_error,
    ),
)

AFTER: tuple[Claim, ...] = (
    Claim(
        "4.5-weights",
        "4.5",
        "For linear functions, changes in feature weights over sequences of increasing length "
        "can be extrapolated to a measure similar to k-relevance.",
        ("function-law",),
        "Expected weights change with k, and their squares follow a + b/k to 1e-12.",
        weights_extrapolate,
    ),
    Claim(
        "4.5-approximators",
        "4.5",
        "k-relevance can be extended to non-binary linear and to nonlinear function "
        "approximators, which is named as an important direction.",
        ("function-selection",),
        "Networks select with FPR at most .15 and TPR at least .8 after the most tasks, on every "
        "domain, one of them without a table.",
        other_approximators,
    ),
)

DIFFERENCES: tuple[Difference, ...] = (
    Difference(
        "4.1.1-value-function",
        "4.1.1",
        "Features of the value function",
        "A near-irrelevant abstraction by (4.9) is recommended and not tried; how near, over how "
        "many tasks, and what becomes of the action is left open.",
        "Backward elimination by the mean relevance in the observed tasks, tolerance 0, and the "
        "action always kept.",
        '`TaskRelevance(tolerance=0.0, rule="mean" | "every", always=("a",))`',
        lambda t: smaller_table(t).evidence,
        ("task-relevance-learning",),
    ),
    Difference(
        "4.5-approximators",
        "4.5",
        "Relevance for other function approximators",
        "Left to future work; regression on many tasks and extrapolated weights are proposed.",
        "Linear: the rise of the squared error, by one projection. Networks: the mean of one "
        "network a task, relevance by resampling the removed features, which takes features to be "
        "independent under p.",
        "`LinearF`, `NetworkF`",
        lambda t: other_approximators(t).evidence,
        ("function-selection",),
    ),
)
