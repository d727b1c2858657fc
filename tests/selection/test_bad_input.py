"""Bad input in one sentence each, for every selector."""

import numpy as np
import pytest

from tests.selection.examples import planted
from thesis_lib.relevance import Solutions, TaskTable
from thesis_lib.selection import FSTEK, IBKR, JackknifeF, LinearF, NetworkF, Selector, TaskRelevance

FEATURES = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
NAMES = ("f", "a")
UNIFORM = np.full((4, 4), 0.25)
WITH_LEVEL = (FSTEK, JackknifeF, LinearF, NetworkF)


def good(n: int = 4) -> Solutions:
    base = planted(np.random.default_rng(0), n)
    return Solutions(base.q, base.p, base.features, NAMES)


def sentence(error: pytest.ExceptionInfo[ValueError]) -> str:
    """The message, which must be one sentence."""
    text = str(error.value)
    assert "\n" not in text
    assert text.endswith((".", "?"))
    assert text.count(". ") == 0
    return text


@pytest.mark.parametrize("make", WITH_LEVEL)
@pytest.mark.parametrize("n", [1, 2])
def test_fewer_than_three_tasks(make: type[Selector], n: int) -> None:
    with pytest.raises(ValueError, match="at least 3") as error:
        make().fit(good(4).take(np.arange(n)))
    text = sentence(error)
    assert f"{n} task" in text
    assert "NoSelection" in text


@pytest.mark.parametrize("names", [("f", "b"), ("a", "f"), ("f",)])
def test_tasks_with_different_features(names: tuple[str, ...]) -> None:
    tables = [
        TaskTable(NAMES, FEATURES, np.arange(4.0)),
        TaskTable(names, FEATURES[:, : len(names)], np.arange(4.0)),
    ]
    with pytest.raises(ValueError, match="task 1 has features") as error:
        Solutions.from_tables(tables)
    assert "same features in the same order" in sentence(error)


def test_nan_in_a_solution() -> None:
    q = good().q.copy()
    q[2, 1] = np.nan
    with pytest.raises(ValueError, match="q of task 2 at pair 1 is nan") as error:
        Solutions(q, UNIFORM, FEATURES, NAMES)
    sentence(error)
    with pytest.raises(ValueError, match="q of task 0 is NaN at pair 3") as error:
        Solutions.from_tables([TaskTable(NAMES, FEATURES, [1.0, 2.0, 3.0, np.nan])])
    sentence(error)


@pytest.mark.parametrize("make", [*WITH_LEVEL, IBKR, TaskRelevance])
def test_all_constant_q(make: type[Selector]) -> None:
    with pytest.raises(ValueError, match="constant") as error:
        make().fit(Solutions(np.full((4, 4), 7.0), UNIFORM, FEATURES, NAMES))
    assert "4 tasks" in sentence(error)


def test_one_constant_q_among_others_is_no_error() -> None:
    q = good().q.copy()
    q[0] = 3.0
    solutions = Solutions(q, UNIFORM, FEATURES, NAMES)
    for make in (*WITH_LEVEL, IBKR, TaskRelevance):
        assert make().fit(solutions).support_.shape == (2,)


@pytest.mark.parametrize("make", WITH_LEVEL)
@pytest.mark.parametrize("alpha", [0.0, 1.0, -0.1, 1.5, np.nan, np.inf])
def test_alpha_out_of_range(make: type[Selector], alpha: float) -> None:
    with pytest.raises(ValueError, match=r"alpha is .*\(0, 1\)") as error:
        make(alpha=alpha).fit(good())
    sentence(error)


@pytest.mark.parametrize("make", WITH_LEVEL)
def test_a_schedule_out_of_range_or_without_a_number(make: type[Selector]) -> None:
    with pytest.raises(ValueError, match=r"alpha is .*4") as error:
        make(alpha=lambda n: n).fit(good())
    sentence(error)
    with pytest.raises(ValueError, match="alpha"):
        make(alpha=lambda n: None).fit(good())  # type: ignore[arg-type, return-value]
    # A schedule that is out of range elsewhere only does no harm.
    make(alpha=lambda n: 0.05 if n == 4 else 7.0).fit(good())


def test_duplicate_feature_names() -> None:
    with pytest.raises(ValueError, match="the feature name 'f' occurs 2 times") as error:
        Solutions(good().q, UNIFORM, FEATURES, ("f", "f"))
    sentence(error)


def test_unsure_fits_are_reported_and_kept() -> None:
    three = FSTEK().fit(good(3))
    assert set(three.unsure_) == set(NAMES)
    assert three.support_.all()
    assert {c.verdict for c in three.history_[-1].checks} == {"unsure"}
    assert all(c.reason for r in three.history_ for c in r.checks)
    # What always decides says so.
    assert JackknifeF().fit(good()).unsure_ == ()
    assert LinearF().fit(good()).unsure_ == ()


@pytest.mark.parametrize("make", [*WITH_LEVEL, IBKR, TaskRelevance])
def test_the_input_is_not_changed(make: type[Selector]) -> None:
    solutions = good()
    before = solutions.q.copy(), solutions.p.copy(), solutions.features.copy()
    make().fit(solutions)
    for one, two in zip(before, (solutions.q, solutions.p, solutions.features), strict=True):
        np.testing.assert_array_equal(one, two)
