r"""The empty room of section 3.3.5: the best cross-task policy is a covering tour, not uniform.

A goal lies in one cell of an otherwise empty room, any with equal chance, and nothing tells where.
A policy without memory that walks a cycle through all n cells meets a new cell at every step, and
no policy can do better, with memory or without: after t steps it has seen at most t of the other
n - 1 cells, so that the discounted cost is at least

.. math:: \frac{1}{n-1} \sum_{t=1}^{n-1} \frac{1-\gamma^t}{1-\gamma},

which the tour attains.  Such a cycle exists where a side is even and both are at least 2; on a
board of two colours with an odd number of cells none can.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from thesis_lib import potentials
from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.chapter3.runs import NAMES, TabularLearner, total_rewards
from thesis_lib.domains import Domain
from thesis_lib.domains.cliff import MOVES
from thesis_lib.edition.criteria import Pair, ordered
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.mdp import TabularMDP
from thesis_lib.potentials.cross_task_policy import gradient_ascent
from thesis_lib.potentials.cross_task_problem import CrossTaskProblem
from thesis_lib.stats import Summary, mean_ci


def empty_room(size: int, discount: float) -> Domain:
    """A walled square of cells with a goal in one of them, each step costing 1.

    Parameters
    ----------
    size
        Cells on a side.
    discount
        gamma.

    Returns
    -------
    Domain
        One task a goal; the start is any other cell.
    """
    n = size * size
    x, y = np.arange(n) % size, np.arange(n) // size
    to = np.stack(
        [np.clip(x + i, 0, size - 1) + size * np.clip(y + j, 0, size - 1) for i, j in MOVES],
        axis=1,
    )
    walk = np.eye(n)[to]
    tasks = []
    for goal in range(n):
        transition, reward = walk.copy(), np.full((n, 4), -1.0)
        transition[goal], reward[goal] = np.eye(n)[goal], 0.0
        terminal = np.arange(n) == goal
        tasks.append(
            TabularMDP(
                transition,
                reward,
                ~terminal / (n - 1),
                terminal,
                discount=discount,
                features={"x": x, "y": y},
                actions=("N", "E", "S", "W"),
            )
        )
    return Domain(f"empty room {size} x {size}", tuple(tasks))


def tour(size: int) -> IntArray:
    """Action in each cell of a cycle through all cells, shape ``(size * size,)``, x slowest.

    Up the first column, and back down by the rows, each through the other columns.

    Raises
    ------
    ValueError
        When the side is odd.
    """
    if size < 2 or size % 2:
        raise ValueError(f"size is {size}, but a square has a cycle only if its side is even.")
    north, east, south, west = range(4)
    action = np.empty((size, size), dtype=np.int64)  # [y, x]
    action[:, 0] = north
    for row in range(size):
        from_top = size - 1 - row
        if from_top % 2 == 0:
            action[row, 1:-1], action[row, -1] = east, south
        else:
            action[row, 2:], action[row, 1] = west, south
    action[-1, 0] = east
    action[0, 1] = west
    return action.T.ravel()


def least_cost(size: int, discount: float) -> float:
    """Discounted cost below which no policy can come, with memory or without."""
    t = np.arange(1, size * size)
    return float(((1 - discount**t) / (1 - discount)).mean())


@dataclass(frozen=True)
class Config:
    """Rooms, and how potentials are tried in them."""

    sizes: tuple[int, ...] = (3, 4, 6)
    """Cells on a side; an odd side has no tour."""
    discount: float = 0.95
    """gamma."""
    restarts: int = 10
    """Starting points of the gradient search for a policy."""
    learner: TabularLearner = field(
        default_factory=lambda: TabularLearner("q_learning", 0.5, 0.05, episodes=20)
    )
    """How each task is learned with the policy's values as a potential."""
    repeats: int = 40
    """Runs a task."""


