"""Beyond the thesis: Table 3.1 for learners it does not try."""

from __future__ import annotations

from dataclasses import dataclass, replace

from thesis_lib.chapter3 import table_3_1
from thesis_lib.edition.experiment import Context, experiment, returns

OTHERS = table_3_1.Config(
    algorithms=("expected_sarsa", "double_q_learning"),
    potentials=("none", "Q_star", "Q_tilde", "constant"),
)


@dataclass(frozen=True)
class Entry:
    """One entry of the table; rewards in units of 10^4."""

    potential: str
    """none, Q_star, Q_tilde, or constant (our control)."""
    algorithm: str
    """expected_sarsa or double_q_learning."""
    sensor: bool
    """Whether the agent has the cliff sensor."""
    mean_return: float
    """Mean total reward of a run, in 10^4."""
    ci95: float
    """Half-width of its 95% t interval, in 10^4."""
    sd: float
    """Standard deviation over runs, in 10^4."""
    n_runs: int
    """Number of runs."""


@experiment(
    "ch3-learners",
    item="Table 3.1, other learners",
    smoke=replace(OTHERS, n_runs=4, episodes=20),
    book=replace(OTHERS, n_runs=400),
    thesis=OTHERS,
    seconds=5,
)
def entries(config: table_3_1.Config, context: Context) -> list[Entry]:
    """Table 3.1 for Expected Sarsa and Double Q-learning."""
    cells = table_3_1.all_cells(config)
    totals = table_3_1.episode_returns(config, cells, context).sum(axis=2) / table_3_1.UNIT
    return [
        Entry(c.potential, c.algorithm, c.sensor, **returns(total))
        for c, total in zip(cells, totals, strict=True)
    ]
