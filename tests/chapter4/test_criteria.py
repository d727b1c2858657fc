"""The criteria of chapter 4 on tables made by hand, on either side of what must hold."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binomtest

from thesis_lib import chapter4
from thesis_lib.chapter4 import interdependence
from thesis_lib.chapter4.appendix_b import STATEMENTS
from thesis_lib.chapter4.protocol import share_interval
from thesis_lib.edition.chapters import read_chapter
from thesis_lib.edition.ledger import Verdict

BY_ID = {claim.id: claim for claim in read_chapter(chapter4).claims}
YES, NEARLY, NO, WRONG, UNSURE = (
    Verdict.REPRODUCED,
    Verdict.DIRECTION,
    Verdict.NOT_REPRODUCED,
    Verdict.REFUTED,
    Verdict.INCONCLUSIVE,
)
KINDS = ("shared", "subsets", "weights")


def of(**columns: object) -> pd.DataFrame:
    """One row."""
    return pd.DataFrame([columns])


def curves(action: float = 0.5, position: float = 0.05, twelve: float = 0.0833) -> pd.DataFrame:
    """Forward relevance at k = 1, 12 and 20, 1 at first."""
    ends = {"a": action, "x1": position, "x2": 0.5, "x3": 2.0}
    rows = [
        {"feature": f, "direction": "forward", "k": k, "relevance": value}
        for f, end in ends.items()
        for k, value in ((1, 1.0), (12, twelve), (20, end))
    ]
    return pd.DataFrame(rows)


def theorem_2(
    step: float = 0.0, law: float = 0.1, shrink: float = 1.0, contracts: float = 1.0
) -> dict[str, pd.DataFrame]:
    """Step from k = 2 to 3 of the example that grows from 0, and how steps go elsewhere."""
    steps = {k: {"kind": k, "n_domains": 9, "law_error": law} for k in KINDS}
    table = pd.DataFrame(steps.values()).assign(
        contraction_80=contracts, steps_shrink=shrink, last_ratio=0.7
    )
    examples = [
        {"example": "a step grows from 0", "k": k, "step": value, "fraction": "1/2"}
        for k, value in enumerate((0.0, 0.0, step, 0.0), 1)
    ]
    return {"theorem-2": table, "ch4-counterexamples": pd.DataFrame(examples)}


def distances(at_1000: float) -> pd.DataFrame:
    rows = [(kind, k, d) for kind in KINDS for k, d in ((1, 1.0), (1000, at_1000))]
    return pd.DataFrame(rows, columns=["kind", "k", "mean_distance"])


def directions(increasing: float = 0.0, both: float = 0.0) -> pd.DataFrame:
    return of(kind="shared", n_domains=9, increasing=increasing, not_monotone=both)


def limits(asymptote: float = 0.02) -> pd.DataFrame:
    """The asymptote is off by .3 at 5 tasks, and by ``asymptote`` at 20."""
    return pd.DataFrame({"tasks_seen": [5, 20], "asymptote": [0.3, asymptote]})


def statements(failing: str = "", error: float = 1e-15) -> pd.DataFrame:
    """All statements of appendix B hold but those that start so."""
    rows = [
        {"kind": kind, "statement": s, "holds": 1.0, "largest_error": error, "n_domains": 9}
        | ({"holds": 0.8} if failing and s.startswith(failing) and kind == "weights" else {})
        for kind in KINDS
        for s in STATEMENTS
    ]
    return pd.DataFrame(rows)


def timings(power: float, noise: float = 0.0) -> pd.DataFrame:
    """Algorithm 8's time a feature grows with this power of what varies, times 1 ± noise."""
    rows = [
        {"method": "algorithm 8", "varied": varied, "features": 2, varied: size,
         "cpu_seconds": 2.0 * size**power * (1 + sign * noise)}
        for varied in ("pairs", "max_seqs")
        for size, sign in ((2**12, 1), (2**13, -1), (2**14, -1), (2**16, 1))
    ]  # fmt: skip
    return pd.DataFrame(rows).fillna({"pairs": 2**12})


def relevances(**changed: tuple[float, float]) -> pd.DataFrame:
    """Task and domain relevance as the thesis has them, but for some (domain initial_feature)."""
    stock = {"s1": (0, 0), "s1e1": (1, 1), "s1e2": (1, 1), "g1": (9, 0), "a": (2, 2)}
    domains: Mapping[tuple[str, str], Mapping[str, tuple[float, float]]] = {
        ("triangle", "as used"): {"x1": (1, 0), "x2": (1, 1), "x3": (0, 1), "a": (1, 1)},
        ("triangle", "on a line"): {"x1": (1, 1)},
        ("continuing cliff", "as used"): {"x": (1, 0.001), "y": (1, 0.001), "cliff": (9, 9)},
        ("episodic cliff", "as used"): {"x": (1, 0.001), "y": (1, 0.001), "cliff": (9, 9)},
        **{(f"stock G={g}", "after_next"): stock for g in (1, 2, 5)},
    }
    rows = []
    for (domain, reading), features in domains.items():
        size = 2 ** int(domain[-1]) if domain.startswith("stock") else 1
        for feature, own in features.items():
            task, limit = changed.get(f"{domain[0]}_{feature}", own)
            rows.append(
                {"domain": domain, "reading": reading, "feature": feature, "share": limit / 10,
                 "task_relevance": task, "domain_relevance": limit,
                 "n_pairs": 16 * size, "n_tasks": 3 * size}
            )  # fmt: skip
    return pd.DataFrame(rows)


