"""The cliff experiments of chapter 2 against hand calculation and the printed table."""

import numpy as np
import pandas as pd
import pytest

from thesis_lib.chapter2 import convergence, dynamic_programming, exploration, one_cliff, online
from thesis_lib.published import load
from thesis_lib.stats import mean_ci

N, E, S, W = range(4)


def q_of(path: list[tuple[tuple[int, int], int]]) -> np.ndarray:
    """A Q-table whose greedy policy takes the given action in each of the given cells."""
    q = np.zeros((16, 4))
    for cell, action in path:
        q[one_cliff.layout().state(cell), action] = 1.0
    return q


def test_greedy_path_along_the_edge() -> None:
    where, mdp = one_cliff.layout(), one_cliff.task()
    assert (where.start, where.goal, where.cliff) == ((0, 0), (3, 0), ((1, 0), (2, 0)))
    edge = q_of([((0, 0), N), ((0, 1), E), ((1, 1), E), ((2, 1), E), ((3, 1), S)])
    path = one_cliff.greedy_path(mdp, edge)
    assert [where.cell(s) for s in path.states] == [(0, 0), (0, 1), (1, 1), (2, 1), (3, 1), (3, 0)]
    assert (path.earned, path.ends, one_cliff.cells_at_edge(path, where)) == (-5.0, True, 2)


def test_greedy_path_around_the_edge() -> None:
    where = one_cliff.layout()
    cells = [(0, 0), (0, 1), (0, 2), (1, 2), (2, 2), (3, 2), (3, 1)]
    detour = q_of(list(zip(cells, [N, N, E, E, E, S, S], strict=True)))
    path = one_cliff.greedy_path(one_cliff.task(), detour)
    assert (path.earned, path.ends, one_cliff.cells_at_edge(path, where)) == (-7.0, True, 0)


def test_greedy_path_in_circles() -> None:
    where = one_cliff.layout()
    circle = q_of([((0, 0), N), ((0, 1), N), ((0, 2), S)])
    path = one_cliff.greedy_path(one_cliff.task(), circle)
    assert [where.cell(s) for s in path.states] == [(0, 0), (0, 1), (0, 2), (0, 1)]
    assert (path.earned, path.ends) == (-100.0, False)


def test_total_reward_is_falls_and_steps() -> None:
    config = online.Config(runs=5, episodes=50, late=10)
    table = online.runs.run(config=config, seed=1).table
    steps = -(table.total_reward + 1000 * table.falls)
    assert (steps == steps.round()).all()
    assert (steps >= 5 * config.episodes).all()  # no episode is shorter than the shortest path
    assert set(table.algorithm) == {"q_learning", "sarsa"}


def test_another_seed_is_another_sample() -> None:
    config = online.Config(runs=4, episodes=30, late=10)
    one, other = (online.runs.run(config=config, seed=seed).table for seed in (2, 3))
    assert not one.total_reward.equals(other.total_reward)


def test_total_rewards_agree_with_table_3_1() -> None:
    table = online.runs.run("book").table
    printed = load("table-3.1").query("potential == 'none' and not sensor").set_index("algorithm")
    for method, runs in table.groupby("algorithm"):
        ours = mean_ci(runs.total_reward / 1e4)
        both = np.hypot(ours.half_width, printed.ci95[method])
        assert abs(ours.mean - printed.value[method]) < both


def test_curve_is_the_mean_of_the_runs() -> None:
    config = online.CurveConfig(runs=6, episodes=40, late=10, block=20)
    curve = online.curve.run(config=config, seed=4).table
    config = online.Config(runs=6, episodes=40, late=10)
    runs = online.runs.run(config=config, seed=4).table
    total = (curve.set_index("algorithm").mean_return * 20).groupby("algorithm").sum()
    np.testing.assert_allclose(total, runs.groupby("algorithm").total_reward.mean())
    assert curve.episode.unique().tolist() == [10.5, 30.5]


