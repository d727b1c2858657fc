r"""The linear baseline :math:`b(s_t)` (lines 6 and 7 of algorithms 5 and 6)."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import torch

from thesis_lib.arrays import FloatArray, IntArray

CLIP = 10.0
"""Observations are clipped to +-10 before they become features."""

ATTEMPTS = 5
"""How often the ridge is made ten times larger when the system cannot be solved."""


def baseline_features(observations: FloatArray, time: IntArray) -> FloatArray:
    r"""Features :math:`(o, o^2, t/100, (t/100)^2, (t/100)^3, 1)` of every step.

    Parameters
    ----------
    observations
        What the policy sees, shape ``(R, D)``.
    time
        Step within its episode, shape ``(R,)``.

    Returns
    -------
    FloatArray
        Shape ``(R, 2 D + 4)``.

    Notes
    -----
    Source: the linear feature baseline of Duan et al., which the author's code uses.
    """
    o = np.clip(observations, -CLIP, CLIP)
    s = np.asarray(time, dtype=np.float64)[:, None] / 100.0
    return np.concatenate([o, o**2, s, s**2, s**3, np.ones_like(s)], axis=1)


class Baseline(Protocol):
    r"""Predicts what a policy earns from a step on, :math:`b(s_t)`."""

    def fit(self, observations: FloatArray, time: IntArray, returns: FloatArray) -> None:
        """Learn from a batch; see :class:`LinearBaseline`."""

    def predict(self, observations: FloatArray, time: IntArray) -> FloatArray:
        """Baseline of every step; 0 before the first fit."""

    def state_dict(self) -> dict[str, Any]:
        """Everything an interrupted run needs."""

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take up the state of an interrupted run."""


class LinearBaseline:
    r"""Ridge regression of returns on :func:`baseline_features`.

    Parameters
    ----------
    ridge
        Added to the diagonal of the normal equations.

    Attributes
    ----------
    weights
        Shape ``(2 D + 4,)``, or None before the first fit, when it predicts 0.
    """

    def __init__(self, ridge: float = 1e-5) -> None:
        if not ridge > 0:
            raise ValueError(f"ridge is {ridge}, but it must be positive.")
        self.ridge = float(ridge)
        self.weights: FloatArray | None = None

    def fit(self, observations: FloatArray, time: IntArray, returns: FloatArray) -> None:
        r"""Minimise :math:`\sum_t (R_t - b(s_t))^2` (line 7 of algorithms 5 and 6).

        Parameters
        ----------
        observations, time
            See :func:`baseline_features`.
        returns
            Discounted returns, shape ``(R,)``.

        Raises
        ------
        FloatingPointError
            When the solution is not finite however large the ridge.
        """
        x = baseline_features(observations, time)
        gram, target = x.T @ x, x.T @ returns
        ridge = self.ridge
        for _ in range(ATTEMPTS):
            regularised = gram + ridge * np.identity(len(gram))
            weights = np.linalg.lstsq(regularised, target, rcond=None)[0]
            if np.isfinite(weights).all():
                self.weights = np.asarray(weights, dtype=np.float64)
                return
            ridge *= 10
        raise FloatingPointError("the baseline's regression has no finite solution.")

    def predict(self, observations: FloatArray, time: IntArray) -> FloatArray:
        """Baseline of every step, shape ``(R,)``."""
        if self.weights is None:
            return np.zeros(len(observations))
        return baseline_features(observations, time) @ self.weights

    def state_dict(self) -> dict[str, Any]:
        """The weights, for a run that may be interrupted."""
        return {"weights": None if self.weights is None else torch.as_tensor(self.weights)}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take up the weights of an interrupted run."""
        weights = state["weights"]
        self.weights = None if weights is None else weights.numpy()
