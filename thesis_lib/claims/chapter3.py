"""Claims of chapter 3, and where this edition differs from it."""

from __future__ import annotations

import pandas as pd
from scipy import stats as scipy_stats

from thesis_lib.claims import Claim, Difference, Finding, Tables, Verdict
from thesis_lib.stats import Comparison, Summary, equivalence, holm, welch

ALPHA = 0.05
NAMES = {"none": "no shaping", "Q_star": "Q*", "Q_tilde": "Q~", "Q_mu": "Q^mu", "constant": "const"}
LEARNERS = {"q_learning": "Q-learning", "sarsa": "Sarsa"}


def entry(table: pd.DataFrame, potential: str, algorithm: str, sensor: bool) -> Summary:
    """One entry of Table 3.1 as a summary, in 10^4."""
    at = (table.potential == potential) & (table.algorithm == algorithm) & (table.sensor == sensor)
    row = table[at].iloc[0]
    return Summary(float(row["mean"]), float(row["sd"]), int(row["n_runs"]))


def _told(a: Summary, b: Summary, test: Comparison, p: float) -> str:
    return (
        f"{a.mean:.2f} against {b.mean:.2f}, difference {test.difference:+.2f} "
        f"[{test.low:+.2f}, {test.high:+.2f}], p = {p:.2g}"
    )


def _ordered(
    table: pd.DataFrame, pairs: list[tuple[str, tuple[str, str, bool], tuple[str, str, bool]]]
) -> Finding:
    """Judge that each first entry earns more than its second: Welch tests with Holm's step."""
    tests = [welch(entry(table, *a), entry(table, *b)) for _, a, b in pairs]
    adjusted = holm([t.p_value for t in tests])
    told = "; ".join(
        f"{label}: {_told(entry(table, *a), entry(table, *b), t, p)}"
        for (label, a, b), t, p in zip(pairs, tests, adjusted, strict=True)
    )
    n = entry(table, *pairs[0][1]).n
    evidence = f"In 10⁴, n = {n} an entry, Welch with Holm's correction: {told}."
    right = [t.difference > 0 for t in tests]
    sure = [p < ALPHA for p in adjusted]
    if all(r and s for r, s in zip(right, sure, strict=True)):
        return Finding(Verdict.REPRODUCED, evidence)
    if any(not r and s for r, s in zip(right, sure, strict=True)):
        return Finding(Verdict.REFUTED, evidence)
    if all(right):
        return Finding(Verdict.DIRECTION, evidence)
    return Finding(Verdict.NOT_REPRODUCED, evidence)


def printed_numbers(tables: Tables) -> Finding:
    """Whether all entries but those of Q^mu meet the printed ones together."""
    table = tables["table-3.1"].dropna(subset=["printed_mean"])
    table = table[table.potential != "Q_mu"]
    se = table.sd / table.n_runs**0.5
    printed_se = table.printed_ci95 / scipy_stats.norm.ppf(0.975)
    z = (table["mean"] - table.printed_mean) / (se**2 + printed_se**2) ** 0.5
    chi2 = float((z**2).sum())
    p = float(scipy_stats.chi2.sf(chi2, len(z)))
    inside = int((abs(table["mean"] - table.printed_mean) <= table.ci95 + table.printed_ci95).sum())
    evidence = (
        f"chi-square {chi2:.1f} on {len(z)} degrees of freedom (p = {p:.2g}); the intervals of "
        f"{inside} of {len(z)} entries overlap the printed ones."
    )
    return Finding(Verdict.REPRODUCED if p > 0.01 else Verdict.NOT_REPRODUCED, evidence)


def sarsa_beats_q_learning(tables: Tables) -> Finding:
    """Unshaped Sarsa against unshaped Q-learning, with and without sensor."""
    return _ordered(
        tables["table-3.1"],
        [
            ("without sensor", ("none", "sarsa", False), ("none", "q_learning", False)),
            ("with sensor", ("none", "sarsa", True), ("none", "q_learning", True)),
        ],
    )


def potentials_help_q_learning(tables: Tables) -> Finding:
    """Q* and Q~ against no shaping, and Q~ against Q*, for Q-learning without sensor."""
    q = "q_learning"
    return _ordered(
        tables["table-3.1"],
        [
            ("Q* over none", ("Q_star", q, False), ("none", q, False)),
            ("Q~ over none", ("Q_tilde", q, False), ("none", q, False)),
            ("Q~ over Q*", ("Q_tilde", q, False), ("Q_star", q, False)),
        ],
    )


def sensor_lets_potentials_help_sarsa(tables: Tables) -> Finding:
    """Q* and Q~ against no shaping, and Q~ against Q*, for Sarsa with the sensor."""
    s = "sarsa"
    return _ordered(
        tables["table-3.1"],
        [
            ("Q* over none", ("Q_star", s, True), ("none", s, True)),
            ("Q~ over none", ("Q_tilde", s, True), ("none", s, True)),
            ("Q~ over Q*", ("Q_tilde", s, True), ("Q_star", s, True)),
        ],
    )


def sensor_does_not_matter_in_one_task(tables: Tables) -> Finding:
    """Unshaped learners with and without sensor: equivalent within 10% of the mean."""
    table = tables["table-3.1"]
    told, shown = [], []
    for algorithm, name in LEARNERS.items():
        a = entry(table, "none", algorithm, True)
        b = entry(table, "none", algorithm, False)
        margin = 0.1 * abs(b.mean)
        test = equivalence(a, b, margin)
        shown.append(test.p_value < ALPHA)
        told.append(
            f"{name}: difference {test.difference:+.3f}, 90% interval [{test.low:+.3f}, "
            f"{test.high:+.3f}] against a margin of {margin:.2f}"
        )
    return Finding(
        Verdict.REPRODUCED if all(shown) else Verdict.INCONCLUSIVE,
        f"In 10⁴, two one-sided Welch tests at n = {a.n}: {'; '.join(told)}.",
    )


