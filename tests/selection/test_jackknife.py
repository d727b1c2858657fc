"""The jackknife F-test: its statistic, its calibration under the null, and its power."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import binomtest, f, ncf, t

from tests.relevance.worlds import kinds, seeds, world
from tests.selection.examples import planted, solved
from thesis_lib.domains import stock, triangle
from thesis_lib.relevance import Solutions, estimate, ground, keep, remove
from thesis_lib.selection import FSTEK, IBKR, JackknifeF, f_threshold, rates
from thesis_lib.selection.jackknife import effective_rank

CONFIDENCE = 0.9999
"""Of the exact binomial intervals below; about 20 of them are computed."""


def interval(hits: int, runs: int) -> tuple[float, float]:
    bounds = binomtest(hits, runs).proportion_ci(CONFIDENCE, method="exact")
    return float(bounds.low), float(bounds.high)


def kept(runs: int, n_tasks: int, selector: JackknifeF, **options: object) -> np.ndarray:
    """How often f and g were kept."""
    rng = np.random.default_rng(20261122)
    return sum(
        selector.fit(planted(rng, n_tasks, **options)).support_.astype(int) for _ in range(runs)
    )


# The statistic.


@settings(deadline=None, max_examples=60)
@given(seed=seeds, kind=kinds, n=st.integers(3, 6))
def test_statistics_of_the_first_round(seed: int, kind: str, n: int) -> None:
    solutions = world(seed, kind, n, sizes=(2, 2, 3))
    selector = JackknifeF().fit(solutions)
    for check in selector.history_[0].checks:
        found = estimate(solutions, remove(solutions, [check.feature]))
        assert check.relevance == pytest.approx(found.domain, abs=1e-10)
        if np.isfinite(check.statistic) and check.statistic > 0:
            assert check.statistic == pytest.approx(found.f_ratio, rel=1e-6)


@settings(deadline=None, max_examples=60)
@given(seed=seeds, kind=kinds, n=st.integers(3, 6))
def test_later_rounds_test_the_increment_or_the_total(seed: int, kind: str, n: int) -> None:
    solutions = world(seed, kind, n, sizes=(2, 2, 3))
    for target in ("increment", "total"):
        for found in JackknifeF(alpha=0.01, target=target).fit(solutions).history_:
            for check in found.checks:
                labels = remove(solutions, [*found.removed, check.feature])
                before = remove(solutions, found.removed) if target == "increment" else None
                expected = estimate(solutions, labels, before)
                assert check.relevance == pytest.approx(expected.domain, abs=1e-9)


@pytest.mark.parametrize("levels", [2, 5])
def test_in_one_direction_f_is_the_square_of_students_t(levels: int) -> None:
    # f has two values, so its effect in a task is one number: half the difference of means.
    solutions = planted(np.random.default_rng(1), 7, levels=levels)
    f_values = solutions.features[:, 0]
    effects = (
        solutions.q[:, f_values == 1].mean(axis=1) - solutions.q[:, f_values == 0].mean(axis=1)
    ) / 2
    statistic = effects.mean() / (effects.std(ddof=1) / np.sqrt(7))
    check = JackknifeF().fit(solutions).history_[0].checks[0]
    assert check.statistic == pytest.approx(statistic**2, rel=1e-9)
    assert check.threshold == pytest.approx(t.ppf(0.975, 6) ** 2)


def test_thresholds() -> None:
    assert f_threshold(7, 0.05) == pytest.approx(t.ppf(0.975, 6) ** 2)
    assert f_threshold(7, 0.05) == pytest.approx(f.ppf(0.95, 1, 6))
    assert f_threshold(7, 0.05, 3.5) == pytest.approx(f.ppf(0.95, 3.5, 21))


def test_effective_number_of_directions() -> None:
    rng = np.random.default_rng(0)
    many = planted(rng, 4000, levels=5)
    cells = ground(many)
    # f: one direction.  g: five independent effects less their mean, four equal directions.
    assert effective_rank(cells, cells.drop(0)) == pytest.approx(1)
    assert effective_rank(cells, cells.drop(1)) == pytest.approx(4, rel=0.05)
    few = [
        effective_rank(ground(s), ground(s).drop(1))
        for s in (planted(rng, 8, levels=5) for _ in range(300))
    ]
    assert min(few) >= 1
    # Never more than the five cells a value of f loses.
    assert max(few) <= 8
    assert np.median(few) == pytest.approx(4, rel=0.25)


# Calibration under the null.


@pytest.mark.parametrize("n_tasks", [3, 5, 12])
@pytest.mark.parametrize("alpha", [0.05, 0.2])
def test_one_gaussian_direction_is_calibrated_exactly(n_tasks: int, alpha: float) -> None:
    runs = 800
    low, high = interval(int(kept(runs, n_tasks, JackknifeF(alpha=alpha))[1]), runs)
    assert low <= alpha <= high


@pytest.mark.parametrize("options", [{"levels": 5}, {"levels": 8, "interaction": True}])
def test_more_directions_are_conservative_with_t2(options: dict) -> None:
    runs = 500
    assert interval(int(kept(runs, 6, JackknifeF(), **options)[1]), runs)[1] < 0.05


@pytest.mark.parametrize("n_tasks", [4, 12])
@pytest.mark.parametrize("options", [{}, {"levels": 5}, {"levels": 8, "interaction": True}])
def test_box_is_close_to_its_level_in_any_number_of_directions(n_tasks: int, options: dict) -> None:
    runs = 500
    low, high = interval(int(kept(runs, n_tasks, JackknifeF(null="box"), **options)[1]), runs)
    assert low <= 0.065
    assert high >= 0.03


def test_different_weights_are_close_to_the_level() -> None:
    runs = 800
    low, high = interval(int(kept(runs, 10, JackknifeF(), shared=False)[1]), runs)
    assert low <= 0.07
    assert high >= 0.05


@pytest.mark.parametrize("n_tasks", [3, 4, 5])
def test_two_opposite_effects_cannot_be_told_from_a_relevant_one(n_tasks: int) -> None:
    # g's effect is +1 or -1.  All tasks agree with probability 2^(1-n); then F is infinite.
    # Otherwise, for n below 6, F stays below the threshold.
    runs = 800
    low, high = interval(int(kept(runs, n_tasks, JackknifeF(), noise="sign")[1]), runs)
    assert low <= 2.0 ** (1 - n_tasks) <= high


def tail(weights: list[float], n: int, threshold: float) -> float:
    """P(F > threshold) for Gaussian scatter with these eigenvalues, by Imhof's inversion."""
    w = np.array(weights)
    c = threshold / (n - 1)

    def integrand(u: float) -> float:
        angle = (np.arctan(w * u).sum() - (n - 1) * np.arctan(c * w * u).sum()) / 2
        size = np.log1p((w * u) ** 2).sum() / 4
        size += (n - 1) / 4 * np.log1p((c * w * u) ** 2).sum()
        return float(np.sin(angle) / u * np.exp(-size))

    value = quad(integrand, 0, np.inf, limit=2000, epsabs=1e-7)[0]
    return 0.5 + value / np.pi


