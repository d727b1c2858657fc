"""Task solutions: construction, sequences of tasks, and one sentence for each bad input."""

import numpy as np
import pytest

from tests.relevance.worlds import KINDS, world
from thesis_lib.domains import Domain, episodic_cliff
from thesis_lib.mdp.model import TabularMDP
from thesis_lib.relevance import Solutions, TaskTable, ground, keep, partition, remove
from thesis_lib.relevance.solutions import encode

FEATURES = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
NAMES = ("f", "g")
Q = np.arange(8.0).reshape(2, 4)
P = np.full((2, 4), 0.25)


def test_tables_are_merged_on_the_union_of_pairs() -> None:
    merged = Solutions.from_tables(
        [
            TaskTable(NAMES, [[1, 0], [0, 0]], [5.0, 3.0]),
            TaskTable(NAMES, [[0, 1], [1, 0]], [7.0, 9.0], [0.25, 0.75]),
        ]
    )
    assert merged.features.tolist() == [[0, 0], [0, 1], [1, 0]]
    np.testing.assert_array_equal(merged.q, [[3, np.nan, 5], [np.nan, 7, 9]])
    np.testing.assert_array_equal(merged.p, [[0.5, 0, 0.5], [0, 0.25, 0.75]])
    assert not merged.shared


def test_a_domain_gives_its_pairs_with_the_action_last() -> None:
    domain = episodic_cliff(sensor=True)
    tables = [np.arange(t.n_states * 4.0).reshape(-1, 4) for t in domain.tasks]
    solutions = Solutions.from_domain(domain, tables)
    assert solutions.feature_names == (*domain.feature_names, "a")
    assert solutions.n_pairs == 4 * domain.n_observations
    np.testing.assert_allclose(solutions.p.sum(axis=1), 1)
    pair = int(np.flatnonzero(np.isfinite(solutions.q[3]))[7])
    observation, action = divmod(pair, 4)
    state = int(np.flatnonzero(domain.observation_index[3] == observation)[0])
    assert solutions.q[3, pair] == tables[3][state, action]
    assert solutions.features[pair].tolist() == [*domain.observations[observation], action]


def test_an_action_feature_of_the_domain_must_not_be_called_a() -> None:
    task = TabularMDP(
        transition=np.ones((1, 1, 1)),
        reward=np.zeros((1, 1)),
        start=np.ones(1),
        terminal=np.zeros(1, dtype=bool),
        discount=0.5,
        actions=("go",),
        features={"a": np.zeros(1, dtype=int)},
    )
    with pytest.raises(ValueError, match="called 'a'"):
        Solutions.from_domain(Domain("one", [task]), [np.zeros((1, 1))])


@pytest.mark.parametrize("kind", KINDS)
def test_a_sequence_of_tasks_is_the_solutions_of_those_tasks(kind: str) -> None:
    solutions = world(0, kind)
    taken = solutions.take([2, 0, 2])
    fresh = Solutions(
        solutions.q[[2, 0, 2]], solutions.p[[2, 0, 2]], solutions.features, ("f0", "f1")
    )
    assert taken.shared == fresh.shared
    for got, expected in zip(taken.moments, fresh.moments, strict=True):
        np.testing.assert_array_equal(got, expected)


def test_one_weighting_for_all_tasks_is_recognised() -> None:
    assert Solutions(Q, P, FEATURES, NAMES).shared
    assert Solutions(Q, np.broadcast_to(P[0], P.shape), FEATURES, NAMES).shared
    other = np.array([[0.25] * 4, [0.1, 0.2, 0.3, 0.4]])
    assert not Solutions(Q, other, FEATURES, NAMES).shared


@pytest.mark.parametrize(
    ("features", "expected"),
    [((), [0, 0, 0, 0]), (("f",), [0, 0, 1, 1]), (("g",), [0, 1, 0, 1]), (NAMES, [0, 1, 2, 3])],
)
def test_labels_of_feature_subsets(features: tuple[str, ...], expected: list[int]) -> None:
    solutions = Solutions(Q, P, FEATURES, NAMES)
    assert keep(solutions, features).tolist() == expected
    others = [name for name in NAMES if name not in features]
    assert remove(solutions, others).tolist() == expected


