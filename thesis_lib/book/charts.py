"""Figures with a slider, made by Altair: a picture without scripts, Vega-Lite with them.

Each function makes one, from the library or from committed results, so that none carries a
number of its own.  The script that moves them is shipped with the book
(:mod:`thesis_lib.book.offline`).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from itertools import product
from typing import Any

import altair as alt
import numpy as np
import pandas as pd

from thesis_lib.chapter2 import one_cliff
from thesis_lib.chapter5.cells import EXTRA_NETS, NETS
from thesis_lib.domains.cliff import continuing_cliff, episodic_cliff, layouts
from thesis_lib.edition.plots import COLOURS
from thesis_lib.edition.saved import saved
from thesis_lib.mdp.learning import learn
from thesis_lib.mdp.planning import soft_policy_iteration
from thesis_lib.potentials import q_tilde
from thesis_lib.selection.fitting import fit_inverse, fstek_threshold
from thesis_lib.selection.jackknife import f_threshold

WIDTH, HEIGHT = 420, 300
"""Pixels of a chart: a phone shows it at nearly its own size, so that its words can be read."""

_PAPER: Mapping[str, Any] = {
    "background": "white",
    "font": "DejaVu Sans",
    "axis": {"labelFontSize": 12, "titleFontSize": 12},
    # Below, as beside a chart on a phone there is no room.
    "legend": {"orient": "bottom", "columns": 3, "labelFontSize": 12, "titleFontSize": 12},
    "range": {"category": list(COLOURS)},
}


def _slider(name: str, value: float, words: str, **ends: Any) -> alt.Parameter:
    """A number that the reader chooses."""
    return alt.param(name=name, value=value, bind=alt.binding_range(name=words, **ends))


def law() -> alt.Chart:
    r"""k-relevance by its law, and the exponential that FS-TEK fits to its first n values."""
    first = _slider("first", 8, "relevance in one task, ρ₁ ", min=0, max=10, step=0.5)
    # By the law the curve never rises, so that a larger limit counts as the first value.
    limit = _slider("limit", 2, "domain relevance, ρ∞, at most ρ₁ ", min=0, max=10, step=0.5)
    seen = _slider("seen", 4, "tasks seen, n ", min=3, max=10, step=1)
    ks = np.arange(1, 41)
    curves: dict[int | None, tuple[str, Any]] = {None: ("the law", 1 / ks)}
    for n in range(3, 11):
        constant, scale, rate = fit_inverse(n).theta
        curves[n] = "FS-TEK's exponential", constant + scale * np.exp(-rate * ks)
    rows = [
        {"n": n, "k": int(k), "curve": name, "share": round(float(s), 5)}
        for n, (name, share) in curves.items()
        for k, s in zip(ks, share, strict=True)
    ]
    base = (
        alt.Chart(pd.DataFrame(rows))
        .transform_filter("datum.n == seen || !isValid(datum.n)")
        .transform_calculate(least="min(limit, first)")
        .transform_calculate(value="datum.least + (first - datum.least) * datum.share")
        .encode(
            x=alt.X("k:Q", title="length of the sequence, k"),
            y=alt.Y("value:Q", title="k-relevance", scale=alt.Scale(zero=False)),
            color=alt.Color("curve:N", title=None),
        )
    )
    lines = base.mark_line(strokeWidth=2)
    points = base.transform_filter("datum.k <= seen && datum.curve == 'the law'").mark_point(
        filled=True, size=60
    )
    return (lines + points).add_params(first, limit, seen)


def threshold() -> alt.Chart:
    """The F-ratio up to which FS-TEK removes a feature, and that of a test at 5%."""
    exponents = np.arange(-4, 0, 0.25)
    level = _slider("level", -2, "FS-TEK's level α = 10 to the ", min=-4, max=-0.25, step=0.25)
    seen = [*range(4, 21), 25, 30, 40, 50]
    rows = [
        {"n": n, "exponent": e, "rule": "FS-TEK", "F": round(fstek_threshold(n, 10**e), 3)}
        for n, e in product(seen, map(float, exponents))
    ]
    rows += [
        {"n": n, "exponent": None, "rule": "jackknife F at 5%", "F": round(f_threshold(n, 0.05), 3)}
        for n in seen
    ]
    y = alt.Y(
        "F:Q",
        title="largest F-ratio removed",
        scale=alt.Scale(type="symlog", constant=2, nice=False),
        axis=alt.Axis(values=[-1, 0, 1, 2, 5, 10, 20, 50, 100, 200, 500]),
    )
    lines = (
        alt.Chart(pd.DataFrame(rows))
        .transform_filter("datum.exponent == level || !isValid(datum.exponent)")
        .mark_line(point=True)
        .encode(x=alt.X("n:Q", title="tasks seen, n"), y=y, color=alt.Color("rule:N", title=None))
    )
    # An F-ratio is no less than 0, and that of a feature without relevance is about 1.
    known = [(1, "an irrelevant feature"), (0, "no feature is below 0")]
    marks = alt.Chart(pd.DataFrame(known, columns=["F", "of"]).assign(n=max(seen))).encode(y=y)
    words = marks.mark_text(align="right", dy=-6, color="#666666").encode(x="n:Q", text="of:N")
    return (marks.mark_rule(color="#999999") + words + lines).add_params(level)


def huddle() -> alt.Chart:
    """The best soft policy on a continuing cliff, by how much it explores."""
    layout, task = layouts()[0], continuing_cliff(0.95).tasks[0]
    names = {layout.start: "S", layout.goal: "G", **dict.fromkeys(layout.cliff, "cliff")}
    cells = pd.DataFrame([layout.cell(s) for s in range(task.n_states)], columns=["x", "y"])
    cells["name"] = [names.get(layout.cell(s), "") for s in range(task.n_states)]
    open_cells = cells[~cells.name.isin(["cliff", "G"])]
    rows = []
    for epsilon in np.arange(0.005, 0.1, 0.005).round(3):
        best = soft_policy_iteration(task, float(epsilon)).q.argmax(axis=1)
        moves = ["↑→↓←"[best[s]] for s in open_cells.index]
        rows.append(open_cells.assign(epsilon=epsilon, move=moves))
    explored = _slider("explored", 0.02, "exploration rate ε ", min=0.005, max=0.095, step=0.005)
    place: dict[str, Any] = {
        "x": alt.X("x:O", title=None, axis=None),
        "y": alt.Y("y:O", title=None, axis=None, sort="descending"),
    }
    grid = alt.Chart(cells).encode(**place)
    squares = grid.mark_rect(stroke="#999999", strokeWidth=1).encode(
        color=alt.condition("datum.name == 'cliff'", alt.value("#555555"), alt.value("white"))
    )
    corners = grid.transform_filter("datum.name != 'cliff'").mark_text(size=16, dx=-24, dy=-24)
    arrows = (
        alt.Chart(pd.concat(rows))
        .transform_filter("abs(datum.epsilon - explored) < 0.001")
        .mark_text(size=28)
        .encode(**place, text="move:N")
    )
    return (squares + corners.encode(text="name:N") + arrows).add_params(explored)


def paths() -> alt.Chart:
    """What two learners have learned of the cliff after ever more episodes, shaped and not."""
    layout, task, domain = one_cliff.layout(), one_cliff.task(), episodic_cliff(sensor=False)
    phi = domain.scatter(q_tilde(domain, epsilon=0.1), 0)
    rates: Mapping[one_cliff.Algorithm, float] = {"q_learning": 1.0, "sarsa": 0.4}
    names = {layout.start: "S", layout.goal: "G", **dict.fromkeys(layout.cliff, "cliff")}
    rows: list[dict[str, Any]] = []
    for (column, (algorithm, alpha)), shaped in product(enumerate(rates.items()), (True, False)):
        left, low = 5 * column, 0 if shaped else 5
        heading = f"{one_cliff.LEARNERS[algorithm]}, {'shaped' if shaped else 'unshaped'}"
        rows.append({"x": left, "y": low + 4, "heading": heading})
        cells = [layout.cell(s) for s in range(task.n_states)]
        rows += [{"x": left + x, "y": low + y, "name": names.get((x, y), "")} for x, y in cells]
        for doubled in range(10):
            run = learn(
                *(task, algorithm),
                **{"alpha": alpha, "epsilon": 0.1, "episodes": 2**doubled, "rng": 0},
                initial_q=phi * shaped,
            )
            path = one_cliff.greedy_path(task, run.q).states
            rows += [
                {
                    **{"x": left + x, "y": low + y, "doubled": doubled, "on": s in path},
                    "move": "↑→↓←"[run.q[s].argmax()],
                }
                for s, (x, y) in enumerate(cells)
                if names.get((x, y), "") in ("", "S")
            ]
    episodes = _slider("doubled", 3, "episodes, 2 to the ", min=0, max=9, step=1)
    place = alt.Chart(pd.DataFrame(rows)).encode(
        x=alt.X("x:O", axis=None, scale=alt.Scale(domain=[*range(9)])),
        y=alt.Y("y:O", axis=None, scale=alt.Scale(domain=[*range(9, -1, -1)])),
    )
    squares = place.transform_filter("isValid(datum.name)").mark_rect(stroke="#999999")
    squares = squares.encode(
        color=alt.condition("datum.name == 'cliff'", alt.value("#555555"), alt.value("white"))
    )
    corners = place.transform_filter("datum.name == 'S' || datum.name == 'G'").mark_text(
        size=9, dx=-11, dy=-11
    )
    headings = place.transform_filter("isValid(datum.heading)").mark_text(
        align="left", dx=-16, dy=6
    )
    arrows = place.transform_filter("isValid(datum.move) && datum.doubled == doubled")
    return (
        squares
        + corners.encode(text="name:N")
        + headings.encode(text="heading:N")
        + arrows.mark_text(size=20, fontWeight="bold").encode(
            text="move:N",
            color=alt.condition("datum.on", alt.value("#D55E00"), alt.value("#999999")),
        )
    ).add_params(episodes)


POINTS = 10
"""Of a learning curve, so that the page is light."""


def _means(curves: pd.DataFrame) -> pd.DataFrame:
    """Mean return over runs at some iterations."""
    longest = curves.groupby(["task", "terrain", "architecture"]).iteration.transform("max")
    curves = curves[curves.iteration % (longest // POINTS) == 0]
    curves = curves.assign(
        task=curves.task + curves.terrain.map({"flat": "", "hill": " on hills"}),
        architecture=curves.architecture.str.upper(),
    )
    by = curves.groupby(["task", "architecture", "iteration"], as_index=False)
    means = by[["steps", "mean_return"]].mean().round().drop(columns="iteration")
    return means.astype({"steps": int, "mean_return": int})


def learning() -> alt.Chart:
    """Learning curves, a robot and ground at a time: the study's, or shorter ones without it.

    Runs of the printed length are a choice of their own.
    """
    cell = ["task", "terrain", "architecture"]
    curves = pd.concat(
        [
            saved("study/breadth/curves").table.query("variant == 'default'").assign(deep=True),
            saved("learning/curves").table.assign(deep=False),
        ]
    )
    curves = curves[curves.deep == curves.groupby(cell).deep.transform("max")]
    long = _means(saved("study/depth/curves").table)
    long["task"] += f", {round(long.steps.max() / 1e6)} million steps"
    means = pd.concat([_means(curves), long])
    robot = alt.param(
        name="robot",
        value="HalfCheetah",
        bind=alt.binding_select(options=list(means.task.unique()), name="robot "),
    )
    nets = alt.selection_point(fields=["architecture"], bind="legend")
    return (
        alt.Chart(means)
        .transform_filter("datum.task == robot")
        .mark_line()
        .encode(
            x=alt.X("steps:Q", title="control steps"),
            y=alt.Y("mean_return:Q", title="mean return of a batch"),
            color=alt.Color(
                "architecture:N",
                title="network",
                legend=alt.Legend(columns=2),  # three are too wide for a phone
                scale=alt.Scale(  # as in figure 5.3
                    domain=[*NETS, *EXTRA_NETS], range=[*COLOURS, "#777777"]
                ),
            ),
            opacity=alt.when(nets).then(alt.value(1)).otherwise(alt.value(0.12)),
        )
        .add_params(robot, nets)
    )


CHARTS: Mapping[str, tuple[Callable[[], alt.Chart], str]] = {
    "law": (law, "k-relevance over k: the law, and the exponential through its first values"),
    "threshold": (threshold, "F-ratio up to which FS-TEK removes a feature, over tasks seen"),
    "paths": (paths, "Four grids of the cliff with what two learners would do in each cell"),
    "huddle": (huddle, "The cliff's grid with the best action of each cell as an arrow"),
    "learning": (learning, "Mean return over control steps for nine networks"),
}
"""What makes each chart, and what its picture shows, for those who do not see it."""


def charts() -> dict[str, str]:
    """Every chart as files: ``chart-NAME.md`` and ``picture-NAME.md`` are to be included."""
    made = {}
    for name, (make, words) in CHARTS.items():
        square = name in ("huddle", "paths")
        spec = drawn(make(), HEIGHT if square else WIDTH, HEIGHT)
        made[f"chart-{name}.svg"] = svg(spec)
        moving = spec if square else {**spec, "width": "container"}
        made[f"picture-{name}.md"] = picture(name, words)
        made[f"chart-{name}.md"] = _page(name, words, moving)
    return made


def drawn(chart: alt.Chart, width: int, height: int) -> dict[str, Any]:
    """A chart in the book's style as Vega-Lite, of so many pixels without its axes."""
    spec: dict[str, Any] = (
        chart.properties(width=width, height=height).configure(**_PAPER).to_dict()
    )
    return spec


def svg(spec: dict[str, Any]) -> str:
    """The picture of a chart, from :func:`drawn`."""
    import vl_convert

    return str(vl_convert.vegalite_to_svg(spec))


def picture(name: str, words: str) -> str:
    """Markdown that shows ``chart-NAME.svg``; the words are for those who do not see it."""
    return f"![{words}](/book/_generated/chart-{name}.svg)\n"


def _page(name: str, words: str, spec: Mapping[str, Any]) -> str:
    """The picture, and beside it what moves it."""
    data = json.dumps(spec, ensure_ascii=False, separators=(",", ":")).replace("</", "<\\/")
    return f"""````{{div}} chart
{picture(name, words)}
```{{raw}} html
<script type="application/json">{data}</script>
```
````
"""
