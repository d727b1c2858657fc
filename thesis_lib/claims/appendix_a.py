"""Claims of appendix A, and where this edition differs from it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd

from thesis_lib.arrays import FloatArray
from thesis_lib.claims import Claim, Difference, Finding, Tables, Verdict
from thesis_lib.experiments.appendix_a.policy_dependent import crossing

EXACT = 1e-9
"""Relative difference below which a computed value counts as equal to a formula."""
MUCH = 5.0
"""What the proof's "much greater" is read as: at least this many times."""
AROUND = 0.02
"""What "around .95" is read as: no further from it than this."""


def _proved(holds: bool, evidence: str) -> Finding:
    """Exact computation decides: it either shows the statement or its opposite."""
    return Finding(Verdict.REPRODUCED if holds else Verdict.REFUTED, evidence)


def fact_1_values(tables: Tables) -> Finding:
    """Values of the deterministic policies and of the fair coin against the formulas."""
    table = tables["figure-a.1"]
    gamma, cost = table.discount, table.penalty
    formula = pd.Series(np.nan, table.index)
    formula[table.p_b.isin([0.0, 1.0])] = -cost / (2 - 2 * gamma)
    formula[table.p_b == 0.5] = -cost / (2 - gamma)
    gap = (abs(table.value / formula - 1)).dropna()
    return _proved(
        bool((gap < EXACT).all()),
        f"Over {table.discount.nunique()} discounts the solved values differ from the formulas by "
        f"at most {gap.max():.1g} of them.",
    )


def fact_1_arbitrarily(tables: Tables) -> Finding:
    """Whether the coin is best of all policies, by a factor that grows as gamma nears 1."""
    table = tables["figure-a.1"]
    best = table.loc[table.groupby("discount").value.idxmax()].set_index("discount")
    ends = table[table.p_b.isin([0.0, 1.0])].groupby("discount").value.max()
    ratio = (ends / best.value).sort_index()
    coin = bool((best.p_b == 0.5).all())
    grows = bool((np.diff(ratio) > 0).all() and (ratio > 1).all())
    formula = (2 - ratio.index) / (2 - 2 * ratio.index)
    same = bool((abs(ratio / formula - 1) < EXACT).all())
    told = ", ".join(f"{r:.4g} at gamma {g:g}" for g, r in ratio.items())
    return _proved(
        coin and grows and same,
        f"The best policy found is {'' if coin else 'not '}the fair coin at every discount; the "
        f"best deterministic policy costs this many times as much: {told}.",
    )


def curves(table: pd.DataFrame, column: str = "value") -> tuple[FloatArray, FloatArray]:
    """Probabilities of B, shape ``(P,)``, and a column for each state, shape ``(P, S)``."""
    wide = table.pivot(index="p_b", columns="state", values=column)
    return wide.index.to_numpy(), wide.to_numpy()


def opposed(second: str) -> Callable[[Tables], Finding]:
    """Judge of one domain of figure A.2: B helps state 1 and harms state 3."""

    def judge(tables: Tables) -> Finding:
        table = tables["figure-a.2"]
        table = table[(table.second == second) & (table.weighting == "uniform")]
        holds, told = [], []
        for gamma, group in table.groupby("discount"):
            _, value = curves(group)
            holds.append((np.diff(value[:, 0]) > 0).all() and (np.diff(value[:, 2]) < 0).all())
            told.append(
                f"at gamma {gamma:g} from 0 to {value[-1, 0]:.3g} and from 0 to {value[-1, 2]:.3g}"
            )
        one = table.iloc[0]
        setting = {"a": not one.same_states, "b": not one.ergodic_2, "c": one.ergodic_2}[second]
        if second != "a":
            setting = setting and one.same_states
        return _proved(
            all(holds) and bool(setting),
            "As p(B) goes from 0 to 1, V(1) and V(3) go "
            f"{'strictly monotonically ' if all(holds) else ''}{'; '.join(told)}.",
        )

    return judge


