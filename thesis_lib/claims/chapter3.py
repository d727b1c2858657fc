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


def bound_holds(tables: Tables) -> Finding:
    """Whether measured sweeps ever exceed the bound of (3.2), rounded up."""
    table = tables["theorem-1"]
    worst = float(table.excess.max())
    share = float((table.sweeps / table.bound.clip(lower=1)).median())
    return Finding(
        Verdict.REPRODUCED if worst <= 0 else Verdict.REFUTED,
        f"Over {len(table)} combinations of domain, precision and initialisation the sweeps "
        f"measured exceed the bound by at most {worst:.0f}; in the median they are {share:.0%} of "
        "it.",
    )


def minimiser_is_fastest(tables: Tables) -> Finding:
    """Whether the (smoothed) minimiser of the objective needs the fewest sweeps measured."""
    table = tables["theorem-1"]
    single = table[table.initialisation == "single task"]
    rest = table[table.initialisation != "single task"]
    fewest = rest.groupby(["domain", "tolerance"]).sweeps.min()
    own = rest[rest.initialisation == "geometric mean"].set_index(["domain", "tolerance"]).sweeps
    fewest = fewest.reindex(own.index)
    wins = int((own <= fewest + 1e-9).sum())
    alone = single.set_index(["domain", "tolerance"]).sweeps.reindex(own.index)
    beaten = int((alone < own - 1e-9).sum())
    degenerate = bool((single.log_geometric_mean == float("-inf")).all())
    evidence = (
        f"The smoothed minimiser needs the fewest sweeps in {wins} of {len(own)} cases (domain and "
        f"precision); one task's own Q* is faster on average in {beaten} of {len(own)}"
        + (", and makes the objective minus infinity in all." if degenerate else ".")
    )
    if wins == len(own) and not beaten:
        return Finding(Verdict.REPRODUCED, evidence)
    return Finding(Verdict.REFUTED if degenerate and beaten else Verdict.DIRECTION, evidence)


def mean_is_good_enough(tables: Tables) -> Finding:
    """Sweeps from the minimiser of the mean distance against the smoothed minimiser's."""
    table = tables["theorem-1"].set_index(["initialisation", "domain", "tolerance"]).sweeps
    ratio = (table["mean distance"] / table["geometric mean"].clip(lower=1)).to_numpy()
    q_star = (table["Q_star"] / table["geometric mean"].clip(lower=1)).to_numpy()
    worst = max(float(ratio.max()), float(q_star.max()))
    return Finding(
        Verdict.REPRODUCED if worst <= 1.25 else Verdict.NOT_REPRODUCED,
        "Sweeps relative to the smoothed geometric-mean minimiser: mean distance up to "
        f"{float(ratio.max()):.2f}, Q* (least squares) up to {float(q_star.max()):.2f}.",
    )


def ga_misses_mu_star(tables: Tables) -> Finding:
    """Whether the GA's best value is below that of exact gradients, by domain."""
    table = tables["section-3.3.5"].set_index(["domain", "objective", "method"]).value
    gap, told = [], []
    for domain, objective in dict.fromkeys((d, o) for d, o, _ in table.index):
        of = {m: float(table[domain, objective, m]) for m in ("ga", "gradient")}
        gap.append((of["gradient"] - of["ga"]) / abs(of["gradient"]))
        told.append(f"{domain} ({objective}): {of['ga']:.4g} of {of['gradient']:.4g}")
    missed = sum(g > 0.01 for g in gap)
    return Finding(
        Verdict.REPRODUCED if missed else Verdict.NOT_REPRODUCED,
        f"The GA stays more than 1% below the value that exact gradients reach in {missed} of "
        f"{len(gap)} cases; values reached: {'; '.join(told)}.",
    )


def mu_star_is_poor_itself(tables: Tables) -> Finding:
    """Whether even the best policy found earns far less than the tasks' own optima."""
    table = tables["section-3.3.5"]
    at = table[(table.domain == "episodic cliff") & (table.objective == "start")]
    best = float(at[at.method == "gradient"].value.iloc[0])
    # Each task's own optimum walks round the cliff in five steps.
    return Finding(
        Verdict.REPRODUCED if best < -1000 else Verdict.NOT_REPRODUCED,
        f"The best cross-task policy found earns {best:.0f} an episode; a task's own optimum "
        "earns -5.",
    )


