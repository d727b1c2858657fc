"""Gymnasium's ids for what is here, and the names by which other packages join in.

*Environments.*  ``import thesis_lib`` enters them in Gymnasium's registry by name alone, so
that ``gymnasium.make("thesis/Hopper-v0")`` works; without the import,
``gymnasium.make("thesis_lib:thesis/Hopper-v0")`` does the same.  (Gymnasium 1.0 gave up the
entry points by which ``import gymnasium`` found other packages' ids.)  There is an id for every
domain of chapters 3 and 4 and appendix A (:mod:`thesis_lib.domains.environments`), for every
robot of chapter 5 and each of them on hills (:mod:`thesis_lib.locomotion.envs`), and for what
installed packages offer.

*Offers.*  A package offers an object under a name by an entry point, for instance in its
``pyproject.toml``::

    [project.entry-points."thesis_lib.architectures"]
    my-net = "my_package.nets:MyNet"

The groups, and what stands behind the name:

``thesis_lib.architectures``
    A callable ``(observation_size, action_size, *, units, dt, seed, features, dtype,
    **options)`` that returns a :class:`~thesis_lib.policies.GaussianPolicy`; every function
    that takes the name of an architecture then takes this one.
``thesis_lib.domains``
    A callable ``(**options)`` that returns a :class:`~thesis_lib.domains.Domain`; its tasks
    are ``gymnasium.make("thesis/NAME-v0", task=0, **options)``.
``thesis_lib.robots``
    A :class:`~thesis_lib.locomotion.Robot`; it is ``gymnasium.make("thesis/NAME-v0")`` and the
    task ``make_task("NAME")``.
``thesis_lib.perturbations``
    A frozen dataclass that is a :class:`~thesis_lib.locomotion.batch.Perturbation`; tests of
    policies write it as ``NAME(field=value)``.

What is built in keeps its name and its id: installing a package changes no result of the thesis.
A name that two packages offer is refused when it is asked for, and not before.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Literal, TypeVar

import gymnasium

from thesis_lib.checks import one_of

Kind = Literal["architecture", "domain", "robot", "perturbation"]
T = TypeVar("T")

DOMAINS = (
    *("EpisodicCliff", "ContinuingCliff", "Triangle", "Stock"),
    *("AppendixA1", "AppendixA2", "AppendixA3"),
)
"""Names of the domains whose tasks are environments."""

ROBOTS = ("Swimmer", "Hopper", "HalfCheetah", "Walker2d", "Ant")
"""Names of the robots, in the order of table 5.2."""

HORIZON = 500
"""Control steps in a training episode (Duan et al.)."""

HILL_DIFFICULTY = 0.5
"""Difficulty of the hills that controllers are trained on (section 5.4)."""


def offers(kind: Kind) -> dict[str, tuple[EntryPoint, ...]]:
    """What installed packages offer, by name, more than one where they disagree; none is loaded."""
    found: dict[str, dict[str, EntryPoint]] = {}
    for point in entry_points(group=f"thesis_lib.{kind}s"):
        found.setdefault(point.name, {}).setdefault(point.value, point)
    return {name: tuple(points.values()) for name, points in found.items()}


def find(kind: Kind, name: str, built_in: Mapping[str, T]) -> T:
    """An object by its name: one of the thesis's, or one that a package offers.

    Parameters
    ----------
    kind
        What it is.
    name
        Its name.
    built_in
        Those of the thesis, which have precedence.

    Raises
    ------
    ValueError
        When there is none of that name, and the message names those there are; or when two
        packages offer it.
    ImportError
        When the package's object can't be loaded.
    """
    if name in built_in:
        return built_in[name]
    offered = offers(kind)
    one_of(kind, name, [*built_in, *offered])
    point, *others = offered[name]
    if others:
        raise ValueError(
            f"{kind} {name!r} is offered as {point.value} and as {others[0].value}; remove one of "
            "the packages."
        )
    try:
        found: T = point.load()
    except Exception as error:
        raise ImportError(
            f"{kind} {name!r} is offered as {point.value}, which can't be loaded "
            f"({type(error).__name__}: {error}); mend or remove that package."
        ) from error
    return found


def register() -> None:
    """Enter the environments in Gymnasium's registry, once; what is built in comes first."""
    for name in DOMAINS:
        _enter_domain(name)
    _enter("Heat", "thesis_lib.domains.heat_environment:HeatEnv")
    for name in ROBOTS:
        _enter_robot(name)
    for name in ROBOTS:
        _enter_robot(name, "Hill", difficulty=HILL_DIFFICULTY)
    for name in offers("domain"):
        _enter_offer("domain", name, _enter_domain)
    for name in offers("robot"):
        _enter_offer("robot", name, _enter_robot)


def _enter_offer(kind: Kind, name: str, enter: Callable[[str], None]) -> None:
    """Enter what a package offers; a name that makes no id harms nothing else."""
    try:
        enter(name)
    except gymnasium.error.Error as error:
        warnings.warn(f"{kind} {name!r} gets no id in Gymnasium: {error}", stacklevel=2)


def _enter_domain(name: str) -> None:
    _enter(name, "thesis_lib.domains.environments:make", domain=name)


def _enter_robot(robot: str, ground: str = "", **kwargs: Any) -> None:
    envs = "thesis_lib.locomotion.envs"
    one, many = f"{envs}:LocomotionEnv", f"{envs}:LocomotionVectorEnv"
    _enter(robot + ground, one, many, HORIZON, robot=robot, **kwargs)


def _enter(
    name: str, one: str, many: str | None = None, horizon: int | None = None, **kwargs: Any
) -> None:
    """Enter an id, unless it is there already."""
    env_id = f"thesis/{name}-v0"
    if env_id not in gymnasium.registry:
        gymnasium.register(
            env_id,
            entry_point=one,
            vector_entry_point=many,
            max_episode_steps=horizon,
            kwargs=kwargs,
        )
