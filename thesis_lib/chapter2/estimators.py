"""Policy-gradient estimators, compared exactly (section 2.3.4).

On a task small enough to list every trajectory, the expectation and the variance of an
estimator are sums, not samples: what each variance-reduction technique costs in bias can
then be said without an error bar.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from thesis_lib.arrays import FloatArray
from thesis_lib.chapter2.every_trajectory import (
    REWARD,
    THETA,
    scores,
    state_values,
    trajectories,
    value_gradient,
)
from thesis_lib.edition.criteria import EXACT, exact
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.edition.words import number

DIFFERENCED = 1e-8
"""Central differences agree with an exact slope to this share of it."""

NEAR = 0.9
"""A baseline counts as near the best one from this share of its reduction of variance on."""


@dataclass(frozen=True)
class Config:
    """Episodes of the small task, and the discount."""

    steps: int = 6
    """Length of the episodes."""
    discount: float = 0.8
    """gamma of the discounted estimators."""


@dataclass(frozen=True)
class Estimator:
    """Expectation and variance of an estimator of the policy gradient."""

    estimator: str
    """What multiplies the scores."""
    bias: float
    """Norm of its expectation less the gradient of the undiscounted return."""
    bias_discounted: float
    """Norm of its expectation less the gradient of the discounted return."""
    variance: float
    """Trace of the covariance matrix of one trajectory's estimate."""
    gradient_norm: float
    """Norm of its expectation."""
    slope_difference: float
    """Norm of its expectation less the differenced undiscounted value."""
    td_difference: float
    """TD error only: largest difference from eq. 2.12 with the value baseline."""
    td_mean_difference: float
    """TD error only: the same of their means given the pair at t."""


@experiment(
    "ch2-estimators",
    item="Section 2.3.4",
    smoke=Config(steps=3),
    book=Config(),
    seconds=0.03,
)
def biases(config: Config, context: Context) -> list[Estimator]:
    """Bias and variance of policy-gradient estimators, over all trajectories of a small task."""
    every = trajectories(config.steps)
    weight = every.probability
    score = scores(THETA)[every.states, every.actions]
    reward = REWARD[every.states, every.actions]
    power = config.discount ** np.arange(config.steps)

    def to_go(gamma: float) -> FloatArray:
        left = np.zeros_like(reward)
        total = np.zeros(len(reward))
        for t in reversed(range(config.steps)):
            total = reward[:, t] + gamma * total
            left[:, t] = total
        return left

    def value(gamma: float) -> FloatArray:
        left = state_values(config.steps, gamma)
        return left[np.arange(config.steps), every.states]

    whole = score.sum(axis=1) * reward.sum(axis=1)[:, None]
    whole_discounted = score.sum(axis=1) * (reward @ power)[:, None]
    truth = {"undiscounted": weight @ whole, "discounted": weight @ whole_discounted}

    def weighted(advantage: FloatArray) -> FloatArray:
        return (score * advantage[:, :, None]).sum(axis=1)

    def best(sample: FloatArray) -> FloatArray:
        """Subtract the baseline of state and time that leaves the least variance."""
        # Scores in one state at one time, zero elsewhere: what each entry of a baseline weighs.
        visits = every.states[:, :, None] == np.arange(2)
        parts = (score[:, :, None, :] * visits[..., None]).reshape(len(weight), -1, 4)
        gram = np.einsum("n,nki,nli->kl", weight, parts, parts)
        baseline = np.linalg.lstsq(gram, np.einsum("n,nki,ni->k", weight, parts, sample))[0]
        return np.asarray(sample - np.einsum("k,nki->ni", baseline, parts))

    gamma = config.discount
    samples = {
        "whole return": whole,
        "return to go": weighted(to_go(1.0)),
        "return to go, baseline": weighted(to_go(1.0) - value(1.0)),
        "return to go, best baseline": best(weighted(to_go(1.0))),
        "discounted whole return": whole_discounted,
        "discounted return to go, weighted": weighted(power * to_go(gamma)),
        "discounted return to go": weighted(to_go(gamma)),
        "discounted return to go, baseline": weighted(to_go(gamma) - value(gamma)),
    }
    advantage = to_go(gamma) - value(gamma)
    following = state_values(config.steps, gamma)[1:]
    td_error = reward - value(gamma)
    td_error[:, :-1] += gamma * following[np.arange(config.steps - 1), every.states[:, 1:]]
    samples["TD error"] = weighted(td_error)
    gap = advantage - td_error
    at_pair = [
        weight[here] @ gap[here, t] / weight[here].sum()
        for t in range(config.steps)
        for pair in range(4)
        if (here := 2 * every.states[:, t] + every.actions[:, t] == pair).any()
    ]
    slope = value_gradient(config.steps)
    records = []
    for name, sample in samples.items():
        mean = weight @ sample
        is_td = name == "TD error"
        records.append(
            Estimator(
                name,
                bias=float(np.linalg.norm(mean - truth["undiscounted"])),
                bias_discounted=float(np.linalg.norm(mean - truth["discounted"])),
                variance=float(weight @ ((sample - mean) ** 2).sum(axis=1)),
                gradient_norm=float(np.linalg.norm(mean)),
                slope_difference=float(np.linalg.norm(mean - slope)),
                td_difference=np.abs(gap).max() if is_td else np.nan,
                td_mean_difference=np.abs(at_pair).max() if is_td else np.nan,
            )
        )
    return records


