"""Leave-one-task-out cross-validation and shrinkage, against slow definitions and closed forms."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.stats import t

from tests.relevance.worlds import kinds, seeds, world
from tests.selection.examples import planted
from thesis_lib.relevance import Solutions, estimate, ground, remove
from thesis_lib.selection import LeaveOneTaskOut, Shrinkage, left_out


def mean_by_cell(tasks: list[dict], keys: list[int]) -> dict:
    """Weighted mean of some tasks' values in each cell of the abstraction x -> x[keys]."""
    mass, total = {}, {}
    for task in tasks:
        for x, (p, q) in task.items():
            y = tuple(x[k] for k in keys)
            mass[y] = mass.get(y, 0.0) + p
            total[y] = total.get(y, 0.0) + p * q
    return {y: total[y] / mass[y] for y in mass}


def mean_of(tasks: list[dict]) -> float:
    """Weighted mean of some tasks' values over all pairs."""
    return mean_by_cell(tasks, [])[()]


def by_definition(
    solutions: Solutions, feature: int, unseen: float | str = "coarser"
) -> tuple[float, float, float]:
    """Mean squared error without and with the feature, and the spread of the two predictions."""
    tasks = [
        {
            tuple(x): (p, q)
            for x, p, q in zip(solutions.features.tolist(), ps, qs, strict=True)
            if p > 0
        }
        for ps, qs in zip(solutions.p.tolist(), solutions.q.tolist(), strict=True)
    ]
    every = list(range(solutions.n_features))
    fewer = [k for k in every if k != feature]
    without = with_it = spread = 0.0
    for i, task in enumerate(tasks):
        others = tasks[:i] + tasks[i + 1 :]
        fine, coarse = mean_by_cell(others, every), mean_by_cell(others, fewer)
        value = mean_of(others) if isinstance(unseen, str) else unseen
        for x, (p, q) in task.items():
            y = tuple(x[k] for k in fewer)
            c = coarse.get(y, value)
            # Of a cell that nobody else visits.
            f = fine.get(x, c if unseen == "coarser" else value)
            without += p * (q - c) ** 2 / len(tasks)
            with_it += p * (q - f) ** 2 / len(tasks)
            spread += p * (f - c) ** 2 / len(tasks)
    return without, with_it, spread


@settings(deadline=None, max_examples=80)
@given(
    seed=seeds,
    kind=kinds,
    n=st.integers(2, 6),
    feature=st.integers(0, 2),
    unseen=st.sampled_from(["coarser", "mean", 0.0, -3.0]),
)
def test_left_out_is_the_difference_of_squared_errors(
    seed: int, kind: str, n: int, feature: int, unseen: float | str
) -> None:
    solutions = world(seed, kind, n, sizes=(2, 2, 3))
    value = unseen if isinstance(unseen, str) else unseen - solutions.centre
    gained, spent = left_out(ground(solutions), feature, value)
    without, with_it, spread = by_definition(solutions, feature, unseen)
    assert 2 * gained - spent == pytest.approx(without - with_it, abs=1e-8)
    assert spent == pytest.approx(spread, abs=1e-8)


@settings(deadline=None, max_examples=300)
@given(seed=seeds, n=st.integers(2, 12), feature=st.integers(0, 2), common=st.floats(0, 3))
def test_with_shared_p_cross_validation_is_a_threshold_on_f(
    seed: int, n: int, feature: int, common: float
) -> None:
    """2N < D exactly where F < 1 + n/(n - 1), by the slow definition and the jackknife's F."""
    solutions = world(seed, "shared", n, sizes=(2, 2, 3))
    rng = np.random.default_rng([seed, 3])
    q = solutions.q + common * rng.normal(size=solutions.n_pairs)
    solutions = Solutions(q, solutions.p, solutions.features, solutions.feature_names)
    F = estimate(solutions, remove(solutions, [feature])).f_ratio
    threshold = 1 + n / (n - 1)
    assume(abs(F - threshold) > 1e-6)
    without, with_it, _ = by_definition(solutions, feature)
    assert (without <= with_it) == (threshold >= F)
    for unseen in ("coarser", "mean", 0.0):
        gained, spent = left_out(ground(solutions), feature, unseen)
        assert gained / spent == pytest.approx((F - 1) / (F - 1 + n / (n - 1)), abs=1e-6)
        check = LeaveOneTaskOut(unseen).fit(solutions).history_[0].checks[feature]
        assert (check.verdict == "remove") == (threshold >= F)


