"""The heat domain as section 4.3 needs it: solutions, relevance and potentials in feature space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from thesis_lib.arrays import BoolArray, FloatArray
from thesis_lib.checks import one_of
from thesis_lib.domains.heat import ACTIONS, LAYOUTS, HeatTask, HeatWorld
from thesis_lib.domains.heat_learning import HeatLearned, Traces, sarsa_lambda
from thesis_lib.domains.tiles import TileCoding
from thesis_lib.potentials import linear_cross_task_weights
from thesis_lib.relevance import Solutions, keep

Weighting = Literal["visits", "uniform"]
"""p(x|m): each pair's share of visits, or the same for all pairs the task visited."""

Sources = Literal["reachable", "inside"]
"""Sources anywhere that the robot can reach, or at least its radius from every wall."""

Tilings = Literal["kept", "feature"]
"""Whether an abstraction keeps tilings apart, or the tiling is a feature that may be removed."""


@dataclass(frozen=True)
class HeatLearner:
    """Sarsa(lambda) as section 4.3 has it; ``alpha`` and ``discount`` are not printed."""

    episodes: int = 500
    """Of each observed task."""
    alpha: float = 0.3
    """Learning rate, shared by the active features."""
    epsilon: float = 0.05
    """Chance of a random action."""
    trace_decay: float = 0.9
    """lambda."""
    discount: float = 1.0
    """gamma."""
    traces: Traces = "replacing"
    """Kind of eligibility traces."""


@dataclass(frozen=True)
class HeatSpace:
    """A heat domain seen through the learner's features.

    Parameters
    ----------
    world
        What the tasks share.
    learner
        Solves the tasks.
    layout
        Of the tilings, a key of :data:`~thesis_lib.domains.heat.LAYOUTS`.
    weighting
        p(x|m) of a pair of binary feature and action.
    tilings
        ``"kept"``: a tile is named by its tiling too, so that no abstraction that keeps a
        variable merges tiles of different tilings.
    sources
        Where sources are.  One near a wall can be met from a short stretch along it only,
        and is far harder to find.
    unseen
        Weight of pairs that no observed task visited.

    Notes
    -----
    Source: section 4.3 and equation 3.5.  A "state-action pair" of the relevance
    machinery is here a pair (binary feature, action), its "Q-value" the weight.
    """

    world: HeatWorld = field(default_factory=HeatWorld)
    learner: HeatLearner = field(default_factory=HeatLearner)
    layout: str = "headings"
    weighting: Weighting = "visits"
    tilings: Tilings = "kept"
    sources: Sources = "reachable"
    unseen: float = 0.0

    def __post_init__(self) -> None:
        one_of("layout", self.layout, tuple(LAYOUTS))
        one_of("weighting", self.weighting, get_args(Weighting))
        one_of("tilings", self.tilings, get_args(Tilings))
        one_of("sources", self.sources, get_args(Sources))

    def with_noise(self, sensor: float) -> HeatSpace:
        """The same with another sensor noise."""
        return replace(self, world=replace(self.world, sensor=sensor))

    @cached_property
    def coding(self) -> TileCoding:
        """The binary features."""
        return self.world.coding(LAYOUTS[self.layout])

    @property
    def feature_names(self) -> tuple[str, ...]:
        """What a selector selects from: the sensors and the action."""
        extra = ("tiling",) if self.tilings == "feature" else ()
        return (*extra, *self.coding.names, "a")

    def sample_tasks(self, n: int, rng: np.random.Generator) -> list[HeatTask]:
        """Draw n tasks from the domain."""
        return [HeatTask(self._source(rng), self.world) for _ in range(n)]

    def _source(self, rng: np.random.Generator) -> tuple[float, float]:
        if self.sources == "reachable":
            return self.world.sample_source(rng)
        low, high = self.world.radius, self.world.size - self.world.radius
        x, y = rng.uniform(low, high, size=2)
        return float(x), float(y)

    def learn(
        self,
        task: HeatTask,
        rng: np.random.Generator | int,
        *,
        episodes: int | None = None,
        initial_weights: FloatArray | None = None,
    ) -> HeatLearned:
        """Learn a task, from weights 0 or from those of a potential.

        Parameters
        ----------
        task
            The task.
        rng
            Generator or seed.
        episodes
            Default: the learner's.
        initial_weights
            Shape ``(n_features, 4)``.
        """
        own = self.learner
        return sarsa_lambda(
            task,
            rng=rng,
            episodes=own.episodes if episodes is None else episodes,
            alpha=own.alpha,
            epsilon=own.epsilon,
            trace_decay=own.trace_decay,
            discount=own.discount,
            coding=self.coding,
            initial_weights=initial_weights,
            traces=own.traces,
        )

    def solutions(self, learned: Sequence[HeatLearned]) -> Solutions:
        """Weights of some tasks, as relevance and selection take them.

        Parameters
        ----------
        learned
            One a task, M of them.

        Returns
        -------
        Solutions
            On all N = ``n_features`` x 4 pairs in the order of the weights.
        """
        visits = np.stack([one.visits.ravel() for one in learned])
        q = np.stack([one.weights.ravel() for one in learned])
        q[visits == 0] = np.nan
        share = visits if self.weighting == "visits" else (visits > 0)
        p = share / share.sum(axis=1, keepdims=True)
        return Solutions(q, p, self._pairs, self.feature_names)

    @cached_property
    def _pairs(self) -> np.ndarray:
        tiling, places = self.coding.places[:, :1], self.coding.places[:, 1:]
        if self.tilings == "kept":
            columns = places + tiling * np.array(self.coding.tiles)
        else:
            columns = np.hstack([tiling, places])
        n_actions = len(ACTIONS)
        actions = np.tile(np.arange(n_actions), len(columns))
        return np.column_stack([np.repeat(columns, n_actions, axis=0), actions])

    def potential(self, solutions: Solutions, support: BoolArray) -> FloatArray:
        r"""Cross-task weights with an abstraction in feature space, shape ``(n_features, 4)``.

        Parameters
        ----------
        solutions
            Of the observed tasks, from :meth:`solutions`.
        support
            Features kept, shape ``(F,)``; all for equation 3.5 itself.

        Notes
        -----
        Source: equations 3.5 and 4.1, with :math:`p(m|f^i = 1)` from the tasks' p(x|m).
        """
        labels = keep(solutions, np.flatnonzero(support).tolist())
        values = linear_cross_task_weights(
            solutions.q, solutions.p, labels=labels, fill=self.unseen
        )
        return values.reshape(self.coding.n_features, len(ACTIONS))
