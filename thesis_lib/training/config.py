"""The settings of a training run (table 5.1, section 5.4 and the author's code)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any

import gymnasium
import torch

from thesis_lib.checks import check_seed, one_of, plain_settings, positive_integer, positive_number
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.policies import ARCHITECTURES, DEEP_NETS, RECURRENT_NETS
from thesis_lib.published import TASKS
from thesis_lib.published import load as published
from thesis_lib.registration import offers

TERRAINS = ("flat", "hill")
ALGORITHMS = ("trpo", "vpg", "natural", "ppo")
BASELINES = ("linear", "network")
FEATURES = ("thesis", "text", "literal", "code", "full")
SUBSET: Mapping[str, str] = {"Swimmer": "text", "Hopper": "code"}
"""The readings of table 5.1's feature subset that ``features="thesis"`` stands for.  On the hopper
the text's learns next to nothing: only the author's, with velocities, reaches table 5.2."""
NARROWED = tuple(SUBSET)
"""Robots on which table 5.1 gives recurrent nets a subset of the sensors."""
PRECISIONS: Mapping[str, torch.dtype] = {"float32": torch.float32, "float64": torch.float64}

DUAN_DELTA: Mapping[str, float] = {"Swimmer": 0.1}
"""Step sizes of the nets that table 5.1 leaves out: it refers to Duan et al., whose text states
the swimmer's."""

OUR_DELTA = 0.05
"""The same for the other tasks, whose step sizes stand in a supplement we do not have.  A script of
Duan et al.'s group for these robots has 0.08 and 0.1 (see results/calibration)."""

HEAD_SCALE: Mapping[str, float] = {"ffwd": 0.1, "gru": 0.1, "lstm": 0.1, "esn": 0.1}
"""What the initial weights of these nets' output layers are multiplied with.  The thesis does not
say how they start.  On the half-cheetah a tenth of the author's law (Glorot) brings FFWD and GRU
nearer to table 5.2, and takes the DTRNN away from it; ESN and LSTM, whose seeds do not tell the two
apart, are taken as the GRU (see results/calibration)."""

LOG_STD_RANGE = (-10.0, 10.0)
"""Where the logarithm of the actions' standard deviation may start."""

TASK_NAMES: Mapping[str, str] = {
    "swimmer": "Swimmer",
    "hopper": "Hopper",
    "halfcheetah": "HalfCheetah",
    "walker": "Walker2d",
    "walker2d": "Walker2d",
    "ant": "Ant",
}
"""Names under which a task is found; case, ``-`` and ``_`` do not matter."""

_MAY_CHANGE = ("iterations", "checkpoint_every", "threads")
_NEEDS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "integrator": ("architecture", ("ctrnn",)),
    "time_constant": ("architecture", ("ctrnn",)),
    "constraint": ("architecture", ("ctrnn",)),
    "spectral_radius": ("architecture", ("esn",)),
    "density": ("architecture", ("esn",)),
    "leak": ("architecture", ("esn",)),
    "forget_bias": ("architecture", ("lstm",)),
    "gate_initialisation": ("architecture", ("gru", "lstm")),
    "time_constant_spread": ("architecture", ("ctrnn",)),
    "trainable_time_constant": ("architecture", ("ctrnn",)),
    "initialisation": ("architecture", ("ffwd", "dffwd", "dffwd-softplus", "ffwd-400")),
    "units": ("architecture", tuple(name for name in ARCHITECTURES if name not in DEEP_NETS)),
    "learning_rate": ("algorithm", ("vpg", "ppo")),
    "delta_kl": ("algorithm", ("trpo", "natural")),
    "cg_iterations": ("algorithm", ("trpo", "natural")),
    "damping": ("algorithm", ("trpo", "natural")),
    "kl_direction": ("algorithm", ("trpo",)),
    "difficulty": ("terrain", ("hill",)),
    "maps": ("terrain", ("hill",)),
}
SEED_KEYS = {"task": 0, "noise": 1, "terrain": 2}
FORMERLY = {"trace": "gae_lambda", "worlds": "num_envs"}
"""How runs that earlier versions saved call a setting, and its present name."""


