"""Temporal-difference control in compiled loops (section 2.3.3, algorithms 3 and 4)."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thesis_lib.arrays import BoolArray, FloatArray, IntArray
from thesis_lib.checks import generator, one_of, positive_integer
from thesis_lib.compiled import njit
from thesis_lib.mdp.checks import Schedule, require_mdp, schedule, table
from thesis_lib.mdp.greedy import EXPLORATIONS, Exploration, tie_tolerance
from thesis_lib.mdp.model import MDP
from thesis_lib.mdp.sampling import draw, sampler

Method = Literal["sarsa", "q_learning", "expected_sarsa", "double_q_learning"]
METHODS: tuple[Method, ...] = ("sarsa", "q_learning", "expected_sarsa", "double_q_learning")

Companion = Literal["sarsa", "q_learning", "expected_sarsa"]
COMPANIONS: tuple[Companion, ...] = ("sarsa", "q_learning", "expected_sarsa")

Recordable = Literal["rewards", "states", "actions", "td_errors", "q"]
RECORDABLE: tuple[Recordable, ...] = ("rewards", "states", "actions", "td_errors", "q")

SARSA, Q_LEARNING, EXPECTED_SARSA, DOUBLE_Q_LEARNING = range(4)

STRETCH = 2**24
"""Steps in one call of the compiled loop: half a second, after which Ctrl-C is heard."""
TRACED_STRETCH = 2**18
ENDS = 2**14
MARKS = 2**10
"""Rows of the buffers that one such call fills; the next call gets new ones."""


@dataclass(frozen=True, eq=False)
class Learned:
    """What a learner knows at the end, and what happened on the way.

    Rewards are the task's own: the shaping reward F is never counted.  Returns are
    undiscounted sums, as in the thesis's "total reward".

    Attributes
    ----------
    q
        Learned values, shape ``(S, A)``; 0 in terminal states.  Double Q-learning: the
        mean of its two estimators.
    total_reward
        Sum of all rewards.
    n_steps
        Number of steps T taken.
    episode_returns
        Sum of rewards of each finished episode, shape ``(E,)``.
    episode_lengths
        Its number of steps, shape ``(E,)``.
    truncated
        True for the episodes that ``max_episode_steps`` ended, shape ``(E,)``.
    visits
        How often each pair was taken, shape ``(S, A)``.
    checkpoint_steps
        Steps taken at each checkpoint, shape ``(C,)``; empty without ``checkpoint_every``.
    checkpoint_rewards
        Cumulative reward at each checkpoint, shape ``(C,)``.
    companion
        The value function learned alongside, shape ``(S, A)``; None if none was asked for.
    estimators
        Double Q-learning's two tables, shape ``(2, S, A)``; None for other methods.
    rewards, states, actions, td_errors
        One entry a step, shape ``(T,)``; None unless recorded.  The TD error of a shaped
        learner includes F.
    checkpoint_q
        ``q`` at each checkpoint, shape ``(C, S, A)``; None unless recorded.
    """

    q: FloatArray
    total_reward: float
    n_steps: int
    episode_returns: FloatArray
    episode_lengths: IntArray
    truncated: BoolArray
    visits: IntArray
    checkpoint_steps: IntArray
    checkpoint_rewards: FloatArray
    companion: FloatArray | None = None
    estimators: FloatArray | None = None
    rewards: FloatArray | None = None
    states: NDArray[np.int32] | None = None
    actions: NDArray[np.int32] | None = None
    td_errors: FloatArray | None = None
    checkpoint_q: FloatArray | None = None


class _Tables(NamedTuple):
    """What is learned: ``advised`` is q + phi, ``pair`` Double Q-learning's estimators."""

    q: FloatArray
    phi: FloatArray
    advised: FloatArray
    pair: FloatArray
    second: FloatArray
    nothing: FloatArray
    visits: IntArray


class _Rates(NamedTuple):
    """Learning and exploration; schedules have one entry or one a unit of the budget."""

    alpha: FloatArray
    epsilon: FloatArray
    second_alpha: FloatArray
    others: bool
    tie: float


