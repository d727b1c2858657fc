"""The table of Gymnasium environments, made from Gymnasium's registry."""

from __future__ import annotations

import inspect
import re

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete, Space

import thesis_lib  # noqa: F401  (registers them)
from thesis_lib.book.tables import table_markdown
from thesis_lib.domains.environments import DOMAINS
from thesis_lib.domains.heat_environment import HeatEnv


def environments_markdown() -> str:
    """Body of the page *Environments*: every id with what it is and its spaces, as MyST."""
    rows = []
    for env_id in sorted(_ids(), key=_robots_last):
        env = gymnasium.make(env_id)
        spaces = _told(env.observation_space), _told(env.action_space)
        rows.append((f"`{env_id}`", _words(env_id), *spaces))
        env.close()
    title = "The environments, as `gymnasium.make` takes them after `import thesis_lib`"
    heads = ("id", "what it is", "observation", "action")
    return "\n".join(table_markdown(title, "tbl-environments", heads, rows))


def _ids() -> list[str]:
    """Ids of this library's own environments, in the order they are registered in."""
    return [name for name in gymnasium.registry if name.startswith("thesis/")]


def _robots_last(env_id: str) -> bool:
    return "robot" in gymnasium.spec(env_id).kwargs


def _words(env_id: str) -> str:
    """A line on an environment, from the docstring of what makes it."""
    given = gymnasium.spec(env_id).kwargs
    if "robot" in given:
        ground = f"hills of difficulty {given['difficulty']:g}" if "difficulty" in given else "flat"
        return f"{given['robot']} of section 5.1, ground: {ground}"
    made = DOMAINS[given["domain"]] if "domain" in given else HeatEnv
    first = (inspect.getdoc(made) or "").partition("\n")[0].partition(";")[0].rstrip(".")
    return re.sub(r":math:`([^`]*)`", r"$\1$", first).replace("|", r"\|")


def _end(high: float) -> str:
    """The end of an interval; a full turn by its name."""
    return "2π" if np.isclose(high, 2 * np.pi) else f"{high:g}"


def _told(space: Space) -> str:
    """A space in a few characters."""
    if isinstance(space, Discrete):
        return f"one of {space.n}"
    assert isinstance(space, Box), space
    ends = ""
    if abs(space.high).max() <= 1e3:
        pairs = [*zip(space.low.tolist(), space.high.tolist(), strict=True)]
        told = [f"[{low:g}, {_end(high)}]" for low, high in pairs]
        ends = " in " + (told[0] if len(set(told)) == 1 else ", ".join(told))
        ends = ends.replace("-", "\N{MINUS SIGN}")
    return f"{space.shape[0]} reals{ends}"
