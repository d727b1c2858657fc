"""Policies for other programs: weights with a card that says what they are, and ONNX.

Neither form runs code when it is read.  The library's own form is a NumPy archive (``.npz``)
that holds an array for each parameter and a text, ``card.json``, that says how the network is
made, so that ``numpy.load`` and an unpacker are enough to read it elsewhere::

    Path("hopper.npz").write_bytes(dumps(policy))
    policy = loads(Path("hopper.npz").read_bytes())

The form of ONNX runs where neither PyTorch nor this library is: see :func:`to_onnx`.
"""

from __future__ import annotations

import io
import json
import logging
import warnings
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from thesis_lib.checks import as_json
from thesis_lib.policies.base import GaussianPolicy
from thesis_lib.policies.factory import SHALLOW_NETS, make_policy

FORMAT = 1
"""Version of the card."""

DTYPES = {"float32": torch.float32, "float64": torch.float64}
"""Number types by name."""

CARD = "card.json"
"""Name of the card in an archive."""


def card(policy: GaussianPolicy) -> dict[str, Any]:
    """What a policy is: how :func:`make_policy` makes it, and what goes in and comes out.

    Returns
    -------
    dict
        JSON values only: ``format``, ``recipe`` (the arguments of
        :func:`~thesis_lib.policies.make_policy` but the weights' source), ``inputs`` and
        ``outputs`` (name and width of each, in order), ``initial_state``, and ``log_std``, the
        logarithm of the standard deviation of an action around its mean.

    Raises
    ------
    ValueError
        When the policy does not come from :func:`~thesis_lib.policies.make_policy`, or an
        option of it can't be written down.
    """
    if policy.recipe is None:
        raise ValueError(
            f"this {type(policy).__name__} was not made by make_policy, so nothing tells how to "
            "make it again; make it by make_policy, and load its weights."
        )
    with torch.no_grad():
        made = {
            "format": FORMAT,
            "recipe": policy.recipe,
            "inputs": {name: tensor.shape[1] for name, tensor in _inputs(policy, 1).items()},
            "outputs": {"mean": policy.action_size, **_state(policy, "next_state")},
            "initial_state": policy.initial_state(1)[0].tolist(),
            "log_std": policy.deviation().tolist(),
        }
    try:
        return dict(json.loads(json.dumps(made, default=as_json)))
    except TypeError as error:
        raise ValueError(
            f"the options of this policy can't be written as JSON ({error}); make it with "
            "numbers and texts."
        ) from error


def dumps(policy: GaussianPolicy) -> bytes:
    """A policy as a NumPy archive; :func:`loads` is the inverse."""
    described = json.dumps(card(policy), indent=1)
    buffer = io.BytesIO()
    np.savez(buffer, **{name: t.detach().numpy() for name, t in policy.state_dict().items()})
    with zipfile.ZipFile(buffer, "a") as archive:
        archive.writestr(CARD, described)
    return buffer.getvalue()


def loads(data: bytes) -> GaussianPolicy:
    """Make the policy that :func:`dumps` wrote down; nothing in ``data`` is run.

    Raises
    ------
    ValueError
        When the archive is not one of a policy, or its weights do not fit its card.
    """
    try:
        archive = np.load(io.BytesIO(data), allow_pickle=False)
        if isinstance(archive, np.ndarray):
            raise TypeError("an array alone has no card")
        described = json.loads(archive[CARD])
        weights = {n: torch.from_numpy(archive[n]) for n in archive.files if n != CARD}
        version, recipe = described["format"], dict(described["recipe"])
    except (KeyError, TypeError, ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError("this is not a policy as thesis_lib writes it (dumps).") from error
    if version != FORMAT:
        raise ValueError(
            f"the policy has format {version}, but this version of thesis_lib reads {FORMAT}; use "
            "the version that wrote it."
        )
    try:
        if recipe["architecture"] in SHALLOW_NETS and "hidden" in recipe:
            recipe["units"] = None  # once written beside the layers, which decided
        policy = make_policy(**recipe | {"dtype": DTYPES[recipe["dtype"]]})
        policy.load_state_dict(weights)
    except (KeyError, RuntimeError, TypeError) as error:
        raise ValueError(f"the weights do not fit the card of the policy: {error}") from error
    policy.check_finite()
    return policy


def to_onnx(policy: GaussianPolicy) -> bytes:
    """One step of a policy as an ONNX model, for instance for onnxruntime.

    Parameters
    ----------
    policy
        From :func:`~thesis_lib.policies.make_policy`.

    Returns
    -------
    bytes
        A model of any number n of worlds.  Inputs: ``observation`` ``(n, D)``;
        ``previous_action`` ``(n, A)`` if the policy sees it, 0 at the first step; ``state``
        ``(n, S)`` if it has one, at first the card's ``initial_state``.  Outputs: ``mean``
        ``(n, A)`` and ``next_state`` ``(n, S)``.  All are of the policy's number type.  The
        model's metadata holds the :func:`card`.

    Raises
    ------
    ImportError
        When ``onnx`` or ``onnxscript`` is missing: ``pip install thesis_lib[onnx]``.
    """
    try:
        import onnx
        import onnxscript  # noqa: F401  (torch's exporter needs it)
    except ImportError as error:
        raise ImportError(f"{error}: install them, `pip install thesis_lib[onnx]`.") from error
    described = json.dumps(card(policy))
    inputs = _inputs(policy, 2)
    with _quiet():
        exported = torch.onnx.export(
            _Step(policy, tuple(inputs)),
            tuple(inputs.values()),
            input_names=list(inputs),
            output_names=["mean", *_state(policy, "next_state")],
            dynamic_shapes={"tensors": tuple({0: "worlds"} for _ in inputs)},
            dynamo=True,
            verbose=False,
        )
    assert exported is not None
    model = exported.model_proto
    # The exporter notes for every part where in whose files it comes from.
    for part in (model.graph, *model.graph.node, *model.graph.value_info, *model.graph.input):
        del part.metadata_props[:]
    onnx.helper.set_model_props(model, {"card": described})
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString())


@contextmanager
def _quiet() -> Iterator[None]:
    """Without the exporter's remarks on packages that it does not need here."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(before)


class _Step(nn.Module):
    """One step, of the inputs that the policy has."""

    def __init__(self, policy: GaussianPolicy, names: tuple[str, ...]) -> None:
        super().__init__()
        self.policy, self.names = policy, names

    def forward(self, *tensors: Tensor) -> tuple[Tensor, ...]:
        given = dict(zip(self.names, tensors, strict=True))
        observation = given["observation"]
        none = observation[:, :0]
        action, state = (given.get(name, none) for name in ("previous_action", "state"))
        mean, state = self.policy.step(observation, action, state)
        return (mean, state) if "state" in given else (mean,)


def _inputs(policy: GaussianPolicy, n: int) -> dict[str, Tensor]:
    widths = {"observation": policy.observation_size}
    if policy.previous_action:
        widths["previous_action"] = policy.action_size
    widths |= _state(policy, "state")
    return {name: torch.zeros((n, width), dtype=policy.dtype) for name, width in widths.items()}


def _state(policy: GaussianPolicy, name: str) -> dict[str, int]:
    return {name: policy.state_size} if policy.state_size else {}