@dataclass(frozen=True)
class TrainConfig:
    """One training run; defaults from table 5.1, section 5.4 and the author's code."""

    task: str = "Hopper"
    """Swimmer, Hopper, HalfCheetah, Walker2d, Ant, a robot that a package offers, or the id of a
    Gymnasium environment with a Box action, such as Pendulum-v1 or my_package:Mine-v0, where the
    package that registers it is imported."""
    terrain: str = "flat"
    """flat, or hill: one map, drawn from the seed."""
    architecture: str = "dtrnn"
    """ffwd, dffwd, dtrnn, ctrnn, gru, lstm, esn, dffwd-softplus, ffwd-400, or one that a package
    offers."""
    seed: int = 0
    """All randomness comes from it."""
    iterations: int = 500
    """Iterations of the learning algorithm (tables average the first 500)."""
    batch_steps: int = 50_000
    """Steps of an iteration: whole episodes of at least this many together (Duan et al.)."""
    horizon: int = 500
    """Steps of an episode (Duan et al.)."""
    algorithm: str = "trpo"
    """trpo, vpg, natural or ppo."""
    delta_kl: float | None = None
    """Bound on the divergence in nats; default table 5.1; where it has no entry 0.05, and 0.1 for
    the swimmer."""
    learning_rate: float | None = None
    """Of vpg and ppo; default 0.01 and 0.0003."""
    discount: float = 0.99
    """gamma (Duan et al.)."""
    gae_lambda: float = 1.0
    """lambda of the advantage estimate; 1 is equation 2.12."""
    bootstrap: bool = False
    """Credit episodes cut at the horizon with the baseline; the author does not."""
    baseline: str = "linear"
    """linear (Duan et al.), or network: a neural one, fitted to lambda-returns."""
    cg_iterations: int = 10
    """Conjugate-gradient steps."""
    damping: float = 1e-5
    """Added to the diagonal of the Fisher matrix."""
    kl_direction: str = "old_new"
    """old_new (the author's code) or new_old (equation 2.14)."""
    features: str = "thesis"
    """What recurrent nets see of Hopper and Swimmer: a reading of table 5.1 (thesis, the default
    one; text, literal or code, see SUBSETS), or full."""
    difficulty: float = 0.5
    """Height of the hills in metres."""
    maps: int = 1
    """Number of hill maps the worlds share out; the author trained on one."""
    reading: str = "code"
    """code, text or duan: whose rewards and observations (see make_task)."""
    alive_bonus: float | None = None
    """Replaces the task's bonus for staying alive, in reward a step."""
    units: int | None = None
    """Hidden units of nets with one hidden layer; default section 5.4."""
    previous_action: bool | None = None
    """Whether the net sees its last action; default recurrent nets do."""
    integrator: str = "heun"
    """Of the CTRNN: heun (the author's "midpoint"), euler or midpoint."""
    time_constant: float = 0.1
    """Initial time constants of the CTRNN in seconds: of those tried at the printed batch (see
    results/calibration) the one that learns as fast as table 5.2 has it.  The author's default
    is 1."""
    time_constant_spread: float = 1.0
    """Largest over smallest of them."""
    trainable_time_constant: bool = True
    """Whether they are learned."""
    constraint: str = "clamp"
    """How the CTRNN's time constants stay above the step: clamp, softplus, exponential."""
    spectral_radius: float | None = None
    """Of the ESN; default table 5.1."""
    density: float | None = None
    """Of the ESN's recurrent weights; default table 5.1."""
    leak: float = 0.5
    """Of the ESN."""
    forget_bias: float = 1.0
    """Of the LSTM: constant added in its forget gate."""
    gate_initialisation: str | None = None
    """Law of a gated net's recurrent weights, glorot or orthogonal; default the author's: glorot
    for the GRU, orthogonal for the LSTM."""
    initial_log_std: float = 0.0
    """Start of the log standard deviation of the actions."""
    initialisation: str = "glorot"
    """Law of a feedforward net's initial weights: glorot (the author's code) or orthogonal."""
    head_scale: float | None = None
    """What the initial weights of the output layer are multiplied with; default HEAD_SCALE, where
    it has no entry 1."""
    num_envs: int | None = None
    """Worlds simulated side by side; default one for each episode of a full batch."""
    precision: str = "float32"
    """float32 or float64 networks, a neural baseline among them; physics, returns and the linear
    baseline are always float64."""
    threads: int = 1
    """Threads of the physics; the result does not depend on it."""
    checkpoint_every: int = 10
    """Iterations between checkpoints."""

    def __post_init__(self) -> None:
        check_seed(self.seed)
        plain_settings(self)
        object.__setattr__(self, "task", task_name(self.task))
        for name, allowed in (
            ("terrain", TERRAINS),
            ("architecture", _architectures(self.architecture)),
            ("algorithm", ALGORITHMS),
            ("baseline", BASELINES),
            ("features", FEATURES),
            ("precision", PRECISIONS),
        ):
            one_of(name, getattr(self, name), allowed)
        if self.terrain != "flat" and not is_robot(self.task):
            raise ValueError(
                f"terrain is {self.terrain!r}, but {self.task} has none: leave it flat."
            )
        for name in ("iterations", "batch_steps", "horizon", "maps", "checkpoint_every"):
            positive_integer(name, getattr(self, name))
        if self.num_envs is not None:
            positive_integer("num_envs", self.num_envs)
        for name in ("delta_kl", "learning_rate"):
            if getattr(self, name) is not None:
                positive_number(name, getattr(self, name))
        low, high = LOG_STD_RANGE
        if not low <= self.initial_log_std <= high:
            raise ValueError(
                f"initial_log_std is {self.initial_log_std}, but it must be between {low:g} and "
                f"{high:g}: less noise explores nothing, and more is clipped from every action."
            )


