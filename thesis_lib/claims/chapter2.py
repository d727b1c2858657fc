"""Claims of chapter 2, and where this edition differs from it."""

from __future__ import annotations

from functools import partial

import numpy as np
import pandas as pd

from thesis_lib.claims import Claim, Difference, Finding, Tables, Verdict
from thesis_lib.experiments.chapter2.policy_search import ENOUGH, NAMES, good_range
from thesis_lib.stats import mean_ci, welch

EXACT = 1e-9
"""Exact computations agree when they differ by less."""

DIFFERENCED = 1e-8
"""Central differences agree with an exact slope to this share of it."""

NEAR = 0.9
"""A baseline counts as near the best one from this share of its reduction of variance on."""

MATTERS = 0.01
"""Shares of the possible gain that differ by less count as the same, significant or not."""


def _p(value: float) -> str:
    return "p < 0.001" if value < 0.001 else f"p = {value:.2g}"


def _sarsa_earns_more(tables: Tables) -> Finding:
    runs = tables["section-2.3.3"]
    sarsa, q_learning = (runs[runs.method == m].total_reward / 1e4 for m in ("sarsa", "q_learning"))
    gap = welch(sarsa, q_learning)
    evidence = (
        f"Sarsa earns {mean_ci(sarsa)} and Q-learning {mean_ci(q_learning)}, in units of 10^4; "
        f"Welch test of the difference: {_p(gap.p_value)}."
    )
    if gap.p_value < 0.05:
        return Finding(Verdict.REPRODUCED if gap.difference > 0 else Verdict.REFUTED, evidence)
    return Finding(Verdict.DIRECTION if gap.difference > 0 else Verdict.NOT_REPRODUCED, evidence)


def _q_learning_walks_the_edge(tables: Tables) -> Finding:
    runs = tables["section-2.3.3"]
    at_edge = {m: g.cells_at_edge > 0 for m, g in runs.groupby("method")}
    falls = {m: g.falls for m, g in runs.groupby("method")}
    more = welch(falls["q_learning"], falls["sarsa"])
    evidence = (
        f"The learned path has cells next to the cliff in {at_edge['q_learning'].mean():.0%} of "
        f"Q-learning's runs and {at_edge['sarsa'].mean():.0%} of Sarsa's; falls a run: "
        f"{mean_ci(falls['q_learning'])} against {mean_ci(falls['sarsa'])}, Welch test "
        f"{_p(more.p_value)}."
    )
    edge = at_edge["q_learning"].mean() > 0.5 > at_edge["sarsa"].mean()
    if edge and more.difference > 0 and more.p_value < 0.05:
        return Finding(Verdict.REPRODUCED, evidence)
    return Finding(Verdict.DIRECTION if edge else Verdict.NOT_REPRODUCED, evidence)


def _q_learning_is_optimistic(tables: Tables) -> Finding:
    runs = tables["section-2.3.3"]
    excess = {m: mean_ci(g.estimate - g.late_return) for m, g in runs.groupby("method")}
    q_learning, sarsa = excess["q_learning"], excess["sarsa"]
    evidence = (
        "In the start state the learned values promise more than the last episodes earn by "
        f"{q_learning} for Q-learning and by {sarsa} for Sarsa."
    )
    over = q_learning.mean - q_learning.half_width > 0
    more = q_learning.mean - q_learning.half_width > sarsa.mean + sarsa.half_width
    if over and more:
        return Finding(Verdict.REPRODUCED, evidence)
    return Finding(Verdict.DIRECTION if over else Verdict.NOT_REPRODUCED, evidence)


def _last(table: pd.DataFrame, method: str, exploration: str) -> pd.DataFrame:
    chosen = table[(table.method == method) & (table.exploration == exploration)]
    return chosen[chosen.step == chosen.step.max()]