def test_tail_by_inversion_is_that_of_f() -> None:
    assert tail([1.0], 7, 5.0) == pytest.approx(f.sf(5, 1, 6), abs=1e-5)
    assert tail([1.0] * 4, 7, 2.0) == pytest.approx(f.sf(2, 4, 24), abs=1e-5)


@pytest.mark.parametrize("n_tasks", [3, 5, 10, 30])
@pytest.mark.parametrize("alpha", [0.01, 0.05, 0.1])
def test_no_spectrum_exceeds_the_level_of_one_direction(n_tasks: int, alpha: float) -> None:
    threshold = f_threshold(n_tasks, alpha)
    spectra = [[1, w] for w in (0.01, 0.05, 0.2, 0.5, 1)] + [
        *([1, 0.3, 0.1], [1, 1, 1], [1, 0.5, 0.25, 0.125], [1] + [0.02] * 20, [1] * 10)
    ]
    for weights in spectra:
        assert tail(weights, n_tasks, threshold) <= alpha + 1e-5


@pytest.mark.parametrize("n_tasks", [3, 6, 12])
def test_beyond_n_less_one_no_spectrum_has_a_heavier_tail_than_one_direction(n_tasks: int) -> None:
    rng = np.random.default_rng(4)
    for threshold in (n_tasks - 1.0, n_tasks + 1.0):
        one = f.sf(threshold, 1, n_tasks - 1)
        for size in (2, 3, 5):
            assert tail(rng.random(size).tolist(), n_tasks, threshold) <= one + 1e-5


