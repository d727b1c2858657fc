r"""How well a fixed controller keeps its return when the world changes (section 5.3, table 5.6).

Arrays of returns end in the axes ``(trained on, condition, robot, net)``, in the order of
:data:`TRAINED_ON` and :data:`CONDITIONS`; any axes may come before, such as resamples.  NaN marks
a cell that has not been run, and what rests on it is NaN.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import FloatArray

TRAINED_ON = ("flat", "hill")
"""Ground a controller was trained on (section 5.4)."""

CONDITIONS = ("base", "noise", "switch")
"""The regular test, sensor noise, and the switch from flat to hilly ground (section 5.4)."""

PERTURBATIONS = CONDITIONS[1:]


def score(base: ArrayLike, perturbed: ArrayLike, best: ArrayLike | None = None) -> FloatArray:
    r"""Robustness score, equation 5.4: :math:`s_c = r_c(t_b)\,[1 - |r_c(t_p) - r_c(t_b)|]`.

    Parameters
    ----------
    base, perturbed
        Returns on the base task and on the perturbed one, shape ``(..., C)``, the last axis the
        controllers that are compared.
    best
        :math:`R_{max}` by which returns are scaled, broadcast against them.  Default: the largest
        return on either task of the pair among the C controllers.

    Returns
    -------
    FloatArray
        Shape ``(..., C)``.  In [0, 1] for returns from 0 to ``best``; NaN for a task pair on
        which a controller has not been run.

    Raises
    ------
    ValueError
        When a return is infinite, or the best return is not positive.

    Examples
    --------
    The first controller loses half of its return, the second nothing:

    >>> score(base=[100.0, 80.0], perturbed=[50.0, 80.0]).tolist()
    [0.5, 0.8]
    """
    b, p = _returns(base), _returns(perturbed)
    top = np.maximum(b, p).max(axis=-1, keepdims=True) if best is None else _returns(best)
    if (top <= 0).any():
        raise ValueError(
            f"the best return of a task pair is {np.nanmin(top):g}, but returns are scaled by it "
            "(equation 5.4): it must be positive, so give `best=` or better controllers."
        )
    b, p = b / top, p / top
    return b * (1 - np.abs(p - b))


def quadrants(returns: ArrayLike) -> FloatArray:
    """Scores of figure 5.4.

    Parameters
    ----------
    returns
        Shape ``(..., 2, 3, robots, nets)``.

    Returns
    -------
    FloatArray
        Equation 5.4, shape ``(..., 2, 2, robots, nets)``: trained on, perturbation.  Scores
        compare within a quadrant only, since the best return is that of a task pair.
    """
    r = _grid(returns)
    return score(r[..., :1, :, :], r[..., 1:, :, :])


def retained(returns: ArrayLike) -> FloatArray:
    """Share of its base return that a controller keeps under a perturbation.

    Parameters
    ----------
    returns
        Shape ``(..., 2, 3, robots, nets)``.

    Returns
    -------
    FloatArray
        Perturbed return over base return, shape ``(..., 2, 2, robots, nets)``: trained on,
        perturbation.  NaN where the base return is not positive, of which nothing can be kept.
    """
    r = _grid(returns)
    base = np.broadcast_to(r[..., :1, :, :], r[..., 1:, :, :].shape)
    return np.divide(r[..., 1:, :, :], base, out=np.full(base.shape, np.nan), where=base > 0)


def improvement(returns: ArrayLike) -> FloatArray:
    """Improvement ratio by training on hills, as table 5.6 computes it.

    The text of section 5.5.2 speaks of a "ratio of the drops"; the printed numbers are those of
    the mean over tasks of the ratio of retained shares, hill-trained over flat-trained.

    Parameters
    ----------
    returns
        Shape ``(..., 2, 3, robots, nets)``.

    Returns
    -------
    FloatArray
        By robot, shape ``(..., 2, robots, nets)``: perturbation first; above 1 where a net keeps
        more of its return if it was trained on hills.  Table 5.6 prints the mean over robots.
    """
    kept = retained(returns)
    flat, hill = kept[..., 0, :, :, :], kept[..., 1, :, :, :]
    return np.divide(hill, flat, out=np.full(flat.shape, np.nan), where=flat != 0)


def ratio_of_drops(returns: ArrayLike) -> FloatArray:
    """What the text of section 5.5.2 says of table 5.6: relative drop, hill over flat.

    Arguments and shape as :func:`improvement`; above 1 where hill training makes a net lose a
    larger share.
    """
    drop = 1 - retained(returns)
    flat, hill = drop[..., 0, :, :, :], drop[..., 1, :, :, :]
    return np.divide(hill, flat, out=np.full(flat.shape, np.nan), where=flat != 0)


def _returns(values: ArrayLike) -> FloatArray:
    array = np.asarray(values, dtype=float)
    if np.isinf(array).any():
        raise ValueError("a return is infinite, but returns must be finite, or NaN where not run.")
    return array


def _grid(values: ArrayLike) -> FloatArray:
    array = _returns(values)
    shape = (len(TRAINED_ON), len(CONDITIONS))
    if array.ndim < 4 or array.shape[-4:-2] != shape:
        raise ValueError(
            f"returns have shape {array.shape}, but they must end in trained on (2), condition "
            "(3), robot and net."
        )
    return array
