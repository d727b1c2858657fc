r"""The linear-quadratic task: small enough for chapter 2, and solved in closed form.

.. math::
    s_{t+1} = A s_t + B a_t + w_t, \qquad r_t = -(s_t^\top Q s_t + a_t^\top R a_t)

With a policy that is linear in the state, :math:`a \sim N(Ks, \sigma^2)`, every expectation
is exact: the second moments of the state follow a linear recursion.  A scalar state and
action leave a policy with two parameters, :math:`K` and :math:`\log\sigma`, that can be
drawn.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from thesis_lib.arrays import FloatArray
from thesis_lib.optimisation.vector_task import Step


class LinearQuadraticTask:
    """Regulate a noisy linear system in n worlds (a
    :class:`~thesis_lib.optimisation.vector_task.VectorTask`).

    Parameters
    ----------
    num_envs
        Number of worlds n.
    A, B
        Dynamics, shapes ``(D, D)`` and ``(D, U)``; default 0.9 and 0.5, scalars.
    Q, R
        Costs of state and action, ``(D, D)`` and ``(U, U)``; default 1 and 0.1.
    noise
        Standard deviation of each entry of w.
    spread
        Standard deviation of each entry of the first state.
    horizon
        Steps of an episode.
    seed
        Source of the noise.

    Raises
    ------
    ValueError
        When shapes disagree or a size is not positive.
    """

    def __init__(
        self,
        num_envs: int,
        *,
        A: ArrayLike = 0.9,
        B: ArrayLike = 0.5,
        Q: ArrayLike = 1.0,
        R: ArrayLike = 0.1,
        noise: float = 0.1,
        spread: float = 1.0,
        horizon: int = 20,
        seed: int | np.random.SeedSequence = 0,
    ) -> None:
        if num_envs < 1 or horizon < 1:
            raise ValueError(
                f"num_envs is {num_envs} and horizon is {horizon}, but both must be at least 1."
            )
        self.A, self.B, self.Q, self.R = (
            np.atleast_2d(np.asarray(m, dtype=np.float64)) for m in (A, B, Q, R)
        )
        d, u = self.B.shape
        for name, matrix, shape in (
            ("A", self.A, (d, d)),
            ("Q", self.Q, (d, d)),
            ("R", self.R, (u, u)),
        ):
            if matrix.shape != shape:
                raise ValueError(
                    f"{name} has shape {matrix.shape}, but {shape} is needed to agree with B of "
                    f"shape {self.B.shape}."
                )
        self.num_envs, self.observation_size, self.action_size = num_envs, d, u
        self.noise, self.spread, self.max_episode_steps = noise, spread, horizon
        self.reseed(seed)

    def reseed(self, seed: int | np.random.SeedSequence) -> None:
        """Start the random stream of another seed; call :meth:`reset` next."""
        self._generator = np.random.default_rng(seed)
        self._state = np.zeros((self.num_envs, self.observation_size))
        self._time = np.full(self.num_envs, self.max_episode_steps)

    def reset(self, worlds: Any = None) -> FloatArray:
        """Draw new first states; they are what the policy sees, shape ``(k, D)``."""
        ids = np.arange(self.num_envs) if worlds is None else np.asarray(worlds)
        first = self.spread * self._generator.standard_normal((len(ids), self.observation_size))
        self._state[ids] = first
        self._time[ids] = 0
        return first

    def step(self, actions: ArrayLike) -> Step:
        """Act in every world, shape ``(n, U)``; worlds at their horizon stand still."""
        a, s = np.asarray(actions, dtype=np.float64), self._state
        running = self._time < self.max_episode_steps
        reward = -(np.einsum("ni,ij,nj->n", s, self.Q, s) + np.einsum("ni,ij,nj->n", a, self.R, a))
        noise = self.noise * self._generator.standard_normal(s.shape)
        self._state = np.where(running[:, None], s @ self.A.T + a @ self.B.T + noise, s)
        self._time = self._time + running
        return Step(
            observation=self._state.copy(),
            reward=np.where(running, reward, 0.0),
            terminated=np.zeros(self.num_envs, dtype=bool),
            truncated=self._time >= self.max_episode_steps,
        )

    # ----------------------------------------------------------- exact expectations
    def state_moments(self, gain: Tensor, log_std: Tensor) -> list[Tensor]:
        r"""Second moments :math:`M_t = E[s_t s_t^\top]` of every step, ``(D, D)`` each.

        Parameters
        ----------
        gain
            K, shape ``(U, D)``.
        log_std
            :math:`\log\sigma`, shape ``(U,)``.
        """
        A, B = torch.as_tensor(self.A), torch.as_tensor(self.B)
        eye = torch.eye(self.observation_size, dtype=torch.float64)
        closed = A + B @ gain
        drawn = B @ torch.diag(torch.exp(2 * log_std)) @ B.T + self.noise**2 * eye
        moments = [self.spread**2 * eye]
        for _ in range(self.max_episode_steps - 1):
            moments.append(closed @ moments[-1] @ closed.T + drawn)
        return moments

    def expected_return(self, gain: Tensor, log_std: Tensor, discount: float = 1.0) -> Tensor:
        r"""Exact :math:`V(\theta) = E[\sum_t \gamma^t r_t]` of a linear policy, a scalar.

        Parameters
        ----------
        gain, log_std
            See :meth:`state_moments`; gradients flow through both.
        discount
            :math:`\gamma`.
        """
        Q, R = torch.as_tensor(self.Q), torch.as_tensor(self.R)
        variance = torch.diag(torch.exp(2 * log_std))
        total = torch.zeros((), dtype=torch.float64)
        for t, moment in enumerate(self.state_moments(gain, log_std)):
            cost = torch.trace(Q @ moment) + torch.trace(R @ (gain @ moment @ gain.T + variance))
            total = total - discount**t * cost
        return total
