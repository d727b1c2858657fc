"""The cross-task policy (section 3.3.5): exact objective, exact gradient, searches."""

import numpy as np
import pytest

from thesis_lib.domains import Domain, continuing_cliff, episodic_cliff
from thesis_lib.mdp.model import TabularMDP
from thesis_lib.mdp.occupancy import average_reward
from thesis_lib.potentials.cross_task_policy import GeneticAlgorithm, gradient_ascent
from thesis_lib.potentials.cross_task_problem import OBJECTIVES, CrossTaskProblem, softmax_policy

DOMAINS = {"episodic": episodic_cliff(), "continuing": continuing_cliff(discount=0.9)}


def bandits(discount=0.5):
    """Two one-state continuing tasks; action A earns 1 in one and B earns 3 in the other."""
    tasks = tuple(
        TabularMDP(np.ones((1, 2, 1)), [reward], [1.0], discount=discount)
        for reward in ([1.0, 0.0], [0.0, 3.0])
    )
    return Domain("bandits", tasks)


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_value_by_hand(objective):
    problem = CrossTaskProblem(bandits(), objective)
    policy = np.array([[0.25, 0.75]])
    # Mean reward per step .5 * .25 * 1 + .5 * .75 * 3, over 1 - gamma.
    assert problem.value(policy) == pytest.approx((0.125 + 1.125) / 0.5)


@pytest.mark.parametrize("domain", DOMAINS)
@pytest.mark.parametrize("objective", OBJECTIVES)
def test_gradient_against_finite_differences(domain, objective):
    problem = CrossTaskProblem(DOMAINS[domain], objective)
    rng = np.random.default_rng(0)
    theta = rng.normal(size=problem.domain.shape)
    value, gradient = problem.gradient(theta)
    assert value == pytest.approx(float(problem.value(softmax_policy(theta))), rel=1e-9)
    for _ in range(6):
        direction = rng.normal(size=theta.shape)
        h = 1e-5
        ends = [problem.value(softmax_policy(theta + s * h * direction)) for s in (1, -1)]
        slope = (ends[0] - ends[1]) / (2 * h)
        assert (gradient * direction).sum() == pytest.approx(slope, rel=1e-5)


def test_stationary_objective_is_the_average_reward():
    """Equation 3.11 equals the average payoff per step over 1 - gamma in a continuing task."""
    domain = DOMAINS["continuing"]
    problem = CrossTaskProblem(domain, "stationary")
    policy = softmax_policy(np.random.default_rng(1).normal(size=domain.shape))
    average = 0.0
    for m, task in enumerate(domain.tasks):
        index = domain.observation_index[m]
        inside = np.flatnonzero(index >= 0)
        mu = policy[index[inside]]
        chain = np.einsum("sa,sat->st", mu, task.transition[inside][:, :, inside])
        share = np.full(len(inside), 1 / len(inside))
        for _ in range(5000):  # power iteration, half a step at a time against periodicity
            share = 0.5 * share + 0.5 * share @ chain
        average += domain.distribution[m] * float((share[:, None] * mu * task.reward[inside]).sum())
    assert problem.value(policy) == pytest.approx(average / (1 - domain.discount), rel=1e-8)


def test_values_agree_with_exact_evaluation():
    from thesis_lib import potentials

    domain = DOMAINS["episodic"]
    problem = CrossTaskProblem(domain, "start")
    policy = softmax_policy(np.random.default_rng(2).normal(size=domain.shape))
    exact = 0.0
    for m, (task, q, mu) in enumerate(
        zip(
            domain.tasks,
            potentials.policy_values(domain, policy),
            potentials.task_policies(domain, policy),
            strict=True,
        )
    ):
        exact += domain.distribution[m] * float(task.start @ (mu * q).sum(axis=1))
    assert problem.value(policy) == pytest.approx(exact, rel=1e-7)


def test_gradient_ascent_solves_the_bandits():
    found = gradient_ascent(CrossTaskProblem(bandits()), np.random.default_rng(0), restarts=3)
    assert found.value == pytest.approx(3.0, rel=1e-4)  # always B: .5 * 3 / .5
    assert found.policy[0, 1] > 0.999


def test_gradient_ascent_beats_random_search():
    """3,000 random soft policies and 3,000 that are all but deterministic."""
    problem = CrossTaskProblem(DOMAINS["continuing"], "stationary")
    found = gradient_ascent(problem, np.random.default_rng(0), restarts=12)
    rng = np.random.default_rng(1)
    soft = softmax_policy(rng.normal(scale=3, size=(3000, *problem.domain.shape)))
    assert found.value > problem.value(soft).max()
    hard = np.eye(4)[rng.integers(4, size=(3000, problem.domain.shape[0]))]
    assert found.value > problem.value(0.999 * hard + 0.001 / 4).max()


@pytest.mark.parametrize("selection", ["truncation", "tournament", "roulette"])
def test_genetic_algorithm_improves_and_never_beats_the_optimum(selection):
    problem = CrossTaskProblem(bandits())
    ga = GeneticAlgorithm(generations=150, population=30, selection=selection)
    found = ga.search(problem, np.random.default_rng(0))
    assert (np.diff(found.history) >= 0).all()
    assert found.history[0] < found.value <= 3.0
    assert found.value == pytest.approx(float(problem.value(found.policy)))


def test_genetic_algorithm_is_deterministic_under_a_seed():
    problem = CrossTaskProblem(DOMAINS["episodic"])
    ga = GeneticAlgorithm(generations=5)
    a, b = (ga.search(problem, np.random.default_rng(7)) for _ in range(2))
    assert np.array_equal(a.policy, b.policy)


