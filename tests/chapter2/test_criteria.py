"""The judges of chapter 2 on tables made by hand, once for each side of the criterion."""

import numpy as np
import pandas as pd
import pytest

from thesis_lib import chapter2
from thesis_lib.chapter2 import estimators, kl_quadratic
from thesis_lib.chapter2.settings import against_the_natural_gradient, against_vanilla
from thesis_lib.edition.chapters import read_chapter
from thesis_lib.edition.ledger import Claim, Verdict

CHAPTER = read_chapter(chapter2)
BY_ID: dict[str, Claim] = {claim.id: claim for claim in CHAPTER.claims}


def online(
    sarsa: float = -39_000, q_learning: float = -58_000, edge: int = 2, excess: float = 60.0
) -> dict[str, pd.DataFrame]:
    """Ten runs of each learner around the given means."""
    wiggle = np.linspace(-1, 1, 10)
    frames = [
        pd.DataFrame(
            {
                "algorithm": method,
                "total_reward": total + 500 * wiggle,
                "falls": falls + 2 * wiggle,
                "cells_at_edge": cells,
                "late_return": -80 + wiggle,
                "estimate": -80 + gap,
            }
        )
        for method, total, falls, cells, gap in (
            ("q_learning", q_learning, 54, edge, excess),
            ("sarsa", sarsa, 31, 0, 0.0),
        )
    ]
    return {"ch2-online": pd.concat(frames)}


def converged(q_learning: float = 0.1, sarsa: float = -11.0) -> dict[str, pd.DataFrame]:
    """Two runs of each learner: distance of Q-learning from Q*, learned start value of Sarsa."""
    shared = {
        "exploration": "constant",
        "epsilon": 0.1,
        "step": 100,
        "start_optimal": -5.0,
        "start_soft": -11.3,
        "gap": 15.0,
    }
    rows = [
        {"algorithm": "q_learning", "start_value": -5.0, "error_optimal": q_learning, **shared},
        {"algorithm": "sarsa", "start_value": sarsa, "error_optimal": 20.0, **shared},
    ]
    return {"ch2-convergence": pd.DataFrame([*rows, *rows])}


def tried(vpg: float = 0.5, natural: float = 0.6, trpo: float = 0.7, late: float = -2.0) -> dict:
    """Ten runs of each algorithm at a short, a good and a long setting.

    The good one has the given mean share; the long one of vanilla policy gradient falls, and
    ends at ``late``.
    """
    wiggle = np.linspace(-0.01, 0.01, 10)
    rows = []
    for name, good in (("vpg", vpg), ("natural", natural), ("trpo", trpo)):
        for setting, mean, last in ((0.001, 0.01, 0.02), (0.01, good, 0.95), (0.1, late, late)):
            fell = setting == 0.1
            for run, w in enumerate(wiggle):
                rows.append(
                    {
                        "algorithm": name,
                        "setting": setting,
                        "run": run,
                        "arrived": 3.0 if last > 0.9 else np.nan,
                        "mean_share": mean + w,
                        "last_share": last,
                        "lowest_share": -3.0 if fell else 0.0,
                        "lost": False,
                        "iterations": 30,
                    }
                )
    return {"ch2-settings": pd.DataFrame(rows)}


def bounded(trpo: float = 0.05) -> dict[str, pd.DataFrame]:
    """Two updates of TRPO and of the natural gradient under a bound of 0.05."""
    rows = [
        {"algorithm": a, "kl_sampled": kl, "kl_exact": kl, "delta_kl": 0.05}
        for a, largest in (("trpo", trpo), ("natural", 0.2))
        for kl in (0.01, largest)
    ]
    return {"ch2-learning": pd.DataFrame(rows)}


JUDGED = [
    ("2.3.5-step-size", tried(), Verdict.REPRODUCED),
    ("2.3.5-step-size", tried(late=0.5), Verdict.DIRECTION),  # all recover
    ("2.3.5-hard-constraint", bounded(), Verdict.REPRODUCED),
    ("2.3.5-hard-constraint", bounded(trpo=0.0501), Verdict.REFUTED),
    ("2.3.3-sarsa-online", online(), Verdict.REPRODUCED),
    ("2.3.3-sarsa-online", online(sarsa=-70_000), Verdict.REFUTED),
    ("2.3.3-sarsa-online", online(sarsa=-57_990), Verdict.DIRECTION),
    ("2.3.3-sarsa-online", online(sarsa=-58_010), Verdict.INCONCLUSIVE),
    ("3.4.1-q-learning-walks-the-edge", online(), Verdict.REPRODUCED),
    ("3.4.1-q-learning-walks-the-edge", online(edge=0), Verdict.NOT_REPRODUCED),
    ("2.3.3-q-learning-optimistic", online(), Verdict.REPRODUCED),
    ("2.3.3-q-learning-optimistic", online(excess=-5), Verdict.NOT_REPRODUCED),
    ("2.3.3-q-learning-converges", converged(), Verdict.REPRODUCED),
    ("2.3.3-q-learning-converges", converged(q_learning=3), Verdict.NOT_REPRODUCED),
    ("2.3.3-sarsa-cannot-converge", converged(), Verdict.REPRODUCED),
    ("2.3.3-sarsa-cannot-converge", converged(sarsa=-5.5), Verdict.NOT_REPRODUCED),
]


