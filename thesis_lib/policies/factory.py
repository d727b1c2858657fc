"""The nine policies of chapter 5 by name, with the thesis's sizes (section 5.4)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import torch

from thesis_lib.policies.base import GaussianPolicy, check_features
from thesis_lib.policies.echo_state import ESN
from thesis_lib.policies.feedforward import FeedforwardPolicy
from thesis_lib.policies.gated import GRU, LSTM
from thesis_lib.policies.vanilla import CTRNN, DTRNN
from thesis_lib.registration import find

DEEP = (100, 50, 25)
"""Hidden layers of DFFWD, those of Duan et al."""

WIDE = 400
"""Units of the wide net of figure 5.5."""


def recurrent_units(architecture: str, feature_size: int, action_size: int) -> int:
    """Number of hidden units N of a net with one hidden layer (section 5.4).

    Parameters
    ----------
    architecture
        Name of the net.
    feature_size
        Number of observations the policy sees, dim(o); the previous action does not
        count.
    action_size
        dim(a).

    Returns
    -------
    int
        dim(a) for LSTM and GRU, 3 dim(a) for DTRNN, CTRNN and FFWD,
        3 dim(o) dim(a) + 4 dim(a)^2 for ESN, 400 for the wide net.
    """
    if architecture in ("lstm", "gru"):
        return action_size
    if architecture == "esn":
        return 3 * feature_size * action_size + 4 * action_size**2
    if architecture == "ffwd-400":
        return WIDE
    return 3 * action_size


def _feedforward(hidden: Sequence[int] | None, activation: str) -> Callable[..., GaussianPolicy]:
    """A maker of feedforward policies; hidden None means the thesis's single layer."""

    def make(
        observation_size: int, action_size: int, *, units: int, dt: float, **options: Any
    ) -> GaussianPolicy:
        options.setdefault("activation", activation)
        options.setdefault("hidden", (units,) if hidden is None else hidden)
        return FeedforwardPolicy(observation_size, action_size, **options)

    return make


def _recurrent(kind: Callable[..., GaussianPolicy]) -> Callable[..., GaussianPolicy]:
    def make(
        observation_size: int, action_size: int, *, units: int, dt: float, **options: Any
    ) -> GaussianPolicy:
        return kind(observation_size, action_size, units=units, **options)

    return make


ARCHITECTURES: Mapping[str, Callable[..., GaussianPolicy]] = {
    "ffwd": _feedforward(None, "tanh"),
    "dffwd": _feedforward(DEEP, "tanh"),
    "dtrnn": _recurrent(DTRNN),
    "ctrnn": CTRNN,
    "gru": _recurrent(GRU),
    "lstm": _recurrent(LSTM),
    "esn": _recurrent(ESN),
    "dffwd-softplus": _feedforward(DEEP, "softplus"),
    "ffwd-400": _feedforward(None, "tanh"),
}
"""The seven architectures of section 5.2 and the two extra nets of figure 5.5.

:meta hide-value:
"""

RECURRENT_NETS = ("dtrnn", "ctrnn", "gru", "lstm", "esn")
"""Those of section 5.2 that remember."""

DEEP_NETS = ("dffwd", "dffwd-softplus")
"""Those whose hidden layers are :data:`DEEP` whatever the number of units."""

SHALLOW_NETS = ("ffwd", "ffwd-400")
"""Those with one hidden layer and no memory, in place of which ``hidden`` gives others."""


def make_policy(
    architecture: str,
    observation_size: int,
    action_size: int,
    *,
    dt: float,
    seed: int = 0,
    units: int | None = None,
    features: Sequence[int] | None = None,
    head_scale: float = 1.0,
    dtype: torch.dtype = torch.float32,
    **options: Any,
) -> GaussianPolicy:
    """Make one of the nine policies with the sizes of section 5.4.

    Parameters
    ----------
    architecture
        A name of :data:`ARCHITECTURES`, or one that an installed package offers
        (:mod:`thesis_lib.registration`).
    observation_size, action_size
        Sizes of the task's observations and actions.
    dt
        Control step of the task in seconds, which the CTRNN integrates over.
    seed
        Source of the initial weights.
    units
        Number of hidden units of a net with one hidden layer, not for :data:`DEEP_NETS`;
        default :func:`recurrent_units`.
    features
        Indices of the observations the policy may see; default all.
    head_scale
        What the initial weights of the output layer are multiplied with.  Small ones let
        every policy start from actions that are noise around 0, whatever it sees.
    dtype
        Number type of the network.
    **options
        Passed to the architecture: see :class:`FeedforwardPolicy`, :class:`DTRNN`,
        :class:`CTRNN`, :class:`GRU`, :class:`LSTM` and :class:`ESN`.

    Raises
    ------
    ValueError
        When the architecture or an option does not exist, the scale is negative, or units are
        given to a deep net, or to a shallow one beside its layers.

    Examples
    --------
    >>> policy = make_policy("ctrnn", 11, 3, dt=0.01, units=10, seed=0)
    >>> policy.observation_size, policy.action_size
    (11, 3)
    """
    if not (math.isfinite(head_scale) and head_scale >= 0):
        raise ValueError(f"head_scale is {head_scale}, but it must be a number from 0 on.")
    make = find("architecture", architecture, ARCHITECTURES)
    chosen = check_features(features, observation_size)
    seen = observation_size if chosen is None else len(chosen)
    if units is not None and architecture in DEEP_NETS:
        raise ValueError(
            f"units is {units}, but {architecture} has layers of its own: leave units out, or give "
            "their sizes (hidden)."
        )
    layered = architecture in SHALLOW_NETS and "hidden" in options
    if units is not None and layered:
        raise ValueError(
            f"units is {units}, but hidden gives the layers of {architecture}, "
            f"{options['hidden']}: leave one of them out."
        )
    if units is None:
        units = recurrent_units(architecture, seen, action_size)
    if units < 1:
        raise ValueError(f"units is {units}, but at least 1 hidden unit is needed.")
    try:
        policy = make(
            observation_size,
            action_size,
            units=units,
            dt=dt,
            seed=seed,
            features=chosen,
            dtype=dtype,
            **options,
        )
    except TypeError as error:
        raise ValueError(f"architecture {architecture!r} does not take this: {error}.") from error
    policy.architecture = architecture
    policy.recipe = {
        "architecture": architecture,
        "observation_size": observation_size,
        "action_size": action_size,
        "dt": dt,
        "units": None if architecture in DEEP_NETS or layered else units,
        "features": chosen,
        "dtype": str(dtype).removeprefix("torch."),
        **options,
    }
    with torch.no_grad():
        policy.head.weight.mul_(head_scale)
    return policy