def flat_for_a(tables: Tables) -> Finding:
    """Whether the policy that always takes A has value 0 everywhere."""
    _, value = curves(tables["figure-a.3"])
    largest = float(abs(value[0]).max())
    return _proved(largest < EXACT, f"The largest absolute value is {largest:.1g}.")


def b_raises_state_4_alone(tables: Tables) -> Finding:
    """Whether a little B lowers states 1 to 3, and more B keeps raising state 4."""
    p_b, value = curves(tables["figure-a.3"])
    step = np.diff(value, axis=0)
    first = (step[0, :3] < 0).all() and step[0, 3] > 0
    rises = (step[:, 3] > 0).all()
    lowest = float(p_b[value[:, 1].argmin()])
    return _proved(
        bool(first and rises),
        f"V(4) rises from 0 to {value[-1, 3]:.3g} throughout; V(1) and V(3) fall to "
        f"{value[-1, 0]:.3g} and {value[-1, 2]:.3g}; V(2) falls until p(B) = {lowest:.2f}, to "
        f"{value[:, 1].min():.3g}.",
    )


def because_of_state_1(tables: Tables) -> Finding:
    """Whether in task 2 state 4 rises with state 1, and by less."""
    _, value = curves(tables["figure-a.3"], "task_2")
    one, four = value[:, 0], value[:, 3]
    share = four[1:] / one[1:]
    rises = (np.diff(one) > 0).all() and (np.diff(four) > 0).all()
    proportional = np.ptp(share) < EXACT * share.mean()
    return _proved(
        bool(rises and proportional and share.mean() < 1),
        f"In task 2 V(1) rises to {one[-1]:.3g} and V(4) to {four[-1]:.3g}, which is "
        f"{share.mean():.3f} of it under every policy.",
    )


def weights_lean(tables: Tables) -> Finding:
    """Whether task 2 dominates state 4 and task 1 dominates state 1, under every policy."""
    table = tables["figure-a.3"]
    (_, one), (_, two) = curves(table, "weight_1"), curves(table, "weight_2")
    at_4 = float((two[:, 3] / one[:, 3]).min())
    at_1 = float((one[:, 0] / two[:, 0]).min())
    return _proved(
        min(at_4, at_1) >= MUCH,
        f"Over all policies d(m2|4) is at least {at_4:.1f} times d(m1|4), and d(m1|1) at least "
        f"{at_1:.1f} times d(m2|1).",
    )


def state_2_turns(tables: Tables) -> Finding:
    """Where V(2) turns positive, and whether d(m1|2) goes to 0."""
    table = tables["figure-a.3"]
    p_b, value = curves(table)
    weight = curves(table, "weight_1")[1][:, 1]
    at = crossing(p_b, value[:, 1])
    vanishes = (np.diff(weight) < 0).all() and weight[-1] < EXACT
    return _proved(
        bool(abs(at - 0.95) <= AROUND and vanishes),
        f"V(2) turns positive at p(B) = {at:.3f} and ends at {value[-1, 1]:.3g}; d(m1|2) falls "
        f"from {weight[0]:.2f} to {weight[-1]:.0f}.",
    )


def state_3_falls(tables: Tables) -> Finding:
    """Whether V(3) falls over the whole range, also where V(2) has turned."""
    _, value = curves(tables["figure-a.3"])
    return _proved(
        bool((np.diff(value[:, 2]) < 0).all()),
        f"V(3) falls from {value[0, 2]:.3g} to {value[-1, 2]:.3g}; its largest change between "
        f"neighbouring policies is {np.diff(value[:, 2]).max():.2g}.",
    )


def no_common_best(tables: Tables) -> Finding:
    """Whether some policy is best in all states of figure A.3."""
    p_b, value = curves(tables["figure-a.3"])
    best = value >= value.max(axis=0) - EXACT
    told = ", ".join(f"{p_b[best[:, s]][0]:g} in state {s + 1}" for s in range(value.shape[1]))
    return _proved(not best.all(axis=1).any(), f"The best p(B) is {told}.")