def _q_learning_converges(tables: Tables) -> Finding:
    last = _last(tables["section-2.3.3-convergence"], "q_learning", "constant")
    worst = last.groupby("epsilon").error_optimal.max()
    evidence = "Largest distance of any run from Q* at the end: " + "; ".join(
        f"{error:.2g} at epsilon {epsilon:g}" for epsilon, error in worst.items()
    )
    evidence += f" (the best soft values lie {last.gap.min():.3g} or more away from Q*)."
    return Finding(Verdict.REPRODUCED if (worst < 1).all() else Verdict.NOT_REPRODUCED, evidence)


def _sarsa_cannot(tables: Tables) -> Finding:
    last = _last(tables["section-2.3.3-convergence"], "sarsa", "constant")
    by_epsilon = last.groupby("epsilon")
    evidence = "; ".join(
        f"epsilon {epsilon:g}: learned value of the start {mean_ci(g.start_value)}, of the best "
        f"soft policy {g.start_soft.iloc[0]:.2f}, of Q* {g.start_optimal.iloc[0]:.2f}"
        for epsilon, g in by_epsilon
    )
    nearer = (last.start_value - last.start_soft).abs() < (
        last.start_value - last.start_optimal
    ).abs()
    apart = bool((last.gap > EXACT).all())
    verdict = Verdict.REPRODUCED if apart and nearer.all() else Verdict.NOT_REPRODUCED
    return Finding(
        verdict, evidence + f". Nearer to the soft value in {nearer.mean():.0%} of runs."
    )


def _estimators(tables: Tables) -> pd.DataFrame:
    return tables["section-2.3.4"].set_index("estimator")


def _smallest_step(tables: Tables) -> pd.Series:
    steps = tables["section-2.3.5"].sort_values("scale")
    return steps.iloc[0]


def _unbiased(tables: Tables) -> Finding:
    t = _estimators(tables).loc["whole return"]
    evidence = (
        "Over all trajectories its expectation differs from the differenced exact value by "
        f"{t.slope_difference:.0e}, where the gradient has norm {t.gradient_norm:.3g}."
    )
    holds = t.slope_difference < DIFFERENCED * t.gradient_norm
    return Finding(Verdict.REPRODUCED if holds else Verdict.REFUTED, evidence)


def _near_optimal(tables: Tables) -> Finding:
    v = _estimators(tables).variance
    none, value, best = (v[f"return to go{end}"] for end in ("", ", baseline", ", best baseline"))
    share = (none - value) / (none - best)
    evidence = (
        f"Variance {none:.3g} without a baseline, {value:.3g} with the state's value and "
        f"{best:.3g} with the best baseline of state and time there is: the value brings "
        f"{share:.1%} of what a baseline can bring."
    )
    return Finding(Verdict.REPRODUCED if share >= NEAR else Verdict.NOT_REPRODUCED, evidence)


def _discounting(tables: Tables) -> Finding:
    t = _estimators(tables)
    bias = float(t.bias["discounted whole return"])
    before, after = t.variance["whole return"], t.variance["discounted whole return"]
    holds = bias > EXACT and after < before
    evidence = (
        f"Discounting lowers the variance from {before:.3g} to {after:.3g} and moves the "
        f"expectation by {bias:.3g}, where the gradient has norm "
        f"{t.gradient_norm['whole return']:.3g}."
    )
    return Finding(Verdict.REPRODUCED if holds else Verdict.REFUTED, evidence)


def _return_to_go(tables: Tables) -> Finding:
    t = _estimators(tables)
    bias = max(
        t.bias["return to go"],
        t.bias_discounted["discounted return to go, weighted"],
    )
    evidence = (
        f"Leaving out the rewards before t lowers the variance from "
        f"{t.variance['whole return']:.3g} to {t.variance['return to go']:.3g} and moves the "
        f"expectation by {bias:.0e}, that is by rounding: it costs no bias. The bias of equation "
        "2.12 comes from counting the discount from t."
    )
    return Finding(Verdict.REPRODUCED if bias > EXACT else Verdict.REFUTED, evidence)