@pytest.mark.parametrize(("kind", "end"), [(np.int8, 100), (np.int16, 30_000)])
def test_narrow_integers_are_told_apart_however_far_apart(kind: type, end: int) -> None:
    # Differences of up to 2 end are no numbers of this kind.
    column = np.arange(-end, end + 1, end // 100, dtype=kind)
    code, sizes = encode(np.tile(column, 80)[:, None])
    assert sizes == (201,)
    assert code.tolist() == list(range(201)) * 80


def test_labels_follow_large_and_negative_feature_values() -> None:
    features = np.array([[-5, 10**12], [10**9, 0], [-5, 0], [10**9, 10**12]])
    solutions = Solutions(Q, P, features, NAMES)
    assert keep(solutions, ["f"]).tolist() == [0, 1, 0, 1]
    assert keep(solutions, [1]).tolist() == [1, 0, 0, 1]


def test_cells_of_features_dropped_one_by_one_are_those_of_the_subset() -> None:
    for seed, sizes in enumerate([(2, 3, 2), (2, 2, 4)]):
        solutions = world(seed, "weights", sizes=sizes)
        # The pairs in another order, and half of them, so that not all combinations occur.
        order = np.random.default_rng(seed).permutation(solutions.n_pairs)
        mixed = Solutions(
            solutions.q[:, order],
            solutions.p[:, order],
            solutions.features[order],
            solutions.feature_names,
        )
        half = Solutions(
            solutions.q[:, ::2],
            solutions.p[:, ::2] / solutions.p[:, ::2].sum(axis=1, keepdims=True),
            solutions.features[::2],
            solutions.feature_names,
        )
        for given in (solutions, mixed, half):
            dropped = ground(given).drop(1).drop(0)
            direct = partition(given, keep(given, [2]))
            np.testing.assert_allclose(dropped.a, direct.a, atol=1e-12)
            np.testing.assert_allclose(dropped.b, direct.b, atol=1e-12)
            kept = ground(given).keep([2])
            np.testing.assert_allclose(kept.a, direct.a, atol=1e-12)
            assert kept.features == dropped.features == (2,)
            assert kept.code.tolist() == dropped.code.tolist()


def test_arrays_larger_than_one_pass_are_summed_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    solutions = world(3, "weights")
    once = partition(solutions, [0, 1, 0, 2, 2, 1])
    monkeypatch.setattr("thesis_lib.relevance.cells.SMALL", 0)
    by_task = partition(solutions, [0, 1, 0, 2, 2, 1])
    np.testing.assert_array_equal(once.a, by_task.a)


BAD = {
    "no pairs": (np.zeros((1, 0)), np.zeros((1, 0)), np.zeros((0, 2), int), NAMES, "at least one"),
    "p shape": (Q, P[:1], FEATURES, NAMES, r"p has shape \(1, 4\)"),
    "p sums to 2": (Q, 2 * P, FEATURES, NAMES, "task 0 sums to 2 .* divide them"),
    "p negative": (Q, [[0.5, 0.5, 0.5, -0.5]] * 2, FEATURES, NAMES, "smallest entry -0.5"),
    "NaN where p > 0": (
        np.where(Q == 6, np.nan, Q),
        P,
        FEATURES,
        NAMES,
        "task 1 at pair 2 is nan, but p",
    ),
    "infinite q": (np.where(Q == 6, np.inf, Q), P, FEATURES, NAMES, "pair 2 is inf"),
    "duplicate names": (Q, P, FEATURES, ("f", "f"), "'f' occurs 2 times"),
    "features shape": (Q, P, FEATURES[:, :1], NAMES, r"\(4, 2\) is needed"),
    "real features": (Q, P, FEATURES * 1.0, NAMES, "integer codes are needed"),
    "equal pairs": (Q, P, FEATURES[[0, 1, 0, 3]], NAMES, r"pairs 0 and 2 .* \[0, 0\]"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_solutions_are_refused_in_one_sentence(case: str) -> None:
    q, p, features, names, message = BAD[case]
    with pytest.raises(ValueError, match=message) as error:
        Solutions(np.asarray(q), np.asarray(p), features, names)
    assert str(error.value).count(". ") == 0


def test_too_many_combinations_of_values_are_refused() -> None:
    features = np.tile(np.arange(4)[:, None], (1, 32))
    with pytest.raises(ValueError, match=r"2\^63"):
        Solutions(Q, P, features, tuple(f"f{i}" for i in range(32)))


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ([], "no task was given"),
        (
            [TaskTable(("f",), [[0]], [1.0]), TaskTable(("g",), [[0]], [1.0])],
            r"task 1 has features \['g'\], but task 0 has \['f'\]",
        ),
        ([TaskTable(("f",), [[0], [0]], [1.0, 2.0])], "task 0 lists a state-action pair twice"),
        ([TaskTable(("f",), [[0], [1]], [1.0])], r"q of shape \(1,\)"),
        ([TaskTable(("f",), [[0], [1]], [1.0, np.nan], [1.0, 0.0])], "NaN at pair 1"),
    ],
)
def test_bad_tables_are_refused(tables: list[TaskTable], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Solutions.from_tables(tables)


@pytest.mark.parametrize("tasks", [[], [2], [-1], [0.5], [[0]]])
def test_bad_sequences_are_refused(tasks: list) -> None:
    with pytest.raises(ValueError, match="task"):
        Solutions(Q, P, FEATURES, NAMES).take(tasks)


def test_unknown_features_are_refused() -> None:
    with pytest.raises(ValueError, match=r"no feature 'h'; the features are f, g"):
        keep(Solutions(Q, P, FEATURES, NAMES), ["h"])
