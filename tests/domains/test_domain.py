"""Domains on tiny hand-made tasks: the union of states, p(m|x), and one-sentence errors."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from thesis_lib.domains import Domain, stock, triangle
from thesis_lib.mdp.model import TabularMDP


def loop(labels, discount=0.9, actions=("go",), name="colour"):
    """A task that walks round its states, which show the given feature values."""
    n = len(labels)
    transition = np.zeros((n, len(actions), n))
    for s in range(n):
        transition[s, :, (s + 1) % n] = 1.0
    return TabularMDP(
        transition=transition,
        reward=np.zeros((n, len(actions))),
        start=np.full(n, 1 / n),
        discount=discount,
        features={name: np.array(labels)},
        actions=actions,
    )


def pair():
    # Task 0 shows colours 5 and 7, task 1 shows 7, 9 and 4; D = .25, .75.
    return Domain("pair", (loop([5, 7]), loop([7, 9, 4])), distribution=[0.25, 0.75])


def test_states_of_the_domain_are_the_union():
    domain = pair()
    assert domain.observations[:, 0].tolist() == [4, 5, 7, 9]
    assert [index.tolist() for index in domain.observation_index] == [[1, 2], [2, 3, 0]]
    assert domain.present.tolist() == [[False, True, True, False], [True, False, True, True]]
    assert domain.shape == (4, 1)


def test_uniform_weights_by_hand():
    weights = pair().uniform()[:, :, 0]
    np.testing.assert_allclose(weights, [[0, 1 / 2, 1 / 2, 0], [1 / 3, 0, 1 / 3, 1 / 3]])


def test_posterior_by_hand():
    # Colour 7: p(x|0) D(0) = 1/2 * 1/4 = 1/8 and p(x|1) D(1) = 1/3 * 3/4 = 1/4, so 1/3 and 2/3.
    posterior = pair().posterior()[:, :, 0]
    np.testing.assert_allclose(posterior, [[0, 1, 1 / 3, 0], [1, 0, 2 / 3, 1]])


def test_posterior_of_given_weights_by_hand():
    # p(x|0) = (.1, .9) on colours 5, 7 and p(x|1) = (.2, .3, .5) on 7, 9, 4.
    weights = np.array([[[0], [0.1], [0.9], [0]], [[0.5], [0], [0.2], [0.3]]])
    joint = [0.25 * 0.9, 0.75 * 0.2]
    got = pair().posterior(weights)[:, 2, 0]
    np.testing.assert_allclose(got, np.array(joint) / sum(joint))


def test_posterior_is_nan_where_no_task_goes():
    weights = np.array([[[0], [0.0], [1.0], [0]], [[0.5], [0], [0.2], [0.3]]])
    assert np.isnan(pair().posterior(weights)[:, 1, 0]).all()


def test_gather_and_scatter_undo_each_other():
    domain = pair()
    tables = [np.array([[1.0], [2.0]]), np.array([[3.0], [4.0], [5.0]])]
    gathered = domain.gather(tables)
    np.testing.assert_array_equal(gathered[0, :, 0], [np.nan, 1, 2, np.nan])
    np.testing.assert_array_equal(gathered[1, :, 0], [5, np.nan, 3, 4])
    function = np.array([[10.0], [20.0], [30.0], [40.0]])
    assert domain.scatter(function, 1)[:, 0].tolist() == [30, 40, 10]
    assert [table[:, 0].tolist() for table in domain.scatter_all(function)] == [
        [20, 30],
        [30, 40, 10],
    ]


def test_terminal_states_are_no_members_and_take_the_fill():
    domain = triangle()
    table = domain.scatter(np.ones(domain.shape), 0, fill=-7)
    assert (table[3] == -7).all()
    assert (table[:3] == 1).all()


def test_tasks_that_share_their_states_are_indexed_like_any_others():
    domain = stock(1, 2, 1)
    apart = Domain("apart", tuple(task.to_tabular() for task in domain.tasks))
    np.testing.assert_array_equal(domain.observations, apart.observations)
    for ours, theirs in zip(domain.observation_index, apart.observation_index, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_sampling_follows_the_distribution():
    drawn = pair().sample(4000, np.random.default_rng(0))
    # Binomial(4000, .25): five standard deviations are 137.
    assert abs((drawn == 0).sum() - 1000) < 137


@settings(max_examples=30, deadline=None)
@given(st.data())
def test_posterior_sums_to_one_wherever_a_pair_can_occur(data):
    n_tasks = data.draw(st.integers(1, 4))
    labels = [
        data.draw(st.lists(st.integers(0, 5), min_size=1, max_size=5, unique=True))
        for _ in range(n_tasks)
    ]
    weights = np.array(data.draw(st.lists(st.integers(1, 9), min_size=n_tasks, max_size=n_tasks)))
    domain = Domain("random", tuple(map(loop, labels)), distribution=weights / weights.sum())
    assert sorted(set().union(*labels)) == domain.observations[:, 0].tolist()
    np.testing.assert_allclose(domain.uniform().sum(axis=(1, 2)), 1)
    np.testing.assert_allclose(domain.posterior().sum(axis=0), 1)
    assert (domain.posterior()[~domain.present] == 0).all()


class TestErrors:
    def test_no_tasks(self):
        with pytest.raises(ValueError, match="domain 'empty' has no tasks"):
            Domain("empty", ())

    def test_weights_that_do_not_sum_to_one(self):
        with pytest.raises(ValueError, match=r"distribution sums to 0\.9 .* divide the weights"):
            Domain("bad", (loop([1]), loop([2])), distribution=[0.4, 0.5])
        with pytest.raises(ValueError, match="must be positive for every task"):
            Domain("bad", (loop([1]), loop([2])), distribution=[0.0, 1.0])
        with pytest.raises(ValueError, match=r"distribution has shape \(3,\)"):
            Domain("bad", (loop([1]), loop([2])), distribution=[0.2, 0.3, 0.5])

    def test_tasks_that_share_too_little(self):
        with pytest.raises(ValueError, match="task '1' has actions"):
            Domain("bad", (loop([1]), loop([2], actions=("stop",))))
        with pytest.raises(ValueError, match="task '1' has features"):
            Domain("bad", (loop([1]), loop([2], name="shape")))
        with pytest.raises(ValueError, match=r"task '1' has discount 0\.5"):
            Domain("bad", (loop([1]), loop([2], discount=0.5)))

    def test_states_that_look_the_same(self):
        with pytest.raises(ValueError, match="same feature values"):
            Domain("bad", (loop([1, 1]),)).shape  # noqa: B018

    def test_names_and_members(self):
        with pytest.raises(ValueError, match="1 task names were given for 2 tasks"):
            Domain("bad", (loop([1]), loop([2])), task_names=("only",))
        with pytest.raises(ValueError, match="members has 1 masks for 2 tasks"):
            Domain("bad", (loop([1]), loop([2])), members=(np.array([True]),))
        with pytest.raises(ValueError, match=r"members of task '0' has shape \(2,\)"):
            Domain("bad", (loop([1]),), members=(np.array([True, True]),)).shape  # noqa: B018

    def test_functions_with_missing_pairs(self):
        function = np.array([[1.0], [2.0], [np.nan], [4.0]])
        with pytest.raises(ValueError, match=r"no value at observation \(colour=7\) of task '0'"):
            pair().scatter(function, 0)
        with pytest.raises(ValueError, match=r"function has shape \(3, 1\)"):
            pair().scatter(np.ones((3, 1)), 0)
        with pytest.raises(ValueError, match="table of task '1' has shape"):
            pair().gather([np.ones((2, 1)), np.ones((2, 1))])
        for n in (1, 3):
            with pytest.raises(ValueError, match=f"{n} tables were given, but domain .* has 2 tas"):
                pair().gather(iter([np.ones((2, 1)), np.ones((3, 1)), np.ones((3, 1))][:n]))

    def test_weights_over_pairs(self):
        domain = pair()
        with pytest.raises(ValueError, match="weights p\\(x\\|m\\) have shape"):
            domain.posterior(np.ones((2, 4)))
        with pytest.raises(ValueError, match=r"task '0' sum to 0\.5"):
            domain.posterior(domain.uniform() * np.array([0.5, 1])[:, None, None])
        outside = np.array([[[1.0], [0], [0], [0]], [[0.5], [0], [0.2], [0.3]]])
        with pytest.raises(ValueError, match="positive outside its state-action space"):
            domain.posterior(outside)