def _baseline(tables: Tables) -> Finding:
    t = _estimators(tables)
    before, after = t.variance["return to go"], t.variance["return to go, baseline"]
    bias = t.bias["return to go, baseline"]
    evidence = (
        f"The state-value baseline lowers the variance from {before:.3g} to {after:.3g} and "
        f"moves the expectation by {bias:.0e}."
    )
    holds = after < before and bias < EXACT
    return Finding(Verdict.REPRODUCED if holds else Verdict.REFUTED, evidence)


def _td_error(tables: Tables) -> Finding:
    t = _estimators(tables)
    pathwise, mean = t.td_difference.max(), t.td_mean_difference.max()
    evidence = (
        f"On single trajectories the two differ by up to {pathwise:.3g}; their expectations "
        f"differ by {mean:.0e}. The identity holds on average over what follows, not for each "
        "sample."
    )
    return Finding(Verdict.REPRODUCED if pathwise < EXACT else Verdict.REFUTED, evidence)


def _by_setting(tables: Tables, algorithm: str) -> pd.DataFrame:
    """One row a setting: share of runs that arrive and stay, and that end below."""
    t = tables["section-2.3.5-settings"]
    t = t.assign(stays=t.arrived.notna() & (t.last_share >= ENOUGH))
    by = t[t.algorithm == algorithm].groupby("setting")
    return pd.DataFrame(
        {
            "arrived": by.stays.mean(),
            "worse": by.last_share.apply(lambda x: (x < 0).mean()),
            "mean": by.mean_share.mean(),
        }
    )


def _best(tables: Tables, algorithm: str) -> tuple[float, pd.Series]:
    """The setting with the highest mean return over all iterations, and its runs' values."""
    t = tables["section-2.3.5-settings"]
    setting = float(_by_setting(tables, algorithm)["mean"].idxmax())
    chosen = (t.algorithm == algorithm) & (t.setting == setting)
    return setting, t[chosen].mean_share


def _step_size(tables: Tables) -> Finding:
    by = _by_setting(tables, "vpg")
    t = tables["section-2.3.5-settings"].query("algorithm == 'vpg'")
    fallen = t[t.lowest_share < 0]
    stuck = (fallen.last_share < 0).mean() if len(fallen) else 0.0
    low, high = by.index.min(), by.index.max()
    evidence = (
        f"Of vanilla policy gradient's runs with rate {high:g} {by.worse[high]:.0%} end below "
        f"where they began, with rate {low:g} {by.arrived[low]:.0%} get 90% of the possible gain "
        f"in {t.iterations.iloc[0]} iterations, and with the best rate, {by['mean'].idxmax():g}, "
        f"{by.arrived[by['mean'].idxmax()]:.0%}. Of the {len(fallen)} runs that ever fell below "
        f"their start {stuck:.0%} end there."
    )
    bad, slow = by.worse[high] > 0.5 and stuck > 0.5, by.arrived[low] < 0.5
    if bad and slow and by.arrived.max() > 0.5:
        return Finding(Verdict.REPRODUCED, evidence)
    return Finding(Verdict.DIRECTION if bad or slow else Verdict.NOT_REPRODUCED, evidence)


def _hard_constraint(tables: Tables) -> Finding:
    t = tables["section-2.3.5-learning"].dropna(subset="kl_sampled")
    ratio = (t.kl_sampled / t.delta_kl).groupby(t.algorithm)
    exact = t[t.algorithm == "trpo"]
    over = (exact.kl_exact > exact.delta_kl).mean()
    highest = (exact.kl_exact / exact.delta_kl).max()
    told = ", ".join(f"{NAMES[a]} {ratio.max()[a]:.3g}" for a in ratio.max().index if a != "trpo")
    evidence = (
        f"On its batch TRPO reaches at most {ratio.max()['trpo']:.3f} of the bound, "
        f"{ratio.median()['trpo']:.2f} of it in the median update; the largest of the others: "
        f"{told}. In expectation over the states rather than on the batch TRPO is above the bound "
        f"in {over:.0%} of its updates, by at most a factor {highest:.3f}."
    )
    holds = ratio.max()["trpo"] <= 1 + EXACT
    return Finding(Verdict.REPRODUCED if holds else Verdict.REFUTED, evidence)


