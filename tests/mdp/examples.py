"""Small tasks whose solution is known, for the tests of this folder."""

import numpy as np

from thesis_lib.mdp.model import MDP, Outcomes, TabularMDP


def random_mdp(
    seed: int, n_states: int = 5, n_actions: int = 3, discount: float = 0.9, terminal: int = 0
) -> TabularMDP:
    """A random dense task; the last ``terminal`` states are absorbing."""
    rng = np.random.default_rng(seed)
    P = rng.dirichlet(np.ones(n_states), size=(n_states, n_actions))
    R = rng.normal(size=(n_states, n_actions))
    ended = np.arange(n_states) >= n_states - terminal
    P[ended] = np.eye(n_states)[ended][:, None]
    R[ended] = 0.0
    start = np.where(ended, 0.0, rng.dirichlet(np.ones(n_states)))
    return TabularMDP(P, R, start / start.sum(), ended, discount)


def grid(width: int = 4, discount: float = 1.0) -> TabularMDP:
    """A square grid from corner 0 to the opposite corner; every step costs 1."""
    n = width * width
    P = np.zeros((n, 4, n))
    for s in range(n - 1):
        x, y = s % width, s // width
        for a, (dx, dy) in enumerate([(0, 1), (1, 0), (0, -1), (-1, 0)]):
            to_x, to_y = (min(max(v, 0), width - 1) for v in (x + dx, y + dy))
            P[s, a, to_x + width * to_y] = 1.0
    P[n - 1, :, n - 1] = 1.0
    R = np.full((n, 4), -1.0)
    R[n - 1] = 0.0
    return TabularMDP(P, R, np.eye(n)[0], np.arange(n) == n - 1, discount, actions=tuple("NESW"))


def chain(n: int = 4, discount: float = 0.5) -> TabularMDP:
    """States 0..n-1 and the end n; action 0 stays, action 1 moves on; 8 for reaching the end."""
    P = np.zeros((n + 1, 2, n + 1))
    R = np.zeros((n + 1, 2))
    for s in range(n):
        P[s, 0, s] = P[s, 1, s + 1] = 1.0
    P[n, :, n] = 1.0
    R[n - 1, 1] = 8.0
    return TabularMDP(P, R, np.eye(n + 1)[0], np.arange(n + 1) == n, discount)


def reversed_chain(n: int = 4, discount: float = 0.5) -> TabularMDP:
    """The chain with its states numbered from the end: the end is 0 and the start n."""
    forward = chain(n, discount)
    order = np.arange(n + 1)[::-1]
    return TabularMDP(
        forward.transition[order][:, :, order],
        forward.reward[order],
        forward.start[order],
        forward.terminal[order],
        discount,
    )


class Factored(MDP):
    """A task that offers expectations only, as one too large for a matrix would."""

    def __init__(self, mdp: TabularMDP) -> None:
        self._matrix = mdp.transition
        for name in ("reward", "start", "terminal", "discount", "actions", "features"):
            setattr(self, name, getattr(mdp, name))

    def expectation(self, values):
        return self._matrix @ values

    def outcomes(self) -> Outcomes:
        raise AssertionError("nothing but expectations may be asked of this task")


def two_rooms() -> TabularMDP:
    """State 0 leads to state 1 with .25 and to the pair (2, 3) with .75; neither is left again.

    States 2 and 3 swap places at each step.  Reward 1 in state 1, 2 in state 2.
    """
    P = np.zeros((4, 1, 4))
    P[0, 0, [1, 2]] = 0.25, 0.75
    P[1, 0, 1] = P[2, 0, 3] = P[3, 0, 2] = 1.0
    return TabularMDP(P, [[0.0], [1.0], [2.0], [0.0]], [1, 0, 0, 0], None, 0.5)


def simulate(mdp: MDP, pi: np.ndarray, episodes: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Discounted returns of episodes ``(E,)`` and visits of pairs ``(S, A)``, all drawn at once."""
    rng, listed = np.random.default_rng(seed), mdp.outcomes()

    def draw(rows: np.ndarray) -> np.ndarray:
        return (rows.cumsum(axis=1) < rng.random(len(rows))[:, None]).sum(axis=1)

    returns, visits = np.zeros(episodes), np.zeros(pi.shape, dtype=int)
    running, s, weight = np.arange(episodes), draw(np.tile(mdp.start, (episodes, 1))), 1.0
    while len(running):
        a = draw(pi[s])
        k = draw(listed.probability[s, a])
        np.add.at(visits, (s, a), 1)
        returns[running] += weight * listed.reward[s, a, k]
        weight *= mdp.discount
        s = listed.successor[s, a, k]
        running, s = running[~mdp.terminal[s]], s[~mdp.terminal[s]]
    return returns, visits