def on_triangle(
    gain: float = 1.0,
    lead: int = 5,
    last: float = -10.0,
    ibkr: float = 1.0,
    fpr: float = 0.45,
    late: float | None = None,
    lacks: dict[int, float] | None = None,
    half: float = 0.2,
) -> pd.DataFrame:
    """FS-TEK matches fixed features from ``lead`` tasks on; the others reach ``last`` at 20.

    Its gain at 20 is ``late``, where that is another.  IBKR earns less than no selection by what
    it ``lacks`` at some numbers of tasks.
    """
    rows = []
    for n in (4, 5, 20):
        own = {
            "fs-tek": -10.0 if n >= lead else -20.0,
            "fixed": -10.0,
            **dict.fromkeys(("ibkr", "none", "jackknife"), last if n == 20 else -20.0),
        }
        rows += [
            {"method": method, "tasks_seen": n, "mean_return": value, "n_runs": 99,
             "sd": 0.3, "fstek_minus_ci95": 0.5, "tpr": 1.0,
             "fstek_minus": gain if late is None or n < 20 else late,
             "none_minus": (lacks or {}).get(n, 0.0), "none_minus_ci95": half,
             "fpr": {"ibkr": ibkr, "fs-tek": fpr}.get(method, 0.0)}
            for method, value in own.items()
        ]  # fmt: skip
    return pd.DataFrame(rows)


def dropping(*seen: int) -> pd.DataFrame:
    """IBKR drops relevant features after these numbers of tasks, of 4, 5 and 20."""
    table = on_triangle()
    return table.assign(tpr=table.tpr.where(~table.tasks_seen.isin(seen), 0.9))


READINGS = of(reading="alpha(k) by the formula", tasks_seen=5, fpr=0.6, tpr=1.0)


def cliff(
    returns: tuple[float, ...] = (-50.0, -20.0, -10.0, -30.0),
    gain: float = 1.0,
    fpr: float = 0.6,
    random: float = 5.0,
    potential: str = "Q_star",
    late: float | None = None,
) -> pd.DataFrame:
    """Return without selection after 1, 2, 4 and 12 tasks, and FS-TEK's gain over it.

    The gain at 12 is ``late``, where that is another.
    """
    rows = []
    for n, earned in zip((1, 2, 4, 12), returns, strict=True):
        for method in ("fs-tek", "none", "random"):
            rows.append(
                {"method": method, "tasks_seen": n, "potential": potential, "fpr": fpr,
                 "mean_return": earned, "sd": 1.0, "n_runs": 20, "ci95": 0.5,
                 "fstek_minus": gain if late is None or n < 12 else late,
                 "fstek_minus_ci95": 0.5, "none_minus": random, "none_minus_ci95": 0.5}
            )  # fmt: skip
    return pd.DataFrame(rows)


def removing(*shares: float, n_runs: int = 500) -> dict[str, pd.DataFrame]:
    """FS-TEK removes the position in these shares of the runs after 4 and after 12 tasks."""
    own = cliff().assign(n_runs=n_runs)
    fpr = 1 - own.tasks_seen.map({4: shares[0], 12: shares[-1]})
    return cliffs(star=own.assign(fpr=fpr.fillna(1.0)))


def cliffs(**tables: pd.DataFrame) -> dict[str, pd.DataFrame]:
    own = {"star": cliff(), "tilde": cliff((-5.0, -4.0, -3.0, -2.0), 2.0), "episodic": cliff()}
    names = {"star": "figure-4.4", "tilde": "figure-4.5", "episodic": "ch4-episodic-cliff"}
    return {names[name]: table for name, table in (own | tables).items()}


