"""The learners in plain Python, drawing the random numbers that `learn` documents.

`sarsa` and `q_learning` are algorithms 3 and 4 line by line, with the loop over episodes
that they leave to the reader.
"""

import numpy as np


class World:
    """A task to step through and an epsilon-greedy choice."""

    def __init__(self, mdp, epsilon, tie, rng, others=False):
        self.mdp, self.epsilon, self.tie, self.rng, self.others = mdp, epsilon, tie, rng, others
        self.listed = mdp.outcomes()

    def draw(self, probabilities):
        possible = np.flatnonzero(probabilities)
        if len(possible) == 1:
            return int(possible[0])
        u, total = self.rng.random(), 0.0
        for i, p in enumerate(probabilities):
            total += p
            if u < total:
                return i
        return int(possible[-1])

    def first_state(self):
        return self.draw(self.mdp.start)

    def step(self, s, a):
        k = self.draw(self.listed.probability[s, a])
        return float(self.listed.reward[s, a, k]), int(self.listed.successor[s, a, k])

    def greedy(self, row):
        return [a for a, v in enumerate(row) if v >= max(row) - self.tie]

    def pick(self, row, u):
        best = self.greedy(row)
        return best[min(int(u * len(best)), len(best) - 1)]

    def choose(self, row):
        u = self.rng.random()
        if u >= self.epsilon:
            return self.pick(row, (u - self.epsilon) / (1.0 - self.epsilon))
        actions = list(range(len(row)))
        if self.others:
            actions = [a for a in actions if a not in self.greedy(row)] or actions
        return actions[min(int(u / self.epsilon * len(actions)), len(actions) - 1)]

    def soft_mean(self, row):
        """Mean of `row` over the epsilon-greedy policy."""
        best = self.greedy(row)
        random = list(range(len(row)))
        if self.others:
            random = [a for a in random if a not in best] or random
        return (1 - self.epsilon) * np.mean([row[a] for a in best]) + self.epsilon * np.mean(
            [row[a] for a in random]
        )


def sarsa(world, alpha, episodes):
    mdp = world.mdp
    Q = np.zeros((mdp.n_states, mdp.n_actions)).tolist()
    for _ in range(episodes):
        s = world.first_state()
        a = world.choose(Q[s])
        while not mdp.terminal[s]:
            r, s_next = world.step(s, a)
            a_next = 0 if mdp.terminal[s_next] else world.choose(Q[s_next])
            Q[s][a] += alpha * (r + mdp.discount * Q[s_next][a_next] - Q[s][a])
            s, a = s_next, a_next
    return np.array(Q)


def q_learning(world, alpha, episodes):
    mdp = world.mdp
    Q = np.zeros((mdp.n_states, mdp.n_actions)).tolist()
    for _ in range(episodes):
        s = world.first_state()
        while not mdp.terminal[s]:
            a = world.choose(Q[s])
            r, s_next = world.step(s, a)
            Q[s][a] += alpha * (r + mdp.discount * max(Q[s_next]) - Q[s][a])
            s = s_next
    return np.array(Q)


def expected_sarsa(world, alpha, episodes):
    mdp = world.mdp
    Q = np.zeros((mdp.n_states, mdp.n_actions))
    for _ in range(episodes):
        s = world.first_state()
        while not mdp.terminal[s]:
            a = world.choose(Q[s])
            r, s_next = world.step(s, a)
            value = 0.0 if mdp.terminal[s_next] else world.soft_mean(Q[s_next])
            Q[s, a] += alpha * (r + mdp.discount * value - Q[s, a])
            s = s_next
    return Q


def double_q_learning(world, alpha, episodes):
    mdp = world.mdp
    pair = np.zeros((2, mdp.n_states, mdp.n_actions))
    for _ in range(episodes):
        s = world.first_state()
        while not mdp.terminal[s]:
            a = world.choose(0.5 * (pair[0, s] + pair[1, s]))
            r, s_next = world.step(s, a)
            u = world.rng.random()
            i = int(u >= 0.5)
            value = 0.0
            if not mdp.terminal[s_next]:
                value = pair[1 - i, s_next, world.pick(pair[i, s_next], 2 * u - i)]
            pair[i, s, a] += alpha * (r + mdp.discount * value - pair[i, s, a])
            s = s_next
    return 0.5 * (pair[0] + pair[1])