def test_bad_input():
    with pytest.raises(ValueError, match="choose one of start, stationary"):
        CrossTaskProblem(bandits(), "best")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="choose one of truncation, tournament, roulette"):
        GeneticAlgorithm(selection="luck")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="population 1"):
        GeneticAlgorithm(population=1)
    with pytest.raises(ValueError, match="restarts is 0"):
        gradient_ascent(CrossTaskProblem(bandits()), np.random.default_rng(0), restarts=0)


def approach(start):
    """0 leads to 1 and 1 to 2, worth 1; from 2 "back" to 1, worth 0, or "stay", worth 4."""
    transition = np.zeros((3, 2, 3))
    transition[0, :, 1] = transition[1, :, 2] = transition[2, 0, 1] = transition[2, 1, 2] = 1
    reward = [[9.0, 9.0], [1.0, 1.0], [0.0, 4.0]]
    return TabularMDP(transition, reward, np.eye(3)[start], discount=0.5, actions=("back", "stay"))


@pytest.mark.parametrize("start", [0, 1, 2])
def test_states_that_are_left_for_good_have_no_share(start):
    # By a fair coin a third of the time is spent in 1: (1/3 + 2/3 (0 + 4)/2) / (1 - gamma).
    problem = CrossTaskProblem(Domain("approach", (approach(start),)), "stationary")
    assert problem.value(np.full((3, 2), 0.5)) == pytest.approx(10 / 3)
    assert problem.gradient(np.zeros((3, 2)))[0] == pytest.approx(10 / 3)
    assert problem.state_distribution(np.full((3, 2), 0.5))[0] == pytest.approx([0, 1 / 3, 2 / 3])
    # Always back: 1 and 0 in turn.  Always stay, which is best: 4, and 1 is left for good too.
    both = problem.value(np.repeat(np.eye(2)[:, None], 3, axis=1))
    assert both == pytest.approx([0.5 / 0.5, 4 / 0.5])
    found = gradient_ascent(problem, np.random.default_rng(0), restarts=2)
    assert found.value == pytest.approx(8.0, rel=1e-5)


@pytest.mark.parametrize("seed", range(5))
def test_a_policy_that_picks_one_action_against_the_exact_distribution(seed):
    rng = np.random.default_rng(seed)
    tasks = []
    for _ in range(2):
        transition = rng.dirichlet(np.full(6, 0.1), size=(6, 2)).round(1)
        transition[..., 5] += 1 - transition.sum(axis=-1)
        transition = np.clip(transition, 0, None)
        transition /= transition.sum(axis=-1, keepdims=True)
        tasks.append(TabularMDP(transition, rng.normal(size=(6, 2)), np.eye(6)[0], discount=0.9))
    domain = Domain("random", tuple(tasks))
    problem = CrossTaskProblem(domain, "stationary")
    for policy in (np.eye(2)[rng.integers(2, size=6)] for _ in range(4)):
        expected = np.mean([average_reward(task, policy) for task in tasks]) / 0.1
        assert problem.value(policy) == pytest.approx(expected, rel=1e-8)


def test_several_sets_that_are_never_left_have_no_one_distribution():
    stay_or_go = np.stack([np.eye(2), np.eye(2)[::-1]], axis=1)
    task = TabularMDP(stay_or_go, np.zeros((2, 2)), [0.5, 0.5], discount=0.5)
    problem = CrossTaskProblem(Domain("two rooms", (task,)), "stationary")
    assert problem.value(np.full((2, 2), 0.5)) == 0
    with pytest.raises(ValueError, match="in task '0' a policy ends up in one of several sets"):
        problem.value(np.array([[1.0, 0.0], [1.0, 0.0]]))
    stuck = TabularMDP(stay_or_go[:, :1], [[1.0], [3.0]], [0.5, 0.5], discount=0.5)
    with pytest.raises(ValueError, match="choose the objective 'start'"):
        CrossTaskProblem(Domain("stuck", (stuck,)), "stationary")
    assert CrossTaskProblem(Domain("stuck", (stuck,))).value(np.ones((2, 1))) == pytest.approx(4)


def test_what_is_no_policy_has_no_value():
    problem = CrossTaskProblem(DOMAINS["continuing"])
    mu = softmax_policy(np.random.default_rng(4).normal(size=problem.domain.shape))
    with pytest.raises(ValueError, match=r"mu has shape .*, but domain 'continuing cliff' needs"):
        problem.value(mu.T)
    with pytest.raises(ValueError, match=r"mu of observation 0 is .*, but the probabilities"):
        problem.value(3 * mu)
    with pytest.raises(ValueError, match=r"mu of observation 0 is .*, but the probabilities"):
        problem.value(np.array([mu, mu - 0.5]))


@pytest.mark.parametrize("domain", DOMAINS)
def test_compiled_objective_agrees_with_linear_algebra(domain):
    """The compiled elimination against LAPACK's, value by value."""
    domain = DOMAINS[domain]
    batch = softmax_policy(np.random.default_rng(3).normal(size=(2, 3, *domain.shape)))
    for objective in OBJECTIVES:
        problem = CrossTaskProblem(domain, objective)
        chain, reward = problem._under(batch)
        values = np.linalg.solve(
            np.eye(chain.shape[-1]) - problem._discount * chain, reward[..., None]
        )
        values = values[..., 0]
        weights = (
            np.broadcast_to(problem._start, values.shape)
            if objective == "start"
            else problem.state_distribution(batch)
        )
        expected = (domain.distribution * (weights * values).sum(-1)).sum(-1)
        assert problem.value(batch) == pytest.approx(expected, rel=1e-7)