def _against(other: str, tables: Tables) -> Finding:
    ours, trpo = _best(tables, "trpo")
    theirs, rival = _best(tables, other)
    gap = welch(trpo, rival)
    width = {k: _told(good_range(tables["section-2.3.5-settings"], k)) for k in ("trpo", other)}
    evidence = (
        "Mean share of the possible gain over all iterations, each at its best setting: TRPO "
        f"(bound {ours:g}) {mean_ci(trpo)}, {NAMES[other]} (rate {theirs:g}) {mean_ci(rival)}; "
        f"Welch test {_p(gap.p_value)}. All runs arrive and stay over {width['trpo']} in the "
        f"length of TRPO's step, the root of its bound, and {width[other]} in that of the other's, "
        "its rate."
    )
    if gap.p_value < 0.05 and abs(gap.difference) > MATTERS:
        return Finding(Verdict.REPRODUCED if gap.difference > 0 else Verdict.REFUTED, evidence)
    return Finding(Verdict.DIRECTION if gap.difference > 0 else Verdict.NOT_REPRODUCED, evidence)


def _told(width: float) -> str:
    return f"a factor {width:.3g}" if np.isfinite(width) else "none"


def _quadratic(tables: Tables) -> Finding:
    smallest = _smallest_step(tables)
    printed = smallest.kl_new_old / smallest.printed_quadratic
    half = smallest.kl_new_old / smallest.half_quadratic
    evidence = (
        f"For a step of length {smallest.scale:g} the divergence is {printed:.4f} times the "
        f"printed form and {half:.4f} times half of it: a factor 1/2 is missing in print."
    )
    return Finding(Verdict.REPRODUCED if abs(printed - 1) < 0.01 else Verdict.REFUTED, evidence)