def test_by_hand() -> None:
    """Effects 1 and 3 of one feature: 1 is predicted by 3 and 3 by 1."""
    features = np.array([[0], [1]])
    p = np.full((2, 2), 0.5)
    solutions = Solutions(np.array([[-1.0, 1.0], [-3.0, 3.0]]), p, features, ("f",))
    # Without it errors 1 and 9, with it 4 and 4; N = (1 * 3 + 3 * 1)/2, D = (9 + 1)/2.
    assert left_out(ground(solutions), 0) == pytest.approx((3.0, 5.0))
    assert LeaveOneTaskOut().fit(solutions).support_.tolist() == [True]
    # F = n V / tr S = 2 * 4 / 2 = 4: above 3, as kept, and 1 - 1/4 of the effect 2 is left.
    shrunk = Shrinkage().fit(solutions)
    assert shrunk.weights_ == pytest.approx([0.75])
    assert shrunk.values(solutions) == pytest.approx([-1.5, 1.5])
    fitted = Shrinkage("cross-fitted").fit(solutions)
    assert fitted.weights_ == pytest.approx([0.6])


def test_a_cell_that_the_others_do_not_visit_by_hand() -> None:
    """One task visits (0, 0) and (0, 1), of values 2 and 10; one (0, 0) and (1, 0), of 4 and 6."""
    features = np.array([[0, 0], [0, 1], [1, 0]])
    q, p = np.array([[2.0, 10, np.nan], [4, np.nan, 6]]), np.array([[0.5, 0.5, 0], [0.5, 0, 0.5]])
    solutions = Solutions(q, p, features, ("f", "g"))
    # Task 1 left out: at (0, 0) f predicts 4 and c 5 of 2, so N = .5 * 3 * 1 and D = .5; at (0, 1)
    # both predict the value there.  Task 2: at (0, 0) both predict 2; at (1, 0) c predicts 2 of 6,
    # and f 2 ("coarser"), 6 (the mean of 2 and 10; N = .5 * 4 * 4) or 0 (N = -.5 * 4 * 2).
    cells = ground(solutions)
    assert left_out(cells, 0, "coarser") == pytest.approx((0.75, 0.25))
    assert left_out(cells, 0, "mean") == pytest.approx(((1.5 + 8) / 2, (0.5 + 8) / 2))
    assert left_out(cells, 0, -solutions.centre) == pytest.approx(((1.5 - 4) / 2, (0.5 + 2) / 2))
    kept = {u: LeaveOneTaskOut(u).fit(solutions) for u in ("coarser", "mean", 0.0, 6.0)}
    first = {u: s.history_[0].checks[0].verdict for u, s in kept.items()}
    assert first == {"coarser": "keep", "mean": "keep", 0.0: "remove", 6.0: "keep"}
    assert LeaveOneTaskOut().unseen == 0.0


@pytest.mark.parametrize("n", [3, 6, 15])
def test_how_often_an_irrelevant_feature_stays(n: int) -> None:
    """For one Gaussian direction: the chance of a squared Student t above 1 + n/(n - 1)."""
    rng = np.random.default_rng(7)
    runs = 400
    kept = sum(LeaveOneTaskOut().fit(planted(rng, n)).support_[1] for _ in range(runs)) / runs
    chance = 2 * t.sf(np.sqrt(1 + n / (n - 1)), n - 1)
    assert abs(kept - chance) < 4 * np.sqrt(chance * (1 - chance) / runs)


@pytest.mark.parametrize("kind", ["shared", "weights", "subsets"])
@pytest.mark.parametrize("unseen", ["coarser", "mean", 0.0])
def test_the_gain_is_unbiased_for_the_next_task(kind: str, unseen: float | str) -> None:
    """Its mean over all sequences of n tasks is the gain of n - 1 tasks on a further one."""
    domain = world(11, kind, 3, sizes=(2, 2))
    sequences = [[i, j, k] for i in range(3) for j in range(3) for k in range(3)]
    gains = []
    for c in sequences:
        own = domain.take(c)
        value = unseen if isinstance(unseen, str) else unseen - own.centre
        gained, spent = left_out(ground(own), 0, value)
        gains.append(2 * gained - spent)
    estimated = np.mean(gains)
    true = 0.0
    rows = domain.features.tolist()
    for i, j, k in sequences:
        tables = [
            {
                tuple(x): (p, q)
                for x, p, q in zip(rows, domain.p[m], domain.q[m], strict=True)
                if p > 0
            }
            for m in (i, j)
        ]
        fine, coarse = mean_by_cell(tables, [0, 1]), mean_by_cell(tables, [1])
        value = mean_of(tables) if isinstance(unseen, str) else unseen
        for x, p, q in zip(rows, domain.p[k], domain.q[k], strict=True):
            if p > 0:
                c = coarse.get((x[1],), value)
                f = fine.get(tuple(x), c if unseen == "coarser" else value)
                true += p * ((q - c) ** 2 - (q - f) ** 2) / 27
    assert estimated == pytest.approx(true, abs=1e-9)


