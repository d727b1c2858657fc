r"""Potential-based shaping rewards (section 3.1).

Learners take a potential by them or, equivalently, by initialisation: see
:func:`thesis_lib.mdp.learning.learn`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def state_shaping(potential: ArrayLike, discount: float, s: int, s_next: int) -> float:
    r"""Potential-based shaping reward over states, :math:`F = \gamma\Phi(s') - \Phi(s)`.

    Parameters
    ----------
    potential
        :math:`\Phi`, shape ``(S,)``; 0 at terminal states.
    discount
        gamma.
    s, s_next
        Indices of the states.

    Notes
    -----
    Source: section 3.1, after Ng, Harada and Russell (1999).
    """
    phi = np.asarray(potential, dtype=float)
    return float(discount * phi[s_next] - phi[s])


def look_ahead_advice(
    potential: ArrayLike, discount: float, s: int, a: int, s_next: int, a_next: int
) -> float:
    r"""Shaping reward over pairs, :math:`F = \gamma\Phi(s', a') - \Phi(s, a)` (section 3.1).

    Parameters
    ----------
    potential
        :math:`\Phi`, shape ``(S, A)``; 0 at terminal states.
    discount
        gamma.
    s, a, s_next, a_next
        Indices; ``a_next`` as in the learning rule.

    Notes
    -----
    Source: section 3.1, after Wiewiora, Cottrell and Elkan (2003).

    Examples
    --------
    >>> look_ahead_advice([[0.0, 1.0], [2.0, 3.0]], 0.5, s=0, a=1, s_next=1, a_next=1)
    0.5
    """
    phi = np.asarray(potential, dtype=float)
    return float(discount * phi[s_next, a_next] - phi[s, a])
