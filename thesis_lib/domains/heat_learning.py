"""Sarsa(lambda) on the heat domain, and potentials from its solutions (section 4.3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import BoolArray, FloatArray, IntArray
from thesis_lib.checks import generator, one_of, positive_integer, positive_number, probability
from thesis_lib.compiled import njit
from thesis_lib.domains.heat import ACTIONS, HeatTask, distance_to, move, place, sense
from thesis_lib.domains.tiles import TileCoding, active_tiles

Traces = Literal["replacing", "accumulating"]

TRACE_CUT_OFF = 1e-3
"""An eligibility trace below this is dropped."""


@dataclass(frozen=True, eq=False)
class HeatLearned:
    """What Sarsa(lambda) learned on one task.

    Attributes
    ----------
    weights
        :math:`w` of each feature and action, shape ``(n_features, 4)``;
        Q(s, a) is the sum over the active features.
    visits
        How often each feature was active when an action was taken, shape
        ``(n_features, 4)``.
    episode_returns
        Undiscounted return of each episode, shape ``(episodes,)``.
    episode_lengths
        Steps of each episode, shape ``(episodes,)``.
    truncated
        Episodes that were cut off, shape ``(episodes,)``.
    """

    weights: FloatArray
    visits: IntArray
    episode_returns: FloatArray
    episode_lengths: IntArray
    truncated: BoolArray

    def pairs(self, coding: TileCoding) -> tuple[tuple[str, ...], IntArray, FloatArray, FloatArray]:
        """The solution as a table of (feature, action) pairs, for relevance and selection.

        Parameters
        ----------
        coding
            The features that were learned with.

        Returns
        -------
        tuple
            Names of the columns (``tiling``, the variables, ``a``); their values for each
            pair that was visited, shape ``(N, 6)``; the pairs' weights w, shape ``(N,)``;
            and the shares of visits p(x|m), shape ``(N,)``.
        """
        feature, action = np.nonzero(self.visits)
        columns = np.column_stack([coding.places[feature], action])
        seen = self.visits[feature, action]
        names = ("tiling", *coding.names, "a")
        return names, columns, self.weights[feature, action], seen / seen.sum()


def sarsa_lambda(
    task: HeatTask,
    *,
    rng: np.random.Generator | int,
    episodes: int = 500,
    alpha: float = 0.3,
    epsilon: float = 0.05,
    trace_decay: float = 0.9,
    discount: float = 1.0,
    coding: TileCoding | None = None,
    initial_weights: ArrayLike | None = None,
    traces: Traces = "replacing",
    max_episode_steps: int = 2000,
) -> HeatLearned:
    r"""Learn one heat task with Sarsa(lambda) and tile coding.

    Parameters
    ----------
    task
        The task.
    rng
        Generator or seed.
    episodes
        How many; 500 in the thesis.
    alpha
        Step size, shared evenly by the active features; the thesis does not print it.
    epsilon
        Chance of a random action; .05 in the thesis.
    trace_decay
        lambda; .9 in the thesis.
    discount
        gamma; not printed.
    coding
        The features; default ``task.world.coding()``, with 1664 of them.
    initial_weights
        Shape ``(n_features, 4)``; default 0.  Starting from the weights of a potential is
        shaping with it, as for tables: the first estimate of every pair is its potential.
    traces
        ``"replacing"`` or ``"accumulating"``.
    max_episode_steps
        After how many steps an episode is cut off.

    Returns
    -------
    HeatLearned

    Raises
    ------
    ValueError
        When a number is out of its range or the weights have the wrong shape.

    Notes
    -----
    Source: section 4.3, heat domain.  Traces below :data:`TRACE_CUT_OFF` are dropped.
    """
    features = task.world.coding() if coding is None else coding
    positive_number("alpha", alpha)
    if alpha > 1:
        raise ValueError(f"alpha is {alpha}, but it must be in (0, 1].")
    one_of("traces", traces, get_args(Traces))
    shape = (features.n_features, len(ACTIONS))
    if initial_weights is None:
        weights = np.zeros(shape)
    else:
        weights = np.array(initial_weights, dtype=np.float64, order="C")
        if weights.shape != shape:
            raise ValueError(
                f"initial_weights has shape {weights.shape}, but (features, actions) = {shape} is "
                "needed."
            )
        if not np.isfinite(weights).all():
            raise ValueError(
                f"initial_weights has {int((~np.isfinite(weights)).sum())} values that are not "
                "finite; give features that were never seen a number, such as 0."
            )
    visits = np.zeros(shape, dtype=np.int64)
    n = positive_integer("episodes", episodes)
    lengths = np.zeros(n, dtype=np.int64)
    truncated = np.zeros(n, dtype=np.bool_)
    _sarsa(
        generator(rng),
        task.world.parameters,
        np.array(task.source, dtype=np.float64),
        *features.arrays,
        alpha / features.tilings,
        probability("epsilon", epsilon),
        probability("trace_decay", trace_decay) * probability("discount", discount),
        float(discount),
        traces == "replacing",
        positive_integer("max_episode_steps", max_episode_steps),
        weights,
        visits,
        lengths,
        truncated,
    )
    returns = lengths.astype(np.float64) * float(task.world.step_reward)
    return HeatLearned(weights, visits, returns, lengths, truncated)


@njit(error_model="numpy")
def _choose(rng, weights, active, epsilon):  # type: ignore[no-untyped-def]
    """Choose epsilon-greedily, ties at random; also return the action's value."""
    A = weights.shape[1]
    u = rng.random()
    random = u < epsilon
    action = min(int(u / epsilon * A), A - 1) if random else 0
    best, ties = -np.inf, 0
    chosen = 0.0
    for b in range(A):
        value = 0.0
        for t in range(active.shape[0]):
            value += weights[active[t], b]
        if random:
            if b == action:
                chosen = value
        elif value > best:
            best, ties, action = value, 1, b
        elif value == best:
            # Each of the tied actions ends up chosen with the same probability.
            ties += 1
            if rng.random() * ties < 1.0:
                action = b
    return action, (chosen if random else best)