def q_mu_is_poor(tables: Tables) -> Finding:
    """Q^mu against no shaping, for both learners, and against the size printed."""
    table = tables["table-3.1"]
    finding = _ordered(
        table,
        [
            (name, ("none", algorithm, False), ("Q_mu", algorithm, False))
            for algorithm, name in LEARNERS.items()
        ],
    )
    if finding.verdict is not Verdict.REPRODUCED:
        return finding
    rows = table[(table.potential == "Q_mu") & table.printed_mean.notna()]
    near = (abs(rows["mean"] - rows.printed_mean) <= rows.ci95 + rows.printed_ci95).all()
    printed = ", ".join(
        f"{LEARNERS[str(r.algorithm)]} {r.printed_mean:g}" for r in rows.itertuples()
    )
    return Finding(
        Verdict.REPRODUCED if near else Verdict.DIRECTION,
        f"{finding.evidence} The thesis prints {printed}.",
    )


def fitted_reading(tables: Tables) -> str:
    """What the number of episodes changes, from the goodness-of-fit curve."""
    fit = tables["table-3.1-fit"]
    curve = fit[fit.reading == "as fitted"].set_index("episodes")
    by_episodes = curve.to_dict("index")
    best = min(by_episodes, key=lambda episodes: by_episodes[episodes]["chi2"])
    row, text = by_episodes[best], by_episodes[500]
    return (
        f"Over the {row['dof']} entries outside the Q^mu row the fit is best at {best} episodes "
        f"(chi-square {row['chi2']:.1f}, p = {row['p_value']:.2g}); at the 500 of the text it is "
        f"{text['chi2']:.0f} (p = {text['p_value']:.1g}, worst entry {text['worst_z']:.0f} "
        "standard errors off)."
    )


def other_readings(tables: Tables) -> str:
    """The best other readings at 500 episodes."""
    fit = tables["table-3.1-fit"]
    at = fit[(fit.episodes == 500) & (fit.reading != "as fitted")].sort_values("chi2")
    told = "; ".join(f"{r.reading}: {r.chi2:.0f}" for r in at.itertuples())
    return f"Chi-square at 500 episodes when one other point is varied instead: {told}."


CLAIMS: tuple[Claim, ...] = (
    Claim(
        id="3.4.1-numbers",
        section="Table 3.1",
        statement="Table 3.1 gives the total reward of each potential, learner and sensor.",
        experiments=("table-3.1",),
        criterion="A chi-square test over all entries outside the Q^mu row keeps p above .01.",
        judge=printed_numbers,
        headline=True,
    ),
    Claim(
        id="3.4.1-sarsa-beats-q-learning",
        section="3.4.1",
        statement="Sarsa earns more than Q-learning on the episodic cliff.",
        experiments=("table-3.1",),
        criterion="Unshaped Sarsa earns more, Welch with Holm below .05, in both parts.",
        judge=sarsa_beats_q_learning,
    ),
    Claim(
        id="3.4.1-potentials-help-q-learning",
        section="3.4.1",
        statement="For Q-learning both Q* and Q~ beat no shaping, and Q~ is significantly better.",
        experiments=("table-3.1",),
        criterion="Each of the three comparisons has the sign stated, Welch with Holm below .05.",
        judge=potentials_help_q_learning,
    ),
    Claim(
        id="3.4.1-sensor-helps-sarsa",
        section="3.4.1",
        statement="With the sensor both potentials significantly beat unshaped Sarsa, Q~ the most.",
        experiments=("table-3.1",),
        criterion="Each of the three comparisons has the sign stated, Welch with Holm below .05.",
        judge=sensor_lets_potentials_help_sarsa,
        headline=True,
    ),
    Claim(
        id="3.4.1-sensor-within-a-task",
        section="3.4.1",
        statement="The sensor makes no difference to learning a single task.",
        experiments=("table-3.1",),
        criterion="Unshaped runs with and without sensor are equivalent within 10% of the mean "
        "(two one-sided tests, p below .05), for both learners.",
        judge=sensor_does_not_matter_in_one_task,
    ),
    Claim(
        id="3.4.1-q-mu-is-poor",
        section="3.4.1",
        statement="Q^mu does very poorly on the episodic cliff, far worse than no shaping.",
        experiments=("table-3.1",),
        criterion="Worse than no shaping for both learners (Welch with Holm below .05), and the "
        "intervals reach the printed ones.",
        judge=q_mu_is_poor,
    ),
)

DIFFERENCES: tuple[Difference, ...] = (
    Difference(
        id="3.4.1-episodes",
        section="3.4.1",
        topic="How many episodes a run of Table 3.1 has",
        thesis="“running the agent for 500 episodes”.",
        ours="600 episodes, the number at which the printed totals come out.",
        option="`Config.episodes`, `thesis run table-3.1 --episodes 500`",
        effect=fitted_reading,
        experiments=("table-3.1-fit",),
    ),
    Difference(
        id="3.4.1-other-readings",
        section="3.4.1",
        topic="What a random action and a fall are",
        thesis="Not said: whether a random action may be the greedy one, and whether a fall also "
        "costs the step.",
        ours="A random action is drawn from all four; a fall costs 1000 and nothing more.",
        option="`Config.exploration`, `Config.fall_reward`, `Config.fall_costs_step`, "
        "`Config.epsilon`",
        effect=other_readings,
        experiments=("table-3.1-fit",),
    ),
)
