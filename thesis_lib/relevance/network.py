r"""Small neural networks as cross-task functions (section 4.5).

One hidden layer, :math:`f(x) = c + \sum_h v_h \tanh(w_h^\top x + b_h)`, fitted to Q-values by
Levenberg and Marquardt's method, many networks side by side.

Two cross-task functions can be made of networks.  One network *fitted to* :math:`Q_c` is no
linear function of :math:`Q_c`, and the law of k-relevance holds for it as far as it is nearly
one.  The *mean of networks*, one a task, is linear in them whatever they are, so that the law
holds exactly for its relevance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from thesis_lib.arrays import BoolArray, FloatArray
from thesis_lib.checks import positive_integer

DAMPING = (1e-12, 1e8)
"""Least and largest damping; a fit with the largest has stopped."""


@dataclass(frozen=True, eq=False)
class Networks:
    """B networks with H hidden units and one output.

    Attributes
    ----------
    weights
        First layer, shape ``(B, I, H)``.
    biases
        Shape ``(B, H)``.
    heads
        Second layer, shape ``(B, H)``.
    offsets
        Shape ``(B,)``.
    """

    weights: FloatArray
    biases: FloatArray
    heads: FloatArray
    offsets: FloatArray

    def __call__(self, inputs: ArrayLike) -> FloatArray:
        """Outputs of every network, shape ``(B, N)``.

        Parameters
        ----------
        inputs
            Shape ``(N, I)``.
        """
        return self.outputs(self.sums(inputs))

    def sums(self, inputs: ArrayLike, which: BoolArray | None = None) -> FloatArray:
        """What inputs add to the sums of all hidden units, shape ``(N, B H)``.

        Parameters
        ----------
        inputs
            Shape ``(N, I)``, or ``(N, J)`` of the inputs ``which``.
        which
            Mask of J of the inputs, shape ``(I,)``; default all.
        """
        x = np.asarray(inputs, dtype=self.weights.dtype)
        side_by_side = self.weights.transpose(1, 0, 2).reshape(self.weights.shape[1], -1)
        return np.matmul(x, side_by_side if which is None else side_by_side[which])

    def outputs(self, sums: FloatArray) -> FloatArray:
        """Outputs of every network, shape ``(B, N)``, from what :meth:`sums` gives."""
        hidden = np.tanh(sums + self.biases.ravel()).reshape(len(sums), *self.heads.shape)
        return np.einsum("nbh,bh->bn", hidden, self.heads) + self.offsets[:, None]

    def single(self) -> Networks:
        """The same networks in single precision, some five times as fast."""
        own: list[Any] = [self.weights, self.biases, self.heads, self.offsets]
        return Networks(*(values.astype(np.float32) for values in own))


def fit_networks(
    inputs: ArrayLike,
    targets: ArrayLike,
    hidden: int,
    rng: np.random.Generator,
    *,
    p: ArrayLike | None = None,
    decay: float = 1e-6,
    iterations: int = 60,
) -> Networks:
    """Fit one network to each row of targets, all from the same random start.

    Parameters
    ----------
    inputs
        Shape ``(N, I)``; best with mean 0 and mean square 1.
    targets
        Shape ``(B, N)``.
    hidden
        Number of hidden units H.
    rng
        Draws the start.
    p
        Weights of the pairs, shape ``(N,)``; default equal.
    decay
        Penalty on the squared parameters, relative to the variance of the targets.
    iterations
        Steps of Levenberg and Marquardt's method at most.

    Returns
    -------
    Networks

    Raises
    ------
    ValueError
        When shapes disagree, a value is not finite or the network has no unit.
    """
    x, y = np.asarray(inputs, dtype=float), np.atleast_2d(np.asarray(targets, dtype=float))
    units = positive_integer("hidden", hidden)
    if x.ndim != 2 or y.shape[1] != len(x) or len(x) == 0:
        raise ValueError(
            f"inputs has shape {x.shape} and targets {y.shape}, but (pairs, inputs) and "
            "(networks, pairs) with the same pairs are needed."
        )
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise ValueError("inputs or targets hold values that are not finite; leave such pairs out.")
    weight = np.full(len(x), 1 / len(x)) if p is None else np.asarray(p, dtype=float)
    # One scale for all networks, so that the penalty treats them alike.
    centre = y @ weight
    scale = float(np.sqrt((((y - centre[:, None]) ** 2) @ weight).mean())) or 1.0
    root = np.sqrt(weight)
    theta = _start(x.shape[1], units, rng)
    theta = np.repeat(theta[None], len(y), axis=0)
    theta = _minimise(theta, x, (y - centre[:, None]) / scale, root, units, decay, iterations)
    found = _unpack(theta, x.shape[1], units)
    return Networks(
        found.weights, found.biases, found.heads * scale, found.offsets * scale + centre
    )


def _start(n_inputs: int, units: int, rng: np.random.Generator) -> FloatArray:
    first = rng.normal(size=(n_inputs + 1, units)) / np.sqrt(n_inputs + 1)
    second = rng.normal(size=units) / np.sqrt(units)
    return np.concatenate([first.ravel(), second, [0.0]])


def _unpack(theta: FloatArray, n_inputs: int, units: int) -> Networks:
    at = (n_inputs + 1) * units
    first = theta[:, :at].reshape(len(theta), n_inputs + 1, units)
    return Networks(first[:, :-1], first[:, -1], theta[:, at : at + units], theta[:, -1])


def _minimise(
    theta: FloatArray,
    x: FloatArray,
    y: FloatArray,
    root: FloatArray,
    units: int,
    decay: float,
    iterations: int,
) -> FloatArray:
    """Levenberg and Marquardt's steps, with a damping of its own for each network."""
    damping = np.full(len(theta), 1e-2)
    cost = _cost(theta, x, y, root, units, decay)
    live = np.ones(len(theta), dtype=bool)
    eye = np.eye(theta.shape[1])
    for _ in range(iterations):
        at = np.flatnonzero(live)
        if len(at) == 0:
            break
        residual, jacobian = _linearise(theta[at], x, y[at], root, units)
        square = np.matmul(jacobian.transpose(0, 2, 1), jacobian)
        slope = np.matmul(jacobian.transpose(0, 2, 1), residual[:, :, None])[..., 0]
        slope += decay * theta[at]
        shift = (damping[at] + decay)[:, None, None] * eye
        step = np.linalg.solve(square + shift, slope[:, :, None])[..., 0]
        proposal = theta[at] - step
        new = _cost(proposal, x, y[at], root, units, decay)
        better = new < cost[at]
        gained = cost[at] - new
        theta[at[better]] = proposal[better]
        live[at] = ~better | (gained > 1e-9 * cost[at])
        cost[at[better]] = new[better]
        damping[at] = np.clip(np.where(better, damping[at] / 3, damping[at] * 4), *DAMPING)
        live[at] &= damping[at] < DAMPING[1]
    return theta


