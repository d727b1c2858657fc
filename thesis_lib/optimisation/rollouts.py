"""Collect whole episodes from many worlds at once (section 5.4).

The rule
--------
Episodes are numbered in the order in which they *start*.  A batch of ``n`` steps is the
shortest run of episodes 0, 1, 2, ... whose lengths add up to at least ``n``; every one of
them is finished, and whatever was begun after them is thrown away.

This is what a single world would collect by sampling one whole episode after another until
it has ``n`` steps, the author's rule, and the batch has the same distribution: whether an
episode belongs to it depends only on the lengths of those numbered before it.  Taking the
episodes that *finish* first instead would prefer short ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium
import gymnasium.vector
import numpy as np
import torch
from numpy.typing import NDArray

from thesis_lib.arrays import BoolArray, FloatArray, IntArray
from thesis_lib.optimisation.vector_task import VectorTask
from thesis_lib.policies import GaussianPolicy, Packing


@dataclass(frozen=True, eq=False)
class Rollouts:
    """A batch of whole episodes, as rows laid out by ``packing``.

    Attributes
    ----------
    packing
        Which row is which step of which episode; episodes in the order of their start.
    observations
        What the policy saw before each action, shape ``(R, D)``.
    actions
        Shape ``(R, A)``, as drawn, before the task clips them.
    rewards
        Shape ``(R,)``.
    terminated
        Whether each episode ended by its state and not by a limit, shape ``(B,)``.
    final_observations
        What the policy would have seen next, shape ``(B, D)``.
    hidden
        Last hidden layer, shape ``(R, F)``, for policies that keep it.
    n_simulated
        Steps simulated for this batch, those thrown away included.
    """

    packing: Packing
    observations: FloatArray
    actions: FloatArray
    rewards: FloatArray
    terminated: BoolArray
    final_observations: FloatArray
    hidden: torch.Tensor | None = None
    n_simulated: int = 0

    @property
    def n_steps(self) -> int:
        """Number of steps R."""
        return self.packing.n_steps

    @property
    def n_episodes(self) -> int:
        """Number of episodes B."""
        return self.packing.n_episodes

    @property
    def lengths(self) -> IntArray:
        """Length of each episode in steps, shape ``(B,)``."""
        return self.packing.lengths

    @property
    def episode_returns(self) -> FloatArray:
        """Undiscounted return of each episode, shape ``(B,)``."""
        total = np.zeros(self.packing.n_episodes)
        np.add.at(total, self.packing.episode, self.rewards)
        return total

    def padded(self, name: str) -> FloatArray:
        """``observations``, ``actions`` or ``rewards`` padded with 0, shape ``(T, B, ...)``."""
        return self.packing.unpack(getattr(self, name))

    @property
    def mask(self) -> BoolArray:
        """True where a padded array holds a real step, shape ``(T, B)``."""
        return self.packing.mask()


def collect(
    task: VectorTask,
    policy: GaussianPolicy,
    n_steps: int,
    generator: np.random.Generator,
    *,
    greedy: bool = False,
) -> Rollouts:
    """Collect whole episodes of at least ``n_steps`` steps by the rule of this module.

    Parameters
    ----------
    task
        Any task in n worlds.  All worlds are reset first.
    policy
        Evaluated once a step for all worlds.
    n_steps
        Number of steps wanted, at least 1; the last episode goes beyond it.
    generator
        Source of the exploration noise.
    greedy
        Whether to act by the mean instead.

    Raises
    ------
    ValueError
        When the task does not fit the policy or ``n_steps`` is not positive.
    FloatingPointError
        When an observation, a reward or an action is not finite.
    """
    if n_steps < 1:
        raise ValueError(f"n_steps is {n_steps}, but a batch needs at least 1 step.")
    recorder = _Recorder(task, policy, None if greedy else generator)
    while recorder.needed(n_steps) is None:
        if recorder.step():
            idle = np.flatnonzero(~recorder.running)
            recorder.start(idle[: recorder.wanted(n_steps)])
    return recorder.rollouts(recorder.needed(n_steps) or 0)


def run_episodes(
    task: VectorTask,
    policy: GaussianPolicy,
    generator: np.random.Generator | None = None,
    *,
    max_steps: int | None = None,
    watch: Callable[[BoolArray], None] | None = None,
) -> Rollouts:
    """Run one episode in every world; episode i of the result is that of world i.

    Parameters
    ----------
    task
        Any task in n worlds.
    policy
        The policy.
    generator
        Source of the exploration noise; None acts greedily, by the mean.
    max_steps
        Steps after which episodes are cut, for tasks that have no limit of their own.
    watch
        Called before every step with the worlds whose episode goes on, shape ``(n,)``.
    """
    recorder = _Recorder(task, policy, generator)
    while recorder.running.any() and (max_steps is None or recorder.n_passes < max_steps):
        if watch is not None:
            watch(recorder.running.copy())
        recorder.step()
    recorder.cut()
    return recorder.rollouts(task.num_envs)


class _Recorder:
    """The loop of acting and recording, and which world runs which episode."""

    def __init__(
        self, task: VectorTask, policy: GaussianPolicy, generator: np.random.Generator | None
    ) -> None:
        if isinstance(task, gymnasium.Env | gymnasium.vector.VectorEnv):
            raise ValueError(
                f"a task in many worlds is needed, but {task} was given; pass "
                "GymnasiumTask(id_or_function, num_envs)."
            )
        for name in ("observation_size", "action_size"):
            ours, theirs = getattr(policy, name), getattr(task, name)
            if ours != theirs:
                raise ValueError(
                    f"the task's {name} is {theirs}, but the policy was made for {ours}."
                )
        n = task.num_envs
        self.task, self.policy, self.generator = task, policy, generator
        self.n_passes = 0
        self.running = np.ones(n, dtype=bool)
        self.episode = np.arange(n)
        self.time = np.zeros(n, dtype=np.int64)
        self.lengths = [0] * n
        self.finished = [False] * n
        self.terminated = [False] * n
        self.final: list[FloatArray | None] = [None] * n
        self.first_unfinished = 0
        self.steps_before = 0
        self.observation = np.array(task.reset(), dtype=np.float64)
        with torch.no_grad():
            self.state = policy.initial_state(n).clone()
            self.std = torch.exp(policy.deviation()).double().numpy()
        self.before = np.zeros((n, policy.action_size))
        self.rows = {
            "observation": _Rows(policy.observation_size, np.dtype(np.float64)),
            "action": _Rows(policy.action_size, np.dtype(np.float64)),
            "reward": _Rows(1, np.dtype(np.float64)),
            "episode": _Rows(1, np.dtype(np.int64)),
            "time": _Rows(1, np.dtype(np.int64)),
        }
        if policy.keeps_hidden:
            kind = np.dtype(np.float32 if policy.dtype == torch.float32 else np.float64)
            self.rows["hidden"] = _Rows(policy.hidden_size, kind)

    def step(self) -> bool:
        """Act once in all worlds; whether an episode has just ended."""
        with torch.no_grad():
            mean, state = self.policy.step(
                torch.from_numpy(self.observation), torch.from_numpy(self.before), self.state
            )
        action = mean.double().numpy()
        if self.generator is not None:
            action = action + self.std * self.generator.standard_normal(action.shape)
        running = self.running
        self._check("action", action)
        outcome = self.task.step(action)
        self._check("reward", outcome.reward)
        self._check("observation", outcome.observation)
        new = {
            "observation": self.observation,
            "action": action,
            "reward": outcome.reward[:, None],
            "episode": self.episode[:, None],
            "time": self.time[:, None],
        }
        if "hidden" in self.rows:
            new["hidden"] = state[:, : self.policy.hidden_size].numpy()
        everywhere = bool(running.all())
        for name, rows in self.rows.items():
            rows.append(new[name] if everywhere else new[name][running])
        self.time += running
        self.n_passes += 1
        self.observation = np.array(outcome.observation, dtype=np.float64)
        self.before, self.state = action, state
        ended = np.flatnonzero((outcome.terminated | outcome.truncated) & running)
        for i in ended:
            self._finish(int(i), bool(outcome.terminated[i]))
        return len(ended) > 0

    def _finish(self, world: int, terminated: bool) -> None:
        k = self.episode[world]
        self.lengths[k] = int(self.time[world])
        self.finished[k] = True
        self.terminated[k] = terminated
        self.final[k] = self.observation[world].copy()
        self.running[world] = False

    def cut(self) -> None:
        """End all episodes where they are."""
        for i in np.flatnonzero(self.running):
            self._finish(int(i), False)

    def start(self, worlds: IntArray) -> None:
        """Start a new episode in some worlds that have ended."""
        if len(worlds) == 0:
            return
        self.observation[worlds] = self.task.reset(worlds)
        self.state = self.state.clone()
        with torch.no_grad():
            self.state[torch.as_tensor(worlds)] = self.policy.initial_state(len(worlds))
        self.before = self.before.copy()
        self.before[worlds] = 0.0
        self.time[worlds] = 0
        self.running[worlds] = True
        self.episode[worlds] = len(self.lengths) + np.arange(len(worlds))
        self.lengths += [0] * len(worlds)
        self.finished += [False] * len(worlds)
        self.terminated += [False] * len(worlds)
        self.final += [None] * len(worlds)

    def wanted(self, n_steps: int) -> int:
        """How many episodes to start now, by a guess of how long those running will be.

        Steps so far over episodes that ended estimates the length, and what is left of an
        episode is guessed to be that much again, up to the task's limit.  The guess decides
        how much is thrown away, and nothing else: the rule does not look at it.
        """
        done, elapsed = sum(self.lengths), self.time[self.running]
        typical = max((done + elapsed.sum()) / sum(self.finished), 1.0)
        limit = getattr(self.task, "max_episode_steps", None) or np.inf
        expected = done + np.minimum(elapsed + typical, limit).sum()
        return max(0, int(np.ceil((n_steps - expected) / typical)))

    def needed(self, n_steps: int) -> int | None:
        """Number of episodes of the batch once it is complete, None before."""
        while self.first_unfinished < len(self.finished):
            if self.steps_before >= n_steps:
                return self.first_unfinished
            if not self.finished[self.first_unfinished]:
                return None
            self.steps_before += self.lengths[self.first_unfinished]
            self.first_unfinished += 1
        return self.first_unfinished if self.steps_before >= n_steps else None

    def _check(self, name: str, values: FloatArray) -> None:
        """Raise FloatingPointError naming the first value of a running world that is bad."""
        if np.isfinite(values).all():
            return
        bad = ~np.isfinite(values.reshape(len(values), -1)).all(axis=1) & self.running
        if bad.any():
            world = int(np.argmax(bad))
            value = np.array2string(values[world], threshold=6, max_line_width=np.inf)  # type: ignore[arg-type]
            raise FloatingPointError(
                f"the {name} in world {world} at step {self.time[world]} of its episode is "
                f"{value}, which is not finite."
            )

    def rollouts(self, n_episodes: int) -> Rollouts:
        """The first episodes as a batch."""
        packing = Packing(np.array(self.lengths[:n_episodes]))
        place = np.empty(n_episodes, dtype=np.int64)
        place[packing.order] = np.arange(n_episodes)
        episode, time = self.rows["episode"].all(), self.rows["time"].all()
        target = np.full(len(episode), -1)
        mine = episode < n_episodes
        target[mine] = packing.offsets[time[mine]] + place[episode[mine]]
        taken = {
            name: self.rows[name].moved(target, packing.n_steps)
            for name in ("observation", "action", "reward", "hidden")
            if name in self.rows
        }
        final = [f for f in self.final[:n_episodes] if f is not None]
        return Rollouts(
            packing=packing,
            observations=taken["observation"],
            actions=taken["action"],
            rewards=taken["reward"][:, 0],
            terminated=np.array(self.terminated[:n_episodes]),
            final_observations=np.stack(final),
            hidden=torch.from_numpy(taken["hidden"]) if "hidden" in taken else None,
            n_simulated=len(target),
        )


class _Rows:
    """Rows that arrive bit by bit, in blocks that go back to the system one by one.

    A reservoir's states are by far the largest part of a batch.  Small arrays that stay,
    one a step, would leave the memory between them in pieces too small to be used again.

    Parameters
    ----------
    width
        Entries of a row.
    dtype
        Their type.
    """

    BYTES = 1 << 26

    def __init__(self, width: int, dtype: np.dtype[Any]) -> None:
        self.width, self.dtype = width, dtype
        self.capacity = max(1, self.BYTES // (width * dtype.itemsize))
        self.blocks: list[NDArray[Any]] = []
        self.used = self.capacity

    def append(self, rows: NDArray[Any]) -> None:
        """Add rows, shape ``(n, width)``."""
        while len(rows):
            if self.used == self.capacity:
                self.blocks.append(np.empty((self.capacity, self.width), dtype=self.dtype))
                self.used = 0
            n = min(len(rows), self.capacity - self.used)
            self.blocks[-1][self.used : self.used + n] = rows[:n]
            self.used += n
            rows = rows[n:]

    def all(self) -> NDArray[Any]:
        """All rows of width 1 so far, shape ``(rows,)``."""
        return np.concatenate([*self.blocks[:-1], self.blocks[-1][: self.used]])[:, 0]

    def moved(self, target: IntArray, n_rows: int) -> NDArray[Any]:
        """Put every row where ``target`` says, -1 for nowhere; the blocks are given up."""
        result = np.empty((n_rows, self.width), dtype=self.dtype)
        for start in range(0, len(target), self.capacity):
            block = self.blocks.pop(0)
            index = target[start : start + self.capacity]
            wanted = np.flatnonzero(index >= 0)
            result[index[wanted]] = block[wanted]
        return result
