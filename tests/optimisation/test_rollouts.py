"""What belongs to a batch, and that short episodes have no advantage."""

from itertools import accumulate, repeat

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.optimisation.tasks import ScriptedTask
from thesis_lib.optimisation import LinearQuadraticTask, Rollouts, collect, run_episodes
from thesis_lib.policies import GaussianPolicy, make_policy


def policy_for(architecture: str = "dtrnn") -> GaussianPolicy:
    return make_policy(architecture, 2, 1, dt=0.1, seed=0, dtype=torch.float64)


def gather(lengths: list[int], num_envs: int, n_steps: int) -> tuple[Rollouts, ScriptedTask]:
    task = ScriptedTask(num_envs, iter(lengths))
    return collect(task, policy_for(), n_steps, np.random.default_rng(0)), task


def one_after_the_other(lengths: list[int], n_steps: int) -> list[int]:
    """The author's rule in a single world: whole episodes until there are enough steps."""
    totals = accumulate(lengths)
    n = next(i for i, total in enumerate(totals) if total >= n_steps) + 1
    return lengths[:n]


@given(
    st.lists(st.integers(1, 12), min_size=400, max_size=400),
    st.integers(1, 9),
    st.integers(1, 150),
)
@settings(max_examples=60, deadline=None)
def test_the_batch_is_that_of_a_single_world(
    lengths: list[int], num_envs: int, n_steps: int
) -> None:
    rollouts, task = gather(lengths, num_envs, n_steps)
    assert rollouts.lengths.tolist() == one_after_the_other(lengths, n_steps)
    assert rollouts.n_simulated == task.simulated


def test_short_episodes_have_no_advantage() -> None:
    # Half of the episodes last 1 step, half 40.  Those that finish first would be nearly all
    # short; the author's rule takes them as they come.
    rng = np.random.default_rng(1)
    ours, first_finished, shares = [], [], []
    for _ in range(150):
        lengths = rng.choice([1, 40], 600).tolist()
        rollouts, _ = gather(lengths, num_envs=10, n_steps=120)
        alone = one_after_the_other(lengths, 120)
        ours.append(np.mean(rollouts.lengths == 1))
        shares.append(np.mean(np.array(alone) == 1))
        ends = np.sort(lengths[:60])
        taken = ends[: np.searchsorted(np.cumsum(ends), 120) + 1]
        first_finished.append(np.mean(taken == 1))
    assert ours == shares
    error = np.std(ours) / np.sqrt(len(ours))
    # E[short episodes] / E[episodes] = 1/2 (Wald); the mean of ratios is a little off it
    assert np.mean(ours) == pytest.approx(0.5, abs=0.1 + 3 * error)
    assert np.mean(first_finished) > 0.85


def test_rows_hold_what_happened() -> None:
    lengths = [3, 1, 4, 2, 2, 5, 1, 1, 1, 9]
    rollouts, _ = gather(lengths, num_envs=3, n_steps=11)
    packing = rollouts.packing
    assert rollouts.lengths.tolist() == [3, 1, 4, 2, 2]
    expected = np.stack([packing.episode, packing.time], axis=1)
    np.testing.assert_array_equal(rollouts.observations, expected)
    np.testing.assert_array_equal(rollouts.rewards, 100 * packing.episode + packing.time)
    np.testing.assert_array_equal(rollouts.final_observations[:, 1], rollouts.lengths)
    assert rollouts.terminated.tolist() == [False, True, False, True, False]
    by_hand = [sum(100 * k + t for t in range(n)) for k, n in enumerate(lengths[:5])]
    assert rollouts.episode_returns.tolist() == by_hand
    assert rollouts.padded("rewards").shape == (4, 5)
    assert rollouts.mask.sum(axis=0).tolist() == [3, 1, 4, 2, 2]


@pytest.mark.parametrize("architecture", ["ffwd", "dtrnn", "lstm", "esn"])
def test_actions_come_from_the_policy(architecture: str) -> None:
    # greedily, the actions recorded are the means of the block, whatever world ran them
    policy = policy_for(architecture)
    task = ScriptedTask(3, iter([3, 1, 4, 2, 2, 5, 1, 1, 1, 9, 9, 9]))
    rollouts = collect(task, policy, 11, np.random.default_rng(0), greedy=True)
    sequences = policy.sequences(rollouts.observations, rollouts.actions, rollouts.packing)
    means = policy.means(sequences).detach().numpy()
    np.testing.assert_allclose(rollouts.actions, means, atol=1e-12)
    if architecture == "esn":
        torch.testing.assert_close(rollouts.hidden, sequences.hidden)
    else:
        assert rollouts.hidden is None


def test_noise_has_the_deviation_of_the_policy() -> None:
    policy = make_policy("ffwd", 1, 1, dt=0.1, initial_log_std=-1.0, dtype=torch.float64)
    task = LinearQuadraticTask(50)
    rollouts = collect(task, policy, 20_000, np.random.default_rng(3))
    sequences = policy.sequences(rollouts.observations, rollouts.actions, rollouts.packing)
    noise = rollouts.actions - policy.means(sequences).detach().numpy()
    # the deviation of 20,000 normal numbers has a standard error of sigma / sqrt(2 n)
    assert noise.std() == pytest.approx(np.exp(-1), rel=4 / np.sqrt(2 * 20_000))
    assert noise.mean() == pytest.approx(0, abs=4 * np.exp(-1) / np.sqrt(20_000))


def test_same_seed_same_batch() -> None:
    def run() -> Rollouts:
        task = LinearQuadraticTask(7, seed=4)
        policy = make_policy("gru", 1, 1, dt=0.1, seed=2)
        return collect(task, policy, 300, np.random.default_rng(5))

    one, two = run(), run()
    np.testing.assert_array_equal(one.observations, two.observations)
    np.testing.assert_array_equal(one.actions, two.actions)


def test_one_episode_in_every_world() -> None:
    policy = policy_for()
    rollouts = run_episodes(ScriptedTask(4, iter([5, 2, 7, 1])), policy)
    assert rollouts.lengths.tolist() == [5, 2, 7, 1]
    cut = run_episodes(ScriptedTask(3, iter([5, 2, 7])), policy, max_steps=3)
    assert cut.lengths.tolist() == [3, 2, 3]
    assert cut.terminated.tolist() == [False, True, False]


@pytest.mark.parametrize("name", ["reward", "observation"])
def test_numbers_that_are_not_finite_stop_the_sampling(name: str) -> None:
    task = ScriptedTask(2, repeat(50))
    task.poison = (name, 20)
    with pytest.raises(FloatingPointError, match=f"the {name} in world 0 at step 9 "):
        collect(task, policy_for(), 100, np.random.default_rng(0))


def test_a_bad_parameter_shows_in_the_action() -> None:
    policy = policy_for()
    with torch.no_grad():
        policy.head.bias[0] = float("inf")
    with pytest.raises(FloatingPointError, match="the action in world 0 at step 0"):
        collect(ScriptedTask(2, repeat(5)), policy, 10, np.random.default_rng(0))


def test_bad_arguments() -> None:
    with pytest.raises(ValueError, match="n_steps is 0"):
        collect(ScriptedTask(2, repeat(5)), policy_for(), 0, np.random.default_rng(0))
    other = make_policy("dtrnn", 3, 1, dt=0.1)
    with pytest.raises(ValueError, match="observation_size is 2, but the policy was made for 3"):
        collect(ScriptedTask(2, repeat(5)), other, 10, np.random.default_rng(0))
