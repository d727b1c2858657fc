"""Compiled tabular learning against the same learners in plain Python.

The peers run Sarsa (algorithm 3) on the same task with the same random numbers, and the
script stops if their Q-table is not ours, bit for bit:

* Gymnasium: a NumPy Q-table and ``gymnasium.make``, the loop that most readers would write;
* Gymnasium, lists: the environment without its wrappers, and Q-tables of Python lists;
* Python: no environment at all, successors and rewards looked up in lists.

The tasks are the 4 x 4 cliff of Table 3.1 and Gymnasium's own CliffWalking-v1, whose step
is Gymnasium's code.  Rates are steps a second of process CPU time, medians of interleaved
rounds, after compilation.

    python benchmarks/tabular_learning.py [--json] [--repeats 5] [--steps 5000000]
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from statistics import median
from typing import Any

import gymnasium
import numpy as np

from thesis_lib.domains import continuing_cliff, episodic_cliff, stock
from thesis_lib.mdp import MDP, TabularEnv, TabularMDP, learn, tie_tolerance
from thesis_lib.mdp.learning import METHODS, Method

ALPHA, EPSILON, SEED = 0.4, 0.1, 0
Row = dict[str, Any]


class Peer:
    """An epsilon-greedy agent in Python that draws its random numbers as `learn` does."""

    def __init__(self, mdp: MDP) -> None:
        self.rng = np.random.default_rng(SEED)
        self.tie = tie_tolerance(mdp.outcomes().reward)

    def choose(self, row: list[float]) -> int:
        """Choose by a row of a table of lists."""
        u = self.rng.random()
        if u < EPSILON:
            return min(int(u / EPSILON * len(row)), len(row) - 1)
        least = max(row) - self.tie
        best = [a for a, value in enumerate(row) if value >= least]
        if len(best) == 1:
            return best[0]
        return best[min(int((u - EPSILON) / (1.0 - EPSILON) * len(best)), len(best) - 1)]

    def choose_numpy(self, row: np.ndarray) -> int:
        """Choose by a row of a NumPy table."""
        u = self.rng.random()
        if u < EPSILON:
            return min(int(u / EPSILON * len(row)), len(row) - 1)
        best = np.flatnonzero(row >= row.max() - self.tie)
        return int(best[min(int((u - EPSILON) / (1.0 - EPSILON) * len(best)), len(best) - 1)])


def sarsa_gymnasium(env: gymnasium.Env, mdp: MDP, steps: int) -> np.ndarray:
    agent = Peer(mdp)
    Q = np.zeros((mdp.n_states, mdp.n_actions))
    s, _ = env.reset(seed=SEED)
    a = agent.choose_numpy(Q[s])
    for _ in range(steps):
        s_next, r, terminated, _, _ = env.step(a)
        if terminated:
            Q[s, a] += ALPHA * (r - Q[s, a])
            s, _ = env.reset()
            a = agent.choose_numpy(Q[s])
        else:
            a_next = agent.choose_numpy(Q[s_next])
            Q[s, a] += ALPHA * (r + mdp.discount * Q[s_next, a_next] - Q[s, a])
            s, a = s_next, a_next
    return Q


def sarsa_lists(env: gymnasium.Env, mdp: MDP, steps: int) -> np.ndarray:
    agent = Peer(mdp)
    gamma = mdp.discount
    Q = np.zeros((mdp.n_states, mdp.n_actions)).tolist()
    s, _ = env.reset(seed=SEED)
    a = agent.choose(Q[s])
    for _ in range(steps):
        s_next, r, terminated, _, _ = env.step(a)
        if terminated:
            Q[s][a] += ALPHA * (r - Q[s][a])
            s, _ = env.reset()
            a = agent.choose(Q[s])
        else:
            row = Q[s_next]
            a_next = agent.choose(row)
            Q[s][a] += ALPHA * (r + gamma * row[a_next] - Q[s][a])
            s, a = s_next, a_next
    return np.array(Q)


def sarsa_python(mdp: MDP, steps: int) -> np.ndarray:
    agent = Peer(mdp)
    gamma = mdp.discount
    listed = mdp.outcomes()
    successor = listed.successor[:, :, 0].tolist()
    reward = listed.reward[:, :, 0].tolist()
    terminal = mdp.terminal.tolist()
    first = int(np.flatnonzero(mdp.start)[0])
    Q = np.zeros((mdp.n_states, mdp.n_actions)).tolist()
    s = first
    a = agent.choose(Q[s])
    for _ in range(steps):
        s_next, r = successor[s][a], reward[s][a]
        if terminal[s_next]:
            Q[s][a] += ALPHA * (r - Q[s][a])
            s = first
            a = agent.choose(Q[s])
        else:
            row = Q[s_next]
            a_next = agent.choose(row)
            Q[s][a] += ALPHA * (r + gamma * row[a_next] - Q[s][a])
            s, a = s_next, a_next
    return np.array(Q)


def ours(mdp: MDP, steps: int, method: Method = "sarsa") -> np.ndarray:
    return learn(mdp, method, alpha=ALPHA, epsilon=EPSILON, steps=steps, rng=SEED).q


def cliff_walking() -> tuple[gymnasium.Env, TabularMDP]:
    """Gymnasium's task and the same as a matrix; its goal states are read off its model."""
    env = gymnasium.make("CliffWalking-v1", max_episode_steps=-1)
    model = env.unwrapped.P  # type: ignore[attr-defined]
    S, A = len(model), len(model[0])
    P, R, terminal = np.zeros((S, A, S)), np.zeros((S, A)), np.zeros(S, dtype=bool)
    for s in range(S):
        for a in range(A):
            for p, s_next, r, done in model[s][a]:
                P[s, a, s_next] += p
                R[s, a] += p * r
                terminal[s_next] |= done
    P[terminal] = np.eye(S)[terminal][:, None]
    R[terminal] = 0.0
    start = np.asarray(env.unwrapped.initial_state_distrib)  # type: ignore[attr-defined]
    return env, TabularMDP(P, R, start, terminal, 1.0)