def test_at_a_high_level_t2_is_not_conservative() -> None:
    assert f.sf(f_threshold(5, 0.3), 2, 8) < 0.3 < f.sf(f_threshold(6, 0.3), 2, 10)


def test_t2_reaches_n_less_one_up_to_six_tasks() -> None:
    assert [f_threshold(n, 0.05) >= n - 1 for n in (3, 4, 5, 6, 7, 8)] == [True] * 4 + [False] * 2


# Power.


@pytest.mark.parametrize(("n_tasks", "effect"), [(5, 1.0), (5, 2.0), (12, 0.7)])
def test_power_is_that_of_the_t_test(n_tasks: int, effect: float) -> None:
    runs = 600
    low, high = interval(int(kept(runs, n_tasks, JackknifeF(), effect=effect)[0]), runs)
    power = float(ncf.sf(f_threshold(n_tasks, 0.05), 1, n_tasks - 1, n_tasks * effect**2))
    assert low <= power <= high


def test_everything_is_found_with_enough_tasks() -> None:
    for make, arguments, irrelevant in (
        (triangle, (), {"x1"}),
        (stock, (1, 2, 2), {"s1", "g1", "g2"}),
    ):
        domain = solved(make, *arguments)
        truth = np.array([name not in irrelevant for name in domain.feature_names])
        tasks = np.random.default_rng(1).integers(0, domain.n_tasks, (100, 20))
        false, true = rates([JackknifeF().fit(domain.take(c)).support_ for c in tasks], truth)
        assert false < 0.08
        assert true > 0.99


def test_false_positives_stay_level_where_those_of_fstek_grow() -> None:
    domain = solved(triangle)
    truth = np.array([name != "x1" for name in domain.feature_names])
    tasks = np.random.default_rng(2).integers(0, 12, (150, 20))

    def false(selector: FSTEK | JackknifeF | IBKR, n: int) -> float:
        return rates([selector.fit(domain.take(c[:n])).support_ for c in tasks], truth)[0]

    assert false(FSTEK(alpha=1e-4), 20) > false(FSTEK(alpha=1e-4), 6) + 0.2
    assert false(JackknifeF(), 20) < false(JackknifeF(), 6) + 0.02


def test_testing_the_increment_finds_weak_features_under_strong_noise() -> None:
    # On stock the globals swamp the action; their removal averages the noise out.
    domain = solved(stock, 1, 2, 2)
    truth = np.array([name not in {"s1", "g1", "g2"} for name in domain.feature_names])
    tasks = np.random.default_rng(3).integers(0, domain.n_tasks, (60, 12))
    true = {
        target: rates(
            [JackknifeF(target=target).fit(domain.take(c)).support_ for c in tasks], truth
        )[1]
        for target in ("increment", "total")
    }
    assert true["increment"] > true["total"] + 0.3


# Behaviour.


def test_growing_relevance_is_kept() -> None:
    apart = Solutions(np.diag([1.0, 2.0]), np.eye(2), np.array([[0], [1]]), ("x",))
    selector = JackknifeF().fit(apart.take([0, 1, 0]))
    (check,) = selector.history_[0].checks
    assert check.statistic == np.inf
    assert check.reason == "relevance does not fall with the number of tasks"


