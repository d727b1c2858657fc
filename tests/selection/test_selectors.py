"""scikit-learn's conventions, the simple selectors, exact selection and ROC points."""

import pickle

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binomtest
from sklearn import config_context
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.frozen import FrozenEstimator
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import ParameterGrid
from sklearn.pipeline import make_pipeline
from sklearn.utils import Tags
from sklearn.utils.estimator_checks import parametrize_with_checks
from sklearn.utils.validation import check_is_fitted

from tests.relevance.worlds import world
from tests.selection.examples import planted, solved
from thesis_lib.domains import stock, triangle
from thesis_lib.relevance import Solutions, domain_relevance, k_relevance, remove
from thesis_lib.relevance.cells import FeatureCells
from thesis_lib.selection import (
    FSTEK,
    IBKR,
    ExactRelevance,
    FixedFeatures,
    FunctionSelector,
    JackknifeF,
    LeaveOneTaskOut,
    LinearF,
    NetworkF,
    NoSelection,
    RandomSelection,
    Selector,
    Shrinkage,
    TaskRelevance,
    rates,
    triangle_alpha,
)
from thesis_lib.selection.base import forward_strength

SELECTORS = [
    FSTEK(alpha=triangle_alpha, max_seqs=20),
    IBKR(alpha=0.01),
    JackknifeF(null="box"),
    ExactRelevance(k=1, tolerance=0.1),
    RandomSelection(0.3, random_state=5),
    FixedFeatures(["f"]),
    NoSelection(),
    TaskRelevance(0.01, "every", always=()),
    LinearF(interactions="pairs"),
    NetworkF(hidden=2, random_state=3),
    LeaveOneTaskOut(),
    Shrinkage("cross-fitted"),
]


def name_of(selector: Selector) -> str:
    return type(selector).__name__


@pytest.mark.parametrize("selector", SELECTORS, ids=name_of)
def test_scikit_learn_conventions(selector: Selector) -> None:
    solutions = planted(np.random.default_rng(0), 6)
    copy = clone(selector)
    assert type(copy) is type(selector)
    assert copy.get_params() == selector.get_params()
    assert copy.fit(solutions) is copy
    assert copy.support_.shape == (2,)
    assert copy.support_.dtype == bool
    # Fitting does not touch parameters, and a clone of a fitted selector is not fitted.
    assert copy.get_params() == selector.get_params()
    assert not hasattr(clone(copy), "support_")
    np.testing.assert_array_equal(copy.get_support(indices=True), np.flatnonzero(copy.support_))
    np.testing.assert_array_equal(copy.get_support(), copy.support_)
    rows = np.arange(6).reshape(3, 2)
    np.testing.assert_array_equal(copy.transform(rows), rows[:, copy.support_])
    kept = copy.get_feature_names_out().tolist()
    assert sorted([*kept, *copy.removed_]) == ["f", "g"]
    assert repr(copy).startswith(type(selector).__name__ + "(")


def open_to_arrays(selector: Selector) -> Selector:
    """The same selector, under a tag without which scikit-learn would skip all its checks."""

    def tags(self) -> Tags:
        found = kind.__sklearn_tags__(self)
        found.input_tags.two_d_array = True
        return found

    kind = type(selector)
    opened = type(kind.__name__, (kind,), {"__sklearn_tags__": tags})
    return opened(**selector.get_params())


FIT_AN_ARRAY = [
    "check_fit_score_takes_y",
    "check_estimators_overwrite_params",
    "check_dont_overwrite_parameters",
    "check_estimators_fit_returns_self",
    "check_readonly_memmap_input",
    "check_n_features_in_after_fitting",
    "check_positive_only_tag_during_fit",
    "check_estimators_dtypes",
    "check_complex_data",
    "check_dtype_object",
    "check_estimators_empty_data_messages",
    "check_pipeline_consistency",
    "check_estimators_nan_inf",
    "check_estimator_sparse_tag",
    "check_estimator_sparse_array",
    "check_estimator_sparse_matrix",
    "check_estimators_pickle",
    "check_f_contiguous_array_estimator",
    "check_transformer_data_not_an_array",
    "check_transformer_general",
    "check_transformer_preserve_dtypes",
    "check_methods_sample_order_invariance",
    "check_methods_subset_invariance",
    "check_fit2d_1sample",
    "check_fit2d_1feature",
    "check_dict_unchanged",
    "check_fit_idempotent",
    "check_fit_check_is_fitted",
    "check_n_features_in",
    "check_fit2d_predict1d",
]
"""Checks of scikit-learn that do not apply: they fit a random array, and a selector is fitted to
the values of several tasks, that is to Solutions.  What of them makes sense with Solutions is in
``test_a_fit_to_solutions``."""


