r"""The binary stock-trading domain :math:`\langle S, E, G\rangle` (section 3.4.4).

S sectors hold E stocks each, and G globals act on all sectors.  Stocks and globals
rise (1) or fall (0).  The agent buys or sells a whole sector at a time and earns +1
for each rising and -1 for each falling stock that it owns.

A task with many globals has too many states for a transition matrix, but its next
state falls into independent parts: ownership is certain, globals ignore everything
else, and the stocks of a sector rise independently with one probability.
:class:`StockMDP` takes expectations through these factors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from types import MappingProxyType
from typing import Any, Literal, TypeVar, get_args, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thesis_lib.arrays import BoolArray, FloatArray, IntArray
from thesis_lib.checks import one_of, probability
from thesis_lib.domains.domain import Domain
from thesis_lib.mdp.model import MDP, Outcomes, TabularMDP

Array = TypeVar("Array", bound=NDArray[Any])

RewardTiming = Literal["after_next", "after_current", "before_next", "before_current"]
"""Ownership before or after the action, times the current or the next stock values."""

Influence = Literal["shared", "per_sector"]
"""Whether all sectors of a task have the same influential stocks, or each its own."""

Start = Literal["uniform", "unowned"]
"""Start in any state, or in any in which no sector is owned, all equally likely."""

MAX_ENTRIES = 2**27
"""Largest number of transitions or outcomes that is ever listed (1 GiB of probabilities)."""


@dataclass(frozen=True)
class StockSize:
    """The size of a stock domain, and the features of its states.

    A state is a row of bits: S owned sectors, then the E stocks of each sector, then G
    globals.  Its number reads them as a binary number, ownership first.

    Attributes
    ----------
    sectors, stocks, global_factors
        S, E (stocks a sector) and G.
    """

    sectors: int
    stocks: int
    global_factors: int

    def __post_init__(self) -> None:
        for name, value, least in (
            ("sectors", self.sectors, 1),
            ("stocks", self.stocks, 1),
            ("global_factors", self.global_factors, 0),
        ):
            if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
                raise ValueError(
                    f"{name} is {value!r}, but it must be an integer of at least {least}."
                )
        if self.n_states > MAX_ENTRIES:
            raise ValueError(
                f"a stock task of size <{self.sectors}, {self.stocks}, {self.global_factors}> has "
                f"2^{self.bits} states, but at most {MAX_ENTRIES} are supported; take fewer "
                "sectors, stocks or globals."
            )

    @property
    def bits(self) -> int:
        """Number of features S + SE + G."""
        return self.sectors + self.sectors * self.stocks + self.global_factors

    @property
    def n_states(self) -> int:
        """Number of states, 2 to the number of features."""
        return 2**self.bits

    @property
    def n_next(self) -> int:
        """Number of successors of a pair: the values of stocks and globals."""
        return 2 ** (self.bits - self.sectors)

    @cached_property
    def feature_names(self) -> tuple[str, ...]:
        """Names: ``s1`` for ownership, ``s1e2`` for a stock, ``g1`` for a global."""
        sectors = range(1, self.sectors + 1)
        return (
            *(f"s{s}" for s in sectors),
            *(f"s{s}e{e}" for s in sectors for e in range(1, self.stocks + 1)),
            *(f"g{g}" for g in range(1, self.global_factors + 1)),
        )

    @cached_property
    def actions(self) -> tuple[str, ...]:
        """Names of the 2S actions: ``buy 1``, ``sell 1``, ..."""
        return tuple(f"{w} {s}" for s in range(1, self.sectors + 1) for w in ("buy", "sell"))

    @cached_property
    def state_bits(self) -> IntArray:
        """The features of every state, shape ``(states, bits)``."""
        shifts = np.arange(self.bits - 1, -1, -1)
        return (np.arange(self.n_states)[:, None] >> shifts) & 1

    @cached_property
    def features(self) -> Mapping[str, IntArray]:
        """The named features, each of shape ``(states,)``."""
        columns = _read_only(np.ascontiguousarray(self.state_bits.T))
        return MappingProxyType(dict(zip(self.feature_names, columns, strict=True)))

    @cached_property
    def owned(self) -> IntArray:
        """Ownership of every state, shape ``(states, S)``."""
        return self.state_bits[:, : self.sectors]

    @cached_property
    def rising(self) -> IntArray:
        """Stocks of every state, shape ``(states, S, E)``."""
        stocks = self.state_bits[:, self.sectors : self.sectors * (1 + self.stocks)]
        return stocks.reshape(-1, self.sectors, self.stocks)

    @cached_property
    def global_values(self) -> IntArray:
        """Globals of every state, shape ``(states, G)``."""
        return self.state_bits[:, self.sectors * (1 + self.stocks) :]

    @cached_property
    def owned_after(self) -> IntArray:
        """Ownership after each action as a number below 2^S, shape ``(states, 2S)``."""
        before = np.arange(self.n_states) >> (self.bits - self.sectors)
        out = np.empty((self.n_states, 2 * self.sectors), dtype=np.int64)
        for s in range(self.sectors):
            bit = 1 << (self.sectors - 1 - s)
            out[:, 2 * s] = before | bit
            out[:, 2 * s + 1] = before & ~bit
        return out

    @cached_property
    def starts(self) -> Mapping[str, FloatArray]:
        """The start-state distribution of each option of :data:`Start`."""
        unowned = ~self.owned.any(axis=1)
        return MappingProxyType(
            {
                "uniform": _read_only(np.full(self.n_states, 1 / self.n_states)),
                "unowned": _read_only(unowned / unowned.sum()),
            }
        )

    @cached_property
    def never_terminal(self) -> BoolArray:
        """The mask of terminal states: there are none."""
        return _read_only(np.zeros(self.n_states, dtype=bool))

    def __reduce__(self) -> tuple[Any, ...]:
        # Copies of a size are the same object, and what it derives can be derived again.
        return _size, (self.sectors, self.stocks, self.global_factors)

    def state(
        self, owned: Sequence[int], stocks: Sequence[int], global_values: Sequence[int]
    ) -> int:
        """The number of a state given its bits.

        Parameters
        ----------
        owned, stocks, global_values
            S, SE (sector by sector) and G bits.
        """
        bits = [*owned, *stocks, *global_values]
        if len(bits) != self.bits or not set(bits) <= {0, 1}:
            raise ValueError(
                f"state bits are {bits}, but {self.bits} of them, each 0 or 1, are needed: "
                f"{', '.join(self.feature_names)}."
            )
        return int("".join(map(str, bits)), 2)


@lru_cache(maxsize=32)
def _size(sectors: int, stocks: int, global_factors: int) -> StockSize:
    # One object a size, so that all tasks of a domain share their feature arrays.
    return StockSize(sectors, stocks, global_factors)


class StockMDP(MDP):
    r"""One stock-trading task, in factored form.

    Parameters
    ----------
    influence
        Which stocks influence their sector, shape ``(S, E)`` bool, at least one a sector.
    rising_helps
        For each global whether stocks are likelier to rise when it rises (True) or when
        it falls (False), shape ``(G,)`` bool.
    discount
        gamma, which the thesis does not print.
    reward_timing
        What a step earns: ownership before or after the action, times +1 or -1 for each
        current or next value of the owned stocks.  The default is the one under which
        the four statements of section 4.3 on the relevance of features hold.
    global_persistence
        Probability that a global keeps its value; 1/2 is a fair coin at every step.
    start
        ``"uniform"`` over all states, or ``"unowned"``: uniform over those in which the
        agent owns nothing.

    Attributes
    ----------
    size
        The numbers S, E and G and the features of the states.

    Raises
    ------
    ValueError
        When a shape is wrong, a sector has no influential stock or an option is unknown.

    Notes
    -----
    Source: section 3.4.4.  Stocks of sector s rise with probability
    :math:`P_s = 0.1 + 0.8 (R_s + 3 R_g) / (I_s + 3 G)`.  The text does not say how globals
    move, nor which ownership and which stock values make up a step's reward.  Its worked
    example holds one rising and one falling stock, which earns 0 by the rule stated there,
    not the 1 printed.
    """

    def __init__(
        self,
        influence: ArrayLike,
        rising_helps: ArrayLike,
        *,
        discount: float = 0.9,
        reward_timing: RewardTiming = "after_next",
        global_persistence: float = 0.5,
        start: Start = "uniform",
    ) -> None:
        self.influence: BoolArray = _read_only(np.array(influence, dtype=bool))
        self.rising_helps: BoolArray = _read_only(np.array(rising_helps, dtype=bool))
        if self.influence.ndim != 2 or self.rising_helps.ndim != 1:
            raise ValueError(
                f"influence has shape {self.influence.shape} and rising_helps has shape "
                f"{self.rising_helps.shape}, but (sectors, stocks) and (globals,) are needed."
            )
        if not self.influence.any(axis=1).all():
            s = int(np.argmin(self.influence.any(axis=1)))
            raise ValueError(
                f"influence of sector {s + 1} names no stock, but every sector needs at least one."
            )
        self.size = _size(*self.influence.shape, len(self.rising_helps))
        self.discount = probability("discount", discount)
        self.reward_timing = one_of("reward_timing", reward_timing, get_args(RewardTiming))
        self.global_persistence = probability("global_persistence", global_persistence)
        self._start = one_of("start", start, get_args(Start))
        self.start = self.size.starts[self._start]
        self.terminal = self.size.never_terminal
        self.actions = self.size.actions
        self.features = self.size.features
        self.reward = _read_only(self._expected_reward())

    def __reduce__(self) -> tuple[Any, ...]:
        # A copy is built again, so that all tasks of one size go on sharing its arrays.
        options = {
            "discount": self.discount,
            "reward_timing": self.reward_timing,
            "global_persistence": self.global_persistence,
            "start": self._start,
        }
        return partial(type(self), **options), (self.influence, self.rising_helps)

    def _levels(self) -> IntArray:
        """The numerators :math:`R_s + 3 R_g` of every state, shape ``(states, S)``."""
        size = self.size
        rising = (size.rising & self.influence).sum(axis=2)
        helping = (size.global_values == self.rising_helps).sum(axis=1)
        return rising + 3 * helping[:, None]

    @property
    def _denominators(self) -> IntArray:
        """The denominators :math:`I_s + 3 G`, shape ``(S,)``."""
        return self.influence.sum(axis=1) + 3 * self.size.global_factors

    def rise_probability(self) -> FloatArray:
        """Probability that the stocks of each sector rise, P_s, shape ``(states, S)``."""
        return 0.1 + 0.8 * self._levels() / self._denominators

    def _expected_reward(self) -> FloatArray:
        size = self.size
        if self.reward_timing.endswith("next"):
            gain = size.stocks * (2 * self.rise_probability() - 1)
        else:
            gain = (2 * size.rising - 1).sum(axis=2).astype(float)
        if self.reward_timing.startswith("before"):
            earned = (size.owned * gain).sum(axis=1)
            return np.repeat(earned[:, None], len(self.actions), axis=1)
        return np.stack(
            [(self._owned_after(a) * gain).sum(axis=1) for a in range(len(self.actions))], axis=1
        )

    def _owned_after(self, action: int) -> IntArray:
        """Ownership after an action as bits, shape ``(states, S)``."""
        shifts = np.arange(self.size.sectors - 1, -1, -1)
        return (self.size.owned_after[:, action, None] >> shifts) & 1

    @cached_property
    def _gather(self) -> tuple[IntArray, ...]:
        """Where :meth:`expectation` finds the pair's number in its table of factors."""
        levels = self._levels()
        index = [self.size.owned_after, *(levels[:, s, None] for s in range(self.size.sectors))]
        if self.global_persistence != 0.5:
            globals_now = np.arange(self.n_states) % 2**self.size.global_factors
            index.append(globals_now[:, None])
        return tuple(index)

    @cached_property
    def _rise_weights(self) -> tuple[FloatArray, ...]:
        """For each sector the probability of its next stocks at each level, ``(L, 2^E)``."""
        codes = np.arange(2**self.size.stocks)
        count = np.array([int(c).bit_count() for c in codes])
        out = []
        for denominator in self._denominators:
            p = (0.1 + 0.8 * np.arange(denominator + 1) / denominator)[:, None]
            out.append(p**count * (1 - p) ** (self.size.stocks - count))
        return tuple(out)

    def expectation(self, values: FloatArray) -> FloatArray:
        """Expected value of the next state, shape ``(S, A)``; see :meth:`MDP.expectation`.

        Averages over the globals first and then over one sector at a time, for every
        level that a sector's probability can have; the cost is about that of reading
        ``values`` once.
        """
        size = self.size
        per_sector, n_globals = 2**size.stocks, 2**size.global_factors
        rest = np.asarray(values, dtype=float).reshape(
            2**size.sectors, *[per_sector] * size.sectors, n_globals
        )
        rest = self._average_globals(rest)
        for s, weights in enumerate(self._rise_weights):
            # Contract sector s in place: its axis of 2^E stock values becomes one of levels.
            rest = np.moveaxis(np.tensordot(weights, rest, axes=(1, s + 1)), 0, s + 1)
        return np.ascontiguousarray(rest[self._gather])

    def _average_globals(self, table: FloatArray) -> FloatArray:
        """Expectation over the next globals, for each current value unless they are coins."""
        if self.global_persistence == 0.5:
            return table.mean(axis=-1)
        stay = self.global_persistence
        kernel = np.array([[stay, 1 - stay], [1 - stay, stay]])
        shape = table.shape
        table = table.reshape(*shape[:-1], *[2] * self.size.global_factors)
        for g in range(self.size.global_factors):
            axis = len(shape) - 1 + g
            table = np.moveaxis(np.tensordot(kernel, table, axes=(1, axis)), 0, axis)
        return table.reshape(shape)

    def _next_probability(self) -> FloatArray:
        """Probability of every next value of stocks and globals, ``(states, 2^(SE+G))``."""
        size = self.size
        levels = self._levels()
        out = np.ones((self.n_states, 1))
        for s, weights in enumerate(self._rise_weights):
            out = (out[:, :, None] * weights[levels[:, s]][:, None, :]).reshape(self.n_states, -1)
        for g in range(size.global_factors):
            rises = np.where(
                size.global_values[:, g], self.global_persistence, 1 - self.global_persistence
            )
            coin = np.stack([1 - rises, rises], axis=1)
            out = (out[:, :, None] * coin[:, None, :]).reshape(self.n_states, -1)
        return out

    def _check_entries(self, entries: int, what: str) -> None:
        if entries > MAX_ENTRIES:
            raise ValueError(
                f"the {what} of a stock task of size <{self.size.sectors}, {self.size.stocks}, "
                f"{self.size.global_factors}> would have {entries} entries, but at most "
                f"{MAX_ENTRIES} are listed; use expectation, which needs none of them, or a "
                "smaller size."
            )

    def outcomes(self) -> Outcomes:
        """List the possible outcomes of every pair, ``2^(SE+G)`` of them.

        Raises
        ------
        ValueError
            When there are more than :data:`MAX_ENTRIES` of them.
        """
        size = self.size
        shape = (self.n_states, self.n_actions, size.n_next)
        self._check_entries(int(np.prod(shape)), "list of outcomes")
        successor = (size.owned_after[:, :, None] * size.n_next + np.arange(size.n_next)).astype(
            np.int32
        )
        stocks = (
            size.rising if self.reward_timing.endswith("current") else size.rising[: size.n_next]
        )
        gain = (2 * stocks - 1).sum(axis=2)
        reward = np.empty(shape)
        for a in range(self.n_actions):
            owned = size.owned if self.reward_timing.startswith("before") else self._owned_after(a)
            if self.reward_timing.endswith("current"):
                reward[:, a] = (owned * gain).sum(axis=1)[:, None]
            else:
                reward[:, a] = owned @ gain.T
        chance = np.broadcast_to(self._next_probability()[:, None, :], shape)
        return Outcomes(successor, chance.copy(), reward)

    def to_tabular(self) -> TabularMDP:
        """The same task with a transition matrix; only for small sizes.

        Raises
        ------
        ValueError
            When the matrix would have more than :data:`MAX_ENTRIES` entries.
        """
        shape = (self.n_states, self.n_actions, self.n_states)
        self._check_entries(int(np.prod(shape)), "transition matrix")
        listed = self.outcomes()
        transition, earned = np.zeros(shape), np.zeros(shape)
        np.put_along_axis(transition, listed.successor.astype(np.int64), listed.probability, axis=2)
        np.put_along_axis(earned, listed.successor.astype(np.int64), listed.reward, axis=2)
        return TabularMDP(
            transition=transition,
            reward=self.reward,
            start=self.start,
            discount=self.discount,
            features=self.features,
            actions=self.actions,
            transition_reward=earned,
        )


