"""Tasks whose episodes end when the test says so."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass
class Outcome:
    observation: NDArray[np.float64]
    reward: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]


class ScriptedTask:
    """Episode k (in the order of starts) has a given length and is seen as (k, t)."""

    observation_size, action_size = 2, 1

    def __init__(self, num_envs: int, lengths: Iterator[int]) -> None:
        self.num_envs = num_envs
        self.script = lengths
        self.started: list[int] = []
        self.episode = np.zeros(num_envs, dtype=int)
        self.time = np.zeros(num_envs, dtype=int)
        self.simulated = 0
        self.poison: tuple[str, int] | None = None

    def reset(self, worlds: Any = None) -> NDArray[np.float64]:
        ids = np.arange(self.num_envs) if worlds is None else np.asarray(worlds)
        for i in ids:
            self.episode[i] = len(self.started)
            self.started.append(next(self.script))
            self.time[i] = 0
        return self.observe()[ids]

    def observe(self) -> NDArray[np.float64]:
        return np.stack([self.episode, self.time], axis=1).astype(float)

    def step(self, actions: ArrayLike) -> Outcome:
        assert np.shape(actions) == (self.num_envs, 1)
        length = np.array([self.started[k] for k in self.episode])
        running = self.time < length
        reward = np.where(running, 100.0 * self.episode + self.time, 0.0)
        self.time = self.time + running
        self.simulated += int(running.sum())
        observation = self.observe()
        if self.poison is not None and self.simulated >= self.poison[1]:
            {"reward": reward, "observation": observation}[self.poison[0]][0] = np.nan
        ended = self.time >= length
        odd = self.episode % 2 == 1
        return Outcome(observation, reward, ended & odd, ended & ~odd)