class _Budget(NamedTuple):
    """Episodes or steps, the other being -1; ``cap`` and ``every`` are off at 0."""

    episodes: int
    steps: int
    cap: int
    every: int


class _Place(NamedTuple):
    """Where a stretch of the loop left off.

    ``whole`` holds state, action (-1 before the first), steps, episodes and the steps of
    the current episode; ``sums`` all reward and that of the current episode.
    """

    whole: IntArray
    sums: FloatArray

    @property
    def steps(self) -> int:
        return int(self.whole[2])

    @property
    def episodes(self) -> int:
        return int(self.whole[3])


class _Records(NamedTuple):
    """Buffers of one stretch; of size 0 what is not recorded.

    ``ends``: return, length and whether cut off of each episode.  ``marks`` and
    ``snapshots``: cumulative reward and q of each checkpoint.  ``numbers`` and
    ``indices``: reward and TD error, state and action of each step.
    """

    ends: FloatArray
    marks: FloatArray
    snapshots: FloatArray
    numbers: FloatArray
    indices: NDArray[np.int32]


def learn(
    mdp: MDP,
    method: Method = "sarsa",
    *,
    alpha: Schedule,
    epsilon: Schedule,
    rng: np.random.Generator | int,
    episodes: int | None = None,
    steps: int | None = None,
    max_episode_steps: int | None = None,
    initial_q: ArrayLike | None = None,
    potential: ArrayLike | None = None,
    exploration: Exploration = "all",
    companion: Companion | None = None,
    companion_alpha: Schedule | None = None,
    checkpoint_every: int | None = None,
    record: Collection[Recordable] = (),
) -> Learned:
    r"""Learn a task by interacting with it (algorithms 3 and 4).

    The agent acts epsilon-greedily with respect to ``Q + potential`` and updates
    :math:`Q(s, a) \leftarrow Q(s, a) + \alpha\delta` (eq. 2.8) with

    .. math:: \delta = r + \gamma\Phi(s', a') - \Phi(s, a) + \gamma Q(s', a') - Q(s, a),

    where :math:`a'` is as in the learning rule: the action taken next (``sarsa``, eq. 2.9),
    the greedy one with respect to :math:`Q + \Phi` (``q_learning``, eq. 2.10), the mean
    over the epsilon-greedy policy (``expected_sarsa``), or the greedy one by the first of two
    estimators, valued by the second (``double_q_learning``).

    Parameters
    ----------
    mdp
        The task.
    method
        The learning rule.
    alpha
        Learning rate in (0, 1]: a number, one a unit, or a function from the array
        0, 1, 2, ... of units to the rates.  The unit is the budget's: episodes or steps.
    epsilon
        Probability of a random action in [0, 1]; given like ``alpha``.
    rng
        Generator or seed.
    episodes, steps
        The budget: exactly one of the two.  With ``steps``, episodes follow one another
        and the last may be unfinished.
    max_episode_steps
        Longest episode.  One that is cut off is no terminal state: its last update
        bootstraps as usual, and the next episode starts afresh.
    initial_q
        Q-table to start from, shape ``(S, A)``; default 0.
    potential
        :math:`\Phi`, shape ``(S, A)``: look-ahead advice, see Notes.
    exploration
        Whether the random action is drawn from ``"all"`` actions or from the ``"others"``,
        those that are not greedy.
    companion
        Rule by which a second value function is learned from the same transitions,
        without influence on the behaviour.  ``"expected_sarsa"`` evaluates the
        epsilon-greedy policy of the second function itself, hence estimates the value
        of the optimal soft policy whatever the behaviour; ``"sarsa"`` evaluates the
        behaviour; ``"q_learning"`` estimates :math:`Q^*`.
    companion_alpha
        Its learning rate; default ``alpha``.
    checkpoint_every
        Note the cumulative reward every so many steps.
    record
        What to keep of every step (``"rewards"``, ``"states"``, ``"actions"``,
        ``"td_errors"``) and of every checkpoint (``"q"``).

    Returns
    -------
    Learned
        Values, returns and records.

    Raises
    ------
    ValueError
        When an argument is out of range or has the wrong shape, when both or neither of
        ``episodes`` and ``steps`` are given, or when episodes are asked of a task in which
        they cannot end.

    Notes
    -----
    *Shaping and initialisation* (section 3.1; Wiewiora et al.).  A learner with
    ``potential=phi`` takes the same action at every step as one with ``initial_q=phi`` and
    the same seed, and ``q + phi`` of the one equals ``q`` of the other up to rounding.  For
    this the advised agent must choose its actions by :math:`Q + \Phi`, ties included, and
    :math:`\Phi` must be 0 in terminal states (so that the last F of an episode is
    :math:`-\Phi(s, a)`).  Both are so here; terminal rows of ``potential`` are not read.
    Shaping that adds F to the reward but chooses by Q alone is *not* equivalent.

    *Ties* (closer than :func:`~thesis_lib.mdp.greedy.tie_tolerance`) are broken at random,
    uniformly.

    *Random numbers.*  One uniform number is drawn for each start state if there are
    several, for each transition if it has several outcomes, for each action, and for each
    update of Double Q-learning, in the order in which they happen.  Action: a number u
    below epsilon picks action ``floor(u / epsilon * n)`` of the n random ones, and one
    above it picks ``floor((u - epsilon) / (1 - epsilon) * n)`` of the n greedy ones.  The
    number of draws does not depend on the values, so learners with the same seed see
    common random numbers.  Sarsa chooses the next action before its update, the other
    methods after it (algorithms 3 and 4).

    *Schedules.*  The action taken in step t is chosen with the epsilon of t (or of its
    episode).

    Examples
    --------
    >>> from thesis_lib.domains import episodic_cliff
    >>> from thesis_lib.potentials import q_tilde
    >>> cliffs = episodic_cliff()
    >>> potential = cliffs.scatter(q_tilde(cliffs, epsilon=0.1), task=0)
    >>> settings = dict(alpha=0.1, epsilon=0.1, episodes=200, potential=potential)
    >>> shaped = learn(cliffs.tasks[0], "q_learning", rng=0, **settings)
    >>> shaped.episode_returns.shape, shaped.q.shape
    ((200,), (16, 4))
    """
    require_mdp(mdp)
    one_of("method", method, METHODS)
    one_of("exploration", exploration, EXPLORATIONS)
    if (episodes is None) == (steps is None):
        given = "neither" if episodes is None else "both"
        raise ValueError(f"{given} of episodes and steps given, but exactly one is the budget.")
    if episodes is not None:
        unit, length = "episode", positive_integer("episodes", episodes)
    else:
        assert steps is not None
        unit, length = "step", positive_integer("steps", steps)
    cap = (
        0 if max_episode_steps is None else positive_integer("max_episode_steps", max_episode_steps)
    )
    if episodes is not None and cap == 0 and not mdp.terminal.any():
        raise ValueError(
            "the task has no terminal state, so its episodes never end; give steps instead of "
            "episodes, or max_episode_steps."
        )
    every = (
        0 if checkpoint_every is None else positive_integer("checkpoint_every", checkpoint_every)
    )
    for what in record:
        one_of("record", what, RECORDABLE)
    if "q" in record and every == 0:
        raise ValueError("record asks for q, which is kept at checkpoints; give checkpoint_every.")
    rate = schedule("alpha", alpha, length, unit, zero_allowed=False)
    second_rate = rate
    if companion is not None:
        one_of("companion", companion, COMPANIONS)
    elif companion_alpha is not None:
        raise ValueError("companion_alpha is given, but no companion; name its learning rule.")
    if companion_alpha is not None:
        second_rate = schedule("companion_alpha", companion_alpha, length, unit, zero_allowed=False)
    shape = (mdp.n_states, mdp.n_actions)
    q = np.zeros(shape) if initial_q is None else table("initial_q", initial_q, mdp)
    phi = np.zeros(shape) if potential is None else table("potential", potential, mdp)
    source = sampler(mdp)
    double = method == "double_q_learning"
    second = q + phi if companion is not None else np.zeros((0, 0))
    tables = _Tables(
        q=q,
        phi=phi,
        advised=q + phi,
        pair=np.stack([q, q]) if double else np.zeros((2, 0, 0)),
        second=second,
        nothing=np.zeros_like(second),
        visits=np.zeros(shape, np.int64),
    )
    rates = _Rates(
        rate,
        schedule("epsilon", epsilon, length, unit, zero_allowed=True),
        second_rate,
        exploration == "others",
        tie_tolerance(source.reward, q, phi),
    )
    budget = _Budget(
        episodes=length if unit == "episode" else -1,
        steps=length if unit == "step" else -1,
        cap=cap,
        every=every,
    )
    at = _Place(np.array([0, -1, 0, 0, 0]), np.zeros(2))
    rng = generator(rng)
    tracing = any(what != "q" for what in record)
    parts: list[list[NDArray[Any]]] = []
    while at.steps != budget.steps and at.episodes != budget.episodes:
        until = at.steps + (TRACED_STRETCH if tracing else STRETCH)
        if budget.steps >= 0:
            until = min(until, budget.steps)
        records = _Records(
            ends=np.empty((ENDS, 3)),
            marks=np.empty(MARKS if every else 0),
            snapshots=np.empty((MARKS if "q" in record else 0, *shape)),
            numbers=np.empty((until - at.steps if tracing else 0, 2)),
            indices=np.empty((until - at.steps if tracing else 0, 2), np.int32),
        )
        n_ends, n_marks, n_taken = _run(
            METHODS.index(method),
            -1 if companion is None else METHODS.index(companion),
            *source,
            float(mdp.discount),
            *tables,
            *rates,
            *budget,
            *at,
            *records,
            until,
            rng,
        )
        buffers: tuple[NDArray[Any], ...] = records
        filled = (n_ends, n_marks, n_marks, n_taken, n_taken)
        parts.append([rows[:n] for rows, n in zip(buffers, filled, strict=True)])
    ends, marks, snapshots, numbers, indices = (np.concatenate(p) for p in zip(*parts, strict=True))
    return Learned(
        q=q,
        total_reward=float(at.sums[0]),
        n_steps=at.steps,
        episode_returns=ends[:, 0].copy(),
        episode_lengths=ends[:, 1].astype(np.int64),
        truncated=ends[:, 2] == 1,
        visits=tables.visits,
        checkpoint_steps=every * np.arange(1, marks.size + 1),
        checkpoint_rewards=marks,
        companion=second if companion is not None else None,
        estimators=tables.pair if double else None,
        rewards=numbers[:, 0].copy() if "rewards" in record else None,
        td_errors=numbers[:, 1].copy() if "td_errors" in record else None,
        states=indices[:, 0].copy() if "states" in record else None,
        actions=indices[:, 1].copy() if "actions" in record else None,
        checkpoint_q=snapshots if "q" in record else None,
    )


