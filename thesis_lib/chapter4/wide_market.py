r"""Stock trading with one sector and too many stocks and factors for any table.

With one sector the agent owns it after "buy" and not after "sell", so that what it owned
before does not matter and prices take no notice of it.  Stocks rise with a probability that
depends on the state through the level :math:`L = R_s + 3 R_g` alone, and the next level is a
binomial count plus three times another.  So

.. math:: V(L) = \max(0, E(2P_L - 1)) + \gamma \sum_{L'} T(L, L')\, V(L')

has some dozens of unknowns whatever the number of states, and
:math:`Q^*(s, a) = [a\ \text{buys}]\, E (2P_L - 1) + \gamma \sum_{L'} T(L, L') V(L')`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binom

from thesis_lib.arrays import BoolArray, FloatArray, IntArray
from thesis_lib.chapter3.runs import TabularLearner
from thesis_lib.compiled import njit
from thesis_lib.relevance import ACTION, Solutions


@dataclass(frozen=True, eq=False)
class WideTask:
    """One task: which stocks have influence, and when each factor helps.

    Attributes
    ----------
    influence
        Shape ``(E,)`` bool, at least one.
    helps
        Whether stocks are likelier to rise while a factor is 1 (True) or 0, ``(G,)`` bool.
    """

    influence: BoolArray
    helps: BoolArray


@dataclass(frozen=True)
class WideMarket:
    """The domain: every non-empty set of influential stocks and every direction of the factors.

    Attributes
    ----------
    stocks, factors
        E and G; a state has 1 + E + G bits.
    discount
        gamma.
    """

    stocks: int = 16
    factors: int = 14
    discount: float = 0.9

    @property
    def feature_names(self) -> tuple[str, ...]:
        """Names as in the stock domain, the action last; it is 0 for buy and 1 for sell."""
        return (
            "s1",
            *(f"s1e{e + 1}" for e in range(self.stocks)),
            *(f"g{g + 1}" for g in range(self.factors)),
            ACTION,
        )

    @property
    def relevant(self) -> BoolArray:
        """Which features are domain relevant, by symmetry: stocks and the action."""
        return np.array([n == ACTION or n.startswith("s1e") for n in self.feature_names])

    def sample_tasks(self, n: int, rng: np.random.Generator) -> list[WideTask]:
        """Draw n tasks, all equally likely."""
        tasks: list[WideTask] = []
        while len(tasks) < n:
            influence = rng.random(self.stocks) < 0.5
            helps = rng.random(self.factors) < 0.5
            if influence.any():
                tasks.append(WideTask(influence, helps))
        return tasks

    def sample_pairs(self, n: int, rng: np.random.Generator) -> IntArray:
        """Draw n different pairs uniformly, shape ``(n, features)``."""
        rows = np.empty((0, len(self.feature_names)), dtype=np.int64)
        while len(rows) < n:
            drawn = rng.integers(2, size=(2 * n, len(self.feature_names)))
            rows = np.unique(np.concatenate([rows, drawn]), axis=0)
        return rng.permutation(rows)[:n]

    def levels(self, task: WideTask, pairs: IntArray) -> IntArray:
        """:math:`R_s + 3 R_g` of each pair's state, shape ``(N,)``."""
        stocks = pairs[:, 1 : 1 + self.stocks]
        factors = pairs[:, 1 + self.stocks : -1]
        return stocks @ task.influence + 3 * (factors == task.helps).sum(axis=1)

    def rise(self, task: WideTask) -> FloatArray:
        """Probability that stocks rise at each level."""
        top = int(task.influence.sum()) + 3 * self.factors
        return 0.1 + 0.8 * np.arange(top + 1) / top

    def q(self, task: WideTask, pairs: IntArray) -> FloatArray:
        """Optimal values of some pairs, exactly, shape ``(N,)``.

        Parameters
        ----------
        task
            The task.
        pairs
            Feature values, shape ``(N, features)``.
        """
        rise = self.rise(task)
        influential = int(task.influence.sum())
        gain = self.stocks * (2 * rise - 1)
        rising = binom.pmf(np.arange(influential + 1), influential, rise[:, None])
        helping = binom.pmf(np.arange(self.factors + 1), self.factors, 0.5)
        step = np.zeros((len(rise), len(rise)))
        for g, chance in enumerate(helping):
            step[:, 3 * g : 3 * g + influential + 1] += chance * rising
        best = np.maximum(gain, 0.0)
        values = np.linalg.solve(np.eye(len(rise)) - self.discount * step, best)
        later = self.discount * step @ values
        level = self.levels(task, pairs)
        return (pairs[:, -1] == 0) * gain[level] + later[level]

    def solutions(self, tasks: Sequence[WideTask], pairs: IntArray) -> Solutions:
        """Values of several tasks at some pairs, all with equal weight."""
        q = np.array([self.q(task, pairs) for task in tasks])
        p = np.broadcast_to(np.full(len(pairs), 1 / len(pairs)), q.shape)
        return Solutions(q, p, pairs, self.feature_names)

    def design(self, pairs: IntArray) -> tuple[FloatArray, BoolArray]:
        """Columns of the learner's linear function and the features each reads.

        Returns
        -------
        columns
            A constant, every feature as -1 or 1, and its product with the action,
            shape ``(N, d)``.
        uses
            Shape ``(d, features)``.
        """
        signs = 2.0 * pairs - 1
        n = signs.shape[1]
        columns = np.column_stack([np.ones(len(signs)), signs, signs[:, :-1] * signs[:, -1:]])
        single = np.eye(n, dtype=bool)
        both = single[:-1].copy()
        both[:, -1] = True
        return columns, np.concatenate([np.zeros((1, n), dtype=bool), single, both])

    def weights(self, solutions: Solutions, kept: BoolArray) -> FloatArray:
        """Least-squares weights of the cross-task function on kept features, shape ``(d,)``."""
        columns, uses = self.design(solutions.features)
        allowed = ~(uses & ~kept).any(axis=1)
        out = np.zeros(columns.shape[1])
        mean = solutions.q.mean(axis=0)
        out[allowed] = np.linalg.lstsq(columns[:, allowed], mean, rcond=None)[0]
        return out

    def learn(
        self,
        task: WideTask,
        weights: FloatArray,
        rng: np.random.Generator,
        learner: TabularLearner,
    ) -> float:
        """Total reward of Q-learning with the linear function, from initial weights.

        Parameters
        ----------
        task
            The task.
        weights
            Initial, shape ``(d,)``; not changed.
        rng
            Source of the randomness.
        learner
            Its budget of steps, exploration rate, and learning rate: the share of its error that
            an update takes away.
        """
        return float(
            _learn(
                task.influence,
                task.helps,
                self.rise(task),
                self.discount,
                weights.copy(),
                learner.steps or 0,
                learner.alpha,
                learner.epsilon,
                rng,
            )
        )


