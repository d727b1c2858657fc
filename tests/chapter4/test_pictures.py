"""No words of a picture lie on other words, at the size at which it is drawn."""

from itertools import combinations
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from matplotlib.text import Text

from thesis_lib.chapter3 import levels
from thesis_lib.chapter4 import (
    figure_4_4,
    figure_4_6,
    figure_4_8,
    function_selection,
    predictors,
    roc,
)
from thesis_lib.domains import episodic_cliff
from thesis_lib.edition.plots import use_style

DEEP = Path(__file__).parents[2] / "results/thesis"


@pytest.fixture(autouse=True)
def _style():
    use_style()
    yield
    plt.close("all")


def overlaps(fig):
    """Pairs of texts that are drawn and whose boxes share more than a pixel."""
    drawn = []

    def noting(self, renderer):
        if self.get_visible() and self.get_text().strip():
            drawn.append((self.get_text(), Text.get_window_extent(self, renderer).padded(-1)))
        return draw(self, renderer)

    draw = Text.draw
    fig.canvas.draw()  # whatever constrained layout still moves
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Text, "draw", noting)
        fig.canvas.draw()
    assert drawn
    return [(a, b) for (a, p), (b, q) in combinations(drawn, 2) if p.overlaps(q)]


def numbers(fig):
    return sum(len(ax.texts) for ax in fig.axes)


def walks(columns, groups, methods, seed=0):
    """Places in ROC space that wander near the left edge and the top, where labels are dense."""
    rng = np.random.default_rng(seed)
    rows = []
    for group in groups:
        for method in methods:
            fpr = np.clip(rng.normal(0.15, 0.15) + rng.normal(0, 0.08, 6).cumsum(), 0, 1)
            tpr = np.clip(1 - abs(rng.normal(0, 0.1) + rng.normal(0, 0.1, 6).cumsum()), 0, 1)
            for n, x, y in zip((3, 4, 5, 6, 8, 12), fpr, tpr, strict=True):
                rows.append({columns: group, "method": method, "tasks_seen": n, "fpr": x, "tpr": y})
    return pd.DataFrame(rows)


@pytest.mark.parametrize("name", ["4.4", "4.5", "4.6", "4.8"])
def test_the_thesis_s_figures_at_its_size(name):
    draw = {"4.4": figure_4_4, "4.5": figure_4_4, "4.6": figure_4_6, "4.8": figure_4_8}[name]
    fig = draw.figure(pd.read_csv(DEEP / f"figure-{name}.csv"))
    assert not overlaps(fig)
    assert numbers(fig) >= 8


def test_no_selection_can_be_told_apart_on_the_cliff():
    table = pd.read_csv(DEEP / "figure-4.4.csv")
    returns = figure_4_4.figure(table).axes[0]
    at = table[table.tasks_seen == 5].set_index("method").mean_return / 1000
    low, high = returns.get_ylim()
    assert (at["fs-tek"] - at["none"]) / (high - low) > 0.1  # it was .01
    shown = {line.get_label() for line in returns.lines}
    assert shown == {"FS-TEK", "IBKR", "jackknife F", "no selection"}
    for line in returns.lines:
        assert low < min(line.get_ydata()[2:])
        assert max(line.get_ydata()) < high


@pytest.mark.parametrize("seed", range(2))
def test_selectors_that_predict(seed):
    methods = ("none", *predictors.METHODS[1:])
    settings = [f"setting {i}" for i in range(8)]
    fig = predictors.roc_figure(walks("setting", settings, methods, seed))
    assert not overlaps(fig)
    assert numbers(fig) >= 8 * 4


def test_selectors_on_functions():
    methods = ("table", "linear", "network", function_selection.MORE)
    table = walks("domain", ["stock G=2", "random MDP", "wide stock"], methods)
    table = table[table.tasks_seen.isin((4, 8, 12))]
    fig = function_selection.figure(table.assign(fpr=table.fpr / 4))
    assert not overlaps(fig)
    assert numbers(fig) == len(table)


def test_selectors_on_eight_domains():
    methods = ("fs-tek", "fs-tek schedule", "ibkr", "jackknife", "cross-validation")
    table = walks("domain", list(roc.FAMILIES), methods).assign(new=True)
    fig = roc.figure(table)
    assert not overlaps(fig)
    assert numbers(fig) >= 8 * 5


def test_potentials_as_maps_and_surfaces():
    cliff = episodic_cliff(sensor=False)
    rng = np.random.default_rng(0)
    shape = len(cliff.observations), len(cliff.actions)
    phi = {name: 1000 * rng.normal(-4, 1, shape) for name in ("Q_star", "Q_tilde", "Q_mu")}
    assert not overlaps(levels.value_maps(cliff, phi))