@njit(error_model="numpy", inline="always")
def _pick(values, s, tie, u):  # type: ignore[no-untyped-def]
    """Pick a greedy action of ``values[s]``; u in [0, 1) settles ties."""
    A = values.shape[1]
    action = 0
    best = values[s, 0]
    for b in range(1, A):
        if values[s, b] > best:
            best = values[s, b]
            action = b
    least = best - tie
    n = 0
    for b in range(A):
        if values[s, b] >= least:
            n += 1
    if n > 1:
        k = min(int(u * n), n - 1)
        for b in range(A):
            if values[s, b] >= least:
                if k == 0:
                    return b
                k -= 1
    return action


@njit(error_model="numpy", inline="always")
def _pick_sum(q, phi, s, tie, u):  # type: ignore[no-untyped-def]
    """Pick a greedy action of ``q[s] + phi[s]``; u in [0, 1) settles ties."""
    A = q.shape[1]
    best = -np.inf
    for b in range(A):
        best = max(best, q[s, b] + phi[s, b])
    n = 0
    for b in range(A):
        if q[s, b] + phi[s, b] >= best - tie:
            n += 1
    k = min(int(u * n), n - 1)
    for b in range(A):
        if q[s, b] + phi[s, b] >= best - tie:
            if k == 0:
                return b
            k -= 1
    return 0


