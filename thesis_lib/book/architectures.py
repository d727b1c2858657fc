"""Figures and tables of section 5.2: the networks drawn, and what they make of signals."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, FancyArrowPatch, Rectangle

from thesis_lib.edition.plots import COLOURS, PRINTED
from thesis_lib.experiments.chapter5.architectures import FAST, GAIT, SLOW, gait_band
from thesis_lib.locomotion.robots import ROBOTS

Point = tuple[float, float]

INK = "#222222"
PALE = "#eef3f7"
INPUT, RECURRENT, OUTPUT = COLOURS[0], COLOURS[2], COLOURS[1]
"""Colours of input, recurrent and output weights."""

NETWORKS = {
    "ffwd": "FFWD",
    "dffwd": "DFFWD",
    "dtrnn": "DTRNN",
    "ctrnn": "CTRNN",
    "lstm": "LSTM",
    "gru": "GRU",
    "esn": "ESN",
    "dffwd-softplus": "DFFWD, softplus",
    "ffwd-400": "FFWD, wide",
}
"""Names of the networks on the page, in its order."""


# -------------------------------------------------------------------------------------- drawing
class _Sketch:
    """A panel of the drawing, 10 wide and 8 high."""

    def __init__(self, ax: Axes, title: str) -> None:
        self.ax = ax
        ax.set(xlim=(0, 10), ylim=(-0.1, 8.2), aspect="equal")
        ax.axis("off")
        ax.set_title(title, fontsize=12)

    def text(self, at: Point, text: str, **options: object) -> None:
        defaults = {"ha": "center", "va": "center", "fontsize": 11, "zorder": 6}
        self.ax.text(*at, text, **(defaults | options))  # type: ignore[arg-type]

    def box(self, at: Point, text: str, width: float = 1.3) -> None:
        """An input, an output or a named operation."""
        corner = (at[0] - width / 2, at[1] - 0.5)
        self.ax.add_patch(
            Rectangle(corner, width, 1.0, facecolor="white", edgecolor=INK, lw=1, zorder=4)
        )
        self.text(at, text)

    def wave(self, at: Point, label: str = "", *, right: bool = True) -> None:
        """Units with a nonlinearity: a circle with a wavy line."""
        self.ax.add_patch(Circle(at, 0.55, facecolor=PALE, edgecolor=INK, lw=1.2, zorder=4))
        x = np.linspace(-0.35, 0.35, 40)
        self.ax.plot(at[0] + x, at[1] + 0.3 * np.tanh(7 * x), color=INK, lw=1.4, zorder=5)
        if label:
            side = 0.75 if right else -0.75
            place = (at[0] + side, at[1])
            self.text(place, label, ha="left" if right else "right", fontsize=10)

    def sign(self, at: Point, text: str) -> None:
        """A sum or a product."""
        self.ax.add_patch(Circle(at, 0.38, facecolor="white", edgecolor=INK, lw=1.2, zorder=4))
        self.text(at, text, fontsize=11)

    def delay(self, at: Point) -> None:
        """A delay of one step."""
        self.ax.add_patch(Rectangle((at[0] - 0.25, at[1] - 0.25), 0.5, 0.5, color=INK, zorder=5))

    def link(
        self, points: Sequence[Point], colour: str = INK, label: str = "", *, fixed: bool = False
    ) -> None:
        """A line along some points with an arrow at its end; dashed if it is not learned."""
        weighted = colour != INK
        style = (0, (2, 1.5)) if fixed else "-"
        width = 1.9 if weighted else 1.1
        xy = np.array(points, dtype=float)
        if len(xy) > 2:
            self.ax.plot(*xy[:-1].T, color=colour, lw=width, ls=style, zorder=2)
        self.ax.add_patch(
            FancyArrowPatch(
                tuple(xy[-2]), tuple(xy[-1]), arrowstyle="-|>", mutation_scale=11, color=colour,
                lw=width, ls=style, shrinkA=0, shrinkB=0, zorder=2,
            )
        )  # fmt: skip
        if label:
            middle = (xy[0] + xy[1]) / 2
            box = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}
            self.text(tuple(middle), label, color=colour, fontsize=10, bbox=box)


def draw_architectures() -> Figure:
    """All architectures of section 5.2: the thesis's figure 5.2 and what it leaves out."""
    fig, axes = plt.subplots(3, 2, figsize=(7.2, 9.2))
    for ax, draw in zip(
        axes.flat, (_feedforward, _discrete, _continuous, _lstm, _gru, _reservoir), strict=True
    ):
        draw(ax)
    handles = [
        Line2D([], [], color=INPUT, lw=2, label="input weights W"),
        Line2D([], [], color=RECURRENT, lw=2, label="recurrent weights K"),
        Line2D([], [], color=OUTPUT, lw=2, label="output weights V"),
        Line2D([], [], color="0.5", lw=2, ls=(0, (2, 1.5)), label="dashed: not learned"),
        Line2D([], [], color=INK, marker="s", ls="", ms=7, label="delay of one step"),
        Line2D([], [], color=INK, lw=1.1, label="no weights"),
    ]
    fig.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=10)
    return fig