def _lowers(known: pd.DataFrame, before: str, after: str) -> str:
    """How the variance changes from one estimator to another."""
    first, second = known.variance[before], known.variance[after]
    moves = "lowers" if second < first else "raises"
    return f"{moves} the variance from {number(first)} to {number(second)}"


@criterion("2.3.4-unbiased", biases)
def unbiased(table: pd.DataFrame) -> Finding:
    """The expectation of the plain estimator against the slope of the exact value."""
    plain = table.set_index("estimator").loc["whole return"]
    return exact(
        plain.slope_difference < DIFFERENCED * plain.gradient_norm,
        "Over all trajectories its expectation differs from the differenced exact value by "
        f"{plain.slope_difference:.0e}, where the gradient has norm "
        f"{number(plain.gradient_norm)}.",
    )


@criterion("2.3.4-discounting-bias", biases)
def discounting(table: pd.DataFrame) -> Finding:
    """Variance and bias of the discounted return."""
    known = table.set_index("estimator")
    plain, discounted = known.loc["whole return"], known.loc["discounted whole return"]
    return exact(
        discounted.bias > EXACT and discounted.variance < plain.variance,
        f"Discounting {_lowers(known, 'whole return', 'discounted whole return')} and moves the "
        f"expectation by {number(discounted.bias)}, where the gradient has norm "
        f"{number(plain.gradient_norm)}.",
    )


@criterion("2.3.4-return-to-go-bias", biases)
def return_to_go(table: pd.DataFrame) -> Finding:
    """Bias of leaving out what was earned before."""
    known = table.set_index("estimator")
    weighted = known.bias_discounted["discounted return to go, weighted"]
    bias = max(known.bias["return to go"], weighted)
    costs = bias > EXACT
    rounding = (
        ", that is by rounding: it costs no bias. The bias of equation 2.12 comes from counting "
        "the discount from t"
    )
    return exact(
        costs,
        f"Leaving out the rewards before t {_lowers(known, 'whole return', 'return to go')} and "
        f"moves the expectation by {bias:.0e}{'' if costs else rounding}.",
    )


@criterion("2.3.4-baseline", biases)
def baseline(table: pd.DataFrame) -> Finding:
    """Variance and bias of the state-value baseline."""
    known = table.set_index("estimator")
    none, value = known.loc["return to go"], known.loc["return to go, baseline"]
    return exact(
        value.variance < none.variance and value.bias < EXACT,
        f"The state-value baseline {_lowers(known, 'return to go', 'return to go, baseline')} and "
        f"moves the expectation by {value.bias:.0e}.",
    )


@criterion("2.3.4-near-optimal", biases)
def near_optimal(table: pd.DataFrame) -> Finding:
    """Reduction of variance by the state's value, as a share of the largest."""
    variance = table.set_index("estimator").variance
    none, value, best = (
        variance[f"return to go{x}"] for x in ("", ", baseline", ", best baseline")
    )
    share = (none - value) / (none - best)
    return Finding(
        Verdict.REPRODUCED if share >= NEAR else Verdict.NOT_REPRODUCED,
        f"Variance {number(none)} without a baseline, {number(value)} with the state's value and "
        f"{number(best)} with the best baseline of state and time there is: the value brings "
        f"{share:.1%} of what a baseline can bring.",
        {"share": share},
    )


@criterion("2.3.4-td-error", biases)
def td_error(table: pd.DataFrame) -> Finding:
    """Largest difference of the two on a trajectory, and of their expectations."""
    pathwise, mean = table.td_difference.max(), table.td_mean_difference.max()
    same = pathwise < EXACT
    instead = " The identity holds on average over what follows, not for each sample."
    other = Verdict.DIRECTION if mean < EXACT else Verdict.REFUTED
    return Finding(
        Verdict.REPRODUCED if same else other,
        f"On single trajectories the two differ by up to {number(pathwise)}; their expectations "
        f"differ by {mean:.0e}.{'' if same else instead}",
    )


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Biases and variance of every estimator; a bias that is rounding is 0."""
    biases = {"bias": "bias, undiscounted", "bias_discounted": "bias, discounted"}
    zeroed = {text: table[name].where(table[name] > 1e-12, 0.0) for name, text in biases.items()}
    return pd.DataFrame({"score times": table.estimator, **zeroed, "variance": table.variance})
