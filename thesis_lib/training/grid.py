"""The runs of a sweep, what they are called, and about what they cost."""

from __future__ import annotations

import ast
import dataclasses
import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from thesis_lib.checks import plain_settings
from thesis_lib.policies import ARCHITECTURES
from thesis_lib.training.columns import columns
from thesis_lib.training.config import TASK_NAMES, TrainConfig, idle_settings, settled

GRID = ("task", "terrain", "architecture", "seed", "precision")
"""Settings a sweep has a list of."""

BUDGET = ("iterations", "batch_steps", "horizon", "num_envs", "threads", "checkpoint_every")
"""Settings all runs of a sweep share."""

DEFAULT = "default"
"""The variant that leaves all other settings as they are."""

GRID_COLUMNS: Mapping[str, str] = columns("grid")
"""Columns that tell the runs of a sweep apart."""


@dataclass(frozen=True)
class Grid:
    """The runs of a sweep: every combination of these."""

    tasks: tuple[str, ...] = tuple(dict.fromkeys(TASK_NAMES.values()))
    """Swimmer, Hopper, HalfCheetah, Walker2d, Ant."""
    terrains: tuple[str, ...] = ("flat",)
    """flat, hill."""
    architectures: tuple[str, ...] = tuple(ARCHITECTURES)
    """ffwd, dffwd, dtrnn, ctrnn, gru, lstm, esn, dffwd-softplus, ffwd-400."""
    seeds: tuple[int, ...] = (0,)
    """Seeds."""
    precisions: tuple[str, ...] = ("float32",)
    """float32, float64."""
    variants: tuple[str, ...] = ()
    """Settings to try besides the default, such as "bootstrap=True" or "delta_kl=0.1,damping=0.1";
    nets on which they have no effect, or that have them by default, are left out."""

    def __post_init__(self) -> None:
        plain_settings(self)
        for f in dataclasses.fields(self):
            values = getattr(self, f.name)
            if not values and f.name != "variants":
                raise ValueError(f"{f.name} is empty, but a sweep needs at least one of them.")
            if len(set(values)) != len(values):
                raise ValueError(f"{f.name} names {first_repeated(values)!r} twice: name it once.")

    def runs(self, base: TrainConfig | None = None) -> list[TrainConfig]:
        """The runs, tasks outermost.

        Parameters
        ----------
        base
            All other settings.

        Raises
        ------
        ValueError
            When a value does not exist.
        """
        base = base or TrainConfig()
        variants = [{}, *map(parse_variant, self.variants)]
        found: dict[str, TrainConfig] = {}
        for task, terrain, net, variant, seed, precision in itertools.product(
            self.tasks, self.terrains, self.architectures, variants, self.seeds, self.precisions
        ):
            config = dataclasses.replace(
                base, task=task, terrain=terrain, architecture=net, seed=seed, precision=precision
            )
            changed = dataclasses.replace(config, **variant)
            if not set(variant) & set(idle_settings(changed)):
                found.setdefault(run_name(changed), changed)
        return list(found.values())


def parse_variant(text: str) -> dict[str, Any]:
    """Read settings from text such as ``"gae_lambda=0.97,damping=0.1"``.

    Raises
    ------
    ValueError
        When a setting does not exist, or is not for variants.
    """
    allowed = [f.name for f in dataclasses.fields(TrainConfig) if f.name not in (*GRID, *BUDGET)]
    found: dict[str, Any] = {}
    for part in text.split(","):
        name, equals, value = (p.strip() for p in part.partition("="))
        if not equals or name not in allowed:
            raise ValueError(
                f"variant {text!r} does not name a setting and its value: write for instance "
                f"bootstrap=True; the settings are {', '.join(allowed)}."
            )
        try:
            found[name] = ast.literal_eval(value)
        except (SyntaxError, ValueError):
            found[name] = value
    return found


def variant(config: TrainConfig) -> str:
    """Settings of a run that differ from the defaults and have an effect, as text.

    One that is given the value its default comes to does not differ.
    """
    default, chosen = TrainConfig(), settled(config)
    by_default = settled(dataclasses.replace(config, delta_kl=None, head_scale=None))
    idle = {*idle_settings(config), *(n for n in chosen if chosen[n] == by_default[n])}
    parts = [
        f"{f.name}={getattr(config, f.name)}"
        for f in dataclasses.fields(config)
        if f.name not in (*GRID, *BUDGET)
        and f.name not in idle
        and getattr(config, f.name) != getattr(default, f.name)
    ]
    return ", ".join(parts) or DEFAULT


def key(config: TrainConfig) -> dict[str, Any]:
    """What tells a run apart, by :data:`GRID_COLUMNS`."""
    return {name: getattr(config, name) for name in GRID} | {"variant": variant(config)}


def first_repeated(values: Sequence[Any]) -> Any:
    """The first value that stands twice; there must be one."""
    return next(v for i, v in enumerate(values) if v in values[:i])


def run_name(config: TrainConfig) -> str:
    """Name of a run within its sweep, such as ``hopper-flat-gru-0-float32``."""
    return named(key(config))


def named(run: Mapping[str, Any]) -> str:
    """The same for what tells a run apart, by :data:`GRID_COLUMNS`."""
    parts = [str(run[column]) for column in GRID_COLUMNS]
    if parts[-1] == DEFAULT:
        parts.pop()
    return re.sub(", |[=/:]", "-", "-".join(parts).lower())
