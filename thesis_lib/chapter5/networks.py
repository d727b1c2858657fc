"""The networks of section 5.2 as several results need them: names, instances, frequencies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from thesis_lib.arrays import FloatArray
from thesis_lib.edition.plots import COLOURS
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.locomotion.tasks import make_task
from thesis_lib.policies import GaussianPolicy, make_policy

NAMES: Mapping[str, str] = {
    "ffwd": "FFWD",
    "dffwd": "DFFWD",
    "dtrnn": "DTRNN",
    "ctrnn": "CTRNN",
    "lstm": "LSTM",
    "gru": "GRU",
    "esn": "ESN",
    "dffwd-softplus": "DFFWD, softplus",
    "ffwd-400": "FFWD, wide",
}
"""Names of the architectures on the page, in its order."""

STYLES: Mapping[str, tuple[str, str]] = {
    "ctrnn": (COLOURS[0], "-"),
    "dtrnn": (COLOURS[1], "-"),
    "esn": (COLOURS[2], "-"),
    "gru": (COLOURS[5], "-"),
    "lstm": (COLOURS[5], "--"),
    "ffwd": (COLOURS[4], "-"),
    "dffwd": (COLOURS[3], "-"),
    "ffwd-400": (COLOURS[4], "--"),
    "dffwd-softplus": (COLOURS[3], "--"),
}
"""Colour and line of each architecture: one colour a family, dashes for the second of one."""

NETS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "FFWD": ("ffwd", {}),
    "DFFWD": ("dffwd", {}),
    "DTRNN": ("dtrnn", {}),
    "CTRNN, 1 s": ("ctrnn", {"time_constant": 1.0}),
    "CTRNN, 0.1 s": ("ctrnn", {"time_constant": 0.1}),
    "GRU": ("gru", {}),
    "LSTM": ("lstm", {}),
    "ESN": ("esn", {}),
}
"""Networks compared as systems; the CTRNN with the author's initial time constant and a shorter."""

SLOW, GAIT, FAST = 0.5, 2.0, 10.0
"""Frequencies that count as slow (below), as those of a gait (about) and as noise (above) [Hz].

A gait's is a convention: ``ch5-gaits`` finds from 0.5 Hz (swimmer) to about 5 Hz
(half-cheetah), of which 2 Hz is near the middle, and none for the hopper and the walker.
"""


def policy_for(architecture: str, task: str, **options: Any) -> GaussianPolicy:
    """A policy with the sizes and the control step of a task, and its initial weights.

    Parameters
    ----------
    architecture, **options
        Of :func:`~thesis_lib.policies.make_policy`.
    task
        Name of the robot.
    """
    made = make_task(task)
    dt = ROBOTS[task].control_dt
    return make_policy(architecture, made.observation_size, made.action_size, dt=dt, **options)


def untrained_net(name: str, task: str, seed: int) -> GaussianPolicy:
    """A network of :data:`NETS` for a task, with its initial weights."""
    architecture, options = NETS[name]
    return policy_for(architecture, task, seed=seed, **options)


def random_direction(size: int, seed: np.random.SeedSequence) -> FloatArray:
    """A random unit vector, shape ``(size,)``."""
    draw = np.random.default_rng(seed).standard_normal(size)
    return np.asarray(draw / np.linalg.norm(draw))


def rms(values: FloatArray) -> FloatArray:
    """Root mean square over the last axis, the actions."""
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=-1)))


def gain_shares(own: pd.DataFrame, gait: float = GAIT) -> pd.DataFrame:
    """Gain within a fifth of a gait's frequency and at noise's, over that to slow signals, by seed.

    Parameters
    ----------
    own
        Columns ``seed``, ``frequency`` and ``gain`` of one kind of network.
    gait
        Frequency of the gait [Hz].

    Returns
    -------
    pandas.DataFrame
        Columns ``gait`` and ``noise``, and ``ratio`` of the second to the first.
    """
    bands = {
        "slow": own.frequency < SLOW,
        "gait": own.frequency.between(gait / 1.2, gait * 1.2),
        "noise": own.frequency > FAST,
    }
    gain = pd.DataFrame({n: own[rows].groupby("seed").gain.mean() for n, rows in bands.items()})
    shares = gain[["gait", "noise"]].div(gain.slow, axis=0)
    return shares.assign(ratio=gain.noise / gain.gait)


def by_network(cells: pd.Series) -> pd.DataFrame:
    """A table of networks by robots, for a page, from cells indexed by task and architecture."""
    wide = cells.unstack("task")
    wide = wide.reindex(
        index=[n for n in NAMES if n in wide.index], columns=[t for t in ROBOTS if t in wide]
    )
    wide = wide.rename(index=NAMES).rename_axis(None, axis=1).rename_axis("network")
    return wide.reset_index().fillna("–")


def low_to_high(values: pd.Series, places: int = 2) -> str:
    """The least and the largest with a dash between that no line ends at."""
    low, high = values.min(), values.max()
    return f"{low:.{places}f}\N{WORD JOINER}–\N{WORD JOINER}{high:.{places}f}"
