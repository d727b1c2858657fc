"""The divergence of a small step and its quadratic approximation (section 2.3.5)."""

from __future__ import annotations

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from thesis_lib.arrays import FloatArray
from thesis_lib.chapter2.every_trajectory import (
    START,
    THETA,
    TRANSITION,
    scores,
    softmax_policy,
    trajectories,
)
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion, effect_of

DIRECTION = np.array([1.0, -0.4, -0.7, 0.2])
"""Of the steps, in the four parameters."""


def kullback_leibler(p: FloatArray, q: FloatArray) -> FloatArray:
    r""":math:`D_{KL}(p\|q)` of each row, in nats; shape ``(S, A)`` to ``(S,)``."""
    return (p * np.log(p / q)).sum(axis=1)


def state_distribution(steps: int, theta: FloatArray = THETA) -> FloatArray:
    """How often the policy visits each state, on average over an episode, shape ``(2,)``."""
    policy = softmax_policy(theta)
    chain = np.einsum("sa,sat->st", policy, TRANSITION)
    now, total = START, np.zeros(2)
    for _ in range(steps):
        total = total + now
        now = now @ chain
    return total / steps


@dataclass(frozen=True)
class Config:
    """Episodes of the small task, and lengths of the step."""

    steps: int = 6
    """Length of the episodes."""
    scales: tuple[float, ...] = tuple(np.logspace(-3, 0.5, 15).round(6).tolist())
    """Lengths of the step in parameter space."""


@dataclass(frozen=True)
class Divergence:
    """Divergence of a step of one length, and three quadratic forms of it."""

    scale: float
    """Length of the step in parameter space."""
    kl_new_old: float
    """Mean over visited states of KL(new || old) [nat], the order of eq. 2.14."""
    kl_old_new: float
    """Mean over visited states of KL(old || new) [nat]."""
    half_quadratic: float
    """One half step' F step, F per visited state [nat]."""
    printed_quadratic: float
    """step' F step, without the half, F per visited state [nat]."""
    trajectory_quadratic: float
    """step' F step as the thesis prints it, F of the score of a trajectory [nat]."""
    steps: int
    """Steps of an episode."""


@experiment(
    "ch2-kl-quadratic",
    item="Section 2.3.5",
    smoke=Config(steps=3),
    book=Config(),
    seconds=0.008,
)
def divergences(config: Config, context: Context) -> list[Divergence]:
    """KL divergence of a policy step against its quadratic approximation."""
    every = trajectories(config.steps)
    score = scores(THETA)
    occupancy = state_distribution(config.steps)
    old = softmax_policy(THETA)
    per_state = np.einsum("s,sa,sai,saj->ij", occupancy, old, score, score)
    along = score[every.states, every.actions].sum(axis=1)
    of_trajectory = np.einsum("n,ni,nj->ij", every.probability, along, along)
    unit = DIRECTION / np.linalg.norm(DIRECTION)
    records = []
    for scale in config.scales:
        step = scale * unit
        new = softmax_policy(THETA + step.reshape(THETA.shape))
        records.append(
            Divergence(
                scale,
                kl_new_old=float(occupancy @ kullback_leibler(new, old)),
                kl_old_new=float(occupancy @ kullback_leibler(old, new)),
                half_quadratic=float(0.5 * step @ per_state @ step),
                printed_quadratic=float(step @ per_state @ step),
                trajectory_quadratic=float(step @ of_trajectory @ step),
                steps=config.steps,
            )
        )
    return records


def smallest(table: pd.DataFrame) -> pd.Series:
    """The shortest step."""
    return table.loc[table.scale.idxmin()]


@criterion("2.3.5-kl-quadratic", divergences)
def quadratic(table: pd.DataFrame) -> Finding:
    """The divergence of the shortest step over the form with and without the half, F of a state."""
    short = smallest(table)
    printed = short.kl_new_old / short.printed_quadratic
    half = short.kl_new_old / short.half_quadratic
    holds = abs(printed - 1) < 0.01
    missing = "" if holds or abs(half - 1) >= 0.01 else ": a factor 1/2 is missing in print"
    return Finding(
        Verdict.REPRODUCED if holds else Verdict.REFUTED,
        f"For a step of length {short.scale:g} the divergence is {printed:.4f} times the form "
        f"with the F of a state and {half:.4f} times half of it{missing}. It is "
        f"{short.kl_new_old / short.trajectory_quadratic:.4f} times the printed form, whose F is "
        "that of trajectories.",
        {"printed": printed, "half": half},
    )


@effect_of("2.3.5-half", divergences)
def step_length(table: pd.DataFrame) -> str:
    """How much leaving out the half shortens a step."""
    short = smallest(table)
    ratio = (short.printed_quadratic / short.kl_old_new) ** 0.5
    return (
        f"Without the one half every step would be {ratio:.3f} times shorter than the divergence "
        "allows."
    )


@effect_of("2.3.5-fisher", divergences)
def fisher_of_trajectories(table: pd.DataFrame) -> str:
    """How much larger the printed matrix is."""
    short = smallest(table)
    ratio = short.trajectory_quadratic / short.printed_quadratic
    return (
        f"On episodes of {short.steps:g} steps the printed matrix is {ratio:.3f} times the one "
        "that belongs to the divergence of equation 2.14, so that the step would be shorter by "
        "the square root of that."
    )


@effect_of("2.3.5-kl-order", divergences)
def order(table: pd.DataFrame) -> str:
    """What the order of the two policies changes, for a short step and a long one."""
    near, far = smallest(table), table.loc[(table.kl_old_new - 0.1).abs().idxmin()]
    return (
        f"For a short step the two agree (ratio {near.kl_old_new / near.kl_new_old:.4f}); for one "
        f"of divergence {far.kl_old_new:.2g} the other order gives {far.kl_new_old:.2g}."
    )


def figure(table: pd.DataFrame) -> Figure:
    """The divergence in both orders (lines) and three quadratic forms (marks), by length."""
    fig, ax = plt.subplots()
    for column, style, text in (
        ("kl_new_old", "-", "KL (new, old)"),
        ("kl_old_new", "--", "KL (old, new)"),
        ("half_quadratic", "xk", "half the quadratic form"),
        ("printed_quadratic", "Dk", "the form without the half"),
        ("trajectory_quadratic", "+k", "as printed, F of trajectories"),
    ):
        ax.loglog(table.scale, table[column], style, ms=5, mfc="none", label=text)
    ax.set(xlabel="length of the step", ylabel="divergence [nat]")
    ax.legend()
    return fig