def _feedforward(ax: Axes) -> None:
    s = _Sketch(ax, "FFWD (left), DFFWD (right)")
    for x, layers in ((2.3, ((4.0, "3 dim(a)"),)), (6.6, ((2.4, "100"), (4.0, "50"), (5.6, "25")))):
        s.box((x, 0.6), "o")
        below = 1.1
        for y, label in layers:
            s.link([(x, below), (x, y - 0.55)], INPUT)
            s.wave((x, y), label)
            below = y + 0.55
        s.link([(x, below), (x, 6.9)], OUTPUT)
        s.box((x, 7.4), r"$\mu$")


def _loop(s: _Sketch, *, fixed: bool = False) -> None:
    """What the networks of panels B and F share: hidden units fed back through a delay."""
    s.link([(4.4, 5.5), (7.6, 5.5), (7.6, 2.6), (4.8, 2.6)], RECURRENT, fixed=fixed)
    s.delay((7.6, 4.1))
    s.text((6.2, 3.0), "K", color=RECURRENT)


def _discrete(ax: Axes) -> None:
    s = _Sketch(ax, "DTRNN")
    s.box((4.4, 0.6), "x")
    s.link([(4.4, 1.1), (4.4, 2.2)], INPUT)
    s.sign((4.4, 2.6), "+")
    s.link([(4.4, 3.0), (4.4, 3.65)])
    s.wave((4.4, 4.2), "h", right=False)
    s.link([(4.4, 4.75), (4.4, 6.9)], OUTPUT)
    s.box((4.4, 7.4), r"$\mu$")
    _loop(s)


def _continuous(ax: Axes) -> None:
    s = _Sketch(ax, "CTRNN")
    s.box((2.2, 0.6), "x")
    s.link([(2.2, 1.1), (2.2, 1.95)], INPUT)
    s.sign((2.2, 2.3), "+")
    s.link([(2.2, 2.7), (2.2, 3.25)])
    s.wave((2.2, 3.8), "f", right=False)
    s.link([(2.2, 4.35), (2.2, 5.1)])
    s.sign((2.2, 5.5), "+")
    s.link([(2.6, 5.5), (3.7, 5.5)])
    s.box((4.8, 5.5), r"$\int\!/\tau$", 2.2)
    s.link([(5.9, 5.5), (8.6, 5.5), (8.6, 6.9)], OUTPUT)
    s.text((7.0, 5.85), "h")
    s.link([(6.5, 5.5), (6.5, 7.0), (2.2, 7.0), (2.2, 5.88)])
    s.text((4.4, 7.35), "leak: −h", fontsize=10)
    s.link([(7.4, 5.5), (7.4, 2.3), (2.6, 2.3)], RECURRENT)
    s.text((5.0, 2.7), "K", color=RECURRENT)
    s.box((8.6, 7.4), r"$\mu$")