CASES = (
    ("a", "1", "tasks have different states", "the tasks have different states"),
    ("b", "2", "a task is not ergodic", "task 2 is not ergodic"),
    ("c", "3", "p(x|m) is uniform over the pairs of each task", "both tasks are ergodic"),
)


def _case(second: str, number: str, words: str, setting: str) -> Claim:
    return Claim(
        id=f"A.2-case-{number}",
        section="Appendix A, fact 2",
        statement=f"Where {words}, there need be no stationary policy that maximises the value of "
        f"every state (case {number}).",
        experiments=("figure-a.2",),
        criterion=f"On the domain of figure A.2 with task 2{second}, in which {setting}, "
        "raising p(B) raises the value of state 1 and lowers that of state 3, strictly, at every "
        "discount, with uniform p(s|m).",
        judge=opposed(second),
    )


CLAIMS: tuple[Claim, ...] = (
    Claim(
        id="A.1-values",
        section="Appendix A, fact 1",
        statement="A deterministic policy is worth -R/(2 - 2 gamma) in state 1 of figure A.1, the "
        "fair coin -R/(2 - gamma).",
        experiments=("figure-a.1",),
        criterion=f"Values by linear solve differ from the formulas by less than {EXACT:g} of "
        "them, at every discount.",
        judge=fact_1_values,
    ),
    Claim(
        id="A.1-arbitrarily-better",
        section="Appendix A, fact 1",
        statement="The best stationary stochastic policy can be arbitrarily better than the best "
        "deterministic one.",
        experiments=("figure-a.1",),
        criterion="The fair coin is the best policy at every discount, and the ratio of the costs "
        "is (2 - gamma)/(2 - 2 gamma), which exceeds any number for gamma near enough to 1.",
        judge=fact_1_arbitrarily,
        headline=True,
    ),
    *(_case(*case) for case in CASES),
    Claim(
        id="A.3-case-4",
        section="Appendix A, fact 2",
        statement="Where d(m|s) depends on the policy, there need be no stationary policy that "
        "maximises the value of every state (case 4).",
        experiments=("figure-a.3",),
        criterion="On the domain of figure A.3 no p(B) is best in all four states.",
        judge=no_common_best,
    ),
    Claim(
        id="A.3-flat",
        section="Appendix A, figure A.3",
        statement="For the policy that always takes A, values are flat at 0.",
        experiments=("figure-a.3",),
        criterion=f"No value exceeds {EXACT:g}.",
        judge=flat_for_a,
    ),
    Claim(
        id="A.3-state-4",
        section="Appendix A, figure A.3",
        statement="More B lowers the values of all states but raises that of state 4, which rises "
        "further with more B.",
        experiments=("figure-a.3",),
        criterion="The first step away from A lowers states 1 to 3; state 4 rises at every step.",
        judge=b_raises_state_4_alone,
    ),
    Claim(
        id="A.3-because-of-state-1",
        section="Appendix A, figure A.3",
        statement="In task 2 state 4 rises because of the large rise of state 1.",
        experiments=("figure-a.3",),
        criterion="Both rise with p(B), and V(4) is a fixed share of V(1), below 1.",
        judge=because_of_state_1,
    ),
    Claim(
        id="A.3-weights",
        section="Appendix A, figure A.3",
        statement="d(m2|s4) is much greater than d(m1|s4), and d(m2|s1) much smaller than "
        "d(m1|s1).",
        experiments=("figure-a.3",),
        criterion=f"At least {MUCH:g} times, under every policy.",
        judge=weights_lean,
    ),
    Claim(
        id="A.3-state-2",
        section="Appendix A, figure A.3",
        statement="From around p(B) = .95 the value of state 2 is positive, since d(m1|s2) goes "
        "to 0.",
        experiments=("figure-a.3",),
        criterion=f"It turns positive within {AROUND:g} of .95; d(m1|s2) falls throughout and ends "
        "at 0.",
        judge=state_2_turns,
    ),
    Claim(
        id="A.3-state-3",
        section="Appendix A, figure A.3",
        statement="The value of state 3 keeps decreasing.",
        experiments=("figure-a.3",),
        criterion="It falls at every step of p(B), from 0 to 1.",
        judge=state_3_falls,
    ),
)