@parametrize_with_checks(
    [open_to_arrays(selector) for selector in (FSTEK(), NetworkF(), NoSelection())],
    expected_failed_checks=lambda _: dict.fromkeys(FIT_AN_ARRAY, "fit takes Solutions"),
    xfail_strict=True,
)
def test_scikit_learns_own_checks(estimator, check) -> None:
    check(estimator)


@pytest.mark.parametrize("selector", SELECTORS, ids=name_of)
def test_a_fit_to_solutions(selector: Selector) -> None:
    solutions = planted(np.random.default_rng(0), 6)
    fresh = clone(selector)
    for use in (check_is_fitted, lambda s: s.transform(solutions), lambda s: s.labels(solutions)):
        with pytest.raises(NotFittedError):
            use(fresh)
    columns = fresh.fit_transform(solutions)
    check_is_fitted(fresh)
    assert fresh.n_features_in_ == 2
    np.testing.assert_array_equal(columns, solutions.features[:, fresh.support_])
    for other in (
        pickle.loads(pickle.dumps(fresh)),
        FrozenEstimator(fresh).fit(planted(np.random.default_rng(1), 9), None),
        make_pipeline(clone(selector)).fit(solutions),
    ):
        np.testing.assert_array_equal(other.transform(solutions.features), columns)
        assert list(other.get_feature_names_out()) == list(fresh.get_feature_names_out())
    known = dict(vars(fresh))
    fresh.transform(solutions.features)
    assert vars(fresh) == known


def test_a_regression_on_the_features_that_are_kept() -> None:
    solutions = planted(np.random.default_rng(0), 6)
    pipeline = make_pipeline(FixedFeatures(["g"]), LinearRegression())
    pipeline.fit(solutions, solutions.q[0])
    by_hand = LinearRegression().fit(solutions.features[:, [1]], solutions.q[0])
    expected = by_hand.predict(solutions.features[:, [1]])
    np.testing.assert_allclose(pipeline.predict(solutions.features), expected)
    framed = FixedFeatures(["g"]).fit(solutions).set_output(transform="pandas")
    frame = pd.DataFrame(solutions.features, columns=["f", "g"], index=[3, 1, 2, 0])
    pd.testing.assert_frame_equal(framed.transform(frame), frame[["g"]])


def test_a_program_that_asks_scikit_learn_for_frames() -> None:
    """Its issue 25239, and issue 488 of category_encoders, whose encoders failed there."""
    solutions = planted(np.random.default_rng(0), 6)
    with config_context(transform_output="pandas"):
        assert list(FixedFeatures(["g"]).fit_transform(solutions)) == ["g"]
        pipeline = make_pipeline(FixedFeatures(["g"]), LinearRegression())
        framed = pipeline.fit(solutions, solutions.q[0]).predict(solutions.features)
    plain = pipeline.fit(solutions, solutions.q[0]).predict(solutions.features)
    np.testing.assert_allclose(framed, plain)


def test_columns_of_other_names_or_in_another_order_are_refused() -> None:
    solutions = planted(np.random.default_rng(0), 6)
    selector = FixedFeatures(["g"]).fit(solutions)
    frame = pd.DataFrame(solutions.features, columns=["f", "g"])
    np.testing.assert_array_equal(selector.transform(frame)[:, 0], frame["g"])
    turned = Solutions(solutions.q, solutions.p, solutions.features[:, ::-1], ("g", "f"))
    for bad in (frame[["g", "f"]], frame.rename(columns={"f": "h"}), frame[["f"]], turned):
        with pytest.raises(ValueError, match="fitted to f, g, in this order"):
            selector.transform(bad)
    with pytest.raises(ValueError, match="the columns are g, f, but"):
        selector.labels(turned)
    with pytest.raises(ValueError, match="the columns are a, b, but"):
        selector.get_feature_names_out(["a", "b"])
    with pytest.raises(ValueError, match="the columns are 0, 1, but"):
        selector.transform(pd.DataFrame(solutions.features))