@njit()
def _value(weights, bits, sell):  # type: ignore[no-untyped-def]
    n = bits.shape[0]
    sign = 1.0 if sell else -1.0
    total = weights[0] + sign * weights[1 + n]
    for j in range(n):
        total += (2.0 * bits[j] - 1.0) * (weights[1 + j] + sign * weights[2 + n + j])
    return total


@njit()
def _learn(  # type: ignore[no-untyped-def]
    influence, helps, rise, discount, weights, steps, alpha, epsilon, rng
):
    """Semi-gradient Q-learning; bits are ownership, stocks, factors; ties go to buying."""
    E, G = influence.shape[0], helps.shape[0]
    n = 1 + E + G
    bits = np.zeros(n, np.int64)
    for j in range(n):
        bits[j] = 1 if rng.random() < 0.5 else 0
    total = 0.0
    for _ in range(steps):
        if rng.random() < epsilon:
            sell = rng.random() < 0.5
        else:
            sell = _value(weights, bits, True) > _value(weights, bits, False)
        level = 0
        for e in range(E):
            if influence[e]:
                level += bits[1 + e]
        for g in range(G):
            if (bits[1 + E + g] == 1) == helps[g]:
                level += 3
        before = bits.copy()
        bits[0] = 0 if sell else 1
        reward = 0.0
        for e in range(E):
            bits[1 + e] = 1 if rng.random() < rise[level] else 0
            if not sell:
                reward += 2.0 * bits[1 + e] - 1.0
        for g in range(G):
            bits[1 + E + g] = 1 if rng.random() < 0.5 else 0
        best = max(_value(weights, bits, True), _value(weights, bits, False))
        delta = reward + discount * best - _value(weights, before, sell)
        # All columns are -1 or 1, so the squared length of the gradient is their number.
        move = alpha * delta / (2 * n + 2)
        sign = 1.0 if sell else -1.0
        weights[0] += move
        weights[1 + n] += move * sign
        for j in range(n):
            weights[1 + j] += move * (2.0 * before[j] - 1.0)
            weights[2 + n + j] += move * sign * (2.0 * before[j] - 1.0)
        total += reward
    return total
