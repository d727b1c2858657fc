"""Tile coding by hand, and its properties."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from thesis_lib.domains.heat import LAYOUTS, HeatWorld
from thesis_lib.domains.tiles import TileCoding


def line(intervals=2, tilings=2, periodic=False):
    return TileCoding(("v",), (0.0,), (1.0,), (intervals,), (periodic,), tilings)


def test_one_variable_by_hand():
    # Tiles are .5 wide, displaced by 1/4 and 3/4 of a tile: .3 is .6 tiles from the left, so
    # floor(.6 + .25) = 0 and floor(.6 + .75) = 1; each tiling has 3 tiles.
    assert line().active([0.3]).tolist() == [0, 3 + 1]
    assert line().active([[0.0], [0.999]]).tolist() == [[0, 3], [2, 5]]


def test_a_periodic_variable_comes_round():
    coding = line(intervals=4, periodic=True)
    assert coding.tiles == (4,)
    # .95 of a turn is 3.8 tiles: floor(4.05) = 4 = 0 and floor(4.55) = 0.
    assert coding.active([0.95]).tolist() == [0, 4]
    assert coding.active([1.3]).tolist() == coding.active([0.3]).tolist()
    assert coding.active([-0.7]).tolist() == coding.active([0.3]).tolist()


def test_values_outside_fall_into_the_outermost_tile():
    assert line().active([-5.0]).tolist() == [0, 3]
    assert line().active([5.0]).tolist() == [2, 5]


@pytest.mark.parametrize("name", LAYOUTS)
def test_the_layouts_have_the_printed_number_of_features(name):
    coding = HeatWorld().coding(LAYOUTS[name])
    assert coding.tilings == 4
    assert coding.n_features == 1664


def test_every_tile_of_every_variable_can_be_active():
    # Tiles of different variables combine freely, so every feature then can be active.
    coding = HeatWorld().coding()
    points = np.linspace(coding.low, coding.high, 500, endpoint=False)
    seen = coding.places[coding.active(points)]  # (500, tilings, 1 + variables)
    for t in range(coding.tilings):
        for d, n in enumerate(coding.tiles):
            assert set(seen[:, t, 1 + d]) == set(range(n))


@settings(max_examples=50, deadline=None)
@given(st.data())
def test_places_are_the_digits_of_the_feature(data):
    intervals = tuple(data.draw(st.lists(st.integers(1, 4), min_size=2, max_size=3)))
    d = len(intervals)
    periodic = tuple(data.draw(st.lists(st.booleans(), min_size=d, max_size=d)))
    coding = TileCoding(tuple("abc"[:d]), (0.0,) * d, (1.0,) * d, intervals, periodic, 3)
    point = np.array(data.draw(st.lists(st.floats(0, 0.999), min_size=d, max_size=d)))
    active = coding.active(point)
    for t, feature in enumerate(active):
        tiling, *tiles = coding.places[feature]
        expected = np.floor(point * intervals + (t + 0.5) / 3).astype(int)
        expected = np.where(periodic, expected % np.array(coding.tiles), expected)
        assert tiling == t
        assert tiles == expected.tolist()


def test_clusters_merge_what_is_not_kept():
    coding = HeatWorld().coding()
    assert (coding.clusters(coding.names) == np.arange(coding.n_features)).all()
    assert np.unique(coding.clusters([])).tolist() == [0, 1, 2, 3]
    heat = coding.clusters(["heat"])
    assert heat.max() + 1 == 4 * 13
    # Two states with the same heat share their clusters, wherever they are.
    here, there = coding.active([[1, 2, 3, 0.4], [9, 8, 1, 0.4]])
    assert heat[here].tolist() == heat[there].tolist()
    assert heat[coding.active([1, 2, 3, 0.9])].tolist() != heat[here].tolist()


def test_bad_codings_are_one_sentence():
    with pytest.raises(ValueError, match="have lengths 1, 1, 1, 2, 1"):
        TileCoding(("v",), (0.0,), (1.0,), (1, 2), (False,))
    with pytest.raises(ValueError, match="low must be below high"):
        TileCoding(("v",), (1.0,), (1.0,), (1,), (False,))
    with pytest.raises(ValueError, match="variable 'v' has 0 intervals"):
        TileCoding(("v",), (0.0,), (1.0,), (0,), (False,))
    with pytest.raises(ValueError, match="tilings is 0"):
        TileCoding(("v",), (0.0,), (1.0,), (1,), (False,), 0)
    with pytest.raises(ValueError, match="keep names 'w', but the variables are v"):
        line().clusters(["w"])
    with pytest.raises(ValueError, match="points have shape"):
        line().active([1.0, 2.0])