def weightings_do_not_matter(tables: Tables) -> Finding:
    """Q* and Q~ under the four p(x|m): equivalent within 5%, or significantly different."""
    table = tables["section-3.3.6"]
    table = table[table.potential.isin(["Q_star", "Q_tilde"])]
    p_equal, p_differ, told = [], [], []
    for key, group in table.groupby(["domain", "algorithm", "potential"]):
        cells = zip(group.weighting, group["mean"], group.sd, group.n_runs, strict=True)
        by = {kind: Summary(float(mean), float(sd), int(n)) for kind, mean, sd, n in cells}
        base = by["uniform"]
        for kind in ("start", "stationary", "learning"):
            p_equal.append(equivalence(by[kind], base, 0.05 * abs(base.mean)).p_value)
            test = welch(by[kind], base)
            p_differ.append(test.p_value)
            told.append(
                (
                    test.p_value,
                    f"{', '.join(map(str, key))}, {kind}: {by[kind].mean:.4g} "
                    f"against {base.mean:.4g} with uniform weights",
                )
            )
    differ = [t for (_, t), p in zip(told, holm(p_differ), strict=True) if p < ALPHA]
    equal = sum(p < ALPHA for p in p_equal)
    evidence = (
        f"Of {len(told)} comparisons with uniform weights {equal} are equivalent within 5% (two "
        f"one-sided tests) and {len(differ)} differ significantly (Welch, Holm)"
        + (f", the clearest: {min(told)[1]}." if differ else ".")
    )
    if equal == len(told):
        return Finding(Verdict.REPRODUCED, evidence)
    return Finding(Verdict.REFUTED if differ else Verdict.INCONCLUSIVE, evidence)


def stationary_is_best_for_q_mu(tables: Tables) -> Finding:
    """In how many settings the stationary p(x|m) gives Q^mu its highest return."""
    table = tables["section-3.3.6"]
    table = table[table.potential == "Q_mu"]
    best, n = [], 0
    for key, group in table.groupby(["domain", "algorithm"]):
        n += 1
        if group.loc[group["mean"].idxmax(), "weighting"] == "stationary":
            best.append(", ".join(map(str, key)))
    evidence = f"The stationary weights give the highest mean return in {len(best)} of {n} settings"
    evidence += f" ({'; '.join(best)})." if best else "."
    if len(best) > n / 2:
        return Finding(Verdict.REPRODUCED, evidence)
    return Finding(Verdict.NOT_REPRODUCED, evidence)


def huddle_threshold(tables: Tables) -> Finding:
    """Exploration rate at which the optimal soft policy gives up the goal, over gamma."""
    by = tables["section-3.4.2-huddle"].groupby("discount").threshold.mean()
    told = ", ".join(f"{t:.3f} at gamma {g:g}" for g, t in by.items())
    near = ((by > 0.035) & (by < 0.065)).all()
    return Finding(
        Verdict.REPRODUCED if near else Verdict.NOT_REPRODUCED,
        f"Exact thresholds, the same in all eight tasks: {told}.",
    )


def sarsa_is_wrong(tables: Tables) -> Finding:
    """Whether Sarsa's solution after its long run is far from the soft optimum."""
    table = tables["section-3.4.2-sarsa"]
    stuck = int((~table.reaches_goal).sum())
    return Finding(
        Verdict.REPRODUCED if stuck == len(table) else Verdict.DIRECTION,
        f"In {stuck} of {len(table)} solutions (8 tasks at each gamma) the greedy path never "
        f"reaches the goal; the policies earn {table.reward_per_step.mean():.1g} a step where the "
        f"best soft policy earns {table.best_reward_per_step.mean():.2f}.",
    )


SHAPED = ("Q_star", "Q_tilde", "Q_tilde_sarsa")


def _best(table: pd.DataFrame) -> tuple[Summary, float]:
    """The cell with the highest mean, and its learning rate."""
    row = table.loc[table["mean"].idxmax()]
    return Summary(float(row["mean"]), float(row["sd"]), int(row["n_runs"])), float(row["alpha"])


def sarsa_does_not_beat_q_learning(tables: Tables) -> Finding:
    """The best unshaped Sarsa against the best unshaped Q-learning, at each gamma."""
    table = tables["figure-3.1"]
    table = table[table.potential == "none"]
    told, beats = [], []
    for gamma, group in table.groupby("discount"):
        sarsa, at = _best(group[group.algorithm == "sarsa"])
        q, at_q = _best(group[group.algorithm == "q_learning"])
        test = welch(sarsa, q)
        beats.append(test.difference > 0 and test.p_value < ALPHA)
        told.append(
            f"gamma {gamma:g}: {sarsa.mean:.0f} (alpha {at:g}) against {q.mean:.0f} (alpha "
            f"{at_q:g}), p = {test.p_value:.2g}"
        )
    return Finding(
        Verdict.NOT_REPRODUCED if any(beats) else Verdict.REPRODUCED,
        f"Best unshaped Sarsa against best unshaped Q-learning, Welch, n = {sarsa.n} a point: "
        f"{'; '.join(told)}.",
    )