def test_parameters_can_be_searched() -> None:
    solutions = planted(np.random.default_rng(0), 6)
    for options in ParameterGrid({"alpha": [0.01, 0.3], "null": ["t2", "box"]}):
        fitted = JackknifeF().set_params(**options).fit(solutions)
        assert fitted.get_params()["alpha"] == options["alpha"]


def test_unknown_parameters_are_refused() -> None:
    with pytest.raises(ValueError, match="Invalid parameter 'level' for estimator IBKR"):
        IBKR().set_params(level=1)


def test_use_before_fit_and_wrong_tables_are_refused() -> None:
    with pytest.raises(ValueError, match=r"call fit\(solutions\) first"):
        NoSelection().transform(np.zeros((1, 2)))
    with pytest.raises(ValueError, match=r"shape \(1, 3\), but the selector was fitted to 2"):
        NoSelection().fit(planted(np.random.default_rng(0), 1)).transform(np.zeros((1, 3)))


@pytest.mark.parametrize("selector", SELECTORS, ids=name_of)
def test_the_same_data_give_the_same_features(selector: Selector) -> None:
    shared = isinstance(selector, FunctionSelector)
    solutions = world(0, "shared" if shared else "weights", 7)
    if isinstance(selector, FixedFeatures):
        selector = FixedFeatures(["f1"])
    first = clone(selector).fit(solutions)
    again = clone(selector).fit(solutions).fit(solutions)
    np.testing.assert_array_equal(first.support_, again.support_)
    assert first.removed_ == again.removed_


def test_the_order_of_tasks_does_not_matter_to_exact_methods() -> None:
    for seed in range(30):
        solutions = world(seed, "weights", 6, sizes=(2, 2, 2))
        turned = solutions.take(np.random.default_rng(seed).permutation(6))
        for selector in (FSTEK(alpha=1e-3), JackknifeF(), IBKR(), LeaveOneTaskOut(), Shrinkage()):
            kept = selector.fit(solutions).removed_
            assert selector.fit(turned).removed_ == kept


@pytest.mark.parametrize("kind", ["shared", "weights"])
def test_names_of_values_and_the_origin_of_q_do_not_matter(kind: str) -> None:
    selectors: list[Selector] = [FSTEK(alpha=1e-3), JackknifeF(), IBKR(), TaskRelevance(always=())]
    selectors += [LeaveOneTaskOut(), Shrinkage()]
    if kind == "shared":
        selectors.append(LinearF(interactions="pairs"))
    for seed in range(30):
        solutions = world(seed, kind, 6, sizes=(2, 3, 2))
        moved = Solutions(
            3 * solutions.q - 5,
            solutions.p,
            7 - 2 * solutions.features,
            solutions.feature_names,
        )
        for selector in selectors:
            kept = selector.fit(solutions).removed_
            assert selector.fit(moved).removed_ == kept


def test_fixed_and_no_selection() -> None:
    solutions = planted(np.random.default_rng(0), 1)
    assert NoSelection().fit(solutions).support_.all()
    assert FixedFeatures(["g"]).fit(solutions).removed_ == ("f",)
    # Keeping nothing makes the potential constant.
    constant = FixedFeatures([]).fit(solutions)
    assert constant.labels(solutions).tolist() == [0, 0, 0, 0]
    with pytest.raises(ValueError, match="no feature 'h'"):
        FixedFeatures(["h"]).fit(solutions)


def test_random_selection_keeps_each_feature_with_its_probability() -> None:
    solutions = world(0, "shared")
    rng = np.random.default_rng(0)
    kept = np.array([RandomSelection(0.3, rng).fit(solutions).support_ for _ in range(1000)])
    for feature in range(2):
        assert binomtest(int(kept[:, feature].sum()), 1000, 0.3).pvalue > 1e-3
    both = int(kept.all(axis=1).sum())
    assert binomtest(both, 1000, 0.09).pvalue > 1e-3
    with pytest.raises(ValueError, match=r"probability is 1\.5"):
        RandomSelection(1.5).fit(solutions)


# Exact selection, and the statements of the text about the domains.


