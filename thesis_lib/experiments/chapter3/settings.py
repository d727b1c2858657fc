"""One learner setting a domain, for experiments that go over all domains of chapter 3."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from thesis_lib.domains import Domain, continuing_cliff, episodic_cliff, stock, triangle
from thesis_lib.experiments.chapter3.common import Learner


@dataclass(frozen=True)
class Setting:
    """A domain with the learners its figure or table uses.

    Attributes
    ----------
    domain
        Builds the domain.
    learners
        Learner settings: those printed, or the best found in the figure's sweep.
    """

    domain: Callable[[], Domain]
    learners: tuple[Learner, ...]


SETTINGS: Mapping[str, Setting] = {
    "episodic cliff": Setting(
        lambda: episodic_cliff(False),
        (
            Learner("q_learning", 1.0, 0.1, episodes=600),
            Learner("sarsa", 0.4, 0.1, episodes=600),
        ),
    ),
    "episodic cliff with sensor": Setting(
        lambda: episodic_cliff(True),
        (
            Learner("q_learning", 1.0, 0.1, episodes=600),
            Learner("sarsa", 0.4, 0.1, episodes=600),
        ),
    ),
    "continuing cliff": Setting(
        lambda: continuing_cliff(0.95),
        (
            Learner("q_learning", 0.1, 0.01, steps=20_000),
            Learner("sarsa", 0.1, 0.01, steps=20_000),
        ),
    ),
    "triangle": Setting(triangle, (Learner("q_learning", 0.5, 0.01, episodes=10),)),
    "stock": Setting(
        lambda: stock(1, 2, 2, discount=0.9), (Learner("q_learning", 0.2, 0.1, steps=300),)
    ),
}
"""The domains of chapter 3 by name."""
