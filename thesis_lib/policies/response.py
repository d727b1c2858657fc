r"""Networks as filters: what they make of an impulse, a step and noise (section 5.2).

A signal is fed along one direction of the observation and the mean action is read out.
The loop is open: the previous action a recurrent net may see is kept at 0.
"""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from scipy import signal as processing

from thesis_lib.arrays import FloatArray
from thesis_lib.policies.base import GaussianPolicy

SETTLED = 1e-6
"""Largest change of the state in a step at which a network counts as at rest."""

SIDE_BY_SIDE = 8
"""Most signals that :func:`measured_gain` feeds in at once."""

AT_ONCE = 200
"""Steps without input after which it is looked whether the network rests."""


def respond(policy: GaussianPolicy, signal: ArrayLike, direction: ArrayLike) -> FloatArray:
    """Mean action while a signal is fed in.

    Parameters
    ----------
    policy
        The network, from its initial state.
    signal
        Shape ``(T,)``, or ``(T, B)`` for B signals side by side.
    direction
        What a signal of 1 adds to the observation, shape ``(D,)``; the rest is 0.

    Returns
    -------
    FloatArray
        Shape ``(T, A)`` or ``(T, B, A)``.
    """
    x = np.asarray(signal, dtype=np.float64)
    observations = torch.as_tensor(np.multiply.outer(x.reshape(len(x), -1), direction))
    actions = torch.zeros((*observations.shape[:2], policy.action_size), dtype=torch.float64)
    with torch.no_grad():
        mean, _ = policy(observations, actions)
    return mean.double().numpy().reshape(*x.shape, -1)


