"""What every policy of chapter 5 has in common (section 5.2).

A policy is an ordinary :class:`torch.nn.Module`.  Its one definition of the network is
used for a single step of many worlds (sampling) and for whole blocks of episodes
(learning).
"""

from __future__ import annotations

import abc
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypedDict

import numpy as np
import torch
from torch import Tensor, nn

from thesis_lib.checks import positive_integer
from thesis_lib.policies.initial import empty_linear
from thesis_lib.policies.packing import Packing


@dataclass(frozen=True, eq=False)
class Sequences:
    """A block of episodes as a policy reads it.

    Attributes
    ----------
    inputs
        Inputs of the network, shape ``(R, I)``, laid out by ``packing``.
    packing
        Which row is which step of which episode.
    hidden
        Outputs of the last hidden layer, shape ``(R, F)``, where they do not depend on
        anything that is learned and were kept while sampling; otherwise None.
    """

    inputs: Tensor
    packing: Packing
    hidden: Tensor | None = None


class Linearised(abc.ABC):
    r"""The mean of a policy near the current parameters, :math:`\mu(\theta + v) \approx \mu + Jv`.

    J has one row for every action entry of every step and one column for every
    trainable parameter; it is never built.  Moving the policy afterwards changes nothing
    here.

    Attributes
    ----------
    mean
        :math:`\mu`, shape ``(R, A)``.
    """

    mean: Tensor

    @abc.abstractmethod
    def jvp(self, v: Tensor) -> Tensor:
        """The product :math:`Jv`.

        Parameters
        ----------
        v
            A direction in parameter space, shape ``(P,)``.

        Returns
        -------
        Tensor
            Shape ``(R, A)``.
        """

    @abc.abstractmethod
    def vjp(self, u: Tensor) -> Tensor:
        r"""The product :math:`J^\top u`.

        Parameters
        ----------
        u
            A weight for each entry of the mean, shape ``(R, A)``.

        Returns
        -------
        Tensor
            Shape ``(P,)``; 0 for parameters the mean does not depend on.
        """


class PolicyOptions(TypedDict, total=False):
    """What every policy takes by these names; see :class:`GaussianPolicy`."""

    features: Sequence[int] | None
    initial_log_std: float
    min_log_std: float | None
    dtype: torch.dtype