def on_stock(
    low: float = 2.0,
    high: float = 0.1,
    fixed: float = 1.0,
    ibkr: float = 0.8,
    n: int = 4,
    peak: float = 0.1,
    everything: tuple[float, float] = (-2.0, 2.0),
) -> pd.DataFrame:
    """FS-TEK's gain for G below and from 4 on; it is larger by ``peak`` after n tasks.

    IBKR has another false positive rate than .2.  No selection earns more than the other methods
    by ``everything`` for G below and from 4 on.
    """
    rows = []
    for g in (1, 3, 4, 5):
        for method in ("fs-tek", "ibkr", "none", "random", "fixed", "constant"):
            for seen in (4, 12):
                gain = fixed if method == "fixed" else (low if g < 4 else high)
                worth = {"fixed": 10.0 * g, "constant": 30.0}.get(method, 20.0)
                rows.append(
                    {"global_factors": g, "method": method, "tasks_seen": seen,
                     "fstek_minus": gain + (seen == n) * peak, "fstek_minus_ci95": 0.5,
                     "mean_return": worth, "sd": 2.0, "n_runs": 60,
                     "none_minus": everything[g >= 4], "none_minus_ci95": 0.5,
                     "fpr": ibkr if method == "ibkr" else 0.2, "tpr": 1.0}
                )  # fmt: skip
    return pd.DataFrame(rows)


