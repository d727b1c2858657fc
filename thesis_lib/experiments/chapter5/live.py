"""A small policy trained while the page is made (section 5.5.1)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import pandas as pd

from thesis_lib.edition.experiment import Context, Experiment
from thesis_lib.training.config import TrainConfig, step_size
from thesis_lib.training.run import CURVE_COLUMNS, Training
from thesis_lib.training.train import train


@dataclass(frozen=True)
class LiveConfig:
    """Settings of section-5.5.1-live."""

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
        return TrainConfig(
            task=self.task,
            architecture=self.architecture,
            seed=seed,
            iterations=self.iterations,
            batch_steps=self.batch_steps,
            horizon=self.horizon,
        )


@lru_cache(maxsize=8)
def trained(run: TrainConfig) -> Training:
    """A run brought to its last iteration; the same settings give the same one."""
    return train(run)


def live(config: LiveConfig, context: Context) -> pd.DataFrame:
    """Learning curves of a few runs."""

    def learn(seed: int) -> pd.DataFrame:
        run = config.run(seed)
        return trained(run).curve.assign(seed=seed, delta_kl=step_size(run))

    seeds = [context.seed + i for i in range(config.seeds)]
    return pd.concat(context.map(learn, seeds, "runs"), ignore_index=True)


SECTION_5_5_1_LIVE = Experiment(
    id="section-5.5.1-live",
    item="Section 5.5.1",
    title="One network learning to run, a few iterations",
    function=live,
    budgets={
        "smoke": LiveConfig(iterations=1, batch_steps=200, horizon=100, seeds=2),
        "book": LiveConfig(),
        "thesis": LiveConfig(iterations=500, batch_steps=50_000, seeds=5),
    },
    columns={
        **CURVE_COLUMNS,
        "seed": "of the run",
        "delta_kl": "bound on the divergence of an update [nat], from table 5.1",
    },
    seconds={"smoke": 0.5, "book": 40, "thesis": 4000},
)