def _lstm(ax: Axes) -> None:
    s = _Sketch(ax, "LSTM")
    s.box((3.2, 0.5), r"$x_n$", 1.5)
    s.box((6.8, 0.5), r"$h_{n-1}$", 1.9)
    gates = {"cell": 1.1, "input": 3.5, "forget": 6.1, "output": 8.7}
    for name, x in gates.items():
        s.link([(3.2, 1.0), (x - 0.12, 2.25)], INPUT)
        s.link([(6.8, 1.0), (x + 0.12, 2.25)], RECURRENT)
        s.wave((x, 2.8))
        s.text((x + 0.62, 3.2), name, ha="left", fontsize=9)
    s.sign((2.3, 4.3), r"$\circ$")
    s.link([(1.2, 3.35), (1.2, 4.3), (1.92, 4.3)])
    s.link([(3.4, 3.35), (3.4, 4.3), (2.68, 4.3)])
    s.sign((6.1, 4.3), r"$\circ$")
    s.link([(6.1, 3.35), (6.1, 3.92)])
    s.sign((4.2, 5.3), "+")
    s.link([(2.3, 4.68), (2.3, 5.3), (3.82, 5.3)])
    s.link([(5.72, 4.3), (4.2, 4.3), (4.2, 4.92)])
    s.link([(4.58, 5.3), (7.4, 5.3), (7.4, 4.3), (6.48, 4.3)])
    s.delay((7.4, 4.85))
    s.text((5.7, 5.6), "c", fontsize=10)
    s.link([(4.2, 5.68), (4.2, 6.15)])
    s.wave((4.2, 6.7))
    s.link([(4.75, 6.7), (8.22, 6.7)])
    s.sign((8.6, 6.7), r"$\circ$")
    s.link([(8.6, 3.35), (8.6, 6.32)])
    s.link([(8.6, 7.08), (8.6, 7.9)])
    s.text((9.2, 7.5), r"$h_n$")


def _gru(ax: Axes) -> None:
    s = _Sketch(ax, "GRU")
    s.box((3.0, 0.5), r"$x_n$", 1.5)
    s.box((7.0, 0.5), r"$h_{n-1}$", 1.9)
    s.wave((1.2, 2.6), "")
    s.text((1.45, 3.55), "update", ha="left", fontsize=9)
    s.wave((8.8, 2.6), "")
    s.text((9.0, 3.5), "reset", fontsize=9)
    s.link([(2.6, 1.0), (1.35, 2.07)], INPUT)
    s.link([(6.1, 0.9), (1.62, 2.25)], RECURRENT)
    s.link([(3.7, 0.9), (8.38, 2.25)], INPUT)
    s.link([(7.5, 1.0), (8.65, 2.07)], RECURRENT)
    s.sign((6.6, 3.2), r"$\circ$")
    s.link([(6.8, 1.0), (6.65, 2.82)], RECURRENT)
    s.link([(8.35, 2.9), (6.98, 3.15)])
    s.wave((4.4, 4.4), "")
    s.text((3.7, 4.55), r"$\tilde h_n$", ha="right", fontsize=10)
    s.link([(3.1, 1.0), (4.2, 3.87)], INPUT)
    s.link([(6.3, 3.42), (4.9, 4.15)])
    s.box((4.9, 6.2), r"mix: $g h + (1-g)\,\tilde h$", 6.6)
    s.link([(4.4, 4.95), (4.4, 5.7)])
    s.link([(1.2, 3.15), (1.2, 6.2), (1.6, 6.2)])
    s.link([(7.95, 0.5), (9.75, 0.5), (9.75, 6.2), (8.2, 6.2)])
    s.link([(4.4, 6.7), (4.4, 7.7)])
    s.text((5.0, 7.4), r"$h_n$")


def _reservoir(ax: Axes) -> None:
    s = _Sketch(ax, "ESN")
    rng = np.random.default_rng(3)
    ring = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    spots = np.array([5 + 2.7 * np.cos(ring), 4.0 + 1.35 * np.sin(ring)]).T
    spots = np.vstack([spots, [[4.1, 4.0], [5.9, 4.0]]]) + rng.uniform(-0.15, 0.15, (10, 2))
    s.box((5, 0.6), "x")
    s.box((5, 7.4), r"$\mu$")
    for a, b in {tuple(sorted(rng.choice(10, 2, replace=False))) for _ in range(22)}:
        way = spots[b] - spots[a]
        trim = 0.36 * way / np.linalg.norm(way)
        s.link([tuple(spots[a] + trim), tuple(spots[b] - trim)], RECURRENT, fixed=True)
    for place in spots:
        ax.add_patch(Circle(tuple(place), 0.33, facecolor=PALE, edgecolor=INK, lw=1, zorder=4))
        x = np.linspace(-0.2, 0.2, 20)
        ax.plot(place[0] + x, place[1] + 0.17 * np.tanh(12 * x), color=INK, lw=1, zorder=5)
    for i in (4, 5, 6, 7, 0):
        s.link([(5, 1.1), tuple(spots[i] - [0, 0.36])], INPUT, fixed=True)
    for i in (4, 3, 2, 1, 0):
        s.link([tuple(spots[i] + [0, 0.36]), (5, 6.9)], OUTPUT)