def measured_gain(
    policy: GaussianPolicy,
    dt: float,
    direction: ArrayLike,
    *,
    amplitude: float,
    generator: np.random.Generator,
    steps: int = 2**15,
    segment: int = 1024,
) -> tuple[FloatArray, FloatArray]:
    r"""Gain over frequency, measured with white noise.

    .. math:: |H(f)| = |P_{xy}(f)| / P_{xx}(f)

    with the spectra of input and output averaged over segments (Welch).  For a nonlinear
    network this is the best linear description of it at this amplitude.

    Parameters
    ----------
    policy
        The network.
    dt
        Control step in seconds.
    direction
        See :func:`respond`.
    amplitude
        Standard deviation of the noise.
    generator
        Its source.
    steps
        Length of the noise, beyond a segment left out as a transient.  It comes as up to
        :data:`SIDE_BY_SIDE` signals of at least two segments each, which takes less time than one.
    segment
        Length of a segment, which sets the resolution in frequency.

    Returns
    -------
    frequency, gain
        In Hz, shape ``(F,)``, and ``(F, A)``.
    """
    if steps < 2 * segment:
        raise ValueError(
            f"steps is {steps}, but at least two segments of {segment} steps are needed."
        )
    rows = min(SIDE_BY_SIDE, steps // (2 * segment))
    x = amplitude * generator.standard_normal((segment + steps // rows, rows))
    y = respond(policy, x, direction)[segment:]
    x = x[segment:, :, None]
    as_said: dict[str, Any] = {"fs": 1 / dt, "nperseg": segment, "detrend": "constant", "axis": 0}
    frequency, power = processing.welch(x, **as_said)
    _, cross = processing.csd(x, y, **as_said)
    return frequency, np.abs(cross.mean(axis=1)) / power.mean(axis=1)


def small_signal_gain(
    policy: GaussianPolicy,
    dt: float,
    direction: ArrayLike,
    frequency: ArrayLike,
    settle: int = 20_000,
) -> FloatArray:
    r"""Gain over frequency for signals so small that the network is linear.

    At rest the state changes by :math:`ds' = A\,ds + b\,dx` and the mean by
    :math:`C\,ds'`, so that

    .. math:: |H(f)| = |C (I - A z^{-1})^{-1} b|, \qquad z = e^{2\pi i f \Delta t}.

    Parameters
    ----------
    policy
        The network.
    dt
        Control step in seconds.
    direction
        See :func:`respond`.
    frequency
        In Hz, shape ``(F,)``.
    settle
        Most steps without input after which the network must be at rest.

    Returns
    -------
    FloatArray
        Shape ``(F, A)``.

    Raises
    ------
    ValueError
        When the network does not come to rest, or would not return to it.
    """
    net, state, change = _without_input(policy, settle)
    if change >= SETTLED:
        raise ValueError(
            f"the {policy.architecture} network still moves by {change:.2g} a step after "
            f"{settle} steps without input: a small-signal gain needs a network at rest."
        )
    action = torch.zeros((1, net.action_size), dtype=torch.float64)
    along = torch.as_tensor(np.asarray(direction, dtype=np.float64))[None]

    def step(x: torch.Tensor, s: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        mean, after = net.step(x * along, action, s[None])
        return mean[0], after[0]

    origin = torch.zeros(1, dtype=torch.float64)
    wanted = np.atleast_1d(np.asarray(frequency, dtype=np.float64))
    if policy.state_size == 0:  # nothing is remembered: the same at all frequencies
        slope = torch.autograd.functional.jacobian(lambda x: step(x, state[0])[0], origin)
        return np.abs(np.tile(np.asarray(slope)[:, 0], (len(wanted), 1)))
    (d_mean, d_state) = torch.autograd.functional.jacobian(step, (origin, state[0]))
    direct, from_state = (np.asarray(d) for d in d_mean)  # (A, 1), (A, S)
    b, A = (np.asarray(d) for d in d_state)  # (S, 1), (S, S)
    growth = _largest(A)
    if growth >= 1:
        raise ValueError(
            f"the {policy.architecture} network is unstable at rest (a disturbance grows by "
            f"{growth:.3g} a step): it has no small-signal gain."
        )
    identity = np.identity(len(A))
    gains = []
    for f in wanted:
        z = np.exp(2j * np.pi * f * dt)
        response = from_state @ np.linalg.solve(z * identity - A, b) + direct
        gains.append(np.abs(response[:, 0]))
    return np.array(gains)


def growth_at_rest(policy: GaussianPolicy) -> float:
    """Factor a step by which the slowest small change of a resting network's state grows.

    The largest modulus among the eigenvalues of the state's Jacobian, at the initial state and
    without input; 0 for a network without state.  Below 1 the network is stable at rest and
    a change fades with the time constant -dt / log(growth).

    Raises
    ------
    ValueError
        When the network moves without input and so is not at rest where it starts.
    """
    if policy.state_size == 0:
        return 0.0
    net, rest, moved = _without_input(policy, 1)
    if moved >= SETTLED:
        raise ValueError(
            f"the {policy.architecture} network moves by {moved:.2g} in its first step without "
            "input: its initial state must be one of rest."
        )
    zero = torch.zeros((1, net.observation_size), dtype=torch.float64)
    action = torch.zeros((1, net.action_size), dtype=torch.float64)
    slope = torch.autograd.functional.jacobian(
        lambda state: net.step(zero, action, state[None])[1][0], rest[0]
    )
    return _largest(np.asarray(slope))


def _without_input(
    policy: GaussianPolicy, steps: int
) -> tuple[GaussianPolicy, torch.Tensor, float]:
    """A copy in float64, its state once it rests without input, and how far it last moved.

    It makes at most so many steps from the initial state, and is at rest if it last moved by
    less than :data:`SETTLED`.
    """
    net = deepcopy(policy).double()  # double() works in place
    state = net.initial_state(1).detach()
    change = 0.0
    with torch.no_grad():
        for done in range(0, steps if state.numel() else 0, AT_ONCE):
            n = min(AT_ONCE, steps - done)
            zeros = [torch.zeros((n, 1, m)) for m in (net.observation_size, net.action_size)]
            _, after = net.run(net.inputs(*zeros).flatten(0, 1), [1] * n, state)
            moved = (after - torch.cat([state, after[:-1]])).abs().amax(dim=1)
            last = int((moved < SETTLED).int().argmax()) if (moved < SETTLED).any() else n - 1
            state, change = after[last : last + 1], float(moved[last])
            if change < SETTLED:
                break
    return net, state, change


def _largest(matrix: FloatArray) -> float:
    """Spectral radius."""
    return float(np.abs(np.linalg.eigvals(matrix)).max())
