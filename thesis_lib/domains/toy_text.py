"""Domains made of other people's tasks: Gymnasium's taxi and frozen lake.

In each task something is numbered anew: the taxi's destinations, or four lakes.  The number
matters within every task, and across tasks not at all: each thing has each number in equally many
tasks, so that averaging over them removes the feature exactly.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import permutations
from typing import Any

import numpy as np
from gymnasium.envs.toy_text.frozen_lake import FrozenLakeEnv, generate_random_map
from gymnasium.envs.toy_text.taxi import TaxiEnv

from thesis_lib.arrays import BoolArray, FloatArray
from thesis_lib.domains.domain import Domain
from thesis_lib.mdp import TabularMDP

Outcomes = Mapping[int, Mapping[int, list[tuple[float, int, float, bool]]]]
"""Gymnasium's ``P``: for state and action the probability, next state, reward, and end."""


def taxi(discount: float = 0.95) -> Domain:
    """Gymnasium's Taxi, whose four destinations are numbered anew in each of 4 tasks, by rotation.

    Features: ``row`` and ``column`` of the taxi, ``passenger`` (at one of four stands, or 4 in
    the taxi) and ``destination``, the only one that is irrelevant across tasks.

    Parameters
    ----------
    discount
        gamma.

    Notes
    -----
    Source: Dietterich (2000), in Gymnasium's version.  States with the passenger at the
    destination end an episode, those that cannot be reached among them.
    """
    env = TaxiEnv()
    row, column, passenger, destination = np.array([list(env.decode(s)) for s in range(500)]).T
    terminal = passenger == destination
    transition, reward = _tables(env.P, terminal)
    features = {"row": row, "column": column, "passenger": passenger}
    start = np.asarray(env.initial_state_distrib)
    actions = ("south", "north", "east", "west", "pick up", "drop off")
    tasks = [
        TabularMDP(
            transition,
            reward,
            start,
            terminal,
            discount=discount,
            features=features | {"destination": (destination + turn) % 4},
            actions=actions,
        )
        for turn in range(4)
    ]
    return Domain("taxi", tasks)


def frozen_lakes(seed: int = 0, discount: float = 0.95) -> Domain:
    """Four of Gymnasium's frozen lakes, slippery and of random maps, numbered anew in 24 tasks.

    An episode begins on any of the lakes.  Features: ``row``, ``column``, and the number of the
    ``lake``, which is irrelevant across tasks.

    Parameters
    ----------
    seed
        Of the maps.
    discount
        gamma.
    """
    maps = [generate_random_map(4, seed=4 * seed + i) for i in range(4)]
    number, cell = np.divmod(np.arange(64), 16)
    terminal = np.array([rows[i // 4][i % 4] in "GH" for rows in maps for i in range(16)])
    transition, reward = np.zeros((64, 4, 64)), np.zeros((64, 4))
    for i, rows in enumerate(maps):
        own = slice(16 * i, 16 * (i + 1))
        P, R = _tables(FrozenLakeEnv(desc=rows).P, terminal[own])
        transition[own, :, own], reward[own] = P, R
    start = (cell == 0) / 4
    return Domain(
        "frozen lakes",
        [
            TabularMDP(
                transition,
                reward,
                start,
                terminal,
                discount=discount,
                features={"row": cell // 4, "column": cell % 4, "lake": np.array(names)[number]},
                actions=("west", "south", "east", "north"),
            )
            for names in permutations(range(4))
        ],
    )


def _tables(outcomes: Outcomes | Any, terminal: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Transitions and expected rewards of Gymnasium's ``P``; terminal states stay, for nothing."""
    n, n_actions = len(outcomes), len(outcomes[0])
    transition, reward = np.zeros((n, n_actions, n)), np.zeros((n, n_actions))
    ends = np.flatnonzero(terminal)
    for s in np.flatnonzero(~terminal):
        for a in range(n_actions):
            for p, successor, r, _ in outcomes[int(s)][a]:
                transition[s, a, successor] += p
                reward[s, a] += p * r
    transition[ends, :, ends] = 1.0
    return transition, reward