# ---------------------------------------------------------------------------------------- sizes
def size_table(table: pd.DataFrame) -> pd.DataFrame:
    """Learned parameters and, in brackets, hidden units of every network on every task."""
    own = table[table.thesis].set_index(["net", "task"])
    cells = own.learned.map("{:,}".format) + " (" + own.units.map("{:,}".format) + ")"
    wide = cells.str.replace(",", "\N{THIN SPACE}").unstack()
    wide = wide.reindex(index=list(NETWORKS), columns=list(ROBOTS)).rename(index=NETWORKS)
    return wide.rename_axis(None, axis=1).rename_axis("network").reset_index().fillna("–")


# -------------------------------------------------------------------------------------- filters
def _panels(
    names: Iterable[str], height: float, *, spare: bool = True
) -> tuple[Figure, np.ndarray, Axes]:
    """Small multiples, three a row; last, where the legend goes: one more, or the first."""
    names = list(names)
    lines = -(-(len(names) + spare) // 3)
    fig, axes = plt.subplots(lines, 3, figsize=(7.2, height), sharex=True, sharey=True)
    for ax, name in zip(axes.flat, names, strict=False):
        ax.set_title(name, fontsize=10)
        ax.tick_params(labelsize=8.5)
    for ax in axes.flat[len(names) :]:
        ax.axis("off")
    return fig, axes.flat[: len(names)], axes.flat[len(names) if spare else 0]


def _logarithmic(n: int) -> list[np.ndarray]:
    """Rows 0 to n - 1 in at most 40 runs, about equally wide on a logarithmic axis."""
    bins = np.unique(np.geomspace(1, n, 40).astype(int) - 1)
    return np.split(np.arange(n), bins[1:])


def responses(table: pd.DataFrame) -> Figure:
    """Response to an impulse and to a step, each over its largest value; one line a network."""
    fig, axes, spare = _panels(table.net.unique(), 5.6)
    colours = {"impulse": COLOURS[1], "step": COLOURS[0]}
    for ax, (_, own) in zip(axes, table.groupby("net", sort=False), strict=True):
        for signal, colour in colours.items():
            chosen = own[own.signal == signal]
            for _, one in chosen.groupby("seed"):
                ax.plot(one.time, one.response / one.response.max(), color=colour, lw=0.9)
    axes[0].set(ylim=(-0.03, 1.05), xlim=(table.time.min(), table.time.max()))
    for signal, colour in colours.items():
        spare.plot([], color=colour, label=signal)
    spare.legend(loc="center", title="response to")
    fig.supxlabel("time since the signal came [s]", fontsize=11)
    fig.supylabel("response / largest response", fontsize=11)
    return fig


def gains(table: pd.DataFrame) -> Figure:
    """Gain over frequency, over that at the lowest frequencies: measured and linearised."""
    fig, axes, spare = _panels(table.net.unique(), 5.6)
    for ax, (_, own) in zip(axes, table.groupby("net", sort=False), strict=True):
        for _, one in own.groupby("seed"):
            slow = one.frequency < SLOW
            f, scale = one.frequency, one.gain[slow].mean()
            parts = _logarithmic(len(f))
            x = [f.iloc[p].mean() for p in parts]
            ax.loglog(x, [one.gain.iloc[p].mean() / scale for p in parts], color=COLOURS[0], lw=0.9)
            small = one.small_signal_gain
            if small.notna().all():
                ax.loglog(f, small / small[slow].mean(), color=COLOURS[1], lw=0.9, ls="--")
    axes[0].set(ylim=(3e-3, 30), xlim=(table.frequency.min(), table.frequency.max()))
    spare.plot([], color=COLOURS[0], label="noise, measured")
    spare.plot([], color=COLOURS[1], ls="--", label="linearised at rest")
    spare.legend(loc="center", fontsize=9)
    fig.supxlabel("frequency [Hz]", fontsize=11)
    fig.supylabel(f"gain / gain below {SLOW:g} Hz", fontsize=11)
    return fig


def bands(gait: float = GAIT) -> tuple[str, str, str]:
    """Headings of what :func:`gain_shares` gives for a gait's frequency [Hz]."""
    return f"about {gait:g} Hz", f"above {FAST:g} Hz", "noise / gait"


def gain_table(table: pd.DataFrame) -> pd.DataFrame:
    """What each network leaves of a gait's frequency and of noise, over slow signals."""
    records = []
    for net, own in table.groupby("net", sort=False):
        shares = gain_shares(own)
        stable = own.groupby("seed").small_signal_gain.apply(lambda g: g.notna().all())
        row: dict[str, object] = {"network": net}
        for name, share in zip(bands(), shares, strict=True):
            row[name] = f"{share.mean():.2f} ({_range(share.min(), share.max(), 2)})"
        row["stable at rest"] = f"{stable.sum()} of {len(stable)}"
        records.append(row)
    return pd.DataFrame(records)


STAGES = {"before": (COLOURS[5], "--"), "after": (COLOURS[1], "-")}
"""Colour and line of networks before and after training."""


def trained_gains(table: pd.DataFrame) -> Figure:
    """Gain over frequency, over that at the lowest frequencies, before and after training.

    Lines are geometric means over networks, and bands go from the least to the largest.
    """
    fig, axes, legend = _panels(table.net.unique(), 4.6, spare=False)
    for ax, (_, own) in zip(axes, table.groupby("net", sort=False), strict=True):
        for stage, (colour, style) in STAGES.items():
            wide = own[own.stage == stage].pivot(index="frequency", columns="seed", values="gain")
            wide /= wide[wide.index < SLOW].mean()
            parts = _logarithmic(len(wide))
            logs = np.log(np.array([wide.iloc[p].mean() for p in parts]))
            x = [wide.index[p].to_numpy().mean() for p in parts]
            ax.loglog(x, np.exp(logs.mean(axis=1)), style, color=colour, lw=1.4)
            low, high = np.exp(logs.min(axis=1)), np.exp(logs.max(axis=1))
            ax.fill_between(x, low, high, color=colour, alpha=0.2, lw=0)
    axes[0].set(ylim=(5e-3, 12), xlim=(table.frequency.min(), table.frequency.max()))
    for stage, (colour, style) in STAGES.items():
        legend.plot([], ls=style, color=colour, label=f"{stage} training")
    legend.legend(loc="lower left", fontsize=8.5)
    fig.supxlabel("frequency [Hz]", fontsize=11)
    fig.supylabel(f"gain / gain below {SLOW:g} Hz", fontsize=11)
    return fig


def trained_table(table: pd.DataFrame, gait: float = GAIT) -> pd.DataFrame:
    """What :func:`gain_table` shows, before and after training: mean and range over networks.

    Parameters
    ----------
    table
        Table ``section-5.2-gain-trained``.
    gait
        Frequency of the robot's gait [Hz].
    """
    records = []
    for net, own in table.groupby("net", sort=False):
        row: dict[str, object] = {"network": net}
        ends = [gain_shares(own[own.stage == stage], gait) for stage in STAGES]
        for name, before, after in zip(bands(gait), *ends, strict=True):
            found = _range(after.min(), after.max(), 2)
            row[name] = f"{before.mean():.2f} → {after.mean():.2f} ({found})"
        records.append(row)
    return pd.DataFrame(records)


def learned_time_constants(table: pd.DataFrame, dt: float) -> Figure:
    """Share of units with a time constant below x, a line a network, by the initial value.

    Parameters
    ----------
    table
        Columns ``initial``, ``learned`` and ``seed``.
    dt
        The control step, below which the clamp lets none go.
    """
    starts = sorted(table.initial.unique(), reverse=True)
    fig, axes = plt.subplots(1, len(starts), figsize=(7.2, 2.9), sharey=True, squeeze=False)
    for ax, start in zip(axes.flat, starts, strict=True):
        for _, own in table[table.initial == start].groupby("seed"):
            ordered = np.sort(own.learned)
            share = np.arange(1, len(ordered) + 1) / len(ordered)
            ax.step(ordered, share, where="post", color=COLOURS[0], lw=1.0)
        ax.axvline(start, color=PRINTED, ls="--", lw=1, label="before training")
        ax.axvline(dt, color=COLOURS[1], ls=":", lw=1.2, label="control step")
        ax.set(xscale="log", xlabel=r"time constant $\tau$ [s]")
        ax.set_title(f"starting at {start:g} s", fontsize=10)
    axes[0, 0].set_ylabel("share of units")
    axes[0, 0].legend(fontsize=8.5)
    return fig


def _range(low: float, high: float, places: int) -> str:
    """Two numbers with a dash that no line ends at."""
    return f"{low:.{places}f}\N{WORD JOINER}–\N{WORD JOINER}{high:.{places}f}"


def gain_shares(own: pd.DataFrame, gait: float = GAIT) -> tuple[pd.Series, pd.Series, pd.Series]:
    """Gain at a gait's frequencies and at those of noise over that below, and their ratio, by seed.

    Parameters
    ----------
    own
        Columns ``seed``, ``frequency`` and ``gain`` of one kind of network.
    gait
        Frequency of the gait [Hz]; all bands are those of
        :mod:`thesis_lib.experiments.chapter5.architectures`.
    """
    slow = own[own.frequency < SLOW].groupby("seed").gain.mean()
    stride = own[gait_band(own.frequency, gait)].groupby("seed").gain.mean()
    fast = own[own.frequency > FAST].groupby("seed").gain.mean()
    return stride / slow, fast / slow, fast / stride


def gait_table(table: pd.DataFrame) -> pd.DataFrame:
    """Frequency of gaits by robot and controller: median, and range over episodes; speed."""
    records = []
    for (robot, controller), own in table.groupby(["robot", "controller"], sort=False):
        beats = own.frequency.dropna()
        told = f"{beats.median():.1f} ({_range(beats.min(), beats.max(), 1)})"
        speed = (own.distance / own.seconds).median()
        records.append(
            {
                "robot": robot,
                "controller": controller,
                "frequency [Hz]": told if len(beats) else "–",
                "speed [m/s]": f"{speed:.1f}" if len(beats) else "–",
                "fell early": f"{len(own) - len(beats)} of {len(own)}",
            }
        )
    return pd.DataFrame(records)


def means_table(table: pd.DataFrame) -> pd.DataFrame:
    """Size of the mean action before training: mean, and range over robots and networks."""
    records = []
    for net, name in NETWORKS.items():
        own = table[table.net == net]
        if len(own):
            row: dict[str, object] = {"network": name}
            for column, title in (("rms", "mean action"), ("lean", "of it, the same everywhere")):
                value = own[column]
                row[title] = f"{value.mean():.2f} ({_range(value.min(), value.max(), 2)})"
            records.append(row)
    return pd.DataFrame(records)


# ----------------------------------------------------------------------------------- reservoirs
def eigenvalue_planes(table: pd.DataFrame) -> Figure:
    """Eigenvalues in the complex plane, with the unit circle and the spectral radius."""
    nets = list(dict.fromkeys(table.net))
    fig, axes = plt.subplots(1, len(nets), figsize=(7.2, 3.0), sharex=True, sharey=True)
    turn = np.linspace(0, 2 * np.pi, 200)
    for ax, net in zip(axes, nets, strict=True):
        own = table[table.net == net]
        ax.plot(np.cos(turn), np.sin(turn), color=PRINTED, lw=1, ls=":")
        radius = own.spectral_radius.iloc[0]
        if np.isfinite(radius):
            ax.plot(radius * np.cos(turn), radius * np.sin(turn), color=COLOURS[1], lw=1.2)
        ax.plot(own.real, own.imaginary, ".", ms=2.5, color=COLOURS[0])
        ax.set_title(f"{net}: {len(own)} units", fontsize=10)
        ax.set(aspect="equal", xlabel="real part")
    axes[0].set_ylabel("imaginary part")
    return fig


def exponents(table: pd.DataFrame) -> Figure:
    """Largest Lyapunov exponent of reservoirs by spectral radius, leak and input."""
    noises = sorted(table.noise.unique())
    fig, axes = plt.subplots(1, len(noises), figsize=(7.2, 3.2), sharey=True)
    for ax, noise in zip(np.atleast_1d(axes), noises, strict=True):
        for (leak, own), colour in zip(
            table[table.noise == noise].groupby("leak", sort=False), COLOURS, strict=False
        ):
            ax.plot(own.spectral_radius, own.exponent, "o", ms=3.5, mfc="none", color=colour)
            middle = own.groupby("spectral_radius").exponent.mean()
            ax.plot(middle.index, middle, color=colour, lw=1.2, label=f"leak {leak:g}")
            if not noise:
                rest = own.groupby("spectral_radius").at_rest.mean()
                ax.plot(rest.index, rest, color=colour, lw=1.2, ls="--")
        ax.axhline(0, color=PRINTED, lw=1)
        ax.axvline(1, color=PRINTED, lw=1, ls=":")
        ax.set(xlabel="spectral radius", title=f"noise {noise:g}" if noise else "no input")
    np.atleast_1d(axes)[0].set_ylabel("largest Lyapunov exponent [1/step]")
    np.atleast_1d(axes)[0].legend(loc="lower right", fontsize=9)
    return fig


# ------------------------------------------------------------------------------- time constants
def integrator_errors(table: pd.DataFrame, gradients: pd.DataFrame) -> Figure:
    """Errors of the integrators, and of gradients integrated apart, over the step."""
    fig, (left, right) = plt.subplots(1, 2, figsize=(7.2, 3.8))
    names = {"euler": "Euler", "heun": 'Heun (the author\'s "midpoint")', "midpoint": "midpoint"}
    for (name, text), colour in zip(names.items(), COLOURS, strict=False):
        by = table[table.integrator == name].groupby("ratio").error
        left.loglog(by.mean().index, by.mean(), "o-", ms=3.5, color=colour, label=text)
        left.fill_between(by.min().index, by.min(), by.max(), color=colour, alpha=0.2, lw=0)
        own = gradients[gradients.integrator == name]
        for places, style in (("nodes", "-"), ("stages", "--")):
            chosen = own[own.places == places].groupby("ratio").difference
            if not len(chosen):
                continue
            right.loglog(chosen.mean().index, chosen.mean(), style, marker="o", ms=3, color=colour)
    for order, start in ((1, 0.5), (2, 0.08)):
        x = np.array([table.ratio.min(), 1.0])
        left.loglog(x, start * x**order, color="0.4", lw=0.9, ls=":")
        left.annotate(f"order {order}", (x[0], start * x[0] ** order), (2, 4), color="0.3",
                      textcoords="offset points", fontsize=8.5)  # fmt: skip
    left.set(xlabel=r"step / time constant", ylabel="largest error of a unit")
    right.set(xlabel=r"step / time constant", ylabel="relative difference of gradients")
    right.plot([], color="0.3", label="states at the ends of steps")
    right.plot([], color="0.3", ls="--", label="states of the stages")
    right.legend(fontsize=8.5, loc="center right")
    fig.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=9)
    return fig


