"""Selection by flipped signs, by hand, by the slow definition and by how often noise passes."""

from itertools import product

import numpy as np
import pytest

from tests.selection.examples import planted
from thesis_lib.relevance import Solutions, estimate, ground, remove
from thesis_lib.selection import SignFlips
from thesis_lib.selection.flips import MOST, contributions, sign_choices


def one_feature(effects: list[float]) -> Solutions:
    """Tasks with values -z and z at the two values of a feature."""
    z = np.array(effects)
    p = np.full((len(z), 2), 0.5)
    return Solutions(np.stack([-z, z], axis=1), p, np.array([[0], [1]]), ("f",))


def test_by_hand() -> None:
    """Of six effects 1, 1, 1, 1, 1 and 2 no signs but the same give 7^2 / (6 * 9)."""
    solutions = one_feature([1, 1, 1, 1, 1, 2])
    assert np.diag(contributions(ground(solutions), 0)) == pytest.approx([1, 1, 1, 1, 1, 4])
    check = SignFlips().fit(solutions).history_[0].checks[0]
    # One of 32 choices is 3%, two are 6%: the second largest, with a sign of a 1 turned, is 25/54.
    assert (check.statistic, check.threshold) == pytest.approx((49 / 54, 25 / 54))
    assert check.verdict == "keep"
    # A level that not even one choice reaches keeps nothing: at five tasks, or at 3%.
    for selector, effects in ((SignFlips(), [1] * 5), (SignFlips(0.03), [1, 1, 1, 1, 1, 2])):
        assert not selector.fit(one_feature(effects)).support_.any()


@pytest.mark.parametrize("shared", [True, False])
def test_the_mean_contribution_is_the_increment(shared: bool) -> None:
    solutions = planted(np.random.default_rng(1), 7, levels=3, interaction=True, shared=shared)
    gram = contributions(ground(solutions), 1)
    assert gram.mean() == pytest.approx(estimate(solutions, remove(solutions, ["g"])).observed)
    assert np.linalg.eigvalsh(gram).min() > -1e-12


def test_choices_of_signs() -> None:
    assert sign_choices(4).tolist() == [[1, *rest] for rest in product((1, -1), repeat=3)]
    many = sign_choices(30)
    assert many.shape == (MOST, 30)
    assert (many[0] == 1).all()


@pytest.mark.parametrize(("noise", "n"), [("gaussian", 6), ("sign", 6), ("sign", 14)])
def test_symmetric_noise_passes_no_more_often_than_the_level_says(noise: str, n: int) -> None:
    rng = np.random.default_rng(5)
    runs = 400
    kept = sum(SignFlips().fit(planted(rng, n, noise=noise)).support_[1] for _ in range(runs))
    assert kept / runs < 0.05 + 3 * np.sqrt(0.05 * 0.95 / runs)