@njit(error_model="numpy", inline="always")
def _choose(values, s, epsilon, others, tie, u):  # type: ignore[no-untyped-def]
    """Choose epsilon-greedily by ``values[s]`` with the uniform number u."""
    if u >= epsilon:
        return _pick(values, s, tie, (u - epsilon) / (1.0 - epsilon))
    A = values.shape[1]
    if others:
        best = values[s, 0]
        for b in range(1, A):
            best = max(best, values[s, b])
        n = 0
        for b in range(A):
            if values[s, b] < best - tie:
                n += 1
        if n > 0:
            k = min(int(u / epsilon * n), n - 1)
            for b in range(A):
                if values[s, b] < best - tie:
                    if k == 0:
                        return b
                    k -= 1
    return min(int(u / epsilon * A), A - 1)


@njit(error_model="numpy", inline="always")
def _bootstrap(rule, q, phi, advised, s, a, epsilon, others, tie):  # type: ignore[no-untyped-def]
    """Value and potential of the next state s by the learning rule.

    ``advised`` is q + phi; ``a`` is the action taken in s, which only Sarsa uses.
    """
    if rule == SARSA:
        return q[s, a], phi[s, a]
    A = q.shape[1]
    action = 0
    best = advised[s, 0]
    for b in range(1, A):
        if advised[s, b] > best:
            best = advised[s, b]
            action = b
    if rule == Q_LEARNING:
        return q[s, action], phi[s, action]
    n = 0
    value_best = potential_best = value_rest = potential_rest = 0.0
    for b in range(A):
        if advised[s, b] >= best - tie:
            n += 1
            value_best += q[s, b]
            potential_best += phi[s, b]
        else:
            value_rest += q[s, b]
            potential_rest += phi[s, b]
    if n == A:
        return value_best / A, potential_best / A
    # Probability of each greedy action, and of each other one.
    if others:
        p_best, p_rest = (1.0 - epsilon) / n, epsilon / (A - n)
    else:
        p_best, p_rest = (1.0 - epsilon) / n + epsilon / A, epsilon / A
    return (
        p_best * value_best + p_rest * value_rest,
        p_best * potential_best + p_rest * potential_rest,
    )


