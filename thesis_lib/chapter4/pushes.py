"""Where Q* and Q~ push the agent on the cliff: the explanation of figures 4.4 and 4.5, exactly.

Section 4.3 explains why performance falls with the number of tasks under Q*, and not under Q~, by
what the two prefer where the sensor reads the cliff, and by position where it reads nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

from thesis_lib import potentials
from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.chapter4.runs import exact_solutions
from thesis_lib.domains import Domain, continuing_cliff
from thesis_lib.domains.cliff import MOVES, SIZE
from thesis_lib.edition.criteria import judged
from thesis_lib.edition.experiment import Context, experiment
from thesis_lib.edition.ledger import Finding, Verdict, criterion
from thesis_lib.potentials import linear_cross_task_weights
from thesis_lib.relevance import Solutions, keep

TIE = 1e-9
"""Values closer than this share of the largest are preferred alike."""


@dataclass(frozen=True)
class Config:
    """What the potentials are made at."""

    discounts: tuple[float, ...] = (0.9, 0.95, 0.99)
    """gamma, which the thesis does not print."""
    epsilon: float = 0.01
    """Exploration rate of Q~."""


@dataclass(frozen=True)
class Push:
    """Where a potential's preferred action leads at one reading of the sensor or one position."""

    discount: float
    """gamma."""
    potential: str
    """Q_star or Q_tilde."""
    by: str
    """sensor: the potential on sensor and action alone, next to a cliff; position: the full
    potential where the sensor reads nothing."""
    where: str
    """The reading, N, E, S or W; or the cell x, y."""
    outward: float
    """By how much a step takes the agent away: from the cliff (1 away, 0 along, -1 into it), or
    from the centre of the grid (rings of cells: from a corner no step leads inwards); mean over
    tied actions."""


@experiment(
    "ch4-pushes", item="Section 4.3 (pushes)", smoke=Config((0.95,)), book=Config(), seconds=0.06
)
def pushes(config: Config, context: Context) -> list[Push]:
    """Where Q* and Q~ push the agent on the cliff, by sensor and by position."""
    rows = []
    for discount in config.discounts:
        domain = continuing_cliff(discount)
        solved = {
            "Q_star": exact_solutions(domain),
            "Q_tilde": Solutions.from_domain(
                domain, potentials.soft_solutions(domain, config.epsilon)
            ),
        }
        for name, solutions in solved.items():
            for by in (_by_sensor, _by_position):
                label = by.__name__.removeprefix("_by_")
                for where, outward in by(domain, solutions):
                    rows.append(Push(discount, name, label, where, outward))
    return rows


def _by_sensor(domain: Domain, solutions: Solutions) -> Iterator[tuple[str, float]]:
    values = _values(domain, solutions, keep(solutions, ["cliff", "a"]))
    for reading, name in enumerate(domain.actions):
        first = int(np.flatnonzero(domain.observations[:, 2] == reading + 1)[0])
        into = MOVES[reading]
        away = [-float(np.dot(into, MOVES[a])) for a in _preferred(values[first])]
        yield name, float(np.mean(away))


def _by_position(domain: Domain, solutions: Solutions) -> Iterator[tuple[str, float]]:
    values = _values(domain, solutions, np.arange(solutions.n_pairs))
    for row, (x, y, sensor) in enumerate(domain.observations):
        if sensor == 0:
            moved = [
                _off_centre(np.clip(np.add((x, y), MOVES[a]), 0, SIZE - 1)) - _off_centre((x, y))
                for a in _preferred(values[row])
            ]
            yield f"{x}, {y}", float(np.mean(moved))


def _values(domain: Domain, solutions: Solutions, labels: IntArray) -> FloatArray:
    weights = linear_cross_task_weights(solutions.q, solutions.p, labels=labels)
    return weights.reshape(domain.shape)


def _off_centre(cell: object) -> float:
    return float(np.abs(np.asarray(cell) - (SIZE - 1) / 2).max())


def _preferred(values: FloatArray) -> IntArray:
    return np.flatnonzero(values >= values.max() - TIE * np.abs(values).max())


def _told(table: pd.DataFrame, potential: str, by: str) -> tuple[pd.DataFrame, str]:
    """Rows, and their means by gamma as a sentence."""
    own = table[(table.potential == potential) & (table.by == by)]
    of = "cliff" if by == "sensor" else "centre"
    parts = ", ".join(
        f"{at.outward.mean():+.2f} at gamma {gamma:g} ({(at.outward > 0).sum()} away, "
        f"{(at.outward < 0).sum()} towards, {(at.outward == 0).sum()} neither)"
        for gamma, at in own.groupby("discount")
    )
    return own, f"Steps away from the {of} that the preferred action takes, mean: {parts}."


@criterion("4.3-cliff-tilde-shies", pushes)
def tilde_shies(table: pd.DataFrame) -> Finding:
    """Whether Q~ prefers the step away at every reading of the sensor."""
    own, told = _told(table, "Q_tilde", "sensor")
    return judged((own.outward == 1).all(), told, otherwise=Verdict.REFUTED)


@criterion("4.3-cliff-star-stays", pushes)
def star_stays(table: pd.DataFrame) -> Finding:
    """Whether Q* prefers steps along the cliff, neither away nor into it, at every reading."""
    own, told = _told(table, "Q_star", "sensor")
    return judged((own.outward == 0).all(), told, otherwise=Verdict.REFUTED)


@criterion("4.3-cliff-star-centre", pushes)
def star_centres(table: pd.DataFrame) -> Finding:
    """Whether Q* pushes towards the centre, on the average over positions, at every gamma."""
    own, told = _told(table, "Q_star", "position")
    mean = own.groupby("discount").outward.mean()
    return judged((mean < 0).all(), told, direction=(mean < 0).any(), otherwise=Verdict.REFUTED)


@criterion("4.3-cliff-tilde-edges", pushes)
def tilde_edges(table: pd.DataFrame) -> Finding:
    """Whether Q~ pushes towards the edges, on the average over positions, at every gamma."""
    own, told = _told(table, "Q_tilde", "position")
    mean = own.groupby("discount").outward.mean()
    return judged((mean > 0).all(), told, direction=(mean > 0).any(), otherwise=Verdict.REFUTED)