@njit(error_model="numpy")
def _sarsa(  # type: ignore[no-untyped-def]
    rng,
    parameters,
    source,
    low,
    width,
    tiles,
    periodic,
    offsets,
    rate,
    epsilon,
    decay,
    discount,
    replacing,
    cap,
    weights,
    visits,
    lengths,
    truncated,
):
    """Run Sarsa(lambda), writing weights, visits, lengths and cut-offs in place."""
    A = weights.shape[1]
    T = offsets.shape[0]
    radius, reward = parameters[1], parameters[8]
    state, reading = np.empty(3), np.empty(4)
    active, following = np.empty(T, np.int64), np.empty(T, np.int64)
    # The traces that are not yet negligible: a list, and where each pair is in it.
    where = np.full(weights.size, -1, np.int64)
    pairs, trace = np.empty(weights.size, np.int64), np.empty(weights.size)
    flat = weights.reshape(-1)
    for episode in range(lengths.shape[0]):
        n = 0
        place(rng, parameters, source, state)
        sense(rng, parameters, source, state, reading)
        active_tiles(reading, low, width, tiles, periodic, offsets, active)
        action, value = _choose(rng, weights, active, epsilon)
        step = 0
        while True:
            for t in range(T):
                pair = active[t] * A + action
                visits[active[t], action] += 1
                k = where[pair]
                if k < 0:
                    where[pair], pairs[n], trace[n] = n, pair, 1.0
                    n += 1
                elif replacing:
                    trace[k] = 1.0
                else:
                    trace[k] += 1.0
            move(rng, parameters, state, action)
            step += 1
            done = distance_to(state, source) <= radius
            if done:
                error = reward - value
            else:
                sense(rng, parameters, source, state, reading)
                active_tiles(reading, low, width, tiles, periodic, offsets, following)
                next_action, next_value = _choose(rng, weights, following, epsilon)
                error = reward + discount * next_value - value
            change = rate * error
            k = 0
            while k < n:
                flat[pairs[k]] += change * trace[k]
                trace[k] *= decay
                if trace[k] < TRACE_CUT_OFF:
                    where[pairs[k]] = -1
                    n -= 1
                    if k < n:
                        # The last one takes the place, and its turn comes next.
                        pairs[k], trace[k] = pairs[n], trace[n]
                        where[pairs[k]] = k
                else:
                    k += 1
            if done or step >= cap:
                truncated[episode] = not done
                break
            active, following = following, active
            action = next_action
            # The update has changed the weights, and with them the value of what was chosen.
            value = 0.0
            for t in range(T):
                value += weights[active[t], action]
        for k in range(n):
            where[pairs[k]] = -1
        lengths[episode] = step
