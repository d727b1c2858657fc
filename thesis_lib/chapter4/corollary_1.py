"""Corollary 1: k-relevance tends to the domain relevance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.chapter4.random_domains import BOOK, SMOKE, WEIGHTS, Config, random_curves
from thesis_lib.edition.criteria import judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, criterion
from thesis_lib.edition.plots import COLOURS
from thesis_lib.edition.words import several


@dataclass(frozen=True)
class Distance:
    """Distance of k-relevance from its limit in the random domains of one kind."""

    kind: str
    """p(x|m): shared by all tasks; uniform on each task's own subset of pairs; any weights."""
    k: int
    """Sequence length."""
    mean_distance: float
    """Mean |rho_k - rho_inf|."""
    mean_rest: float
    """Mean |rho_k - rho_inf - c/k|, c the exact rate."""
    n_domains: int
    """Number of random domains."""


@experiment("corollary-1", item="Corollary 1", smoke=SMOKE, book=BOOK, thesis=Config(), seconds=6)
def distances(config: Config, context: Context) -> list[Distance]:
    """Distance of k-relevance from domain relevance, over k, in random domains."""
    records = []
    for curves in random_curves(config, context):
        for rho, k in zip(curves.rho.T, config.lengths.tolist(), strict=True):
            gap = rho - curves.limit
            rest = gap - curves.slope / k
            records.append(
                Distance(
                    kind=curves.kind,
                    k=k,
                    mean_distance=float(np.abs(gap).mean()),
                    mean_rest=float(np.abs(rest).mean()),
                    n_domains=len(gap),
                )
            )
    return records


@criterion("4.1.2-corollary-1", distances)
def tends_to_the_domain_relevance(table: pd.DataFrame) -> Finding:
    """Distance from the domain relevance at k = 1000 over that at k = 1."""
    by = table.pivot(index="kind", columns="k", values="mean_distance")
    shares = by[1000] / by[1]
    listed = several(f"{share:.2%} ({WEIGHTS[kind]})" for kind, share in shares.items())
    return judged(
        shares.max() < 0.01,
        f"Mean distance from the limit at k = 1000, of that at k = 1: {listed}.",
        dict(shares),
        direction=shares.max() < 1,
    )


def figure(table: pd.DataFrame) -> Figure:
    """Distance from the limit over k, and what is left of it after the 1/k term."""
    fig, axes = plt.subplots(1, 2, figsize=(7.2, 3.2), sharex=True)
    for i, (kind, own) in enumerate(table.groupby("kind", sort=False)):
        look: dict[str, Any] = {"marker": "o", "ms": 3, "color": COLOURS[i]}
        axes[0].loglog(own.k, own.mean_distance, label=WEIGHTS[str(kind)], **look)
        axes[1].loglog(own.k, own.mean_rest.clip(lower=1e-17), **look)
    axes[0].set(xlabel="k", ylabel=r"mean $|\rho_k - \rho_\infty|$")
    axes[1].set(xlabel="k", ylabel=r"mean $|\rho_k - \rho_\infty - c/k|$")
    fig.legend(loc="outside lower center", ncols=3, fontsize=8)
    return fig