def unshaped_sarsa_is_best(tables: Tables) -> Finding:
    """The best unshaped Sarsa against the best shaped one, at each gamma."""
    table = tables["figure-3.1"]
    table = table[table.algorithm == "sarsa"]
    told, p_values, signs = [], [], []
    for gamma, group in table.groupby("discount"):
        unshaped, _ = _best(group[group.potential == "none"])
        shaped, _ = _best(group[group.potential.isin(SHAPED)])
        test = welch(unshaped, shaped)
        p_values.append(test.p_value)
        signs.append(test.difference > 0)
        told.append(f"gamma {gamma:g}: {unshaped.mean:.0f} against {shaped.mean:.0f}")
    sure = all(holm(p_values) < ALPHA)
    return Finding(
        Verdict.REPRODUCED if sure and all(signs) else Verdict.NOT_REPRODUCED,
        f"Best unshaped against best shaped Sarsa, Welch with Holm: {'; '.join(told)}; "
        f"largest p = {max(holm(p_values)):.2g}.",
    )


def shaped_overtakes(tables: Tables) -> Finding:
    """Lowest learning rate from which the best shaped Sarsa is ahead of the unshaped one."""
    table = tables["figure-3.1"]
    table = table[table.algorithm == "sarsa"]
    told, near = [], []
    for gamma, group in table.groupby("discount"):
        by = group.pivot(index="alpha", columns="potential", values="mean")
        ahead = by[list(SHAPED)].max(axis=1) > by["none"]
        behind = ahead.index[~ahead]
        later = [a for a in ahead.index if not len(behind) or a > behind.max()]
        crossing = float(min(later)) if later else float("nan")
        near.append(0.075 <= crossing <= 0.3)
        told.append(f"{crossing:g} at gamma {gamma:g}")
    return Finding(
        Verdict.REPRODUCED if any(near) else Verdict.NOT_REPRODUCED,
        f"The best shaped Sarsa stays ahead from alpha {', '.join(told)}.",
    )


def early_boost(tables: Tables) -> Finding:
    """Step at which unshaped Sarsa's mean cumulative reward overtakes each shaped one's."""
    by = tables["figure-3.2"].pivot(index="step", columns="potential", values="mean")
    told, near = [], []
    for name in (n for n in SHAPED if n in by):
        behind = by.index[by["none"] < by[name]]
        crossing = int(behind.max()) if len(behind) else 0
        near.append(3_000 <= crossing <= 30_000)
        told.append(f"{NAMES.get(name, 'Q~ by Sarsa')} until step {crossing}")
    return Finding(
        Verdict.REPRODUCED if any(near) else Verdict.NOT_REPRODUCED,
        f"Shaped Sarsa's mean cumulative reward is ahead: {', '.join(told)}.",
    )


def stasis(tables: Tables) -> Finding:
    """Share of the run in long stretches without a goal, shaped against unshaped."""
    table = tables["figure-3.2"].groupby("potential").first()
    base, half = table.loc["none", "stasis_share"], table.loc["none", "stasis_ci95"]
    told, more = [], []
    for name in (n for n in SHAPED if n in table.index):
        share, own = table.loc[name, "stasis_share"], table.loc[name, "stasis_ci95"]
        more.append(bool(share - own > base + half))
        told.append(f"{NAMES.get(name, 'Q~ by Sarsa')} {share:.0%} ± {own:.0%}")
    return Finding(
        Verdict.REPRODUCED
        if all(more)
        else Verdict.DIRECTION
        if any(more)
        else Verdict.NOT_REPRODUCED,
        f"Share of the run in stasis: unshaped {base:.0%} ± {half:.0%}, {', '.join(told)}.",
    )


def _at_best(table: pd.DataFrame) -> dict[str, tuple[Summary, float]]:
    """Each potential at its best learning rate."""
    return {str(name): _best(group) for name, group in table.groupby("potential")}


def triangle_no_difference(tables: Tables) -> Finding:
    """Potentials on the triangle at their best alpha: equivalent within 5%?"""
    table = tables["figure-3.3"]
    best = _at_best(table[table.epsilon == 0.01])
    pairs = [("Q_star", "Q_tilde"), ("Q_star", "Q_mu"), ("Q_tilde", "Q_mu")]
    tests = [equivalence(best[a][0], best[b][0], 0.05 * abs(best[a][0].mean)) for a, b in pairs]
    differ = holm([welch(best[a][0], best[b][0]).p_value for a, b in pairs])
    told = "; ".join(
        f"{NAMES[a]} {best[a][0].mean:.2f}, {NAMES[b]} {best[b][0].mean:.2f}, p = {p:.2g}"
        for (a, b), p in zip(pairs, differ, strict=True)
    )
    n = best["Q_star"][0].n
    if all(t.p_value < ALPHA for t in tests):
        verdict = Verdict.REPRODUCED
    elif (differ < ALPHA).any():
        verdict = Verdict.REFUTED
    else:
        verdict = Verdict.INCONCLUSIVE
    return Finding(verdict, f"At each potential's best alpha, n = {n} (Welch, Holm): {told}.")