@dataclass(frozen=True)
class Policy:
    """One cross-task policy of one room, and its values as a potential."""

    size: int
    """Cells on a side."""
    policy: str
    """uniform, tour, gradient ascent; or a potential that is no policy's: Q_star, none,
    constant (the tour's level without its order)."""
    value: float
    """Mean discounted return over goals and starts; none where there is no policy."""
    bound: float
    """The most that any policy can earn."""
    mean_return: float
    """Mean total reward of a Q-learner with its values as the potential."""
    ci95: float
    """Half-width of its 95% t interval over runs."""
    sd: float
    """Standard deviation over runs."""
    n_runs: int
    """Runs, all tasks together."""


@experiment(
    "ch3-covering-tour",
    item="Section 3.3.5, the empty room",
    smoke=Config(sizes=(4,), restarts=1, repeats=1),
    book=Config(),
    seconds=7,
)
def rooms(config: Config, context: Context) -> list[Policy]:
    """Value of cross-task policies in an empty room, and the return with them as potentials."""
    rows = []
    for size in config.sizes:
        domain = empty_room(size, config.discount)
        uniform = np.full(domain.shape, 0.25)
        rng = np.random.default_rng(context.seed)
        found = gradient_ascent(
            CrossTaskProblem(domain, "start"), rng, restarts=config.restarts
        ).policy
        policies = {"uniform": uniform, "gradient ascent": found}
        if size % 2 == 0:
            policies["tour"] = np.eye(4)[tour(size)]
        phi = {name: potentials.q_mu(domain, mu) for name, mu in policies.items()}
        level = float(phi["tour" if "tour" in phi else "gradient ascent"].mean())
        phi |= {
            "Q_star": potentials.q_star(domain),
            "none": potentials.constant_potential(domain, 0.0),
            "constant": potentials.constant_potential(domain, level),
        }
        cells = [(config.learner, values) for values in phi.values()]
        totals = total_rewards(context, domain, cells, config.repeats, domain.name)
        for name, total in zip(phi, totals, strict=True):
            earned = mean_ci(total)
            value = mean_value(domain, policies[name]) if name in policies else float("nan")
            rows.append(
                Policy(
                    *(size, name, value, -least_cost(size, config.discount), earned.mean),
                    *(earned.half_width, float(total.std(ddof=1)), earned.n),
                )
            )
    return rows


def mean_value(domain: Domain, policy: FloatArray) -> float:
    """Mean discounted return of a cross-task policy over tasks and their starts."""
    values = potentials.policy_values(domain, policy)
    return float(
        np.mean(
            [
                task.start @ (policy * q).sum(axis=1)
                for task, q, policy in zip(
                    domain.tasks, values, potentials.task_policies(domain, policy), strict=True
                )
            ]
        )
    )


@criterion("3.3.5-empty-room", rooms)
def uniform_is_best(table: pd.DataFrame) -> Finding:
    """Whether the uniform policy is the best of an empty room."""
    by = table.set_index(["size", "policy"]).value
    sizes = list(dict.fromkeys(table["size"]))
    best = {s: float(by.loc[s].max()) for s in sizes}
    beaten = [s for s in sizes if best[s] > by[s, "uniform"] + 1e-9]
    told = "; ".join(
        f"{s} x {s}: uniform {by[s, 'uniform']:.2f}, best found {best[s]:.2f}, bound "
        f"{float(table[table['size'] == s].bound.iloc[0]):.2f}"
        for s in sizes
    )
    return Finding(
        Verdict.REFUTED if beaten else Verdict.REPRODUCED,
        f"Another memoryless policy earns more in {len(beaten)} of {len(sizes)} rooms: {told}.",
        {"beaten": len(beaten)},
    )


@criterion("3.3.5-tour-as-potential", rooms)
def tour_shapes_best(table: pd.DataFrame) -> Finding:
    """The tour's values as a potential against Q*, their level alone and no shaping."""
    pairs = []
    for size, own in table.groupby("size", sort=False):
        row = {r.policy: Summary(r.mean_return, r.sd, r.n_runs) for r in own.itertuples()}
        for other in ("Q_star", "constant", "none") if "tour" in row else ():
            names = ("the tour", NAMES.get(other, other))
            pairs.append(Pair(row["tour"], row[other], names, f"{size} x {size}"))
    return ordered(pairs, "total reward")
