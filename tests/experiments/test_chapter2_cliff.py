"""The cliff experiments of chapter 2 against hand calculation and the printed table."""

import numpy as np
import pandas as pd
import pytest

from thesis_lib.edition.experiment import Context
from thesis_lib.experiments.chapter2 import EXPERIMENTS, SECTION_2_3_2, SECTION_2_3_3
from thesis_lib.experiments.chapter2 import cliff_learning as c
from thesis_lib.published import load
from thesis_lib.stats import mean_ci

N, E, S, W = range(4)


def q_of(path: list[tuple[tuple[int, int], int]]) -> np.ndarray:
    """A Q-table whose greedy policy takes the given action in each of the given cells."""
    q = np.zeros((16, 4))
    for cell, action in path:
        q[c.layout().state(cell), action] = 1.0
    return q


def test_greedy_path_along_the_edge() -> None:
    where, mdp = c.layout(), c.task()
    assert (where.start, where.goal, where.cliff) == ((0, 0), (3, 0), ((1, 0), (2, 0)))
    edge = q_of([((0, 0), N), ((0, 1), E), ((1, 1), E), ((2, 1), E), ((3, 1), S)])
    path = c.greedy_path(mdp, edge)
    assert [where.cell(s) for s in path.states] == [(0, 0), (0, 1), (1, 1), (2, 1), (3, 1), (3, 0)]
    assert (path.earned, path.ends, c.cells_at_edge(path, where)) == (-5.0, True, 2)


def test_greedy_path_around_the_edge() -> None:
    where = c.layout()
    cells = [(0, 0), (0, 1), (0, 2), (1, 2), (2, 2), (3, 2), (3, 1)]
    detour = q_of(list(zip(cells, [N, N, E, E, E, S, S], strict=True)))
    path = c.greedy_path(c.task(), detour)
    assert (path.earned, path.ends, c.cells_at_edge(path, where)) == (-7.0, True, 0)


def test_greedy_path_in_circles() -> None:
    where = c.layout()
    circle = q_of([((0, 0), N), ((0, 1), N), ((0, 2), S)])
    path = c.greedy_path(c.task(), circle)
    assert [where.cell(s) for s in path.states] == [(0, 0), (0, 1), (0, 2), (0, 1)]
    assert (path.earned, path.ends) == (-100.0, False)


def test_total_reward_is_falls_and_steps() -> None:
    config = c.OnlineConfig(runs=5, episodes=50, late=10)
    table = c.online(config, Context(seed=1))
    steps = -(table.total_reward + 1000 * table.falls)
    assert (steps == steps.round()).all()
    assert (steps >= 5 * config.episodes).all()  # no episode is shorter than the shortest path
    assert set(table.method) == {"q_learning", "sarsa"}


def test_workers_change_nothing() -> None:
    config = c.OnlineConfig(runs=4, episodes=30, late=10)
    one, three = (c.online(config, Context(seed=2, workers=w)) for w in (1, 3))
    pd.testing.assert_frame_equal(one, three)
    other = c.online(config, Context(seed=3))
    assert not one.total_reward.equals(other.total_reward)


def test_total_rewards_agree_with_table_3_1() -> None:
    table = SECTION_2_3_3.run("book").table
    printed = load("table-3.1").query("potential == 'none' and not sensor").set_index("algorithm")
    for method, runs in table.groupby("method"):
        ours = mean_ci(runs.total_reward / 1e4)
        both = np.hypot(ours.half_width, printed.ci95[method])
        assert abs(ours.mean - printed.value[method]) < both


def test_curve_is_the_mean_of_the_runs() -> None:
    config = c.CurveConfig(runs=6, episodes=40, late=10, block=20)
    curve = c.curve(config, Context(seed=4))
    runs = c.online(c.OnlineConfig(runs=6, episodes=40, late=10), Context(seed=4))
    total = (curve.set_index("method")["mean"] * 20).groupby("method").sum()
    np.testing.assert_allclose(total, runs.groupby("method").total_reward.mean())
    assert curve.episode.unique().tolist() == [10.5, 30.5]