CLAIMS: tuple[Claim, ...] = (
    Claim(
        id="2.3.3-sarsa-online",
        section="2.3.3",
        statement="Sarsa may earn more than Q-learning while learning; the cliff shows it.",
        experiments=("section-2.3.3",),
        criterion="Mean total reward of Sarsa above that of Q-learning, Welch test, p < .05.",
        judge=_sarsa_earns_more,
        headline=True,
    ),
    Claim(
        id="2.3.3-q-learning-optimistic",
        section="2.3.3",
        statement="Q-learning ignores the randomness of exploration and expects too much.",
        experiments=("section-2.3.3",),
        criterion=(
            "In the start state the learned values promise the epsilon-greedy agent more than its "
            "last episodes earn: the 95% interval of the excess lies above 0 and above Sarsa's."
        ),
        judge=_q_learning_is_optimistic,
    ),
    Claim(
        id="2.3.3-q-learning-converges",
        section="2.3.3",
        statement="Q-learning converges to the optimal values under many behaviour policies.",
        experiments=("section-2.3.3-convergence",),
        criterion=(
            "In every run at every epsilon the root mean square distance from Q* ends below 1, "
            "the cost of one step."
        ),
        judge=_q_learning_converges,
    ),
    Claim(
        id="2.3.3-sarsa-cannot-converge",
        section="2.3.3",
        statement="Sarsa cannot converge to the optimal values while it explores.",
        experiments=("section-2.3.3-convergence",),
        criterion=(
            "The exact values of the best soft policy differ from Q*, and in every run the learned "
            "value of the start state ends nearer to the former than to the latter."
        ),
        judge=_sarsa_cannot,
    ),
    Claim(
        id="2.3.4-unbiased",
        section="2.3.4",
        statement="The score-function estimate of the policy gradient is unbiased.",
        experiments=("section-2.3.4",),
        criterion=(
            "Exactly computed: its expectation equals the slope of the exact value, found by "
            "central differences, to a relative 1e-8."
        ),
        judge=_unbiased,
    ),
    Claim(
        id="2.3.4-discounting-bias",
        section="2.3.4",
        statement="Discounting reduces the variance of the policy gradient at the cost of bias.",
        experiments=("section-2.3.4",),
        criterion="Exactly computed: lower variance, and a bias that is not 0.",
        judge=_discounting,
    ),
    Claim(
        id="2.3.4-return-to-go-bias",
        section="2.3.4",
        statement="Using only the return from t onwards also comes at the cost of bias.",
        experiments=("section-2.3.4",),
        criterion="Exactly computed: a bias that is not 0 with everything else unchanged.",
        judge=_return_to_go,
    ),
    Claim(
        id="2.3.4-baseline",
        section="2.3.4",
        statement="A state-value baseline reduces variance and costs no bias.",
        experiments=("section-2.3.4",),
        criterion="Exactly computed: lower variance, bias 0 up to rounding.",
        judge=_baseline,
    ),
    Claim(
        id="2.3.4-near-optimal",
        section="2.3.4",
        statement="The state-value function is a near-optimal baseline.",
        experiments=("section-2.3.4",),
        criterion=(
            "Exactly computed: it brings at least 90% of the reduction in variance that the best "
            "baseline of state and time brings."
        ),
        judge=_near_optimal,
    ),
    Claim(
        id="2.3.4-td-error",
        section="2.3.4",
        statement="With the state-value function as baseline the advantage is the TD error.",
        experiments=("section-2.3.4",),
        criterion="Exactly computed: equal on every trajectory of a small task.",
        judge=_td_error,
    ),
    Claim(
        id="2.3.5-step-size",
        section="2.3.5",
        statement=(
            "Too long a gradient step makes a bad policy from which it is hard to recover; tiny "
            "steps make learning inefficient."
        ),
        experiments=("section-2.3.5-settings",),
        criterion=(
            "On a task with two parameters: at the highest rate most runs of vanilla policy "
            "gradient end below their start, and so do most runs that ever fell below it; at the "
            "lowest rate most do not get 90% of the possible gain, which most get at another rate."
        ),
        judge=_step_size,
    ),
    Claim(
        id="2.3.5-hard-constraint",
        section="2.3.5",
        statement="TRPO puts a hard limit on the divergence between the old and the new policy.",
        experiments=("section-2.3.5-learning",),
        criterion="In no update is the mean divergence over the batch's states above the bound.",
        judge=_hard_constraint,
    ),
    Claim(
        id="2.3.5-penalty",
        section="2.3.5",
        statement=(
            "That TRPO fixes the divergence, where the natural gradient charges for it, makes a "
            "significant difference."
        ),
        experiments=("section-2.3.5-settings",),
        criterion=(
            "On a task with two parameters TRPO's return, averaged over iterations, is above the "
            "natural gradient's of fixed rate by more than 1% of the possible gain, each at its "
            "best setting; Welch test, p < .05."
        ),
        judge=partial(_against, "natural"),
    ),
    Claim(
        id="2.3.5-trpo-better",
        section="2.3.5",
        statement=(
            "TRPO outperforms other policy-gradient methods (said of continuous control; here "
            "vanilla policy gradient on a small task)."
        ),
        experiments=("section-2.3.5-settings",),
        criterion=(
            "On a task with two parameters TRPO's return, averaged over iterations, is above "
            "vanilla policy gradient's by more than 1% of the possible gain, each at its best "
            "setting; Welch test, p < .05."
        ),
        judge=partial(_against, "vpg"),
    ),
    Claim(
        id="2.3.5-kl-quadratic",
        section="2.3.5",
        statement="The KL divergence of a small step is step' F step, F the Fisher information.",
        experiments=("section-2.3.5",),
        criterion="Exactly computed: the ratio of the two is within 1% of 1 for a small step.",
        judge=_quadratic,
    ),
    Claim(
        id="3.4.1-q-learning-walks-the-edge",
        section="3.4.1",
        statement="Q-learning tends to walk right next to the cliff and falls more often.",
        experiments=("section-2.3.3",),
        criterion=(
            "The greedy path has cells next to the cliff in most runs of Q-learning and in fewer "
            "than half of Sarsa's, and Q-learning falls more often, Welch test, p < .05."
        ),
        judge=_q_learning_walks_the_edge,
    ),
)