class StockTasks(Sequence[StockMDP]):
    """The tasks of a stock domain, each built when it is first asked for.

    Influence counts slowest, then the directions of the globals.

    Parameters
    ----------
    size
        S, E and G.
    influence
        ``"shared"``: all sectors of a task have the same influential stocks, which gives
        the printed :math:`(2^E - 1) 2^G` tasks.  ``"per_sector"``: each sector has its own,
        as in the text's example, which gives :math:`(2^E - 1)^S 2^G`.
    **options
        Passed to :class:`StockMDP`.
    """

    def __init__(self, size: StockSize, influence: Influence = "shared", **options: Any) -> None:
        self._influence = one_of("influence", influence, get_args(Influence))
        self._size = size
        self._options = options
        self._free_sectors = 1 if influence == "shared" else size.sectors
        kept_bytes = 8 * size.n_states * (2 * size.sectors + size.sectors + 1)
        self._built = lru_cache(maxsize=max(1, MAX_ENTRIES // kept_bytes))(self._build)

    def __reduce__(self) -> tuple[Any, ...]:
        # Tasks are built when asked for, in a copy too.
        return partial(type(self), **self._options), (self._size, self._influence)

    def __len__(self) -> int:
        sets = 2**self._size.stocks - 1
        return int(sets**self._free_sectors * 2**self._size.global_factors)

    def parameters(self, index: int) -> tuple[BoolArray, BoolArray]:
        """Influence ``(S, E)`` and directions of globals ``(G,)`` of one task."""
        size = self._size
        sets, helps = divmod(index, 2**size.global_factors)
        rows = []
        for _ in range(self._free_sectors):
            sets, one = divmod(sets, 2**size.stocks - 1)
            rows.append(_bits(one + 1, size.stocks))
        rows = rows[::-1] if len(rows) > 1 else rows * size.sectors
        return np.array(rows), _bits(helps, size.global_factors)

    def name(self, index: int) -> str:
        """The task as text, such as ``influence 01|10, globals +-``."""
        influence, helps = self.parameters(index)
        sets = "|".join("".join("01"[int(b)] for b in row) for row in influence)
        signs = "".join("-+"[int(b)] for b in helps)
        return f"influence {sets}" + (f", globals {signs}" if signs else "")

    def _build(self, index: int) -> StockMDP:
        return StockMDP(*self.parameters(index), **self._options)

    @overload
    def __getitem__(self, index: int) -> StockMDP: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[StockMDP, ...]: ...

    def __getitem__(self, index: int | slice) -> StockMDP | tuple[StockMDP, ...]:
        if isinstance(index, slice):
            return tuple(self[i] for i in range(*index.indices(len(self))))
        if not -len(self) <= index < len(self):
            raise IndexError(f"task {index} of a stock domain with {len(self)} tasks")
        return self._built(index % len(self))


def stock(
    sectors: int = 1,
    stocks: int = 2,
    global_factors: int = 2,
    *,
    influence: Influence = "shared",
    discount: float = 0.9,
    reward_timing: RewardTiming = "after_next",
    global_persistence: float = 0.5,
    start: Start = "uniform",
) -> Domain:
    r"""The stock-trading domain :math:`\langle S, E, G\rangle` of section 3.4.4, uniform D.

    Parameters
    ----------
    sectors, stocks, global_factors
        S, E (stocks a sector) and G.  Section 3.4.4 prints E = 3 beside 240 runs, which is
        20 runs for each of 12 tasks and so E = 2; section 4.3 says that E = 2.
    influence
        ``"shared"`` or ``"per_sector"``; see :class:`StockTasks`.
    discount, reward_timing, global_persistence, start
        See :class:`StockMDP`.

    Returns
    -------
    Domain
        Its tasks share their :math:`2^{S+SE+G}` states, and are built when asked for.

    Examples
    --------
    >>> market = stock(sectors=1, stocks=2, global_factors=2)
    >>> len(market), market.shape, market.feature_names
    (12, (32, 2), ('s1', 's1e1', 's1e2', 'g1', 'g2'))
    """
    tasks = StockTasks(
        _size(sectors, stocks, global_factors),
        influence,
        discount=discount,
        reward_timing=reward_timing,
        global_persistence=global_persistence,
        start=start,
    )
    return Domain(
        name=f"stock <{sectors}, {stocks}, {global_factors}>",
        tasks=tasks,
        task_names=tuple(tasks.name(i) for i in range(len(tasks))),
    )


def _bits(number: int, width: int) -> BoolArray:
    """The binary digits of a number, first one highest, shape ``(width,)``."""
    return (number >> np.arange(width - 1, -1, -1)) & 1 == 1


def _read_only(array: Array) -> Array:
    array.flags.writeable = False
    return array