def windows(
    low: float = 1.5,
    hidden: float = 0.01,
    gap: float = 0.1,
    factor: float = 2.0,
    high: float = 3.0,
    domain: str = "meadow",
    early: float = 0.3,
    runs: int = 500,
) -> pd.DataFrame:
    """Factor of the small table after 3 tasks, what it lacks after 8, and its gain at the end."""
    rows = [
        {"domain": domain, "tasks_seen": n, "method": method, "step": step, "pairs": 9.0,
         "factor": factor, "factor_low": low, "factor_high": high,
         "hidden": hidden if n == 8 else early, "ci95": 0.01, "n_runs": runs,
         "reward": 1 + gap * (method == "table")}
        for n in (1, 3, 8)
        for method in ("full", "table")
        for step in (10, 100)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def function_law(change: float, misfit: float) -> pd.DataFrame:
    rows = [
        {"function": function, "feature": "g1", "k": k, "value": change * k, "misfit": misfit}
        for function in ("weight", "squared weight")
        for k in (1, 2)
    ]
    return pd.DataFrame(rows)


def on_two(factor: float, high: float) -> pd.DataFrame:
    """The small table is faster on one meadow, and has another factor on the other."""
    return pd.concat([windows(), windows(low=0.5, factor=factor, high=high, domain="other")])


def by_function(tpr: float, n_runs: int = 60) -> pd.DataFrame:
    rows = [
        {"domain": "wide", "method": m, "tasks_seen": 16, "fpr": 0.1, "tpr": tpr,
         "fpr_ci95": 0.02, "tpr_ci95": 0.02, "n_runs": n_runs}
        for m in ("table", "linear", "network")
    ]  # fmt: skip
    return pd.DataFrame(rows)


def dialled(
    fpr: float = 0.02,
    tpr: float = 0.99,
    half: float = 0.01,
    chance: bool = False,
    other: float | None = None,
) -> pd.DataFrame:
    """Rates at a strict and a lax level, far from each other and above chance unless said.

    With the other reading the strict level's false positive rate is ``other``, where that is
    another.
    """
    rows = [
        {"domain": domain, "method": "fs-tek", "level": level, "tasks_seen": 5, "flat": flat,
         "fpr": low if other is None or flat == "unsure" or level > 0.5 else other,
         "tpr": low if chance else high, "fpr_ci95": half, "tpr_ci95": half}
        for domain in ("triangle", "cliff")
        for flat in ("unsure", "limit")
        for level, low, high in ((1e-4, fpr, 0.5), (0.9, 0.9, tpr))
    ]  # fmt: skip
    return pd.DataFrame(rows)


def heat_share(share: float, half: float) -> pd.DataFrame:
    return of(removed="x, y, heading", sensor=0.02, share=share, share_ci95=half, n_tasks=60)


def pushes(**outward: float) -> pd.DataFrame:
    """What the thesis says of the pushes, but for some (potential_by)."""
    said = {"Q_star_sensor": 0, "Q_star_position": -1, "Q_tilde_sensor": 1, "Q_tilde_position": 1}
    return pd.DataFrame(
        [
            {"discount": gamma, "potential": key.rpartition("_")[0], "by": key.rpartition("_")[2],
             "outward": float(value)}
            for gamma in (0.9, 0.99)
            for key, value in (said | outward).items()
        ]
    )  # fmt: skip


def subsets(bcd: float = 1.0, kept: str = "AB", b: float = 0.0, xor: float = 0.0, tests: int = 3):
    """One target of footnote 2, an exclusive or, and two features of which one is removed."""
    abcd = {"B": (b, 0.6), "C": (0.0, 0.3), "D": (0.0, 0.4), "BC": (0.5, 0.6), "CD": (0.0, 0.6)}
    abcd["BCD"] = (bcd, 0.6)
    rows = [("ABCD", 0, f, *values, kept, 9) for f, values in abcd.items()]
    rows += [("xor", 0, f, 1.0, xor, "AB", 2) for f in "AB"]
    rows += [("all removed", 2, f, 0.0, 1.0, "b", tests) for f in "ab"]
    names = ["example", "target", "features", "relevance", "strength", "kept", "tests"]
    return pd.DataFrame(rows, columns=names)


def nearer(lead: float) -> pd.DataFrame:
    return of(domain="torus", tasks_seen=3, lead=lead, lead_ci95=0.1)


def tried(
    good: float = 0.0, ibkr: float = 0.0, strict: float = 9.0, half: float = 1.0, tests: float = 50
):
    """Returns of 100 or so: what keeping for good, a varying level and any level earn besides.

    Keeping for good takes some number of tests, of 100.
    """
    beside = {"fs-tek": ("again", good, tests), "fs-tek, tested again": ("1e-4", strict, 100)}
    beside["fs-tek at 1e-4"] = ("fs-tek", -strict, tests)
    beside["ibkr, varying level"] = ("constant", ibkr, tests)
    beside["no selection"] = ("1e-4", strict, 0)
    return pd.DataFrame(
        [
            {"domain": "stock G = 4", "method": method, "tasks_seen": n, "ahead": gain,
             "beside": "fs-tek at 1e-4" if other == "1e-4" else other, "ahead_ci95": half,
             "mean_return": 100.0, "tests": count, "saved": 100.0 - count, "saved_ci95": 5.0}
            for n in (4, 8)
            for method, (other, gain, count) in beside.items()
        ]
    )  # fmt: skip


def rated(fpr: float = 0.2, one: float = 0.0) -> dict[str, pd.DataFrame]:
    """Rates at 1e-4 for G = 4 and 5 beside .2/1 below; one true positive rate falls short."""
    rows = [
        {"domain": f"stock G = {g}", "method": "fs-tek at 1e-4", "tasks_seen": n, "fpr": fpr,
         "tpr": 1.0 - one * (g == n == 4), "fpr_ci95": 0.05, "tpr_ci95": 0.05}
        for g in (4, 5) for n in (4, 12)
    ]  # fmt: skip
    return {"ch4-settings": pd.DataFrame(rows), "figure-4.6": on_stock()}


CASES = {
    "4.1-not-additive": [(subsets(), YES), (subsets(bcd=0.0), WRONG)],
    "4.2-abcd": [(subsets(), YES), (subsets(kept="ACD"), WRONG), (subsets(b=0.1), WRONG)],
    "4.2-interdependence": [(subsets(), YES), (subsets(xor=0.1), WRONG), (subsets(b=0.1), WRONG)],
    "4.2-quadratic": [(subsets(), YES), (subsets(tests=4), WRONG)],
    "4.2-combinations": [(nearer(0.2), YES), (nearer(0.05), NEARLY), (nearer(-0.2), WRONG)],
    "4.3-cliff-tilde-shies": [(pushes(), YES), (pushes(Q_tilde_sensor=0), WRONG)],
    "4.3-cliff-star-stays": [
        (pushes(), YES), (pushes(Q_star_sensor=1), WRONG), (pushes(Q_star_sensor=-1), WRONG),
    ],
    "4.3-cliff-star-centre": [(pushes(), YES), (pushes(Q_star_position=0), WRONG)],
    "4.3-cliff-tilde-edges": [(pushes(), YES), (pushes(Q_tilde_position=-1), WRONG)],
    "4.3-kept-for-good": [
        (tried(), YES), (tried(good=-4.5), WRONG), (tried(half=9.0), UNSURE),
        # Of 100 tests 38.3 saved are within 5 of a third, and 4 within 5 of none.
        (tried(tests=61), YES), (tried(tests=62), NEARLY), (tried(tests=96), NO),
    ],
    "4.3-stock-ibkr-level": [
        (tried(), YES), (tried(ibkr=9.0), WRONG), (tried(half=9.0), UNSURE),
    ],
    "4.3-stock-level-worst": [
        (tried(), YES), (tried(strict=0.5), NEARLY), (tried(strict=-9.0), WRONG),
    ],
    "4.1.1-plateau": [
        (curves(), YES), (curves(action=0.05), NO), (curves(position=0.2), NO),
    ],
    "4.1.1-twelve": [
        (curves(twelve=0.05), YES), (curves(twelve=0.2), NEARLY), (curves(twelve=0.6), NO),
    ],
    "4.1.2-theorem-2": [
        (theorem_2(), YES), (theorem_2(-0.003), WRONG), (theorem_2(law=1e-15), WRONG),
        (theorem_2(shrink=0.9), WRONG), (theorem_2(contracts=0.5), UNSURE),
    ],
    "4.1.2-power-law": [(theorem_2(law=1e-15), YES), (theorem_2(law=1e-6), NO)],
    "4.1.2-corollary-1": [
        (distances(0.001), YES), (distances(0.1), NEARLY), (distances(1.0), NO),
    ],
    "4.1.2-theorem-3": [(directions(), YES), (directions(both=0.1), WRONG)],
    "4.1.2-increasing": [(directions(increasing=0.1), YES), (directions(), WRONG)],
    "4.1.2-exponential": [
        (limits(), YES), (limits(asymptote=0.1), NEARLY), (limits(asymptote=0.4), NO),
    ],
    # The true positive rate goes from .5 to .2, .5 or .99.
    "4.5-alpha": [
        (dialled(tpr=0.2), YES), (dialled(tpr=0.5), UNSURE), (dialled(), WRONG),
        (dialled(tpr=0.2, half=0.3), UNSURE),
    ],
    "4.1-two-forms": [
        (statements(), YES), (statements(error=1e-6), WRONG), (statements(error=1e-11), UNSURE),
    ],
    "B.1-lemma-1": [(statements(), YES), (statements("lemma 1"), WRONG)],
    "B.1-lemma-2": [(statements(), YES), (statements("lemma 2 as printed"), WRONG)],
    "B.1-equation-B4": [(statements(), YES), (statements("eq. B.4 as printed"), WRONG)],
    "B.2-lemma-3": [
        (of(n_tasks=2, k=3, counted=0.5, same=True), YES),
        (of(n_tasks=2, k=3, counted=0.5, same=False), WRONG),
    ],
    "4.2-complexity": [
        (timings(1.0), YES), (timings(2.0), WRONG), (timings(1.0, 0.9), UNSURE),
        # Constant time, with and without noise, and what may be more than linear.
        (timings(0.0), NO), (timings(0.0, 0.1), NO), (timings(1.2, 0.2), UNSURE),
    ],
    "4-triangle-features": [
        (relevances(), YES), (relevances(t_x2=(0, 1)), NEARLY), (relevances(t_x1=(1, 1)), NO),
    ],
    "4-cliff-sensor-both": [
        (relevances(), YES), (relevances(e_cliff=(0, 9)), NEARLY), (relevances(c_cliff=(9, 0)), NO),
    ],
    "4.3-triangle-relevance": [(relevances(), YES), (relevances(t_x1=(1, 1)), NO)],
    "4.3-cliff-relevance": [(relevances(), YES), (relevances(e_x=(1, 1)), NO)],
    "4.3-stock-relevance": [(relevances(), YES), (relevances(s_s1=(1, 0)), NO)],
    "4.3-stock-sizes": [
        (relevances(), YES), (relevances().assign(n_tasks=3), NO),
    ],
    # Of two numbers of tasks and rivals intervals are norm.isf(.00625) / norm.isf(.025) = 1.274
    # times as wide: .637.
    "4.3-triangle-improves": [
        (on_triangle(), YES), (on_triangle(gain=0.6), UNSURE), (on_triangle(gain=-1.0), WRONG),
        (on_triangle(gain=0.3), NO),  # .937 at most, and 5% of the return are 1
        (on_triangle().assign(fstek_minus=lambda t: 1.0 * (t.tasks_seen == 5)), NEARLY),
    ],
    "4.3-triangle-first": [
        (on_triangle(), YES), (on_triangle(gain=0.4), NEARLY), (on_triangle(lead=20), NO),
        (on_triangle(lead=21), UNSURE),
    ],
    "4.3-triangle-all-reach": [
        (on_triangle(), YES), (on_triangle(last=-11.0), WRONG), (on_triangle(last=-10.5), UNSURE),
    ],
    # By Wilson with z = 2.638, for both rates at three numbers of tasks, a rate of 1 is at least
    # 500/(500 + 6.96) = .986, but of 99 runs .934; one of .9 is at most .930.
    "4.3-triangle-ibkr": [
        (table.assign(n_runs=500), verdict)
        for table, verdict in (
            (on_triangle(), YES), (dropping(4), YES), (dropping(4, 5), NEARLY),
            (on_triangle(ibkr=0.9), NO), (on_triangle(ibkr=0.95), UNSURE),
        )
    ] + [(on_triangle(), UNSURE)],
    # It earns -20 after 4 and 5 tasks and -10 after 20, of which 5% are 1 and 1/2.
    "4.3-triangle-ibkr-vanilla": [
        (on_triangle(), YES), (on_triangle(lacks={4: 0.7, 5: -0.7, 20: 0.2}), YES),
        (on_triangle(lacks={4: 9.0}), NEARLY), (on_triangle(lacks={4: 9.0, 5: -9.0}), WRONG),
        (on_triangle(half=2.0), UNSURE),
    ],
    # Of 500 runs .5 is .456 to .544 and .52 up to .563.  Of 99 .99 has a half-width of .0196: what
    # keeps everything is no direction.  Of 20 a true positive rate of 1 is .839 or more.
    "4.3-triangle-roc": [
        ({"figure-4.3": on_triangle(fpr=fpr).assign(n_runs=n), "ch4-readings": READINGS}, verdict)
        for fpr, n, verdict in (
            (0.5, 500, YES), (0.52, 500, NEARLY), (0.6, 500, NEARLY), (0.99, 99, NO),
            (1.0, 500, NO), (0.5, 20, UNSURE),
        )
    ],
    # By Wilson with z = 2.241, for two numbers of tasks, .4 of 500 runs is .352 to .450, .33 is
    # .285 to .379, .2 at most .243; .2 of 20 runs .071 to .449.
    "4.3-cliff-removes": [
        (removing(0.4), YES), (removing(0.4, 0.1), NEARLY), (removing(0.2), NO),
        (removing(0.0), NO), (removing(0.33), UNSURE), (removing(0.2, n_runs=20), UNSURE),
        (cliffs(), UNSURE),
    ],
    "4.3-cliff-gain": [
        # Of two numbers of tasks an interval is norm.isf(.0125) / norm.isf(.025) = 1.144 times as
        # wide: .572.
        (cliff(), YES), (cliff(gain=0.58), YES), (cliff(gain=0.56), UNSURE), (cliff(gain=-1.0), NO),
    ],
    "4.3-cliff-turns": [
        (cliffs(), YES),
        (cliffs(star=cliff((-4.0, -3.0, -2.0, -1.0))), NEARLY),
        # A difference is ± .53 to one side: after the peak it falls by up to .63, 5% are .055.
        *(
            (cliffs(**dict.fromkeys(("star", "episodic"), cliff(returns))), verdict)
            for returns, verdict in (
                ((-4.0, -3.0, -2.0, -1.0), NO), ((-1.0, -2.0, -3.0, -4.0), NO),
                ((-4.0, -3.0, -1.0, -1.1), UNSURE),
            )
        ),
    ],
    "4.3-cliff-tilde-rises": [
        (cliffs(tilde=cliff((-50.0, -40.0, -30.0, -20.0))), YES),
        (cliffs(tilde=cliff()), Verdict.REFUTED),
        (cliffs(), UNSURE),  # a margin of 5% is .1 here, of means that are ± .47
    ],
    # Half-widths of .5 add up: the gain with Q* is 1, that with Q~ has to be above 2.
    "4.3-cliff-tilde-gains": [
        (cliffs(tilde=cliff(gain=gain)), verdict)
        for gain, verdict in (
            (2.1, YES), (1.9, NEARLY), (0.5, UNSURE), (0.1, UNSURE), (-0.1, WRONG),
        )
    ],
    "4.3-cliff-long-run": [
        (cliffs(), YES), (cliffs(tilde=cliff()), UNSURE),
        (cliffs(tilde=cliff((-5.0, -4.0, -3.0, -40.0))), WRONG),
        (cliffs(tilde=cliff((-5.0, -4.0, -3.0, -29.99))), NEARLY),
    ],
    "4.3-cliff-few": [
        (cliffs(tilde=cliff((-90.0, -90.0, -3.0, -2.0))), YES),
        (cliffs(tilde=cliff()), UNSURE),
        (cliffs(), WRONG),
        (cliffs(tilde=cliff((-90.0, -20.01, -3.0, -2.0))), NEARLY),
    ],
    # Without selection 20, 10 and 30 are lost from two tasks on, of which .6 are 5% twice.  Of six
    # numbers of tasks intervals are 1.346 times as wide: .673.
    "4.3-cliff-random": [
        (cliffs(), YES), (cliffs(tilde=cliff(random=0.1)), NO),
        (cliffs(tilde=cliff((-5.0, -4.0, -3.0, -2.0), random=0.1)), UNSURE),
        (cliffs(tilde=cliff(random=-0.6)), UNSURE), (cliffs(tilde=cliff(random=-0.7)), WRONG),
    ],
    # Of 16 comparisons intervals are norm.isf(.025 / 16) / norm.isf(.025) = 1.508 times as wide,
    # .754; 5% of the return are 1, of fixed features at G = 1 a half.
    "4.3-stock-outperforms": [
        (on_stock(), YES), (on_stock(fixed=0.3), NEARLY), (on_stock(low=0.1), NO),
        (on_stock(low=0.3), UNSURE), (on_stock(fixed=-1.0), WRONG),
        # One of them may be .054 better, and all are less than 5% so; in the mean half are ahead.
        (on_stock(fixed=-0.8), NO), (on_stock(fixed=-0.05), UNSURE),
    ],
    "4.3-stock-deteriorates": [
        (on_stock(), YES), (on_stock(high=1.0), NEARLY), (on_stock(high=3.0), WRONG),
        (on_stock(low=1.2, high=1.0), UNSURE),
    ],
    "4.3-stock-fixed": [
        # Of two intervals are 1.144 times as wide: .572.
        (on_stock(), YES), (on_stock(fixed=0.48), NEARLY), (on_stock(fixed=0.45), UNSURE),
        (on_stock(fixed=-0.2), NO), (on_stock(fixed=-1.0), WRONG),
    ],
    # Of the false positive rate the half-width is .05 over the root of 2 with four and five
    # factors and 1.96 sqrt(.2 (1 - .2) / 60 / 2) with one and three: .0354 and .0716, .0798 of
    # the difference.  The last is off by .4 in one true positive rate, .1 in the mean.
    "4.3-stock-roc": [
        (rated(), YES), (rated(0.265), YES), (rated(0.275), UNSURE), (rated(0.135), YES),
        (rated(0.125), UNSURE), (rated(0.44), WRONG), (rated(one=0.4), WRONG),
    ],
    "4.3-stock-importance": [
        (on_stock(), YES), (on_stock(everything=(-2.0, 0.1)), NEARLY),
        (on_stock(everything=(-2.0, -0.1)), UNSURE), (on_stock(everything=(2.0, 2.0)), WRONG),
    ],
    # The error of rates of .2 and .22 is at most sqrt((.2 .8 + .22 .78) / 60) = .074.
    "4.3.1-ibkr-filters": [
        ({"figure-4.3": on_triangle(), "figure-4.6": on_stock(ibkr=rate)}, verdict)
        for rate, verdict in ((0.8, YES), (0.22, NEARLY), (0.2, UNSURE), (0.0, WRONG))
    ],
    # Two levels: intervals are norm.isf(.0125) / norm.isf(.025) = 1.144 times as wide.
    "4.3.1-tuned": [
        (dialled(), YES), (dialled(fpr=0.088), YES), (dialled(fpr=0.09), NEARLY),
        (dialled(fpr=0.11), NO), (dialled(fpr=0.12), WRONG), (dialled(tpr=0.93), WRONG),
        (dialled(chance=True), WRONG), (dialled(half=0.3), NEARLY),
        # Refuted by neither reading alone, and reproduced by the one used only.
        (dialled(fpr=0.12, other=0.02), NO), (dialled(other=0.12), YES),
    ],
    # Of five numbers above six a difference of two gains that are ± .5 each, and share runs, is
    # ± norm.isf(.005) / norm.isf(.025), 1.314.
    "4.3.1-few-tasks": [
        ({"figure-4.4": cliff(late=late), "figure-4.5": cliff(late=late),
          "figure-4.3": on_triangle(late=late), "figure-4.6": on_stock(n=n, peak=peak)}, verdict)
        for n, late, peak, verdict in (
            (4, -1.0, 3.0, YES), (4, 0.5, 3.0, NEARLY), (12, -1.0, 1.32, WRONG),
            (12, -1.0, 1.3, UNSURE),
        )
    ],
    # Of two domains an upper end is (high / factor)^.144 times as far: .933 and 1.017.
    "4-smaller-table": [
        (windows(), YES), (windows(low=0.9), NEARLY),
        (windows(low=0.5, factor=0.8, high=1.2), UNSURE),
        (windows(low=0.5, factor=0.8, high=0.95), WRONG),
        (on_two(0.7, 0.9), NO), (on_two(0.7, 0.97), UNSURE), (on_two(0.0, 0.0), NO),
    ],
    # Wilson's intervals of 1% are .4% to 2.3% over 500 runs and .2% to 7.4% over 60; those of 7%
    # and of 20% over 60 are 2.8% to 16% and 12% to 32%.
    "4.1.1-near-irrelevant": [
        (windows(), YES), (windows(hidden=0.1), NEARLY), (windows(gap=-0.1), NO),
        (windows(hidden=0.4), NO), (windows(early=0.0, runs=60), UNSURE),
        (windows(hidden=0.07, early=0.0, runs=60), UNSURE),
        (windows(hidden=0.2, early=0.0, runs=60), NO),
    ],
    "4.5-weights": [
        (function_law(0.1, 1e-15), YES), (function_law(0.0, 1e-15), NEARLY),
        (function_law(0.1, 0.1), NO),
    ],
    # By t a half-width is 1.021 times as large for 60 runs and 2.195 for 3, and 1.174 to refuse
    # one of two rates: .0204, .0439 and .0235.
    "4.5-approximators": [
        (by_function(0.9), YES), (by_function(0.5), NO), (by_function(0.77), NO),
        (by_function(0.78), UNSURE), (by_function(0.81), UNSURE), (by_function(0.84), YES),
        (by_function(0.84, n_runs=3), UNSURE),
    ],
    "4.3-heat-information": [
        (heat_share(0.05, 0.01), YES), (heat_share(0.2, 0.01), NEARLY),
        (heat_share(0.095, 0.01), NEARLY), (heat_share(0.05, 0.1), UNSURE),
        (heat_share(-0.05, 0.1), UNSURE), (heat_share(-0.2, 0.1), NO),
    ],
}  # fmt: skip
"""Tables, one or several by experiment, and the verdict on them, by claim."""


@pytest.mark.parametrize(
    ("claim", "tables", "verdict"),
    [(claim, *case) for claim, cases in CASES.items() for case in cases],
)
def test_verdicts(claim, tables, verdict):
    own = BY_ID[claim]
    if isinstance(tables, pd.DataFrame):
        tables = dict.fromkeys(own.experiments, tables)
    assert own.judge(tables).verdict is verdict


def test_how_far_curves_are_from_the_law_is_computed():
    """Through 1 and 2 at k = 1 and 20 it is at 2 - (1/12 - 1/20) / (1 - 1/20) = 1.96 at 12."""
    found = BY_ID["4.1.1-plateau"].judge({"figure-4.1": curves()})
    assert "at most 0.9 of the largest" in found.evidence


def test_forward_relevance_keeps_the_smaller_subset(monkeypatch):
    """B goes first where it is the first of B, C and D, in a third of the orders; C and D stay."""
    judge = BY_ID["4.2-smaller-subset"].judge
    found = judge({})
    assert found.verdict is YES
    assert "features: {A, B} in 24 where" in found.evidence
    for kept in ("{A, B} in 16", "{A, C, D} in 8"):
        assert kept in found.evidence.partition("marked; ")[2]

    class NoSmaller:
        def fit(self, solutions):
            return self

        def get_feature_names_out(self):
            return list("ACD")

    monkeypatch.setattr(interdependence, "IBKR", NoSmaller)
    assert judge({}).verdict is WRONG


def test_shares_have_wilsons_interval():
    """SciPy's, of 48 in 120 at 95%, and at 99% where five are looked at."""
    share, runs = pd.Series([0.4]), pd.Series([120])
    for choices, level in ((1, 0.95), (5, 0.99)):
        ends = binomtest(48, 120).proportion_ci(level, method="wilson")
        found = share_interval(share, runs, choices).iloc[0]
        assert tuple(found) == pytest.approx((ends.low, ends.high))


PAIRED = ("fstek_minus", "none_minus", "lead", "ahead", "saved")
"""Columns of paired differences, with their intervals beside them."""


def noise(table: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    """No difference at all, as these runs would show it."""
    own = table.copy()
    for gap in PAIRED:
        if gap in own:
            own[gap] = own[f"{gap}_ci95"] / 1.96 * rng.standard_normal(len(own))
    if {"mean_return", "sd", "n_runs"} <= set(own):
        error = own.sd / own.n_runs**0.5
        own["mean_return"] = -10 + error * rng.standard_normal(len(own))
    return own


def few(table: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    """The same, from so few runs that intervals are a hundred times as wide."""
    wider = {f"{gap}_ci95": 100.0 for gap in PAIRED} | {"sd": 100.0, "ci95": 100.0}
    return noise(table.assign(**{c: table[c] * by for c, by in wider.items() if c in table}), rng)


def rates_at_random(table: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    """Every method keeps as many features as it happens to, relevant or not."""
    rates = [rate for rate in ("fpr", "tpr") if rate in table]
    return table.assign(**{rate: rng.random(len(table)) for rate in rates})


RATES = {
    *("4.3-triangle-ibkr", "4.3-triangle-roc", "4.3-cliff-removes", "4.3-stock-roc"),
    *("4.3.1-ibkr-filters", "4.5-approximators"),
}
"""Claims on rates, to which tables of differences say nothing."""

LIKENESS = {
    *("4.3-triangle-ibkr-vanilla", "4.3-stock-ibkr-level", "4.3-triangle-all-reach"),
    "4.3-cliff-tilde-rises",
}
"""Claims that there is no difference: true of noise, but not to be told from few runs."""


def by_experiment(claim: str) -> dict[str, pd.DataFrame]:
    """The tables on which a claim holds."""
    tables = CASES[claim][0][0]
    one = isinstance(tables, pd.DataFrame)
    return dict.fromkeys(BY_ID[claim].experiments, tables) if one else tables


DRAWN = [
    claim
    for claim in CASES
    if claim not in RATES and any({*PAIRED, "sd"} & set(t) for t in by_experiment(claim).values())
]
"""Claims whose tables tell the spread of their runs."""


@pytest.mark.parametrize(
    ("claim", "null"),
    [(c, null) for c in DRAWN for null in ((few,) if c in LIKENESS else (noise, few))],
)
def test_it_does_not_hold_on_noise(claim, null):
    rng = np.random.default_rng(0)
    passed = sum(
        BY_ID[claim].judge({e: null(t, rng) for e, t in by_experiment(claim).items()}).verdict
        is YES
        for _ in range(40)
    )
    assert passed <= 4


@pytest.mark.parametrize("claim", sorted(RATES))
def test_rates_at_random_do_not_pass(claim):
    rng = np.random.default_rng(0)
    tables = by_experiment(claim)
    passed = sum(
        BY_ID[claim].judge({e: rates_at_random(t, rng) for e, t in tables.items()}).verdict is YES
        for _ in range(40)
    )
    assert passed <= 4
