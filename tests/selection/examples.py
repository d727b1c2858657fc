"""Task solutions with planted features, and the thesis's domains solved exactly."""

from functools import cache
from itertools import product
from typing import Literal

import numpy as np

from thesis_lib.domains import Domain
from thesis_lib.mdp import solve
from thesis_lib.relevance import Solutions


@cache
def solved(make: type[Domain] | object, *arguments: object) -> Solutions:
    """Optimal solutions of every task of a domain."""
    domain = make(*arguments)  # type: ignore[operator]
    return Solutions.from_domain(domain, [solve(task).q for task in domain.tasks])


def planted(
    rng: np.random.Generator,
    n_tasks: int,
    *,
    effect: float = 1.0,
    levels: int = 2,
    interaction: bool = False,
    noise: Literal["gaussian", "sign"] = "gaussian",
    shared: bool = True,
) -> Solutions:
    """Feature ``f`` has the effect ``effect`` plus unit noise, ``g`` noise alone.

    f has two values, g ``levels`` values with independent effects.  With ``interaction``
    the noise is independent for each pair.
    """
    features = np.array(list(product(range(2), range(levels))))
    f, g = features.T

    def draw(*shape: int) -> np.ndarray:
        if noise == "sign":
            return rng.choice([-1.0, 1.0], size=shape)
        return rng.normal(size=shape)

    q = (effect + draw(n_tasks))[:, None] * (2 * f - 1.0)
    if levels == 2 and not interaction:
        q = q + draw(n_tasks)[:, None] * (2 * g - 1.0)
    elif not interaction:
        q = q + draw(n_tasks, levels)[:, g]
    else:
        q = q + draw(n_tasks, len(features))
    n = len(features)
    p = (
        np.broadcast_to(np.full(n, 1 / n), q.shape)
        if shared
        else rng.dirichlet(np.full(n, 3.0), n_tasks)
    )
    return Solutions(q, p, features, ("f", "g"))
