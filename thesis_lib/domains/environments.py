"""The tasks of the domains as Gymnasium environments.

Importing :mod:`thesis_lib` registers ``thesis/EpisodicCliff-v0``,
``thesis/ContinuingCliff-v0``, ``thesis/Triangle-v0``, ``thesis/Stock-v0``,
``thesis/AppendixA1-v0``, ``thesis/AppendixA2-v0`` and ``thesis/AppendixA3-v0``, and the
continuous ``thesis/Heat-v0`` (:class:`~thesis_lib.domains.heat_environment.HeatEnv`).  A
task is named by its index in the domain, and what else is given goes to the function that
makes the domain::

    gymnasium.make("thesis/Stock-v0", task=5, sectors=1, stocks=2, global_factors=3)

Without an import, ``gymnasium.make("thesis_lib:thesis/Stock-v0")`` does the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from numbers import Integral
from types import MappingProxyType
from typing import Any

from thesis_lib.domains.appendix_a import figure_a1, figure_a2, figure_a3
from thesis_lib.domains.cliff import continuing_cliff, episodic_cliff
from thesis_lib.domains.domain import Domain
from thesis_lib.domains.stock import stock
from thesis_lib.domains.triangle import triangle
from thesis_lib.mdp.environment import Observation, TabularEnv
from thesis_lib.registration import find

DOMAINS: Mapping[str, Callable[..., Domain]] = MappingProxyType(
    {
        "EpisodicCliff": episodic_cliff,
        "ContinuingCliff": continuing_cliff,
        "Triangle": triangle,
        "Stock": stock,
        "AppendixA1": figure_a1,
        "AppendixA2": figure_a2,
        "AppendixA3": figure_a3,
    }
)
"""The functions that make a domain, by the name of its environment.

:meta hide-value:
"""


def make(
    domain: str,
    task: int = 0,
    *,
    observation: Observation = "state",
    render_mode: None = None,
    **options: Any,
) -> TabularEnv:
    """One task of a domain as an environment.

    Parameters
    ----------
    domain
        A key of :data:`DOMAINS`, or the name of one that an installed package offers
        (:mod:`thesis_lib.registration`).
    task
        Index of the task in the domain.
    observation
        ``"state"`` or ``"features"``; see :class:`~thesis_lib.mdp.environment.TabularEnv`.
    render_mode
        Only None.
    **options
        Passed to the function that makes the domain.

    Returns
    -------
    TabularEnv

    Raises
    ------
    ValueError
        When there is no such domain or task.
    """
    made = find("domain", domain, DOMAINS)(**options)
    if isinstance(task, bool) or not isinstance(task, Integral) or not 0 <= task < len(made):
        raise ValueError(
            f"task is {task!r}, but domain {made.name!r} has tasks 0 to {len(made) - 1}."
        )
    return TabularEnv(made.tasks[int(task)], observation=observation, render_mode=render_mode)
