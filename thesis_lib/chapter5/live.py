"""A small policy trained while the page is made (section 5.5.1)."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import lru_cache

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.chapter5.networks import NAMES
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.plots import COLOURS, PRINTED
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.training.config import TrainConfig, step_size, table_5_1
from thesis_lib.training.run import CURVE_COLUMNS, Training
from thesis_lib.training.train import train


@dataclass(frozen=True)
class Config:
    """Which runs are made."""

    task: str = "HalfCheetah"
    """Robot that learns."""
    architecture: str = "dtrnn"
    """Its network."""
    iterations: int = 60
    """Iterations of each run."""
    batch_steps: int = 10_000
    """Steps of an iteration."""
    horizon: int = 500
    """Steps of an episode."""
    seeds: int = 3
    """Runs."""

    def run(self, seed: int) -> TrainConfig:
        """The training run of a seed: as ``thesis train`` would make it."""
        settings = asdict(self)
        del settings["seeds"]
        return TrainConfig(**settings, seed=seed)


@lru_cache(maxsize=8)
def trained(run: TrainConfig) -> Training:
    """A run brought to its last iteration; the same settings give the same one."""
    return train(run)


@experiment(
    "ch5-live",
    item="Section 5.5.1",
    smoke=Config(iterations=1, batch_steps=200, horizon=100, seeds=2),
    book=Config(iterations=30, seeds=2),
    thesis=Config(iterations=500, batch_steps=50_000, seeds=5),
    seconds=40,
    columns={
        **CURVE_COLUMNS,
        "seed": "of the run",
        "delta_kl": "bound on the divergence of an update [nat], from table 5.1",
    },
)
def curves(config: Config, context: Context) -> pd.DataFrame:
    """One network learning to run, a few iterations."""

    def learn(seed: int) -> pd.DataFrame:
        run = config.run(seed)
        return trained(run).curve.assign(seed=seed, delta_kl=step_size(run))

    seeds = [context.seed + i for i in range(config.seeds)]
    return pd.concat(context.map(learn, seeds, "runs"), ignore_index=True)


def figure(table: pd.DataFrame) -> Figure:
    """Return and divergence of a few runs, iteration by iteration."""
    fig, (left, right) = plt.subplots(1, 2, figsize=(7.2, 3.3))
    steps = table.groupby("iteration").steps.mean() / 1000
    for _, own in table.groupby("seed"):
        left.plot(
            own.steps / 1000, own.mean_return, ".-", ms=2, color=COLOURS[0], lw=0.9, alpha=0.7
        )
        right.plot(own.iteration, own.kl, "o", color=COLOURS[0], ms=3, mfc="none")
    left.plot(steps, table.groupby("iteration").mean_return.mean(), color=COLOURS[0], lw=2.2)
    right.axhline(table.delta_kl.iloc[0], color=PRINTED, ls="--", lw=1.2, label=r"$\delta_{KL}$")
    left.set(xlabel="thousands of control steps", ylabel="mean return of an episode")
    right.set(xlabel="update", ylabel="divergence [nat]")
    right.set_ylim(0, 1.15 * max(table.delta_kl.iloc[0], table.kl.max()))
    right.legend(loc="lower right")
    return fig


def bounds() -> pd.DataFrame:
    """Step sizes of table 5.1, tasks by networks, with those used where it has none in bold."""
    records = []
    for task in ROBOTS:
        record = {"task": task}
        for net in ("ctrnn", "dtrnn", "gru", "esn", "lstm", "ffwd", "dffwd"):
            printed = table_5_1(task, net, "delta_kl")
            used = step_size(TrainConfig(task=task, architecture=net))
            record[NAMES[net]] = f"**{used:g}**" if printed is None else f"{used:g}"
        records.append(record)
    return pd.DataFrame(records)