def other_numbers(tables: Tables) -> str:
    """How often the statements hold when the numbers of figure A.3 are others."""
    table = tables["figure-a.3-numbers"]
    names = ["first_step", "state_4_rises", "state_3_falls", "state_2_turns"]
    every = table[names].all(axis=1)
    near = every & (abs(table.crossing - 0.95) <= AROUND)
    return (
        f"Of {len(table)} other choices of gain, detour and discount, fact 2 holds in "
        f"{table.conflict.mean():.0%}, all the proof's statements on how values move in "
        f"{every.mean():.0%}, and the turn of state 2 lies within {AROUND:g} of .95 as well in "
        f"{near.mean():.0%}."
    )


def other_weights(tables: Tables) -> str:
    """Whether the conflicts of figure A.2 survive occupancy weights."""
    table = tables["figure-a.2"]
    last = table[table.p_b == 1].set_index(["second", "discount", "state", "weighting"]).value
    wide = last.unstack(["weighting", "state"])
    both = (wide["occupancy", 1] > 0) & (wide["occupancy", 3] < 0)
    gap = (wide["occupancy"] - wide["uniform"]).abs().groupby("second").max().max(axis=1)
    return (
        f"With the stationary distribution as p(s|m) the conflict remains in {both.sum()} of "
        f"{len(both)} combinations of domain and discount; values change by at most "
        + ", ".join(f"{g if g > EXACT else 0:.2g} with task 2{s}" for s, g in gap.items())
        + "."
    )


DIFFERENCES: tuple[Difference, ...] = (
    Difference(
        id="A.2-numbers",
        section="Appendix A, figure A.2",
        topic="The transitions and rewards of figure A.2",
        thesis="Drawn in a figure that our text of the thesis lacks; the text says where the "
        "decision is taken, which states the tasks have and what more B does to states 1 and 3.",
        ours="Task 1 is a cycle of 1, 2 and 3, and task 2 a cycle of 1 and 2; B earns -x in the "
        "one and +x in the other. The proof is shown for every discount and every detour "
        "below 1.",
        option="`figure_a2(second, reward, discount, detour)`",
        effect="None on the facts, which claim that such domains exist; values in the figure are "
        "ours alone.",
    ),
    Difference(
        id="A.2-weights",
        section="Appendix A, figure A.2",
        topic="d(m|s) in cases 1 and 2",
        thesis="Uniform and independent of the policy in case 3; not said for cases 1 and 2.",
        ours="Uniform p(s|m) over the states of a task in all three, from which d(m|s) follows by "
        "Bayes' rule.",
        option="`state_values(..., weighting)`, `Config.weightings`",
        effect=other_weights,
        experiments=("figure-a.2",),
    ),
    Difference(
        id="A.3-numbers",
        section="Appendix A, figure A.3",
        topic="The transitions and rewards of figure A.3, and its five policies",
        thesis="Drawn in a figure that our text of the thesis lacks; the text says how the values "
        "move, and names always A and p(B) around .95 among the policies.",
        ours="A domain made so that every statement of the text holds, and p(B) = 0, .25, .5, .95 "
        "and 1.",
        option="`figure_a3(loss, gain, discount, detour)`, `thesis run figure-a.3 --gain 4`",
        effect=other_numbers,
        experiments=("figure-a.3-numbers",),
    ),
)