def triangle_all_but_one(tables: Tables) -> Finding:
    """The caption of figure 3.3: every difference significant but that of Q~ and Q^mu."""
    table = tables["figure-3.3"]
    best = _at_best(table[table.epsilon == 0.01])
    names = ("none", "Q_star", "Q_tilde", "Q_mu")
    pairs = [(a, b) for i, a in enumerate(names) for b in names[i + 1 :]]
    adjusted = holm([welch(best[a][0], best[b][0]).p_value for a, b in pairs])
    alike = [
        f"{NAMES[a]} and {NAMES[b]}"
        for (a, b), p in zip(pairs, adjusted, strict=True)
        if p >= ALPHA
    ]
    return Finding(
        Verdict.REPRODUCED if alike == ["Q~ and Q^mu"] else Verdict.NOT_REPRODUCED,
        f"Not significantly different at n = {best['none'][0].n} (Welch, Holm): "
        f"{', '.join(alike) or 'none'}.",
    )


def triangle_levels(tables: Tables) -> Finding:
    """Q* above Q~ above Q^mu at every pair, with the same order of actions."""
    table = tables["section-3.3-levels"]
    at = table[table.domain == "triangle"].set_index("potential")
    means = at["mean"]
    ordered = bool(
        means["Q_star"] > means["Q_tilde"] > means["Q_mu"] and at.largest_rise.max() <= 1e-9
    )
    same = float(at.same_greedy_actions.min())
    evidence = (
        f"Mean over pairs: Q* {means['Q_star']:.3f}, Q~ {means['Q_tilde']:.3f}, Q^mu "
        f"{means['Q_mu']:.3f}; least share of observations with Q*'s greedy actions: {same:.0%}."
    )
    if ordered and same == 1.0:
        return Finding(Verdict.REPRODUCED, evidence)
    return Finding(Verdict.DIRECTION if ordered else Verdict.NOT_REPRODUCED, evidence)


def _stock(tables: Tables) -> pd.DataFrame:
    table = tables["figure-3.4"]
    return table[(table.stocks == 2) & (table.epsilon == table.epsilon.min())]


def stock_best(tables: Tables) -> Finding:
    """Q* and Q~ above no shaping and above Q^mu on stock, each at its best alpha."""
    best = _at_best(_stock(tables))
    pairs = [(a, b) for a in ("Q_star", "Q_tilde") for b in ("none", "Q_mu")]
    tests = [welch(best[a][0], best[b][0]) for a, b in pairs]
    adjusted = holm([t.p_value for t in tests])
    told = ", ".join(f"{NAMES[k]} {v.mean:.1f}" for k, (v, _) in best.items())
    right = [t.difference > 0 for t in tests]
    evidence = (
        f"Best mean return (n = {best['none'][0].n} a point): {told}; {sum(right)} of 4 "
        f"comparisons have the sign stated, {sum(p < ALPHA for p in adjusted)} are significant."
    )
    if all(right) and all(p < ALPHA for p in adjusted):
        return Finding(Verdict.REPRODUCED, evidence)
    wrong = any(not r and p < ALPHA for r, p in zip(right, adjusted, strict=True))
    if wrong:
        return Finding(Verdict.REFUTED, evidence)
    return Finding(Verdict.DIRECTION if all(right) else Verdict.NOT_REPRODUCED, evidence)


def constant_wins_on_stock(tables: Tables) -> Finding:
    """Our control: a constant potential against the best of the thesis's three."""
    best = _at_best(_stock(tables))
    top = max(("Q_star", "Q_tilde", "Q_mu"), key=lambda name: best[name][0].mean)
    test = welch(best["constant"][0], best[top][0])
    explained = test.difference > 0 and test.p_value < ALPHA
    return Finding(
        Verdict.REFUTED if explained else Verdict.REPRODUCED,
        f"A constant potential of the same level earns {best['constant'][0].mean:.1f}, the best of "
        f"the three ({NAMES[top]}) {best[top][0].mean:.1f}; difference {test.difference:+.1f} "
        f"[{test.low:+.1f}, {test.high:+.1f}], Welch p = {test.p_value:.2g}.",
    )


