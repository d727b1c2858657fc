"""Networks as filters (section 5.2, and the explanation of section 5.5.2): before training."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from thesis_lib.arrays import FloatArray
from thesis_lib.chapter5.networks import (
    FAST,
    GAIT,
    NETS,
    SLOW,
    gain_shares,
    low_to_high,
    random_direction,
    rms,
    untrained_net,
)
from thesis_lib.edition.criteria import judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, criterion
from thesis_lib.edition.plots import COLOURS, panels
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.policies import GaussianPolicy
from thesis_lib.policies.response import measured_gain, small_signal_gain


@dataclass(frozen=True)
class Spectrum:
    """How a gain is measured."""

    amplitude: float = 1.0
    """Standard deviation of the noise: the perturbation of section 5.4."""
    steps: int = 2**15
    """Length of the noise."""
    segment: int = 512
    """Steps of a segment of the spectrum."""

    def points(
        self,
        policy: GaussianPolicy,
        dt: float,
        direction: FloatArray,
        generator: np.random.Generator,
    ) -> list[tuple[float, float, float]]:
        """Gain of one network over frequency.

        Parameters
        ----------
        policy
            The network.
        dt
            Control step [s].
        direction
            Along which the signal is fed, shape ``(dim(o),)``.
        generator
            Of the noise.

        Returns
        -------
        list of tuple
            Frequency [Hz], measured gain, and gain of the network linearised at rest: NaN where
            it is never at rest, or unstable there.
        """
        frequency, gain = measured_gain(
            policy,
            dt,
            direction,
            amplitude=self.amplitude,
            generator=generator,
            steps=self.steps,
            segment=self.segment,
        )
        # The mean was taken out of every segment, and with it the lowest frequency.
        frequency, gain = frequency[1:], gain[1:]
        try:
            small = rms(small_signal_gain(policy, dt, direction, frequency))
        except ValueError:
            small = np.full(len(frequency), np.nan)
        return list(zip(frequency, rms(gain), small, strict=True))


@dataclass(frozen=True)
class Config(Spectrum):
    """Which networks are measured, and how."""

    task: str = "Hopper"
    """Whose sizes and control step are used."""
    seeds: int = 5
    """Networks of each kind."""


@dataclass(frozen=True)
class Point:
    """Gain of one network at one frequency."""

    net: str
    """A key of NETS."""
    seed: int
    """Seed of the initial weights and of the direction of the input."""
    frequency: float
    """Hz."""
    gain: float
    """Measured with white noise, root mean square over the actions."""
    small_signal_gain: float
    """Of the network linearised at rest; empty if it is unstable there."""


@experiment(
    "ch5-gain",
    item="Section 5.2",
    smoke=Config(seeds=1, steps=2048, segment=256),
    book=Config(steps=2**14),
    thesis=Config(),
    seconds=19,
)
def untrained(config: Config, context: Context) -> list[Point]:
    """Gain of every architecture over frequency, before training."""
    dt = ROBOTS[config.task].control_dt

    def measure(job: tuple[str, int]) -> list[Point]:
        name, seed = job
        policy = untrained_net(name, config.task, seed)
        along, noise = context.seeds(2, seed)
        direction = random_direction(policy.observation_size, along)
        generator = np.random.default_rng(noise)
        return [Point(*job, *p) for p in config.points(policy, dt, direction, generator)]

    jobs = [(name, seed) for name in NETS for seed in range(config.seeds)]
    return [point for found in context.map(measure, jobs, "networks") for point in found]


def low_pass(table: pd.DataFrame, stage: str) -> Finding:
    """Whether the CTRNN takes the most of fast signals, whatever its initial time constant.

    Parameters
    ----------
    table
        Columns ``net``, ``seed``, ``frequency`` and ``gain``.
    stage
        In words, such as ``before training``.
    """
    shares = pd.concat({net: gain_shares(own) for net, own in table.groupby("net")})
    ratio, kept = shares.noise.unstack(), shares.gait.unstack().mean(axis=1)
    ours = ratio.index.str.startswith("CTRNN")
    least = ratio[~ours].min()
    wins = (ratio[ours] < least).mean(axis=1)
    mean = ratio.mean(axis=1)
    best = mean[~ours].idxmin()
    evidence = (
        f"Gain above {FAST:g} Hz over that below {SLOW:g} Hz, {stage}: "
        + " and ".join(f"{mean[net]:.3f} ({net})" for net in mean.index[ours])
        + f"; the next is {best} with {mean[best]:.2f}. At {GAIT:g} Hz, taken for a gait, "
        + " and ".join(f"{kept[net]:.2f}" for net in mean.index[ours])
        + f" of the slow gain is left ({best}: {kept[best]:.2f})."
    )
    return judged((wins == 1).all(), evidence, direction=wins.mean() > 0.5)


@criterion("5.2-low-pass", untrained)
def low_pass_before_training(table: pd.DataFrame) -> Finding:
    """Gain at the frequencies of noise over that of slow signals, before training."""
    return low_pass(table, "before training")


def net_panels(
    names: Iterable[str], height: float, *, spare: bool = True
) -> tuple[Figure, list[Axes], Axes]:
    """A panel a network, three a row; last, where the legend goes: one more, or the first."""
    names = list(names)
    fig, axes = panels(len(names) + spare, 3, height, 0.2, sharex=True, sharey=True)
    for ax, name in zip(axes, names, strict=False):
        ax.set_title(name, fontsize=10)
        ax.tick_params(labelsize=8.5)
    if not spare:
        return fig, axes, axes[0]
    axes[-1].axis("off")
    return fig, axes[:-1], axes[-1]


def logarithmic(n: int) -> list[np.ndarray]:
    """Rows 0 to n - 1 in at most 40 runs, about equally wide on a logarithmic axis."""
    bins = np.unique(np.geomspace(1, n, 40).astype(int) - 1)
    return np.split(np.arange(n), bins[1:])


def figure(table: pd.DataFrame) -> Figure:
    """Gain over frequency, over that at the lowest frequencies: measured and linearised."""
    fig, axes, spare = net_panels(table.net.unique(), 1.8)
    for ax, (_, own) in zip(axes, table.groupby("net", sort=False), strict=True):
        for _, one in own.groupby("seed"):
            slow = one.frequency < SLOW
            f, scale = one.frequency, one.gain[slow].mean()
            parts = logarithmic(len(f))
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


def bands(gait: float = GAIT) -> dict[str, str]:
    """Headings of the columns of :func:`gain_shares`, for a gait's frequency [Hz]."""
    return {"gait": f"about {gait:g} Hz", "noise": f"above {FAST:g} Hz", "ratio": "noise / gait"}


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """What each network leaves of a gait's frequency and of noise, over slow signals."""
    records = []
    for net, own in table.groupby("net", sort=False):
        shares = gain_shares(own)
        stable = own.groupby("seed").small_signal_gain.apply(lambda g: g.notna().all())
        record: dict[str, object] = {"network": net}
        for column, heading in bands().items():
            share = shares[column]
            record[heading] = f"{share.mean():.2f} ({low_to_high(share)})"
        record["stable at rest"] = f"{stable.sum()} of {len(stable)}"
        records.append(record)
    return pd.DataFrame(records)


def mean_shares(table: pd.DataFrame, gait: float = GAIT) -> pd.DataFrame:
    """Mean of :func:`gain_shares` by network."""
    return pd.DataFrame({net: gain_shares(own, gait).mean() for net, own in table.groupby("net")}).T