def test_triangle_features() -> None:
    domain = solved(triangle)
    # "The triangle domain contains one domain-irrelevant feature, namely the state number."
    assert ExactRelevance().fit(domain).removed_ == ("x1",)
    # "To describe an optimal policy for each task, only position ... is needed", and colour
    # is constant within a task; distance is a function of position and task.
    assert set(ExactRelevance(k=1).fit(domain).removed_) == {"x2", "x3"}


@pytest.mark.parametrize("g", [1, 2, 3])
def test_stock_features(g: int) -> None:
    domain = solved(stock, 1, 2, g)
    globals_ = {f"g{i}" for i in range(1, g + 1)}
    # "Stock ownership is completely irrelevant, while the stock features and action are
    # domain relevant"; the globals are "strongly task relevant ... but domain irrelevant".
    assert set(ExactRelevance().fit(domain).removed_) == {"s1"} | globals_
    assert ExactRelevance(k=1).fit(domain).removed_ == ("s1",)
    rho = {name: k_relevance(domain, remove(domain, [name]), 1) for name in domain.feature_names}
    assert min(rho[name] for name in globals_) > max(rho["s1e1"], rho["s1e2"])


def test_exact_selection_between_one_task_and_infinitely_many() -> None:
    solutions = planted(np.random.default_rng(0), 50, effect=2.0)
    D = np.full(50, 1 / 50)
    share = {}
    for k in (1, 10, np.inf):
        full = (
            domain_relevance(solutions, [0] * 4)
            if np.isinf(k)
            else k_relevance(solutions, [0] * 4, int(k))
        )
        left = (
            domain_relevance(solutions, remove(solutions, ["g"]))
            if np.isinf(k)
            else k_relevance(solutions, remove(solutions, ["g"]), int(k))
        )
        share[k] = left / full
        for tolerance in (share[k] * 0.99, share[k] * 1.01):
            selector = ExactRelevance(k, float(tolerance), D).fit(solutions)
            assert ("g" in selector.removed_) == (tolerance > share[k])
    assert share[1] > share[10] > share[np.inf]


def test_distribution_decides_what_is_relevant() -> None:
    q = np.array([[1.0, -1.0], [-1.0, 1.0]])
    solutions = Solutions(q, np.full((2, 2), 0.5), np.array([[0], [1]]), ("x",))
    assert ExactRelevance().fit(solutions).removed_ == ("x",)
    assert ExactRelevance(distribution=[0.7, 0.3]).fit(solutions).removed_ == ()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"k": 0}, "at least 1"),
        ({"k": 1.5}, "integers"),
        ({"k": np.nan}, "k is nan, but"),
        ({"k": -np.inf}, "k is -inf, but"),
        ({"tolerance": -0.1}, "tolerance is -0.1"),
        ({"distribution": [1.0]}, "each of the 3 tasks"),
    ],
)
def test_bad_exact_parameters_are_refused(options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ExactRelevance(**options).fit(planted(np.random.default_rng(0), 3))


# ROC.


def test_rates_by_hand() -> None:
    truth = [True, True, False]
    assert rates([True, False, True], truth) == (1.0, 0.5)
    runs = [[True, True, False], [True, False, True], [True, True, True]]
    assert rates(runs, truth) == pytest.approx((2 / 3, 5 / 6))
    assert np.isnan(rates([True], [True])[0])
    assert np.isnan(rates([True], [False])[1])
    with pytest.raises(ValueError, match=r"truth \(3,\)"):
        rates([True, False], truth)


def test_forward_strength_by_hand() -> None:
    # Two features of two values, each pair with weight 1/4; what is explained is sum a^2 / b.
    a, b = np.array([[1.0, 0.0, 3.0, 2.0]]), np.full((1, 4), 0.25)
    pooled = FeatureCells(a, b, (0, 1), np.arange(4), (2, 2))
    nothing = 6**2
    assert forward_strength(pooled, []) == 0
    assert forward_strength(pooled, [0]) == pytest.approx((1 + 5**2) / 0.5 - nothing)
    assert forward_strength(pooled, [1]) == pytest.approx((4**2 + 2**2) / 0.5 - nothing)
    assert forward_strength(pooled, [0, 1]) == pytest.approx((1 + 9 + 4) / 0.25 - nothing)