def _step_length(tables: Tables) -> str:
    smallest = _smallest_step(tables)
    ratio = (smallest.printed_quadratic / smallest.kl_old_new) ** 0.5
    return (
        f"Taken literally, the printed form would make every step {ratio:.3f} times shorter than "
        "the divergence allows."
    )


def _fisher(tables: Tables) -> str:
    smallest = _smallest_step(tables)
    ratio = smallest.trajectory_quadratic / smallest.printed_quadratic
    return (
        f"On episodes of {smallest.steps:g} steps the printed matrix is {ratio:.3f} times the one "
        "that belongs to the divergence of equation 2.14, so that the step would be shorter by "
        "the square root of that."
    )


def _kl_direction(tables: Tables) -> str:
    t = tables["section-2.3.5"].sort_values("scale")
    near = t.iloc[0]
    far = t.loc[(t.kl_old_new - 0.1).abs().idxmin()]
    return (
        f"For a short step the two agree (ratio {near.kl_old_new / near.kl_new_old:.4f}); for one "
        f"of divergence {far.kl_old_new:.2g} the other order gives {far.kl_new_old:.2g}."
    )


def _no_line_search(tables: Tables) -> str:
    t = tables["section-2.3.5-learning"].dropna(subset="kl_sampled")
    free, held = (t[t.algorithm == a] for a in ("natural_delta", "trpo"))
    over = (free.kl_sampled > free.delta_kl).mean()
    return (
        f"Without the search {over:.0%} of updates pass the bound on their own batch, the furthest "
        f"by a factor {(free.kl_sampled / free.delta_kl).max():.2f}; with it "
        f"{(held.backtracks > 0).mean():.0%} of updates are shortened, at most "
        f"{held.backtracks.max():.0f} times."
    )


DIFFERENCES: tuple[Difference, ...] = (
    Difference(
        id="2.3.5-half",
        section="2.3.5",
        topic="The factor one half of the quadratic approximation",
        thesis="The divergence of a step is approximated by step' F step.",
        ours="One half of it, which is what a second-order expansion gives.",
        option="none: the printed form is a slip",
        effect=_step_length,
        experiments=("section-2.3.5",),
    ),
    Difference(
        id="2.3.5-fisher",
        section="2.3.5",
        topic="Fisher information of a trajectory or of a state",
        thesis="F is the mean outer product of the score of a whole trajectory.",
        ours="The mean over visited states, because the constraint is a mean over states.",
        option="none: the two differ by the length of the episodes",
        effect=_fisher,
        experiments=("section-2.3.5",),
    ),
    Difference(
        id="2.3.5-kl-order",
        section="2.3.5",
        topic="Order of the two policies in the divergence",
        thesis="KL(new || old) in equation 2.14.",
        ours="KL(old || new), as in the author's code and the TRPO paper; the other is an option.",
        option="`TRPO(kl_direction='old_new' | 'new_old')`",
        effect=_kl_direction,
        experiments=("section-2.3.5",),
    ),
    Difference(
        id="2.3.5-line-search",
        section="2.3.5",
        topic="The line search",
        thesis="On L and the divergence, to determine the step size.",
        ours=(
            "From the step whose quadratic form is at the bound, times 0.8 up to 14 times, until "
            "L has grown and the divergence itself is within the bound; if none does, the policy "
            "stays as it is. This is the author's code."
        ),
        option="`TRPO(backtrack_ratio=, max_backtracks=)`",
        effect=_no_line_search,
        experiments=("section-2.3.5-learning",),
    ),
    Difference(
        id="2.3.4-baseline-order",
        section="2.3.4",
        topic="When the baseline is fitted",
        thesis="Line 7 of algorithms 5 and 6, after the advantages of line 6.",
        ours=(
            "The same: advantages subtract the baseline fitted to earlier iterations, and 0 in the "
            "first."
        ),
        option="none: fitting first would make the baseline depend on the actions it judges",
        effect=(
            "A baseline fitted to the very returns it is subtracted from is no longer a function "
            "of the state alone, and the estimate is no longer unbiased."
        ),
    ),
)