def soft_values(epsilon: float) -> np.ndarray:
    """Values of the best policy that explores with epsilon, by plain iteration."""
    mdp = one_cliff.task()
    q = np.zeros((16, 4))
    for _ in range(5000):
        v = (1 - epsilon) * q.max(axis=1) + epsilon * q.mean(axis=1)
        v[mdp.terminal] = 0
        q = mdp.reward + mdp.transition @ v
    return q


@pytest.fixture(scope="module")
def converged() -> pd.DataFrame:
    config = convergence.Config(
        runs=2, steps=400_000, checkpoints=4, epsilons_q_learning=(0.5,), epsilons_sarsa=(0.3,)
    )
    return convergence.distances.run(config=config).table


def test_exact_values_of_the_convergence_table(converged: pd.DataFrame) -> None:
    assert (converged.start_optimal == -5).all()
    for epsilon, rows in converged.groupby("epsilon"):
        soft = soft_values(epsilon)
        assert rows.start_soft.iloc[0] == pytest.approx(soft[0].max(), rel=1e-6)
        playable = np.delete(np.arange(16), [1, 2, 3])
        gap = np.sqrt(((soft - soft_values(0.0))[playable] ** 2).mean())
        assert rows.gap.iloc[0] == pytest.approx(gap, rel=1e-6)


def test_q_learning_gets_nearer_to_the_optimum_and_sarsa_does_not(
    converged: pd.DataFrame,
) -> None:
    last = converged[converged.step == 400_000].set_index("algorithm")
    q_learning = last.loc[["q_learning"]]
    assert (q_learning.error_optimal < 1).all()
    sarsa = last.loc[["sarsa"]]
    sarsa = sarsa[sarsa.exploration == "constant"]
    assert (sarsa.error_soft < sarsa.error_optimal).all()
    assert (sarsa.start_value < -20).all()


def test_sweeps_of_the_episodic_cliff_by_hand() -> None:
    table = dynamic_programming.errors.run("book").table
    episodic = table[(table.task == "episodic") & (table.discount == 1)]
    # The pair furthest from the goal is 7 steps away (one off the grid in the far corner, 6 back),
    # a synchronous sweep reaches one step further, and a fall is worth -1000 - 5.
    synchronous = episodic[episodic.algorithm == "synchronous"]
    assert synchronous.error.tolist() == [1005, 6, 5, 4, 3, 2, 1, 0]
    assert (episodic.groupby("algorithm").error.last() == 0).all()


def test_sweeps_of_the_discounted_cliff_stay_below_the_bound() -> None:
    table = dynamic_programming.errors.run("book").table
    bounded = table.dropna(subset="bound")
    assert set(bounded.task) == {"episodic", "continuing"}
    assert (bounded.error <= bounded.bound * (1 + 1e-9)).all()
    last = table.groupby(["task", "discount", "algorithm"]).error.last()
    assert (last <= 1e-5).all()


def test_exploration_dilemma() -> None:
    config = exploration.Config(runs=60, epsilons=(0.0, 0.2))
    table = exploration.by_epsilon.run(config=config).table
    table = table.set_index(["algorithm", "initial", "epsilon"]).sort_index()
    pessimistic = table.loc["q_learning", "pessimistic"]
    assert pessimistic.online[0.0] > pessimistic.online[0.2]
    assert pessimistic.optimal[0.0] < pessimistic.optimal[0.2] == 1
    assert (table.loc["q_learning", "optimistic"].optimal == 1).all()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: online.Config(episodes=10, late=20), "late is 20"),
        (lambda: online.CurveConfig(episodes=100, late=10, block=30), "block is 30"),
        (lambda: convergence.Config(steps=100, checkpoints=7), "checkpoints is 7"),
        (lambda: convergence.Config(power=0.4), "power is 0.4"),
    ],
)
def test_bad_settings(make, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()