def best_kind_depends(tables: Tables) -> Finding:
    """Which of the three potentials is best, by domain and learner."""
    told: dict[str, str] = {}
    table = tables["table-3.1"]
    for (sensor, algorithm), group in table.groupby(["sensor", "algorithm"]):
        own = group[group.potential.isin(["Q_star", "Q_tilde", "Q_mu"])]
        key = f"episodic cliff {'with' if sensor else 'without'} sensor, {LEARNERS[str(algorithm)]}"
        told[key] = NAMES[str(own.loc[own["mean"].idxmax(), "potential"])]
    for identifier, name in (("figure-3.3", "triangle"), ("figure-3.4", "stock")):
        source = tables[identifier] if identifier == "figure-3.3" else _stock(tables)
        best = _at_best(source)
        told[name] = NAMES[max(("Q_star", "Q_tilde", "Q_mu"), key=lambda k: best[k][0].mean)]
    cliff = tables["figure-3.1"]
    for algorithm, group in cliff.groupby("algorithm"):
        best = _at_best(group)
        top = max(("Q_star", "Q_tilde", "Q_mu"), key=lambda k: best[k][0].mean)
        told[f"continuing cliff, {LEARNERS[str(algorithm)]}"] = NAMES[top]
    kinds = set(told.values())
    return Finding(
        Verdict.REPRODUCED if len(kinds) > 1 else Verdict.NOT_REPRODUCED,
        f"Highest mean: {'; '.join(f'{k}: {v}' for k, v in told.items())}.",
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


def learning_rates_are_best(tables: Tables) -> Finding:
    """Whether each learner earns the most at its printed learning rate."""
    table = tables["table-3.1-alpha"]
    told, right = [], []
    for algorithm, alpha in (("q_learning", 1.0), ("sarsa", 0.4)):
        own = table[table.algorithm == algorithm]
        best, at = _best(own)
        printed, _ = _best(own[own.alpha == alpha])
        test = welch(best, printed)
        right.append(test.p_value >= ALPHA)
        told.append(
            f"{LEARNERS[algorithm]}: best {best.mean:.2f} at alpha {at:g}, {printed.mean:.2f} at "
            f"the printed {alpha:g} (p = {test.p_value:.2g})"
        )
    return Finding(
        Verdict.REPRODUCED
        if all(right)
        else Verdict.DIRECTION
        if any(right)
        else Verdict.NOT_REPRODUCED,
        f"Total reward in 10⁴, Welch, n = {printed.n} a point: {'; '.join(told)}.",
    )


def q_mu_readings(tables: Tables) -> str:
    """How far each reading's Q^mu row is from the printed one."""
    table = tables["table-3.1-mu"]
    table = table[table.reading.str.startswith(("GA", "exact", "uniform"))]
    told = []
    for algorithm, name in LEARNERS.items():
        own = table[table.algorithm == algorithm]
        near = own.loc[(own["mean"] - own.printed_mean).abs().idxmin()]
        told.append(
            f"{name}: from {own['mean'].max():.1f} to {own['mean'].min():.1f}, nearest to the "
            f"printed {near.printed_mean:g} under “{near.reading}”"
        )
    return f"Mean total reward (10⁴) over {table.reading.nunique()} readings: {'; '.join(told)}."


def goal_keeps_potential(tables: Tables) -> str:
    """What a non-zero potential at the goal does to Q^mu and to Q*."""
    table = tables["table-3.1-mu"].set_index(["reading", "algorithm"])["mean"]
    told = []
    for reading in ("GA, goal keeps its potential", "Q*, goal keeps its potential"):
        cells = ", ".join(f"{LEARNERS[a]} {table[reading, a]:.2f}" for a in LEARNERS)
        told.append(f"{reading}: {cells}")
    return f"Mean total reward in 10⁴: {'; '.join(told)}."


def discounts_of_the_continuing_cliff(tables: Tables) -> str:
    """Where shaped Sarsa overtakes, by discount."""
    return shaped_overtakes(tables).evidence


def e_of_stock(tables: Tables) -> str:
    """Return of the constant control and of Q* for both readings of E."""
    table = tables["figure-3.4"]
    table = table[table.epsilon == table.epsilon.min()]
    told = []
    for stocks, group in table.groupby("stocks"):
        best = _at_best(group)
        cells = ", ".join(f"{NAMES[k]} {v.mean:.1f}" for k, (v, _) in best.items())
        told.append(f"E = {stocks}: {cells}")
    return f"Best mean returns: {'; '.join(told)}."


CLAIMS: tuple[Claim, ...] = (
    Claim(
        id="3.3.1-bound",
        section="3.3.1",
        statement="The distance to Q* bounds the sweeps value iteration needs (eq. 3.2).",
        experiments=("theorem-1",),
        criterion="Measured sweeps never exceed the bound rounded up, on any domain.",
        judge=bound_holds,
    ),
    Claim(
        id="3.3.1-theorem-1",
        section="3.3.1",
        statement="The initialisation with the least geometric-mean distance needs the fewest "
        "sweeps in expectation (theorem 1).",
        experiments=("theorem-1",),
        criterion="The smoothed minimiser needs the fewest measured sweeps on every domain and "
        "precision; refuted if the exact minimisers (single tasks' Q*) are degenerate and beat it.",
        judge=minimiser_is_fastest,
        headline=True,
    ),
    Claim(
        id="3.3.1-average-distance",
        section="3.3.1",
        statement="Minimising an average distance approximates the optimal initialisation well.",
        experiments=("theorem-1",),
        criterion="Least squares and least mean distance need at most 1.25 times the sweeps of the "
        "smoothed minimiser everywhere.",
        judge=mean_is_good_enough,
    ),
    Claim(
        id="3.3.5-ga-missed-mu-star",
        section="3.4.1",
        statement="The genetic algorithm may not have found the best cross-task policy.",
        experiments=("section-3.3.5",),
        criterion="In some domain the GA's best value is more than 1% below the one that exact "
        "gradients reach.",
        judge=ga_misses_mu_star,
    ),
    Claim(
        id="3.3.5-mu-star-is-poor",
        section="3.4.1",
        statement="More likely, even the best cross-task policy earns little on the cliff.",
        experiments=("section-3.3.5",),
        criterion="The best policy found loses more than 1000 an episode.",
        judge=mu_star_is_poor_itself,
    ),
    Claim(
        id="3.3.6-weights",
        section="3.3.6",
        statement="The choice of p(x|m) makes no significant difference for Q* and Q~.",
        experiments=("section-3.3.6",),
        criterion="Every other choice is equivalent to uniform weights within 5% of the return "
        "(two one-sided tests at .05); refuted if any differs significantly (Welch, Holm).",
        judge=weightings_do_not_matter,
    ),
    Claim(
        id="3.3.6-stationary-q-mu",
        section="3.3.6",
        statement="For Q^mu the stationary distribution of mu works best in most cases.",
        experiments=("section-3.3.6",),
        criterion="It gives the highest mean return in more than half of the settings.",
        judge=stationary_is_best_for_q_mu,
    ),
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
    Claim(
        id="3.4.1-learning-rates",
        section="3.4.1",
        statement="Learning rates of 1 for Q-learning and .4 for Sarsa maximise their performance.",
        experiments=("table-3.1-alpha",),
        criterion="At no learning rate tried does an unshaped learner earn significantly more "
        "(Welch, .05).",
        judge=learning_rates_are_best,
    ),
    Claim(
        id="3.4.2-huddle",
        section="3.4.2",
        statement="From an exploration rate around .05 the best soft policy huddles in a corner.",
        experiments=("section-3.4.2-huddle",),
        criterion="The exact threshold lies between .035 and .065 at every gamma tried.",
        judge=huddle_threshold,
    ),
    Claim(
        id="3.4.2-sarsa-is-wrong",
        section="3.4.2",
        statement="Sarsa converges to a wrong solution on the continuing cliff.",
        experiments=("section-3.4.2-sarsa",),
        criterion="After its long run the greedy path reaches the goal in no task.",
        judge=sarsa_is_wrong,
    ),
    Claim(
        id="3.4.2-sarsa-no-better",
        section="3.4.2",
        statement="Even at its best setting Sarsa does not significantly beat Q-learning.",
        experiments=("figure-3.1",),
        criterion="At no gamma is the best unshaped Sarsa significantly above the best unshaped "
        "Q-learning (Welch, .05).",
        judge=sarsa_does_not_beat_q_learning,
    ),
    Claim(
        id="3.4.2-unshaped-sarsa-best",
        section="3.4.2",
        statement="Unshaped Sarsa at its best learning rate beats shaped Sarsa at its best.",
        experiments=("figure-3.1",),
        criterion="So at every gamma, Welch with Holm below .05.",
        judge=unshaped_sarsa_is_best,
        headline=True,
    ),
    Claim(
        id="3.4.2-shaped-overtakes",
        section="3.4.2",
        statement="Shaped Sarsa dominates only from a learning rate of around .15.",
        experiments=("figure-3.1",),
        criterion="At some gamma the best shaped mean stays ahead from an alpha between .075 and "
        ".3.",
        judge=shaped_overtakes,
    ),
    Claim(
        id="3.4.2-early-boost",
        section="3.4.2",
        statement="Shaping gives Sarsa an initial boost that lasts to around 10⁴ steps.",
        experiments=("figure-3.2",),
        criterion="For some potential the mean curves cross between 3,000 and 30,000 steps.",
        judge=early_boost,
    ),
    Claim(
        id="3.4.2-stasis",
        section="3.4.2",
        statement="Shaped Sarsa falls into long stasis, without reward, more than unshaped Sarsa.",
        experiments=("figure-3.2",),
        criterion="The share of the run in stretches of 10⁴ steps without a goal is larger, with "
        "intervals apart, for every shaped potential.",
        judge=stasis,
    ),
    Claim(
        id="3.4.3-no-difference",
        section="3.4.3",
        statement="There is no significant difference between the potentials on the triangle.",
        experiments=("figure-3.3",),
        criterion="At their best alphas all three pairs are equivalent within 5% (two one-sided "
        "tests); refuted if any pair differs significantly (Welch, Holm).",
        judge=triangle_no_difference,
    ),
    Claim(
        id="3.4.3-caption",
        section="Figure 3.3",
        statement="All differences between the methods are significant except that of Q~ and Q^mu.",
        experiments=("figure-3.3",),
        criterion="Exactly that pair keeps a Welch-Holm p of .05 or more at the best alphas.",
        judge=triangle_all_but_one,
    ),
    Claim(
        id="3.4.3-levels",
        section="3.4.3",
        statement="On the triangle Q* lies above Q~ above Q^mu, and actions have the same order.",
        experiments=("section-3.3-levels",),
        criterion="The means have that order, no pair exceeds Q*, and the greedy actions agree at "
        "every observation.",
        judge=triangle_levels,
    ),
    Claim(
        id="3.4.4-best",
        section="3.4.4",
        statement="Q* and Q~ do best on stock trading, and Q^mu lags behind.",
        experiments=("figure-3.4",),
        criterion="Both beat no shaping and Q^mu at their best alphas (Welch, Holm below .05).",
        judge=stock_best,
    ),
    Claim(
        id="3.4.4-constant",
        section="3.4.4",
        statement="Implied: what helps on stock trading is what the potential knows of the domain.",
        experiments=("figure-3.4",),
        criterion="Our control: refuted if a constant potential of the same level earns "
        "significantly more than the best of the three (Welch, .05).",
        judge=constant_wins_on_stock,
        headline=True,
    ),
    Claim(
        id="3.6-best-kind-depends",
        section="3.6",
        statement="Which potential is best depends on the domain, the learner and its settings.",
        experiments=("table-3.1", "figure-3.1", "figure-3.3", "figure-3.4"),
        criterion="The potential with the highest mean is not the same everywhere.",
        judge=best_kind_depends,
        headline=True,
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
    Difference(
        id="3.4.1-q-mu-row",
        section="3.4.1",
        topic="The Q^mu row of Table 3.1",
        thesis="-19.77 for Q-learning and -512 for Sarsa; of the genetic algorithm, selection, "
        "initial population and number of generations are not said.",
        ours="Not reproduced. The genetic algorithm runs 1000 generations with truncation "
        "selection, one elite and genes first uniform in [-1, 1].",
        option="`Config.mu`, `GeneticAlgorithm(selection, elite, initial, generations)`",
        effect=q_mu_readings,
        experiments=("table-3.1-mu",),
    ),
    Difference(
        id="3.4.1-terminal-potential",
        section="3.4.1",
        topic="The potential of a terminal state",
        thesis="Not said. The goal cell of one task is an ordinary cell of others, where it has a "
        "potential.",
        ours="0, without which shaping and initialisation are not equivalent and the optimal "
        "policy is not kept.",
        option="`Reading.goal_keeps_potential` of `table-3.1-mu`",
        effect=goal_keeps_potential,
        experiments=("table-3.1-mu",),
    ),
    Difference(
        id="3.3.1-bound-direction",
        section="3.3.1",
        topic="Which way the bound of theorem 1 bounds",
        thesis="Calls (3.2) a lower bound on the number of iterations.",
        ours="It is a number that suffices, hence an upper bound on the number needed: the "
        "contraction may be faster than gamma.",
        option="`theorem_1.sufficient_sweeps`, `theorem_1.measured_sweeps`",
        effect=lambda tables: bound_holds(tables).evidence,
        experiments=("theorem-1",),
    ),
    Difference(
        id="3.3.1-degenerate",
        section="3.3.1",
        topic="The objective of theorem 1 is degenerate",
        thesis="Assumes all distances positive and calls the minimiser optimal.",
        ours="At any single task's Q* the product is 0. We minimise the smoothed objective and "
        "measure on held-out tasks as well.",
        option="`geometric_mean_minimiser(smoothing=…)`, `Theorem1Config.smoothing`",
        effect=lambda tables: minimiser_is_fastest(tables).evidence,
        experiments=("theorem-1",),
    ),
    Difference(
        id="3.1-advice-acts-on-the-sum",
        section="3.1",
        topic="When look-ahead advice equals initialisation",
        thesis="States the equivalence for shaping rewards under the same experience.",
        ours="The advised learner also chooses its actions by Q + Phi, without which the "
        "experience is not the same.",
        option="`learn(potential=…)` and `learn(initial_q=…)`",
        effect="With it both learners take the same actions at every step, which a test holds for "
        "every learning rule.",
    ),
    Difference(
        id="3.3.5-mu-by-gradients",
        section="3.3.5",
        topic="How the cross-task policy is found",
        thesis="By the genetic algorithm of footnote 2 throughout.",
        ours="By exact gradients from many starting points; by the genetic algorithm in Table 3.1.",
        option="`MuSearch.method`",
        effect=lambda tables: ga_misses_mu_star(tables).evidence,
        experiments=("section-3.3.5",),
    ),
    Difference(
        id="3.4.2-discount",
        section="3.4.2",
        topic="The discount of the continuing cliff",
        thesis="Not printed.",
        ours="Three discounts side by side; .95 where one must be chosen.",
        option="`Figure31Config.discounts`, `continuing_cliff(discount)`",
        effect=discounts_of_the_continuing_cliff,
        experiments=("figure-3.1",),
    ),
    Difference(
        id="3.4.2-figure-3.2",
        section="Figure 3.2",
        topic="Learning rate and potential of Figure 3.2",
        thesis="Neither is printed.",
        ours="The learning rate of the long Sarsa runs of Section 3.4.2, and all potentials.",
        option="`Figure32Config.alpha`, `Figure32Config.names`",
        effect=lambda tables: early_boost(tables).evidence,
        experiments=("figure-3.2",),
    ),
    Difference(
        id="3.4.2-runs",
        section="Figure 3.1",
        topic="Runs a point",
        thesis="One run on each of the 8 tasks.",
        ours="Several runs a task, so that intervals are of use.",
        option="`Figure31Config.repeats`",
        effect=lambda tables: f"{int(tables['figure-3.1'].n_runs.iloc[0])} runs a point.",
        experiments=("figure-3.1",),
    ),
    Difference(
        id="3.4.3-shape",
        section="3.4.3",
        topic="The shape of the triangle and its start",
        thesis="The figure is not in our text; start states are not said.",
        ours="A ring of three states with the goal attached to one; the start is uniform over the "
        "three.",
        option="`triangle(shape=…, start=…)`",
        effect="The stated features of the example, (1, .25), (2, 1), (3, .25), and the 12 tasks "
        "come out, which a test holds.",
    ),
    Difference(
        id="3.4.3-text-and-caption",
        section="Figure 3.3",
        topic="Text and caption contradict each other",
        thesis="The text sees no significant difference between the potentials; the caption calls "
        "all but one significant.",
        ours="Both are judged.",
        option="`thesis run figure-3.3 --repeats 1` is the thesis's number of runs",
        effect=lambda tables: triangle_all_but_one(tables).evidence,
        experiments=("figure-3.3",),
    ),
    Difference(
        id="3.4.4-size",
        section="3.4.4",
        topic="E of the stock domain",
        thesis="Prints E = 3, but counts 240 runs as 20 on each task, which makes 12 tasks and "
        "E = 2.",
        ours="Both; E = 2 where one must be chosen.",
        option="`StockConfig.sizes`",
        effect=e_of_stock,
        experiments=("figure-3.4",),
    ),
    Difference(
        id="3.4.4-reward",
        section="3.4.4",
        topic="When a stock pays",
        thesis="“At each timestep, for each sector that it owns”; the example earns 1, which the "
        "rule as stated does not give.",
        ours="Ownership after the action times the next prices, the only reading under which "
        "Section 4.3's four statements on relevance hold.",
        option="`stock(reward_timing=…)`",
        effect="A test holds the four statements for this reading and their failure for the "
        "others.",
    ),
    Difference(
        id="3.4.4-influence",
        section="3.4.4",
        topic="Which stocks have influence",
        thesis="The example gives each sector an influence of its own; the number of tasks, "
        "(2^E - 1) 2^G, leaves one for all sectors.",
        ours="One for all sectors, as the number of tasks says.",
        option='`stock(influence="shared" | "per_sector")`',
        effect="Nothing for one sector, as in every experiment of the thesis.",
    ),
    Difference(
        id="3.4.4-globals",
        section="3.4.4",
        topic="How globals move, and the discount",
        thesis="Neither is printed.",
        ours="Globals are fair coins, independent from step to step; gamma is .9.",
        option="`stock(global_persistence=…, discount=…)`",
        effect="`thesis run figure-3.4 --discounts 0.5 0.95` shows other discounts.",
    ),
)