@pytest.mark.parametrize(("claim", "tables", "verdict"), JUDGED)
def test_judges(claim: str, tables: dict[str, pd.DataFrame], verdict: Verdict) -> None:
    finding = BY_ID[claim].judge(tables)
    assert finding.verdict is verdict
    assert finding.evidence.endswith(".")


@pytest.mark.parametrize(
    ("judge", "tables", "verdict"),
    [
        (against_the_natural_gradient, tried(), Verdict.REPRODUCED),
        (against_the_natural_gradient, tried(natural=0.8), Verdict.REFUTED),
        (against_the_natural_gradient, tried(natural=0.695), Verdict.DIRECTION),  # half a per cent
        (against_vanilla, tried(), Verdict.REPRODUCED),
        (against_vanilla, tried(vpg=0.701), Verdict.NOT_REPRODUCED),
    ],
)
def test_illustrations_of_claims_on_robots(judge, tables, verdict: Verdict) -> None:
    shown = judge.of(tables)
    assert shown.verdict is verdict
    claim = BY_ID[judge.subject].judge(tables)
    assert claim.verdict is Verdict.NOT_TESTABLE
    # What is said of the illustration goes on after a colon.
    assert claim.evidence.lower().endswith(shown.evidence.lower())


@pytest.fixture(scope="module")
def exact() -> dict[str, pd.DataFrame]:
    return {e.id: e.run("book").table for e in (estimators.biases, kl_quadratic.divergences)}


@pytest.mark.parametrize(
    ("claim", "verdict"),
    [
        ("2.3.4-unbiased", Verdict.REPRODUCED),  # Williams 1992
        ("2.3.4-discounting-bias", Verdict.REPRODUCED),
        ("2.3.4-return-to-go-bias", Verdict.REFUTED),  # Williams 1992: E[score_t r_s] = 0, s < t
        ("2.3.4-baseline", Verdict.REPRODUCED),
        ("2.3.4-near-optimal", Verdict.REPRODUCED),  # the value brings 99% of what there is
        ("2.3.4-td-error", Verdict.DIRECTION),  # holds in expectation only
        ("2.3.5-kl-quadratic", Verdict.REFUTED),  # the second-order term carries 1/2
    ],
)
def test_exact_claims(exact: dict[str, pd.DataFrame], claim: str, verdict: Verdict) -> None:
    assert BY_ID[claim].judge(exact).verdict is verdict


@pytest.mark.parametrize(
    ("claim", "column", "change", "verdict"),
    [
        ("2.3.4-unbiased", "slope_difference", 1.0, Verdict.REFUTED),
        ("2.3.4-discounting-bias", "variance", 1.0, Verdict.REFUTED),  # no estimator has less
        ("2.3.4-return-to-go-bias", "bias", 1.0, Verdict.REPRODUCED),
        ("2.3.4-baseline", "bias", 1.0, Verdict.REFUTED),
        ("2.3.4-near-optimal", "variance", [3, 2, 1], Verdict.NOT_REPRODUCED),  # half of it
        ("2.3.4-td-error", "td_difference", 0.0, Verdict.REPRODUCED),
        ("2.3.4-td-error", "td_mean_difference", 1.0, Verdict.REFUTED),
        ("2.3.5-kl-quadratic", "kl_new_old", "printed_quadratic", Verdict.REPRODUCED),
    ],
)
def test_exact_claims_can_turn(exact, claim, column, change, verdict: Verdict) -> None:
    """One column of the table with other numbers in it, or those of another column."""
    (name,) = BY_ID[claim].experiments
    table = exact[name].copy()
    if isinstance(change, list):
        rows = [f"return to go{x}" for x in ("", ", baseline", ", best baseline")]
        table = table.set_index("estimator").loc[rows].reset_index()
    table[column] = table[change] if isinstance(change, str) else change
    assert BY_ID[claim].judge({name: table}).verdict is verdict


def test_effects(exact: dict[str, pd.DataFrame]) -> None:
    told = {
        d.id: d.effect(exact)
        for d in CHAPTER.differences
        if callable(d.effect) and set(d.experiments) <= set(exact)
    }
    assert "1.414" in told["2.3.5-half"]  # the square root of 2
    assert "6.000" in told["2.3.5-fisher"]  # the number of steps
    assert "ratio 1.000" in told["2.3.5-kl-order"]  # the two orders agree to second order
