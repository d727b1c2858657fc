"""Networks that are discrete-time ones in disguise (section 5.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import torch

from thesis_lib.edition.criteria import EXACT, exact
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, criterion
from thesis_lib.policies import CTRNN, DTRNN, ESN

EULER = "CTRNN by Euler steps of the time constant"
HEUN = "CTRNN by Heun steps of the time constant"


@dataclass(frozen=True)
class Config:
    """How long networks are compared, and how many."""

    steps: int = 200
    """Steps over which networks are compared, with random inputs."""
    seeds: int = 5
    """Networks."""


@dataclass(frozen=True)
class Gap:
    """One network beside the DTRNN."""

    net: str
    """Compared with the DTRNN of the same weights and inputs."""
    seed: int
    """Of weights and inputs."""
    difference: float
    """Largest difference of a unit in any step."""


@experiment(
    "ch5-identities",
    item="Section 5.2",
    smoke=Config(steps=20, seeds=2),
    book=Config(),
    seconds=0.1,
)
def gaps(config: Config, context: Context) -> list[Gap]:
    """Networks that are discrete-time ones in disguise."""
    records = []
    for seed in range(config.seeds):
        rng = np.random.default_rng(context.seeds(1, seed)[0])
        drives = torch.as_tensor(rng.standard_normal((config.steps, 6)))
        plain = DTRNN(3, 2, units=6, seed=seed, dtype=torch.float64)
        common: dict[str, Any] = {"units": 6, "seed": seed, "dtype": torch.float64}
        step: dict[str, Any] = {"dt": 0.02, "time_constant": 0.02, **common}
        others = {
            EULER: CTRNN(3, 2, integrator="euler", **step),
            HEUN: CTRNN(3, 2, integrator="heun", **step),
            "ESN without leak": ESN(3, 2, leak=1.0, **common),
            "ESN with the author's leak of 0.5": ESN(3, 2, leak=0.5, **common),
        }
        for name, net in others.items():
            with torch.no_grad():
                net.recurrent.weight.copy_(plain.recurrent.weight)
                start = torch.zeros((1, 6), dtype=torch.float64)
                sizes = [1] * config.steps
                gap = net.unroll(drives, sizes, start) - plain.unroll(drives, sizes, start)
            records.append(Gap(name, seed, float(gap.abs().max())))
    return records


@criterion("5.2.2-euler-is-dtrnn", gaps)
def euler_is_discrete(table: pd.DataFrame) -> Finding:
    """Euler steps of the time constant against the discrete-time network."""
    worst = table.groupby("net").difference.max()
    apart = f" by more than {worst[EULER]:.0e}" if worst[EULER] else " at all"
    return exact(
        worst[EULER] < EXACT,
        f"Over random inputs no unit differs{apart}. By the author's "
        f"midpoint steps of the same length the two differ by up to {worst[HEUN]:.2f}.",
    )


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Largest difference from the DTRNN, by network."""
    worst = table.groupby("net").difference.max().rename("largest difference from the DTRNN")
    return worst.rename_axis("network").reset_index()
