"""Policies of chapter 5: feedforward and recurrent networks with a Gaussian head."""

from thesis_lib.policies.base import GaussianPolicy, Linearised, Sequences
from thesis_lib.policies.distribution import entropy, kl_divergence, log_likelihood
from thesis_lib.policies.echo_state import ESN, spectral_radius
from thesis_lib.policies.factory import (
    ARCHITECTURES,
    DEEP_NETS,
    RECURRENT_NETS,
    make_policy,
    recurrent_units,
)
from thesis_lib.policies.feedforward import FeedforwardPolicy
from thesis_lib.policies.gated import GRU, LSTM
from thesis_lib.policies.linearised import DualLinearised
from thesis_lib.policies.packing import Packing
from thesis_lib.policies.recurrent import RecurrentPolicy
from thesis_lib.policies.vanilla import CTRNN, DTRNN

__all__ = [
    "ARCHITECTURES",
    "CTRNN",
    "DEEP_NETS",
    "DTRNN",
    "ESN",
    "GRU",
    "LSTM",
    "RECURRENT_NETS",
    "DualLinearised",
    "FeedforwardPolicy",
    "GaussianPolicy",
    "Linearised",
    "Packing",
    "RecurrentPolicy",
    "Sequences",
    "entropy",
    "kl_divergence",
    "log_likelihood",
    "make_policy",
    "recurrent_units",
    "spectral_radius",
]