def instability(table: pd.DataFrame) -> Figure:
    """Share of networks with a growing mode, by time constant over step."""
    fig, ax = plt.subplots(figsize=(7.2, 3.2))
    nets = table[table.net != "leak alone"]
    tasks = list(dict.fromkeys(nets.net))
    for integrator, style in (("euler", "-"), ("heun", "--")):
        chosen = nets[nets.integrator == integrator]
        for task, colour in zip(tasks, COLOURS, strict=False):
            share = (chosen[chosen.net == task].growth > 1 + 1e-9).groupby(chosen.ratio).mean()
            ax.plot(share.index, share, style, color=colour, lw=1.3)
    for task, colour in zip(tasks, COLOURS, strict=False):
        ax.plot([], color=colour, label=task)
    ax.plot([], color="0.3", label="Euler")
    ax.plot([], color="0.3", ls="--", label="Heun")
    ax.axvline(1, color=PRINTED, lw=1, ls=":")
    ax.set(xlabel="time constant / step", ylabel="share of networks", ylim=(-0.03, 1.03))
    ax.legend(fontsize=9, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return fig


def memory_table(table: pd.DataFrame) -> pd.DataFrame:
    """Steps and seconds until an impulse is forgotten: median, and range over networks.

    Then how many networks still feel it, apart for those that are stable at rest and for those
    that are not.
    """
    records = []
    for net, own in table.groupby("net", sort=False):
        still, unstable = own.steps.isna(), own.growth > 1
        done = own.dropna(subset="steps")
        n = done.steps
        records.append(
            {
                "network": net,
                "steps": f"{n.median():.0f} ({_range(n.min(), n.max(), 0)})" if len(n) else "–",
                "seconds": f"{done.seconds.median():.2f}" if len(done) else "–",
                "unstable at rest": f"{unstable.sum()} of {len(own)}",
                "of them still feel it": f"{(still & unstable).sum()}" if unstable.any() else "–",
                "stable ones that do": f"{(still & ~unstable).sum()} of {(~unstable).sum()}",
            }
        )
    return pd.DataFrame(records)