def soft_values(epsilon: float) -> np.ndarray:
    """Values of the best policy that explores with epsilon, by plain iteration."""
    mdp = c.task()
    q = np.zeros((16, 4))
    for _ in range(5000):
        v = (1 - epsilon) * q.max(axis=1) + epsilon * q.mean(axis=1)
        v[mdp.terminal] = 0
        q = mdp.reward + mdp.transition @ v
    return q


@pytest.fixture(scope="module")
def convergence() -> pd.DataFrame:
    config = c.ConvergenceConfig(
        runs=2, steps=400_000, checkpoints=4, epsilons_q_learning=(0.5,), epsilons_sarsa=(0.3,)
    )
    return c.convergence(config, Context())


def test_exact_values_of_the_convergence_table(convergence: pd.DataFrame) -> None:
    assert (convergence.start_optimal == -5).all()
    for epsilon, rows in convergence.groupby("epsilon"):
        soft = soft_values(epsilon)
        assert rows.start_soft.iloc[0] == pytest.approx(soft[0].max(), rel=1e-6)
        playable = np.delete(np.arange(16), [1, 2, 3])
        gap = np.sqrt(((soft - soft_values(0.0))[playable] ** 2).mean())
        assert rows.gap.iloc[0] == pytest.approx(gap, rel=1e-6)


def test_q_learning_gets_nearer_to_the_optimum_and_sarsa_does_not(
    convergence: pd.DataFrame,
) -> None:
    last = convergence[convergence.step == 400_000].set_index("method")
    q_learning = last.loc[["q_learning"]]
    assert (q_learning.error_optimal < 1).all()
    sarsa = last.loc[["sarsa"]]
    sarsa = sarsa[sarsa.exploration == "constant"]
    assert (sarsa.error_soft < sarsa.error_optimal).all()
    assert (sarsa.start_value < -20).all()


def test_sweeps_of_the_episodic_cliff_by_hand() -> None:
    table = SECTION_2_3_2.run("book").table
    episodic = table[(table.task == "episodic") & (table.discount == 1)]
    # The pair furthest from the goal is 7 steps away (one off the grid in the far corner, 6 back),
    # a synchronous sweep reaches one step further, and a fall is worth -1000 - 5.
    synchronous = episodic[episodic.method == "synchronous"]
    assert synchronous.error.tolist() == [1005, 6, 5, 4, 3, 2, 1, 0]
    assert (episodic.groupby("method").error.last() == 0).all()


def test_sweeps_of_the_discounted_cliff_stay_below_the_bound() -> None:
    table = SECTION_2_3_2.run("book").table
    bounded = table.dropna(subset="bound")
    assert set(bounded.task) == {"episodic", "continuing"}
    assert (bounded.error <= bounded.bound * (1 + 1e-9)).all()
    last = table.groupby(["task", "discount", "method"]).error.last()
    assert (last <= 1e-5).all()


def test_exploration_dilemma() -> None:
    config = c.ExplorationConfig(runs=60, epsilons=(0.0, 0.2))
    table = c.exploration(config, Context())
    table = table.set_index(["method", "initial", "epsilon"]).sort_index()
    pessimistic = table.loc["q_learning", "pessimistic"]
    assert pessimistic.online[0.0] > pessimistic.online[0.2]
    assert pessimistic.optimal[0.0] < pessimistic.optimal[0.2] == 1
    assert (table.loc["q_learning", "optimistic"].optimal == 1).all()


@pytest.mark.parametrize("experiment", EXPERIMENTS, ids=lambda e: e.id)
def test_smoke_budget(experiment) -> None:
    table = experiment.run("smoke", seed=5).table
    assert len(table) > 0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: c.OnlineConfig(episodes=10, late=20), "late is 20"),
        (lambda: c.CurveConfig(episodes=100, late=10, block=30), "block is 30"),
        (lambda: c.ConvergenceConfig(steps=100, checkpoints=7), "checkpoints is 7"),
        (lambda: c.ConvergenceConfig(power=0.4), "power is 0.4"),
    ],
)
def test_bad_settings(make, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()
