"""Tasks as Gymnasium environments, so that other people's agents can run on them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from thesis_lib.arrays import FloatArray, IntArray
from thesis_lib.checks import one_of
from thesis_lib.mdp.checks import require_mdp
from thesis_lib.mdp.model import MDP, TabularMDP
from thesis_lib.mdp.sampling import draw, sampler

Observation = Literal["state", "features"]
OBSERVATIONS: tuple[Observation, ...] = ("state", "features")


class TabularEnv(gymnasium.Env[Any, Any]):
    """A finite MDP as a :class:`gymnasium.Env`.

    An episode terminates in a terminal state.  It is never truncated here: pass
    ``max_episode_steps`` to ``gymnasium.make`` or wrap the environment in ``TimeLimit``.

    Parameters
    ----------
    mdp
        The task.
    observation
        ``"state"``: the index of the state, a ``Discrete`` space.  ``"features"``: the
        values of the named features in their order, a ``MultiDiscrete`` space.
    render_mode
        Only None: pictures of tasks belong to the book.

    Notes
    -----
    ``info`` holds the index of the state under ``"state"`` and the named features under
    ``"features"``.  Random numbers are drawn as by :func:`thesis_lib.mdp.learning.learn`,
    one for each start state and transition that has several outcomes.
    """

    metadata = {"render_modes": []}  # noqa: RUF012  (Gymnasium's own convention)

    def __init__(
        self,
        mdp: MDP,
        *,
        observation: Observation = "state",
        render_mode: None = None,
    ) -> None:
        if render_mode is not None:
            raise ValueError(f"render_mode is {render_mode!r}, but this environment has none.")
        require_mdp(mdp)
        one_of("observation", observation, OBSERVATIONS)
        self.mdp = mdp
        self.render_mode = render_mode
        self.action_space = spaces.Discrete(mdp.n_actions)
        self._sampler = sampler(mdp)
        if observation == "features" and not mdp.features:
            raise ValueError(
                "observation is 'features', but the task has none; give it some, or choose 'state'."
            )
        columns = [*mdp.features.values()] or [np.empty((mdp.n_states, 0), dtype=np.int64)]
        self._features = np.column_stack(columns)
        self._by_features = observation == "features"
        if self._by_features:
            lowest = self._features.min(axis=0)
            self.observation_space: spaces.Space[Any] = spaces.MultiDiscrete(
                self._features.max(axis=0) - lowest + 1, start=lowest
            )
        else:
            self.observation_space = spaces.Discrete(mdp.n_states)
        self._state = -1

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.int64 | IntArray, dict[str, Any]]:
        """Start an episode.

        Parameters
        ----------
        seed
            Seed of the environment's random numbers; None goes on with them.
        options
            ``{"state": s}`` starts in that state instead of a random one.

        Returns
        -------
        tuple
            Observation and info.
        """
        super().reset(seed=seed)
        forced = (options or {}).get("state")
        if forced is None:
            source = self._sampler
            self._state = int(source.start[self._draw(source.start_cumulative)])
        elif not 0 <= forced < self.mdp.n_states or self.mdp.terminal[forced]:
            raise ValueError(
                f"options ask to start in state {forced}, but it must be a non-terminal state "
                f"from 0 to {self.mdp.n_states - 1}."
            )
        else:
            self._state = int(forced)
        return self._observe()

    def step(self, action: int) -> tuple[np.int64 | IntArray, float, bool, bool, dict[str, Any]]:
        """Take an action.

        Returns
        -------
        tuple
            Observation, reward, whether the state is terminal, False (never truncated), info.

        Raises
        ------
        ValueError
            When the action is not in the action space.
        gymnasium.error.ResetNeeded
            When no episode was started.
        """
        if self._state < 0:
            raise gymnasium.error.ResetNeeded("call reset before the first step.")
        if not self.action_space.contains(action):
            raise ValueError(
                f"action is {action!r}, but it must be an integer from 0 to "
                f"{self.mdp.n_actions - 1}."
            )
        source, s = self._sampler, self._state
        k = self._draw(source.cumulative[s, action])
        reward = float(source.reward[s, action, k])
        self._state = int(source.successor[s, action, k])
        observation, info = self._observe()
        return observation, reward, bool(source.terminal[self._state]), False, info

    def _draw(self, row: FloatArray) -> int:
        return 0 if row[0] >= 1.0 else int(draw(row, self.np_random.random()))

    def _observe(self) -> tuple[np.int64 | IntArray, dict[str, Any]]:
        s = self._state
        values = self._features[s]
        named = dict(zip(self.mdp.features, values.tolist(), strict=True))
        seen = values.copy() if self._by_features else np.int64(s)
        return seen, {"state": s, "features": named}


def from_gymnasium(
    env: gymnasium.Env[Any, Any], discount: float, features: Mapping[str, ArrayLike] | None = None
) -> TabularMDP:
    """The task of an environment that lists its transitions, such as ``FrozenLake-v1``.

    Parameters
    ----------
    env
        An environment that, as Gymnasium's own tabular ones do, has a table ``P`` of lists
        ``P[s][a]`` of (probability, next state, reward, terminated), and the distribution
        ``initial_state_distrib`` of its first state.
    discount
        gamma, which environments do not know.
    features
        Named integer features of the states, each of shape ``(S,)``; default one, ``state``.

    Returns
    -------
    TabularMDP
        States in which an episode has terminated absorb, whatever ``P`` lists for them.

    Raises
    ------
    ValueError
        When this is no environment or has no such table, or an episode can end in a state from
        which another goes on: the states of an MDP do one or the other.
    """
    if not isinstance(env, gymnasium.Env):
        raise ValueError(f"env is {env!r}, but an environment is needed: gymnasium.make(...).")
    inner = env.unwrapped
    listed, start = getattr(inner, "P", None), getattr(inner, "initial_state_distrib", None)
    if listed is None or start is None:
        instead = "build a TabularMDP from what you know of it"
        if hasattr(inner, "mdp"):
            instead = "take the one that it holds, env.unwrapped.mdp"
        raise ValueError(
            f"{inner} lists no transitions (P and initial_state_distrib) to make an MDP of; "
            f"{instead}."
        )
    shape = (len(listed), len(listed[0]), len(listed))
    transition, earned = np.zeros(shape), np.zeros(shape)
    terminal = np.zeros(len(listed), dtype=bool)
    onward = np.zeros((len(listed), len(listed)), dtype=bool)
    for s, actions in listed.items():
        for a, outcomes in actions.items():
            for chance, t, reward, terminated in outcomes:
                transition[s, a, t] += chance
                earned[s, a, t] += chance * reward
                terminal[t] |= terminated
                onward[s, t] |= chance > 0 and not terminated
    reached = np.asarray(start) > 0
    while (more := onward[reached].any(axis=0) & ~reached).any():
        reached |= more
    if (both := terminal & reached).any():
        raise ValueError(
            f"an episode of {inner} can end in state {np.argmax(both)} and can also go on from "
            "there, but a state of an MDP does one or the other; let what ends it lead to a state "
            "of its own."
        )
    transition[terminal], earned[terminal] = np.eye(shape[0])[terminal, None], 0.0
    reward = earned.sum(axis=2)
    np.divide(earned, transition, out=earned, where=transition > 0)
    return TabularMDP(
        transition,
        reward,
        np.asarray(start),
        terminal,
        discount,
        features,  # type: ignore[arg-type]
        transition_reward=earned,
    )