@njit(error_model="numpy", inline="always")
def _first_state(start, start_cumulative, rng):  # type: ignore[no-untyped-def]
    """Draw the state in which an episode begins."""
    if start.shape[0] == 1:
        return start[0]
    return start[draw(start_cumulative, rng.random())]


@njit(error_model="numpy")
def _run(  # type: ignore[no-untyped-def]
    rule, second_rule,
    successor, cumulative, reward, terminal, start, start_cumulative, discount,
    q, phi, advised, pair, second, nothing, visits,
    rate, explore, second_rate, others, tie,
    n_episodes, n_steps, cap, every,
    whole, sums,
    ends, marks, snapshots, numbers, indices,
    until, rng,
):  # fmt: skip
    """Run a stretch of the loop of algorithms 3 and 4, and return how much it recorded.

    The arguments are the fields of a :class:`~thesis_lib.mdp.sampling.Sampler`, of
    :class:`_Tables`, :class:`_Rates`, :class:`_Budget`, :class:`_Place` and :class:`_Records`:
    passed as tuples they would cost more than a short run.  The arrays are changed in place.
    The stretch ends at step ``until``, with the budget, or with a record full; arrays are not
    grown here, as reassigning one would cost more than all the learning.
    """
    deterministic = cumulative.shape[2] == 1
    by_step = n_steps >= 0
    tracing = numbers.shape[0] > 0
    s, a, t, episode, length = whole[0], whole[1], whole[2], whole[3], whole[4]
    total, earned = sums[0], sums[1]
    begun, n_ends, n_marks = t, 0, 0
    next_mark = (t // every + 1) * every if every > 0 else -1
    epsilon = explore[0]
    if explore.shape[0] > 1:
        epsilon = explore[t if by_step else episode]
    if a < 0:
        s = _first_state(start, start_cumulative, rng)
        a = _choose(advised, s, epsilon, others, tie, rng.random())
    while t < until:
        # Take action a, observe r and s'.
        k = 0
        if not deterministic and cumulative[s, a, 0] < 1.0:
            k = draw(cumulative[s, a], rng.random())
        s_next = successor[s, a, k]
        r = reward[s, a, k]
        done = terminal[s_next]

        now = t if by_step else episode
        alpha = rate[now if rate.shape[0] > 1 else 0]
        if by_step and explore.shape[0] > 1:
            epsilon = explore[min(t + 1, n_steps - 1)]
        a_next = 0
        if rule == SARSA and not done:
            a_next = _choose(advised, s_next, epsilon, others, tie, rng.random())
        value = potential = 0.0
        if rule == DOUBLE_Q_LEARNING:
            u = rng.random()
            i = 0 if u < 0.5 else 1
            if not done:
                b = _pick_sum(pair[i], phi, s_next, tie, 2.0 * u - i)
                value, potential = pair[1 - i, s_next, b], phi[s_next, b]
            delta = r + (discount * potential - phi[s, a]) + discount * value - pair[i, s, a]
            pair[i, s, a] += alpha * delta
            q[s, a] = 0.5 * (pair[0, s, a] + pair[1, s, a])
        else:
            if not done:
                value, potential = _bootstrap(
                    rule, q, phi, advised, s_next, a_next, epsilon, others, tie
                )
            delta = r + (discount * potential - phi[s, a]) + discount * value - q[s, a]
            q[s, a] += alpha * delta
        advised[s, a] = q[s, a] + phi[s, a]
        if rule != SARSA and not done:
            a_next = _choose(advised, s_next, epsilon, others, tie, rng.random())
        if second_rule >= 0:
            value = 0.0
            if not done:
                value, _ = _bootstrap(
                    second_rule, second, nothing, second, s_next, a_next, epsilon, others, tie
                )
            step = second_rate[now if second_rate.shape[0] > 1 else 0]
            second[s, a] += step * (r + discount * value - second[s, a])

        visits[s, a] += 1
        if tracing:
            numbers[t - begun, 0] = r
            numbers[t - begun, 1] = delta
            indices[t - begun, 0] = s
            indices[t - begun, 1] = a
        total += r
        earned += r
        length += 1
        t += 1
        s = s_next
        a = a_next
        if done or length == cap:
            ends[n_ends, 0] = earned
            ends[n_ends, 1] = length
            ends[n_ends, 2] = 0.0 if done else 1.0
            n_ends += 1
            episode += 1
            length = 0
            earned = 0.0
            if episode != n_episodes:
                s = _first_state(start, start_cumulative, rng)
                if not by_step and explore.shape[0] > 1:
                    epsilon = explore[episode]
                a = _choose(advised, s, epsilon, others, tie, rng.random())
            if episode == n_episodes or n_ends == ends.shape[0]:
                until = t
        if t == next_mark:
            marks[n_marks] = total
            if snapshots.shape[0] > 0:
                snapshots[n_marks] = q
            n_marks += 1
            next_mark += every
            if n_marks == marks.shape[0]:
                until = t
    whole[0], whole[1], whole[2], whole[3], whole[4] = s, a, t, episode, length
    sums[0], sums[1] = total, earned
    return n_ends, n_marks, t - begun
