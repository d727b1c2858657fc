"""What the text leaves open on the heat domain, and what each choice changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from thesis_lib.chapter4.heat_runs import Config as HeatConfig
from thesis_lib.chapter4.heat_runs import measure_heat
from thesis_lib.chapter4.heat_space import HeatLearner, HeatSpace
from thesis_lib.chapter4.looks import two_rates
from thesis_lib.chapter4.protocol import Protocol
from thesis_lib.chapter4.runs import Kept
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Effect, effect_of
from thesis_lib.selection import rates

READINGS: Mapping[str, Mapping[str, Any]] = {
    "as used": {},
    "stride .25": {"world": {"stride": 0.25}},
    "stride 1": {"world": {"stride": 1.0}},
    "turn pi/16": {"world": {"turn": np.pi / 16}},
    "turn pi/4": {"world": {"turn": np.pi / 4}},
    "heat exponential": {"world": {"intensity": "exponential"}},
    "heat linear": {"world": {"intensity": "linear"}},
    "noise in shares of the range": {"world": {"noise_scale": "range"}},
    "alpha .1": {"learner": {"alpha": 0.1}},
    "alpha .6": {"learner": {"alpha": 0.6}},
    "accumulating traces": {"learner": {"traces": "accumulating", "alpha": 0.1}},
    "gamma .98": {"learner": {"discount": 0.98}},
    "positions fine": {"space": {"layout": "positions"}},
    "sources off the walls": {"space": {"sources": "inside"}},
    "p(x|m) uniform": {"space": {"weighting": "uniform"}},
    "tiling may go": {"space": {"tilings": "feature"}},
    "observed tasks shaped": {"config": {"lessons": "shaped"}},
    "level 1e-4": {"config": {"fstek": 1e-4}},
    "level 1e-3": {"config": {"fstek": 1e-3}},
}
"""Options by reading, one changed at a time."""

METHODS = ("fs-tek", "none", "constant")

BASE = HeatConfig(
    sensors=(0.02,),
    protocol=Protocol(runs=8, tasks_seen=(5, 8), methods=METHODS),
    followed=0,
)

SMALL = HeatConfig(
    space=HeatSpace(learner=HeatLearner(episodes=3)),
    sensors=(0.02,),
    protocol=Protocol(runs=2, tests=1, tasks_seen=(4,), methods=METHODS),
    first=1,
    followed=0,
)


@dataclass(frozen=True)
class Config:
    """Settings of the comparison of readings."""

    base: HeatConfig = BASE
    """What every reading starts from."""
    readings: tuple[str, ...] = tuple(READINGS)
    """Keys of :data:`READINGS`."""


def changed(base: HeatConfig, reading: str) -> HeatConfig:
    """The config with one reading's options."""
    options = READINGS[reading]
    space = replace(
        base.space,
        world=replace(base.space.world, **options.get("world", {})),
        learner=replace(base.space.learner, **options.get("learner", {})),
        **options.get("space", {}),
    )
    return replace(base, space=space, **options.get("config", {}))


@dataclass(frozen=True)
class Reading(Kept):
    """One reading after one number of observed tasks; x, y and heading count as irrelevant."""

    reading: str
    """Which option differs from the one used."""
    sensor: float
    """sigma_sensor; sigma_slip is .1."""
    gain: float
    """FS-TEK's return of the first five episodes less that without selection, paired."""
    gain_ci95: float
    """Half-width of its 95% t interval over runs."""
    constant_gain: float
    """The constant potential's return less that without selection, paired."""
    constant_gain_ci95: float
    """Half-width of its 95% t interval over runs."""
    none_return: float
    """Mean return of the first five episodes without selection."""
    n_runs: int
    """Number of runs."""


@experiment(
    "ch4-heat-readings",
    item="Figures 4.7 and 4.8 (readings)",
    smoke=Config(SMALL),
    book=Config(),
    thesis=Config(replace(BASE, protocol=replace(BASE.protocol, runs=100))),
    seconds=23,
)
def by_reading(config: Config, context: Context) -> list[Reading]:
    """FS-TEK on the heat domain, by reading of what the text leaves open."""
    records = []
    for reading in config.readings:
        own = changed(config.base, reading)
        fstek, none, constant = (own.protocol.methods.index(m) for m in METHODS)
        for sensor in own.sensors:
            space = own.space.with_noise(sensor)
            runs = measure_heat(own, space, context, test=True)
            runs = replace(runs, returns=runs.returns[..., : own.first].sum(axis=-1))
            # Where the tiling may go it is neither right nor wrong to remove it.
            counted = np.array(space.feature_names) != "tiling"
            truth = own.truth[counted]
            for j, n in enumerate(own.protocol.tasks_seen):
                gain, control = (runs.ahead_of(j, method, none) for method in (fstek, constant))
                fpr, tpr = rates(runs.support[:, j, fstek][:, counted], truth)
                records.append(
                    Reading(
                        reading=reading,
                        sensor=sensor,
                        tasks_seen=n,
                        gain=gain.mean,
                        gain_ci95=gain.half_width,
                        constant_gain=control.mean,
                        constant_gain_ci95=control.half_width,
                        none_return=float(runs.returns[:, j, none].mean()),
                        fpr=fpr,
                        tpr=tpr,
                        n_runs=own.protocol.runs,
                    )
                )
    return records


def _few(table: pd.DataFrame) -> pd.DataFrame:
    """After the fewest tasks, at the lowest noise."""
    return table[
        (table.sensor == table.sensor.min()) & (table.tasks_seen == table.tasks_seen.min())
    ]


def _effect(difference: str, *readings: str) -> Effect:
    """Tells what readings do to FS-TEK's gain and rates after few tasks."""

    def gains_of(table: pd.DataFrame) -> str:
        own = _few(table)
        own = own[own.reading.isin(("as used", *readings))]
        listed = "; ".join(
            f"{r.reading} {r.gain:+.0f} ± {r.gain_ci95:.0f} of {r.none_return:.0f}, {pair}"
            for r, pair in zip(own.itertuples(), two_rates(own), strict=True)
        )
        return (
            f"FS-TEK's gain after {own.tasks_seen.iloc[0]} tasks in the first five episodes, and "
            f"its FPR/TPR: {listed} (n = {own.n_runs.iloc[0]} runs)."
        )

    return effect_of(difference, by_reading)(gains_of)


layout = _effect("4.3-heat-layout", "positions fine")
tiling = _effect("4.3-heat-tiling", "tiling may go")
weighting = _effect("4.3-heat-weighting", "p(x|m) uniform")
moves = _effect("4.3-heat-moves", "stride .25", "stride 1", "turn pi/16", "turn pi/4")
law = _effect("4.3-heat-law", "heat exponential", "heat linear")
noise_scale = _effect("4.3-heat-noise-scale", "noise in shares of the range")
alpha = _effect("4.3-heat-alpha", "alpha .1", "alpha .6", "accumulating traces", "gamma .98")
level = _effect("4.3-heat-level", "level 1e-4", "level 1e-3")
start = _effect("4.3-heat-start", "sources off the walls")
solutions = _effect("4.3-heat-solutions", "observed tasks shaped")


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Gains and rates by reading after the fewest tasks."""
    own = _few(table)
    gain = own.gain.map("{:+.0f}".format) + " ± " + own.gain_ci95.map("{:.0f}".format)
    return pd.DataFrame(
        {
            "reading": own.reading,
            "gain": gain,
            "no selection": own.none_return.map("{:.0f}".format),
            "constant gains": own.constant_gain.map("{:+.0f}".format),
            "FPR / TPR": two_rates(own).str.replace("/", " / "),
        }
    )
