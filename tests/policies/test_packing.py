import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from thesis_lib.policies import Packing

LENGTHS = st.lists(st.integers(1, 6), min_size=1, max_size=8)


def test_layout_by_hand() -> None:
    packing = Packing(np.array([2, 3, 1]))
    assert packing.order.tolist() == [1, 0, 2]
    assert packing.sizes == [3, 2, 1]
    assert packing.time.tolist() == [0, 0, 0, 1, 1, 2]
    assert packing.episode.tolist() == [1, 0, 2, 1, 0, 1]
    # rows 3, 4, 5 continue rows 0, 1, 3
    assert packing.previous.tolist() == [0, 1, 3]
    assert packing.last.tolist() == [4, 5, 2]
    assert packing.mask().tolist() == [[True] * 3, [True, True, False], [False, True, False]]


@given(LENGTHS)
@settings(max_examples=50, deadline=None)
def test_padding_and_back(lengths: list[int]) -> None:
    packing = Packing(np.array(lengths))
    padded = np.random.default_rng(0).normal(size=(max(lengths) + 2, len(lengths), 3))
    rows = packing.pack(padded)
    assert len(rows) == sum(lengths)
    again = packing.unpack(rows)
    for b, n in enumerate(lengths):
        np.testing.assert_array_equal(again[:n, b], padded[:n, b])
        assert (again[n:, b] == 0).all()


@given(LENGTHS)
@settings(max_examples=50, deadline=None)
def test_shift_is_the_step_before(lengths: list[int]) -> None:
    packing = Packing(np.array(lengths))
    padded = np.random.default_rng(1).normal(size=(max(lengths), len(lengths), 2))
    before = np.concatenate([np.zeros_like(padded[:1]), padded[:-1]])
    expected = packing.pack(before)
    np.testing.assert_array_equal(packing.shift(packing.pack(padded)), expected)
    rows = torch.as_tensor(packing.pack(padded))
    np.testing.assert_array_equal(packing.shift(rows).numpy(), expected)


@pytest.mark.parametrize("lengths", [[], [2, 0], [[1, 2]]])
def test_an_episode_needs_a_step(lengths: list[int]) -> None:
    with pytest.raises(ValueError, match="at least one step"):
        Packing(np.array(lengths, dtype=int))


def test_a_padded_array_must_fit() -> None:
    with pytest.raises(ValueError, match="exactly 2 episodes"):
        Packing(np.array([2, 3])).pack(np.zeros((3, 5)))