def _architectures(asked: str) -> tuple[str, ...]:
    """The architectures there are; what packages offer is looked up for a name that is new."""
    return tuple(
        ARCHITECTURES if asked in ARCHITECTURES else (*ARCHITECTURES, *offers("architecture"))
    )


def idle_settings(config: TrainConfig) -> dict[str, str]:
    """Settings that differ from their default and have no effect, with what they belong to."""
    default = TrainConfig()
    return {
        name: owner
        for name, owner in _without_effect(config).items()
        if getattr(config, name) != getattr(default, name)
    }


def _without_effect(config: TrainConfig) -> dict[str, str]:
    """Settings that have no effect on a run, with what they belong to."""
    of_robots = () if is_robot(config.task) else ("features", "reading", "alive_bonus", "threads")
    offered = config.architecture not in ARCHITECTURES
    return dict.fromkeys(of_robots, "a robot's task") | {
        name: f"{by} {' or '.join(values)}"
        for name, (by, values) in _NEEDS.items()
        if getattr(config, by) not in values and not (offered and name == "units")
    }


def task_name(name: str) -> str:
    """The name of a task: a robot's in any spelling, or an environment's id.

    Raises
    ------
    ValueError
        Naming the tasks there are, or the package before the colon that can't be imported.
    """
    plain = name.replace("_", "").replace("-", "").lower()
    if plain in TASK_NAMES:
        return TASK_NAMES[plain]
    if is_robot(name) or name in gymnasium.registry:
        return name
    package, colon, own = name.partition(":")
    if colon:
        try:
            import_module(package)
        except (ImportError, TypeError, ValueError) as error:
            raise ValueError(
                f"task {name!r} is of {package!r}, which can't be imported ({error}): install "
                "that package, or mend its name."
            ) from error
        if own in gymnasium.registry:
            return name
    robots = ", ".join((*ROBOTS, *offers("robot")))
    raise ValueError(
        f"task {name!r} does not exist: choose one of {robots}, or the id of an environment that "
        "is registered in Gymnasium, as my_package:Mine-v0 where a package of yours does so."
    )


def is_robot(task: str) -> bool:
    """Whether a task is a robot's, and no other environment of Gymnasium."""
    return task in ROBOTS or task in offers("robot")


@cache
def table_5_1(task: str, architecture: str, quantity: str) -> float | None:
    """A setting that table 5.1 or its caption prints, None where it prints none.

    Parameters
    ----------
    task
        Name of the task.
    architecture
        Name of the net.
    quantity
        ``delta_kl``, ``spectral_radius`` or ``weight_density``.
    """
    table = published("table-5.1")
    chosen = table[
        (table.task == TASKS.get(task))
        & (table.architecture == architecture.upper())
        & (table.quantity == quantity)
    ]
    return None if chosen.empty else float(chosen.value.iloc[0])


def step_size(config: TrainConfig) -> float:
    """The bound on the divergence of a run: asked for, printed in table 5.1, or Duan et al.'s."""
    if config.delta_kl is not None:
        return config.delta_kl
    printed = table_5_1(config.task, config.architecture, "delta_kl")
    return DUAN_DELTA.get(config.task, OUR_DELTA) if printed is None else printed


def head_scale(config: TrainConfig) -> float:
    """What the initial weights of the output layer are multiplied with in a run."""
    if config.head_scale is not None:
        return config.head_scale
    return HEAD_SCALE.get(config.architecture, 1.0)


def sensors(config: TrainConfig) -> str:
    """What a run's net sees: ``all``, or the reading of table 5.1's subset."""
    if config.architecture not in RECURRENT_NETS or config.task not in NARROWED:
        return "all"
    named = {"thesis": SUBSET[config.task], "full": "all"}
    return named.get(config.features, config.features)


def settled(config: TrainConfig) -> dict[str, float]:
    """What the settings that are left to their defaults come to: ``delta_kl``, ``head_scale``."""
    return {"delta_kl": step_size(config), "head_scale": head_scale(config)}


def renamed(saved: Mapping[str, Any]) -> dict[str, Any]:
    """Settings of a saved run by their present names."""
    return {FORMERLY.get(name, name): value for name, value in saved.items()}


def differences(saved: Mapping[str, Any], config: TrainConfig) -> dict[str, tuple[object, object]]:
    """Settings in which a saved run is not the one asked for: what it has, and what is wanted.

    Those without effect on the run that is asked for do not count.

    Parameters
    ----------
    saved
        With the entries ``config`` and those of :func:`settled`, as checkpoints and records have
        them.
    config
        The run that is asked for.
    """
    have = dataclasses.asdict(TrainConfig()) | renamed(saved["config"])
    want = dataclasses.asdict(config)
    # A default may be another number in another version of this library.
    for name, value in settled(config).items():
        have[name], want[name] = saved.get(name, have[name]), value
    return {
        name: (have[name], want[name])
        for name in want
        if name not in (*_MAY_CHANGE, *_without_effect(config)) and have[name] != want[name]
    }