def clock(function: Callable[[int], np.ndarray], steps: int) -> float:
    """Steps a CPU second of one call."""
    begin = time.process_time()
    function(steps)
    return steps / (time.process_time() - begin)


def compare(
    name: str,
    mdp: MDP,
    peer: Callable[[int], np.ndarray],
    peer_steps: int,
    args: argparse.Namespace,
) -> Row:
    """Time ours and a peer in turns, once it is sure that they compute the same table."""
    if not np.array_equal(ours(mdp, 2000), peer(2000)):
        raise SystemExit(f"{name}: the peer's Q-table is not ours")
    pairs = [
        (clock(lambda n: ours(mdp, n), args.steps), clock(peer, peer_steps))
        for _ in range(args.repeats)
    ]
    our_rate, peer_rate = (median(rates) for rates in zip(*pairs, strict=True))
    ratio = median(a / b for a, b in pairs)
    return {"name": name, "ours": our_rate, "peer": peer_rate, "ratio": ratio, "unit": "steps/s"}


def rate(name: str, function: Callable[[int], np.ndarray], args: argparse.Namespace) -> Row:
    """Time ours where there is no peer."""
    function(10)
    ours_rate = median(clock(function, args.steps) for _ in range(args.repeats))
    return {"name": name, "ours": ours_rate, "peer": None, "ratio": None, "unit": "steps/s"}


def call_overhead(mdp: MDP, repeats: int) -> Row:
    """Time of a call that learns a single step."""
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        for _ in range(200):
            ours(mdp, 1)
        times.append((time.process_time() - begin) / 200)
    return {
        "name": "one call of learn, one step",
        "ours": 1e6 * median(times),
        "peer": None,
        "ratio": None,
        "unit": "us",
    }


def measure(args: argparse.Namespace) -> list[Row]:
    cliff = episodic_cliff().tasks[0]
    gymnasium.register("benchmark/Cliff-v0", TabularEnv)
    made = gymnasium.make("benchmark/Cliff-v0", mdp=cliff)
    walking, walking_mdp = cliff_walking()
    few, many = args.steps // 100, args.steps // 20
    rows = [
        compare(
            "sarsa, cliff 4 x 4: Gymnasium",
            cliff,
            lambda n: sarsa_gymnasium(made, cliff, n),
            few,
            args,
        ),
        compare(
            "sarsa, cliff 4 x 4: Gymnasium, lists",
            cliff,
            lambda n: sarsa_lists(made.unwrapped, cliff, n),
            few,
            args,
        ),
        compare("sarsa, cliff 4 x 4: Python", cliff, lambda n: sarsa_python(cliff, n), many, args),
        compare(
            "sarsa, CliffWalking-v1: Gymnasium",
            walking_mdp,
            lambda n: sarsa_gymnasium(walking, walking_mdp, n),
            few,
            args,
        ),
    ]
    tasks = {
        "cliff 4 x 4": cliff,
        "continuing cliff": continuing_cliff(discount=0.95).tasks[0],
        "stock <1,2,2>, 16 outcomes": stock(1, 2, 2).tasks[0],
    }
    for name, task in tasks.items():
        for method in METHODS:
            rows.append(rate(f"{method}, {name}", lambda n, t=task, m=method: ours(t, n, m), args))
    rows.append(call_overhead(cliff, args.repeats))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--json", action="store_true", help="rows for machines")
    parser.add_argument("--repeats", type=int, default=5, help="rounds of each measurement")
    parser.add_argument("--steps", type=int, default=5_000_000, help="steps of our learner")
    args = parser.parse_args()
    rows = measure(args)
    if args.json:
        print(json.dumps(rows))
        return
    print(f"{'':46}{'ours':>14}{'peer':>12}{'ratio':>8}")
    for row in rows:
        peer = "" if row["peer"] is None else f"{row['peer']:,.0f}"
        ratio = "" if row["ratio"] is None else f"{row['ratio']:.0f}"
        print(f"{row['name']:46}{row['ours']:14,.0f}{peer:>12}{ratio:>8}  {row['unit']}")


if __name__ == "__main__":
    main()