def test_choice_between_marked_features() -> None:
    rng = np.random.default_rng(0)
    for _ in range(10):
        solutions = planted(rng, 6, effect=0.0, levels=3)
        by_statistic = JackknifeF(alpha=1e-6).fit(solutions)
        first = by_statistic.history_[0]
        assert [c.verdict for c in first.checks] == ["remove", "remove"]
        assert first.choice == min(first.checks, key=lambda c: c.statistic).feature
        by_forward = JackknifeF(alpha=1e-6, choose="forward").fit(solutions)
        assert by_forward.removed_[0] == FSTEK(alpha=1e-9).fit(solutions).removed_[0]


@settings(deadline=None, max_examples=40)
@given(seed=seeds, kind=kinds, n=st.integers(3, 7))
def test_invariances(seed: int, kind: str, n: int) -> None:
    solutions = world(seed, kind, n, sizes=(2, 2, 3))
    base = {c.feature: c.statistic for c in JackknifeF().fit(solutions).history_[0].checks}
    rng = np.random.default_rng(seed)
    other = Solutions(
        solutions.q * 10 + 3, solutions.p, 5 - 2 * solutions.features, solutions.feature_names
    ).take(rng.permutation(n))
    moved = {c.feature: c.statistic for c in JackknifeF().fit(other).history_[0].checks}
    for feature, statistic in base.items():
        assert moved[feature] == pytest.approx(statistic, rel=1e-6)


@settings(deadline=None, max_examples=40)
@example(seed=4635, kind="binary", n=4)
@given(seed=seeds, kind=kinds, n=st.integers(4, 7))
@pytest.mark.parametrize("selector", [JackknifeF(), FSTEK(alpha=1e-3), IBKR()])
def test_constant_and_duplicate_features_are_removed(
    selector: JackknifeF | FSTEK | IBKR, seed: int, kind: str, n: int
) -> None:
    solutions = world(seed, kind, n)
    f0 = solutions.features[:, 0]
    wide = Solutions(
        solutions.q,
        solutions.p,
        np.column_stack([np.full_like(f0, 4), solutions.features, 1 - f0]),
        ("constant", "f0", "f1", "duplicate"),
    )
    narrow = selector.fit(solutions).support_.copy()
    selected = selector.fit(wide).support_
    assert not selected[0]
    # One of the two copies at most, and the rest as without them.  FS-TEK may differ there,
    # as what it keeps for good depends on the order of removals.
    assert not (selected[1] and selected[3])
    if not isinstance(selector, FSTEK):
        kept = np.array([selected[1] or selected[3], selected[2]])
        # Features that say the same of the tasks seen are ties, which go by their order.
        lost = [
            estimate(solutions, keep(solutions, np.flatnonzero(k).tolist())).observed
            for k in (kept, narrow)
        ]
        assert (kept == narrow).all() or lost[0] == pytest.approx(lost[1], rel=1e-9, abs=1e-12)


def test_labels_are_those_of_the_features_kept() -> None:
    solutions = planted(np.random.default_rng(0), 8, effect=20.0)
    selector = JackknifeF().fit(solutions)
    np.testing.assert_array_equal(
        selector.labels(solutions),
        keep(solutions, selector.get_feature_names_out()),
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"alpha": 1.5}, r"alpha is 1.5.*\(0, 1\)"),
        ({"null": "normal"}, "t2, box"),
        ({"target": "all"}, "increment, total"),
        ({"choose": "first"}, "statistic, forward"),
    ],
)
def test_bad_parameters_are_refused(options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        JackknifeF(**options).fit(planted(np.random.default_rng(0), 5))


def test_too_few_tasks_are_refused() -> None:
    with pytest.raises(ValueError, match=r"given 2 task\(s\), but needs at least 3"):
        JackknifeF().fit(planted(np.random.default_rng(0), 2))