def _cost(
    theta: FloatArray, x: FloatArray, y: FloatArray, root: FloatArray, units: int, decay: float
) -> FloatArray:
    residual = root * (_unpack(theta, x.shape[1], units)(x) - y)
    return (residual**2).sum(axis=1) + decay * (theta**2).sum(axis=1)


def _linearise(
    theta: FloatArray, x: FloatArray, y: FloatArray, root: FloatArray, units: int
) -> tuple[FloatArray, FloatArray]:
    """Weighted residuals ``(B, N)`` and their derivatives ``(B, N, P)``."""
    nets = _unpack(theta, x.shape[1], units)
    active = np.tanh(x @ nets.weights + nets.biases[:, None, :])
    residual = root * ((active @ nets.heads[:, :, None])[..., 0] + nets.offsets[:, None] - y)
    back = nets.heads[:, None, :] * (1 - active**2)
    wide = root[:, None] * np.concatenate([x, np.ones((len(x), 1))], axis=1)
    jacobian = np.empty((*residual.shape, theta.shape[1]))
    first, second = jacobian[..., : -units - 1], jacobian[..., -units - 1 : -1]
    np.multiply(
        wide[:, :, None], back[:, :, None, :], out=first.reshape(*residual.shape, -1, units)
    )
    np.multiply(root[:, None], active, out=second)
    jacobian[..., -1] = root
    return residual, jacobian