def test_shrinkage_without_scatter_changes_nothing() -> None:
    rng = np.random.default_rng(3)
    features = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    q = np.tile(rng.normal(size=4), (5, 1))
    solutions = Solutions(q, np.full((5, 4), 0.25), features, ("f", "g"))
    for weight in ("plug-in", "cross-fitted"):
        shrunk = Shrinkage(weight).fit(solutions)
        assert shrunk.weights_ == pytest.approx([1, 1])
        assert shrunk.values(solutions) == pytest.approx(q[0])


def test_shrinkage_of_pure_noise_leaves_the_mean() -> None:
    """Effects that cancel exactly have F = 0 and weight 0."""
    features = np.array([[0], [1]])
    q = np.array([[-2.0, 2.0], [2.0, -2.0]]) + 7
    solutions = Solutions(q, np.full((2, 2), 0.5), features, ("f",))
    shrunk = Shrinkage().fit(solutions)
    assert shrunk.support_.tolist() == [False]
    assert shrunk.removed_ == ("f",)
    assert shrunk.values(solutions) == pytest.approx([7, 7])


def test_shrinkage_predicts_better_than_keeping_and_than_removing() -> None:
    """Where one feature matters and one is noise; errors of the mean function, many domains."""
    rng = np.random.default_rng(5)
    kept, shrunk, dropped = [], [], []
    for _ in range(400):
        solutions = planted(rng, 5, effect=1.0)
        truth = 2 * solutions.features[:, 0] - 1.0
        kept.append(np.mean((solutions.q.mean(axis=0) - truth) ** 2))
        values = Shrinkage().fit(solutions).values(solutions)
        shrunk.append(np.mean((values - truth) ** 2))
        dropped.append(np.mean((solutions.q.mean() - truth) ** 2))
    assert np.mean(shrunk) < np.mean(kept)
    assert np.mean(shrunk) < np.mean(dropped)


def test_a_cell_nobody_visits_takes_the_coarser_value() -> None:
    """Only the pair (1, 1) is never visited; f matters less than g, so f leaves first."""
    features = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    q = np.array([[1.0, 9.0, 3.0, np.nan], [1.0, 9.0, 0.0, np.nan]])
    p = np.array([[0.25, 0.25, 0.5, 0.0]] * 2)
    shrunk = Shrinkage().fit(Solutions(q, p, features, ("f", "g")))
    assert shrunk.order_.tolist() == [0, 1]
    # With g = 1 only (0, 1) was seen; g's own effect has no reason to be shrunk to less.
    values = shrunk.values(Solutions(q, p, features, ("f", "g")))
    assert values[3] == pytest.approx(values[1])


def test_bad_input() -> None:
    solutions = planted(np.random.default_rng(0), 3)
    with pytest.raises(ValueError, match="weight 'none' does not exist"):
        Shrinkage("none").fit(solutions)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="unseen 'zero' does not exist"):
        LeaveOneTaskOut("zero").fit(solutions)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="unseen is nan, but a finite number"):
        LeaveOneTaskOut(float("nan")).fit(solutions)
    for selector in (LeaveOneTaskOut(), Shrinkage()):
        with pytest.raises(ValueError, match="at least 2"):
            selector.fit(solutions.take([0]))
    flat = Solutions(np.ones((2, 4)), solutions.p[:2], solutions.features, ("f", "g"))
    with pytest.raises(ValueError, match="same constant"):
        Shrinkage().fit(flat)
    turned = Solutions(solutions.q, solutions.p, solutions.features[:, ::-1], ("g", "f"))
    with pytest.raises(ValueError, match="the columns are g, f, but the selector was fitted to f"):
        Shrinkage().fit(solutions).values(turned)
