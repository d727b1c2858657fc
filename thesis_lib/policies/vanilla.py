"""The vanilla recurrent nets in discrete and continuous time (sections 5.2.1 and 5.2.2)."""

from __future__ import annotations

import math
from typing import Unpack

import torch
from torch import Tensor, nn
from torch.nn import functional

from thesis_lib.checks import one_of, positive_number
from thesis_lib.policies.initial import glorot_, random_source
from thesis_lib.policies.recurrent import Recur, RecurrentOptions, RecurrentPolicy

INTEGRATORS = ("heun", "euler", "midpoint")
"""How a CTRNN's differential equation is stepped; the first is the default."""

CONSTRAINTS = ("clamp", "softplus", "exponential")
"""How time constants are kept at or above the step; the first is the default."""


class DTRNN(RecurrentPolicy):
    r"""Elman network :math:`h_n = \tanh(K h_{n-1} + W x_n + b)` (equation 5.1).

    Parameters
    ----------
    observation_size, action_size, units
        Sizes.
    bias
        Equation 5.1 shows none, since section 2.4 counts the constant 1 among the
        inputs; the author's code has one.
    seed
        W and K are Glorot-uniform from this seed, b is 0.
    **options
        See :class:`~thesis_lib.policies.recurrent.RecurrentPolicy`; the initial state is learned
        unless ``trainable_initial_state`` is False.
    """

    architecture = "dtrnn"

    def __init__(
        self,
        observation_size: int,
        action_size: int,
        *,
        units: int,
        seed: int = 0,
        bias: bool = True,
        **options: Unpack[RecurrentOptions],
    ) -> None:
        options.setdefault("trainable_initial_state", True)
        super().__init__(observation_size, action_size, units, bias=bias, **options)
        generator = random_source(seed)
        for layer in (self.input, self.recurrent, self.head):
            glorot_(layer.weight, generator)

    def cell(self, drive: Tensor, state: Tensor, recur: Recur, *coefficients: Tensor) -> Tensor:
        """Equation 5.1."""
        return torch.tanh(drive + recur(state))


class CTRNN(DTRNN):
    r"""Leaky integrators :math:`\tau \dot h = -h + \tanh(K h + W x + b)` (equation 5.2).

    The input is held constant over a step of the task, which is one step of the
    integrator.

    Parameters
    ----------
    observation_size, action_size, units, bias, seed
        See :class:`DTRNN`.
    dt
        Control step of the task in seconds.
    integrator
        ``"heun"``: the mean of the old state and two Euler steps, which is what the
        author's "midpoint" is; ``"euler"``; ``"midpoint"``: the true one.
    time_constant
        Initial :math:`\tau` of every unit in seconds, above ``dt`` unless the
        constraint is a clamp.  The value used in the thesis is not recorded; 1 is the
        author's default.
    time_constant_spread
        Largest over smallest initial :math:`\tau`: they are spaced evenly in their
        logarithm around ``time_constant``.
    constraint
        How :math:`\tau \ge \Delta t` is kept.  ``"clamp"``: :math:`\tau` is learned
        and raised to :math:`\Delta t` whenever parameters are set, as in the thesis.
        ``"softplus"`` and ``"exponential"``: :math:`\tau = \Delta t + g(\rho)` with
        :math:`\rho` learned.
    trainable_time_constant
        Whether :math:`\tau` is learned.
    **options
        See :class:`~thesis_lib.policies.recurrent.RecurrentPolicy`; the initial state is learned
        unless ``trainable_initial_state`` is False.

    Raises
    ------
    ValueError
        When dt or the time constant is out of range, or an option does not exist.
    """

    architecture = "ctrnn"

    def __init__(
        self,
        observation_size: int,
        action_size: int,
        *,
        units: int,
        dt: float,
        seed: int = 0,
        integrator: str = "heun",
        time_constant: float = 1.0,
        time_constant_spread: float = 1.0,
        constraint: str = "clamp",
        trainable_time_constant: bool = True,
        bias: bool = True,
        **options: Unpack[RecurrentOptions],
    ) -> None:
        one_of("integrator", integrator, INTEGRATORS)
        one_of("constraint", constraint, CONSTRAINTS)
        positive_number("dt", dt)
        largest = torch.finfo(options.get("dtype", torch.float32)).max
        if not time_constant <= largest:
            raise ValueError(
                f"time_constant is {time_constant} s, but it must be a number of seconds up to "
                f"{largest:.3g}, the largest there is of this type."
            )
        if not 1 <= time_constant_spread < math.inf:
            raise ValueError(
                f"time_constant_spread is {time_constant_spread}, but the largest time constant "
                "is at least 1 times the smallest."
            )
        smallest = time_constant / math.sqrt(time_constant_spread)
        if not (smallest >= dt if constraint == "clamp" else smallest > dt):
            relation = "at least" if constraint == "clamp" else "above"
            spread = f" (smallest {smallest:.3g} s)" if time_constant_spread > 1 else ""
            raise ValueError(
                f"time_constant is {time_constant} s{spread}, but it must be {relation} the "
                f"control step of {dt} s, below which the integrator is unstable."
            )
        super().__init__(
            observation_size, action_size, units=units, seed=seed, bias=bias, **options
        )
        self.dt = float(dt)
        self.integrator = integrator
        self.constraint = constraint
        place = torch.linspace(-0.5, 0.5, units, dtype=torch.float64)
        tau = time_constant * time_constant_spread**place
        if constraint == "softplus":
            # log(exp(x) - 1) that does not overflow
            raw = (tau - dt) + torch.log(-torch.expm1(dt - tau))
        elif constraint == "exponential":
            raw = torch.log(tau - dt)
        else:
            raw = tau
        self.tau_raw = nn.Parameter(raw.to(self.dtype), requires_grad=trainable_time_constant)

    def time_constants(self) -> Tensor:
        r""":math:`\tau` of every unit in seconds, shape ``(N,)``."""
        if self.constraint == "softplus":
            return self.dt + functional.softplus(self.tau_raw)
        if self.constraint == "exponential":
            return self.dt + torch.exp(self.tau_raw)
        return self.tau_raw

    def project_(self) -> None:
        r""":math:`\tau \leftarrow \max(\Delta t, \tau)` (section 5.2.2), for the clamp."""
        if self.constraint == "clamp":
            with torch.no_grad():
                self.tau_raw.clamp_(min=self.dt)

    def coefficients(self) -> tuple[Tensor, ...]:
        r"""The step in units of the time constant, :math:`\Delta t/\tau`."""
        return (self.dt / self.time_constants(),)

    def cell(self, drive: Tensor, state: Tensor, recur: Recur, *coefficients: Tensor) -> Tensor:
        """One step of equation 5.2; ``lerp(h, f, a)`` is :math:`h + a(f - h)`."""
        (rate,) = coefficients
        slope = torch.tanh(drive + recur(state))
        if self.integrator == "euler":
            return torch.lerp(state, slope, rate)
        if self.integrator == "midpoint":
            half = torch.lerp(state, slope, 0.5 * rate)
            return torch.addcmul(state, rate, torch.tanh(drive + recur(half)) - half)
        once = torch.lerp(state, slope, rate)
        twice = torch.lerp(once, torch.tanh(drive + recur(once)), rate)
        return torch.lerp(state, twice, 0.5)