class GaussianPolicy(nn.Module, abc.ABC):
    r"""A policy :math:`\pi_\theta(a|s) = N(\mu_\theta(s), \mathrm{diag}(\sigma^2))` (section 5.2).

    The mean is a linear map of the last hidden layer; :math:`\log\sigma` is one free
    vector that does not depend on the state.

    Parameters
    ----------
    observation_size
        Length of the observations the task gives.
    action_size
        Length A of the actions.
    hidden_size
        Length F of the last hidden layer.
    features
        Indices of the observations the policy may see, in this order; default all.
    previous_action
        Whether the previous action is part of the input.
    initial_log_std
        Start of :math:`\log\sigma`.
    min_log_std
        A floor under :math:`\log\sigma`, or None.
    dtype
        Number type of the network.

    Raises
    ------
    ValueError
        When a size is not positive or a feature does not exist.
    """

    architecture: str = ""
    """Name by which :func:`~thesis_lib.policies.make_policy` knows the network."""

    recipe: dict[str, Any] | None = None
    """Arguments by which :func:`~thesis_lib.policies.make_policy` made it, as plain values."""

    def __init__(
        self,
        observation_size: int,
        action_size: int,
        hidden_size: int,
        *,
        features: Sequence[int] | None = None,
        previous_action: bool = False,
        initial_log_std: float = 0.0,
        min_log_std: float | None = None,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        super().__init__()
        for name, size in (
            ("observation_size", observation_size),
            ("action_size", action_size),
            ("hidden_size", hidden_size),
        ):
            positive_integer(name, size)
        self.observation_size = observation_size
        self.action_size = action_size
        self.hidden_size = hidden_size
        self.previous_action = previous_action
        self.min_log_std = min_log_std
        self.features = check_features(features, observation_size)
        self.head = empty_linear(hidden_size, action_size, dtype=dtype)
        self.log_std = nn.Parameter(torch.full((action_size,), float(initial_log_std), dtype=dtype))

    @property
    def feature_size(self) -> int:
        """Number of observations the policy sees."""
        return self.observation_size if self.features is None else len(self.features)

    @property
    def input_size(self) -> int:
        """Length I of the network's input: features, then previous action where it is used."""
        return self.feature_size + (self.action_size if self.previous_action else 0)

    @property
    def dtype(self) -> torch.dtype:
        """Number type of the network."""
        return self.log_std.dtype

    @property
    def state_size(self) -> int:
        """Length S of the state carried from step to step; 0 for a feedforward net."""
        return 0

    @property
    def keeps_hidden(self) -> bool:
        """Whether the last hidden layer depends on nothing that is learned.

        The sampler then keeps its outputs and learning never runs the network again.
        """
        return False

    # ------------------------------------------------------------------ the network
    @abc.abstractmethod
    def initial_state(self, n: int) -> Tensor:
        """State of n worlds before their first step, shape ``(n, S)``."""

    @abc.abstractmethod
    def advance(self, inputs: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """One step of the hidden layers.

        Parameters
        ----------
        inputs
            Shape ``(n, I)``.
        state
            Shape ``(n, S)``.

        Returns
        -------
        hidden, state
            Last hidden layer, ``(n, F)``, and the new state, ``(n, S)``.
        """

    @abc.abstractmethod
    def run(self, inputs: Tensor, sizes: list[int], state: Tensor) -> tuple[Tensor, Tensor]:
        """Many steps of the hidden layers.

        Parameters
        ----------
        inputs
            Shape ``(R, I)``, time-major.
        sizes
            Number of rows of each time, falling; they sum to R.
        state
            State before the first step, shape ``(sizes[0], S)``.

        Returns
        -------
        hidden, states
            Shapes ``(R, F)`` and ``(R, S)``.
        """

    def linearise(self, sequences: Sequences) -> Linearised:
        """The mean as a linear function of the parameters near the current ones.

        This default serves any network; subclasses know faster ways.
        """
        from thesis_lib.policies.linearised import DualLinearised

        return DualLinearised(self, sequences)

    # -------------------------------------------------------------------- interface
    def select(self, observation: np.ndarray) -> np.ndarray:
        """The observations the policy may see, shape ``(..., D')``."""
        return observation if self.features is None else observation[..., self.features]

    def step(
        self, observation: Tensor, previous_action: Tensor, state: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Mean action of n worlds, one step.

        Parameters
        ----------
        observation
            Shape ``(n, D)``, in the task's units.
        previous_action
            Action taken one step earlier, shape ``(n, A)``; 0 at the first step.
        state
            Shape ``(n, S)``, from :meth:`initial_state` or the step before.

        Returns
        -------
        mean, state
            Shapes ``(n, A)`` and ``(n, S)``.
        """
        hidden, state = self.advance(self.inputs(observation, previous_action), state)
        return self.head(hidden), state

    def forward(
        self, observations: Tensor, previous_actions: Tensor, state: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Mean actions of a padded block of episodes.

        The network is causal, so that whatever stands in the padding after an episode's
        end changes nothing before it.

        Parameters
        ----------
        observations
            Shape ``(T, B, D)``.
        previous_actions
            Shape ``(T, B, A)``.
        state
            State before the first step, ``(B, S)``; default :meth:`initial_state`.

        Returns
        -------
        mean, state
            Shapes ``(T, B, A)`` and ``(B, S)``, the state after the last step.
        """
        n_steps, n_episodes = observations.shape[:2]
        inputs = self.inputs(observations, previous_actions).flatten(0, 1)
        start = self.initial_state(n_episodes) if state is None else state
        hidden, states = self.run(inputs, [n_episodes] * n_steps, start)
        return self.head(hidden).unflatten(0, (n_steps, n_episodes)), states[-n_episodes:]

    def sequences(
        self,
        observations: np.ndarray | Tensor,
        actions: np.ndarray | Tensor,
        packing: Packing,
        hidden: Tensor | None = None,
    ) -> Sequences:
        """Prepare a batch of episodes for :meth:`means` and :meth:`linearise`.

        Parameters
        ----------
        observations
            Rows in the order of ``packing``, shape ``(R, D)``.
        actions
            Actions taken, shape ``(R, A)``.
        packing
            Layout of the rows.
        hidden
            Last hidden layer, where :attr:`keeps_hidden` and the sampler kept it.
        """
        before = packing.shift(torch.as_tensor(actions))
        inputs = self.inputs(torch.as_tensor(observations), before)
        if self.keeps_hidden and hidden is None:
            with torch.no_grad():
                start = self.initial_state(packing.n_episodes)
                hidden, _ = self.run(inputs, packing.sizes, start)
        return Sequences(inputs, packing, hidden if self.keeps_hidden else None)

    def means(self, sequences: Sequences) -> Tensor:
        """Mean action of every step of a batch, shape ``(R, A)``."""
        hidden = sequences.hidden
        if hidden is None:
            start = self.initial_state(sequences.packing.n_episodes)
            hidden, _ = self.run(sequences.inputs, sequences.packing.sizes, start)
        return self.head(hidden)

    def inputs(self, observation: Tensor, previous_action: Tensor) -> Tensor:
        """The network's input: the features it may see, and the previous action, ``(..., I)``."""
        if observation.shape[-1] != self.observation_size:
            raise ValueError(
                f"observation has {observation.shape[-1]} entries, but the policy was made for "
                f"{self.observation_size}."
            )
        seen = observation if self.features is None else observation[..., self.features]
        if self.previous_action:
            seen = torch.cat([seen, previous_action.to(seen.dtype)], -1)
        return seen.to(self.dtype)

    def deviation(self) -> Tensor:
        r""":math:`\log\sigma` with its floor applied, shape ``(A,)``."""
        if self.min_log_std is None:
            return self.log_std
        return self.log_std.clamp(min=self.min_log_std)

    # ------------------------------------------------------------------- parameters
    def trainable(self) -> dict[str, nn.Parameter]:
        """The parameters that are learned, by name, in the order of the parameter vector."""
        return {name: p for name, p in self.named_parameters() if p.requires_grad}

    @property
    def n_trainable(self) -> int:
        """Number P of parameters that are learned."""
        return sum(p.numel() for p in self.trainable().values())

    def parameter_vector(self) -> Tensor:
        r"""A copy of :math:`\theta`, shape ``(P,)``."""
        return torch.cat([p.detach().flatten() for p in self.trainable().values()])

    def set_parameter_vector(self, theta: Tensor) -> None:
        r"""Set :math:`\theta`, then apply :meth:`project_`.

        Parameters
        ----------
        theta
            Shape ``(P,)``.
        """
        with torch.no_grad():
            values = self.split(theta)
            for name, parameter in self.trainable().items():
                parameter.copy_(values[name])
            self.project_()

    def project_(self) -> None:
        """Bring the parameters back to where they are allowed to be; nothing by default."""

    def split(self, vector: Tensor) -> dict[str, Tensor]:
        """A parameter vector as named tensors (views), the inverse of :meth:`join`."""
        parameters = self.trainable()
        pieces = torch.split(vector, [p.numel() for p in parameters.values()])
        return {
            name: piece.view(p.shape)
            for (name, p), piece in zip(parameters.items(), pieces, strict=True)
        }

    def join(self, tensors: dict[str, Tensor]) -> Tensor:
        """One vector from tensors named as the parameters; absent ones count as 0."""
        return torch.cat(
            [
                tensors[name].reshape(-1) if name in tensors else torch.zeros_like(p).flatten()
                for name, p in self.trainable().items()
            ]
        )

    def check_finite(self) -> None:
        """Raise FloatingPointError naming a parameter that is not finite."""
        for name, p in self.named_parameters():
            if not torch.isfinite(p).all():
                raise FloatingPointError(
                    f"parameter {name!r} of the {self.architecture} policy holds a value that is "
                    "not finite."
                )


def check_features(features: Sequence[int] | None, observation_size: int) -> list[int] | None:
    """Feature indices as a list of integers, or ValueError naming the bad one."""
    if features is None:
        return None
    chosen = [int(i) for i in features]
    if not chosen:
        raise ValueError("features is empty, but a policy needs at least one observation.")
    for i in chosen:
        if not 0 <= i < observation_size:
            raise ValueError(
                f"feature {i} does not exist: the observations are 0 to {observation_size - 1}."
            )
    if len(set(chosen)) < len(chosen):
        raise ValueError(f"features {chosen} names an observation twice; name each once.")
    return chosen
