"""Domains in which it is known, from how they are made, which features matter across tasks.

On :func:`random_domain` and :func:`torus` irrelevance is exact by symmetry, not by small numbers:
for every task the domain also holds its mirror images, and averaging over them removes the
feature.  On :func:`meadow` some features matter in few tasks and others in none.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from thesis_lib.domains.domain import Domain
from thesis_lib.mdp import TabularMDP


def random_domain(
    seed: int, *, relevant: int = 2, irrelevant: int = 3, bases: int = 3, signal: float = 0.5
) -> Domain:
    """Random MDPs over binary features, some of them irrelevant across tasks.

    A base task has random transitions and rewards.  Its images swap the two values of some
    of the irrelevant features; the domain holds all of them, so the mean value function
    does not depend on those features, although every task's own does.

    Parameters
    ----------
    seed
        Of the transitions and rewards.
    relevant, irrelevant
        Number of features of each kind, ``r1`` ... and ``i1`` ...
    bases
        Number of base tasks; the domain has ``bases * 2**irrelevant`` tasks.
    signal
        Size of the reward that all bases share, which depends on the relevant features and
        the action; the rewards of a base's own have size 1.
    """
    rng = np.random.default_rng(seed)
    bits = relevant + irrelevant
    n, n_actions = 2**bits, 2
    names = [*(f"r{i + 1}" for i in range(relevant)), *(f"i{i + 1}" for i in range(irrelevant))]
    states = np.array(list(product(range(2), repeat=bits)))
    features = {name: states[:, i] for i, name in enumerate(names)}
    common = rng.normal(size=(2**relevant, n_actions))
    number = states[:, :relevant] @ (2 ** np.arange(relevant)[::-1])
    tasks = []
    for _ in range(bases):
        P = rng.dirichlet(np.full(n, 0.2), (n, n_actions))
        R = signal * common[number] + rng.normal(size=(n, n_actions))
        for mask in range(2**irrelevant):
            image = np.arange(n) ^ mask
            tasks.append(
                TabularMDP(
                    P[image][:, :, image],
                    R[image],
                    np.full(n, 1.0 / n),
                    discount=0.9,
                    features=features,
                )
            )
    return Domain(f"random {relevant}+{irrelevant}", tuple(tasks))


def torus(size: int = 4, mud: float = 3.0) -> Domain:
    """A gridworld without edges, with position, direction to the goal, and a distractor.

    The goal and one muddy cell may be anywhere, and a chessboard of two colours lies either
    way.  Features: ``x``, ``y`` position; ``dx``, ``dy`` offset to the goal; ``colour`` of
    the cell.  Position and colour matter in every task, for where the mud is, but the
    domain is the same after a shift of the board, so across tasks they mean nothing.

    Parameters
    ----------
    size
        Cells on a side, even so that the chessboard closes.
    mud
        Extra cost of stepping on the muddy cell.
    """
    n = size * size
    x, y = np.arange(n) % size, np.arange(n) // size
    moves = [(0, 1), (1, 0), (0, -1), (-1, 0)]
    to = np.stack([(x + i) % size + size * ((y + j) % size) for i, j in moves], axis=1)
    walk = np.eye(n)[to]
    tasks = []
    for goal, dirt, colour in product(range(n), range(n), range(2)):
        if goal == dirt:
            continue
        terminal = np.arange(n) == goal
        features = {
            "x": x,
            "y": y,
            "dx": (x[goal] - x) % size,
            "dy": (y[goal] - y) % size,
            "colour": (x + y + colour) % 2,
        }
        transition, reward = walk.copy(), -1.0 - mud * (to == dirt)
        transition[goal], reward[goal] = np.eye(n)[goal], 0.0
        start = np.where(terminal, 0.0, 1.0 / (n - 1))
        tasks.append(
            TabularMDP(
                transition,
                reward,
                start,
                terminal,
                features=features,
                actions=("N", "E", "S", "W"),
            )
        )
    return Domain("torus", tuple(tasks))


def meadow(size: int = 4, bits: int = 3, rare: float = 0.25, bog: float = 10.0) -> Domain:
    """A walled gridworld under changing weather, most of which does not matter.

    Features: ``x``, ``y`` position, and ``w1`` ... weather bits, each a fair coin at every
    step.  The goal, worth 10, may be in any cell; a step costs 1.  The middle columns are a
    bog.  In most tasks the weather is only weather; in some, stepping onto the bog costs
    ``bog`` more while the first bit, or in as many others while the second, is 1.  The
    other bits never matter.

    Parameters
    ----------
    size
        Cells on a side.
    bits
        Weather bits, at least 2; the table has ``2**bits`` times as many entries as the
        board needs.
    rare
        Share of the tasks in which the first two bits matter, together.
    bog
        Extra cost.
    """
    n, n_weather = size * size, 2**bits
    x, y = np.arange(n) % size, np.arange(n) // size
    moves = [(0, 1), (1, 0), (0, -1), (-1, 0)]
    to = np.stack(
        [np.clip(x + i, 0, size - 1) + size * np.clip(y + j, 0, size - 1) for i, j in moves],
        axis=1,
    )
    cell, weather = np.repeat(np.arange(n), n_weather), np.tile(np.arange(n_weather), n)
    values = (weather[:, None] >> np.arange(bits)[::-1]) & 1
    features = {"x": x[cell], "y": y[cell], **{f"w{i + 1}": values[:, i] for i in range(bits)}}
    wet = (x > 0) & (x < size - 1)
    n_states = n * n_weather
    transition = np.zeros((n_states, len(moves), n_states))
    for w in range(n_weather):
        np.put_along_axis(transition, (to[cell] * n_weather + w)[:, :, None], 1 / n_weather, axis=2)
    tasks, chances = [], []
    for goal, cause in product(range(n), (None, 0, 1)):
        terminal = cell == goal
        reward = np.where(to[cell] == goal, 9.0, -1.0)
        if cause is not None:
            reward = reward - bog * (wet[to[cell]] & (values[:, cause] == 1)[:, None])
        own = transition.copy()
        own[terminal] = np.eye(n_states)[terminal][:, None, :]
        reward[terminal] = 0.0
        tasks.append(
            TabularMDP(
                own,
                reward,
                ~terminal / (~terminal).sum(),
                terminal,
                discount=0.95,
                features=features,
                actions=("N", "E", "S", "W"),
            )
        )
        chances.append((1 - rare if cause is None else rare / 2) / n)
    return Domain("meadow", tuple(tasks), np.array(chances))
