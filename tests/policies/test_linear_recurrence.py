"""The compiled recurrence beside its equation written out, and its transpose."""

import numpy as np
import pytest

from thesis_lib.policies.linear_recurrence import LinearRecurrence, Rows

UNITS, SIZES = 3, [4, 4, 2, 1]  # episodes of 4, 3, 2 and 2 steps
ROWS = sum(SIZES)


def example(stages: int, parts: int, gates: int) -> tuple[LinearRecurrence, list, list, Rows]:
    """A recurrence with slopes in every argument a function can have."""
    rng = np.random.default_rng([stages, parts, gates])
    functions = stages - 1 + parts
    weight = rng.normal(size=(gates * UNITS, UNITS)) / 2

    def slopes(n: int) -> list[tuple[int, Rows]]:
        return [(k, rng.normal(size=(ROWS, UNITS))) for k in range(n)]

    # A function sees the results of the stages before it.
    recurrent = [
        [slopes(gates) if j <= min(i, stages - 1) else [] for j in range(stages)]
        for i in range(functions)
    ]
    state = [slopes(parts) for _ in range(functions)]
    return LinearRecurrence(weight, recurrent, state, SIZES), recurrent, state, weight


def written_out(recurrent: list, state: list, weight: Rows, sources: Rows, start: Rows) -> Rows:
    """The module's equation, row by row."""
    functions, stages = len(recurrent), len(recurrent[0])
    df = sources.copy()
    dr = np.zeros((stages, ROWS, len(weight)))
    bounds = np.concatenate(([0], np.cumsum(SIZES)))
    for t, size in enumerate(SIZES):
        for episode in range(size):
            row = bounds[t] + episode
            old = start[:, episode] if t == 0 else df[stages - 1 :, bounds[t - 1] + episode]
            dr[0, row] = weight @ old[0]
            for i in range(functions):
                for j in range(stages):
                    for gate, slope in recurrent[i][j]:
                        part = dr[j, row, gate * UNITS : (gate + 1) * UNITS]
                        df[i, row] += slope[row] * part
                for p, slope in state[i]:
                    df[i, row] += slope[row] * old[p]
                if i < stages - 1:
                    dr[i + 1, row] = weight @ df[i, row]
    return df


@pytest.mark.parametrize(("stages", "parts", "gates"), [(1, 1, 1), (2, 1, 1), (1, 2, 4), (3, 2, 2)])
class TestLinearRecurrence:
    def test_forward_is_the_equation(self, stages: int, parts: int, gates: int) -> None:
        recurrence, recurrent, state, weight = example(stages, parts, gates)
        rng = np.random.default_rng(0)
        sources = rng.normal(size=(stages - 1 + parts, ROWS, UNITS))
        start = rng.normal(size=(parts, SIZES[0], UNITS))
        expected = written_out(recurrent, state, weight, sources, start)
        recurrence.forward(sources, start)
        np.testing.assert_allclose(sources, expected, rtol=1e-12)

    def test_backward_is_its_transpose(self, stages: int, parts: int, gates: int) -> None:
        """The error of every source and of the initial state, whatever reaches the new state."""
        recurrence, recurrent, state, weight = example(stages, parts, gates)
        rng = np.random.default_rng(1)
        sources = rng.normal(size=(stages - 1 + parts, ROWS, UNITS))
        start = rng.normal(size=(parts, SIZES[0], UNITS))
        outside = np.zeros_like(sources)
        outside[stages - 1 :] = rng.normal(size=(parts, ROWS, UNITS))
        changes = written_out(recurrent, state, weight, sources, start)
        errors = outside.copy()
        errors[: stages - 1] = np.nan  # filled, whatever they hold
        results, first = recurrence.backward(errors)
        reached = (sources * errors).sum() + (start * first).sum()
        np.testing.assert_allclose(reached, (outside * changes).sum(), rtol=1e-12)
        # An error at a result of the weights is what a change of that result alone does.
        assert results.shape == (stages, ROWS, gates * UNITS)
        for j in range(stages):
            through = [
                sum(
                    slope * errors[i]
                    for i, row in enumerate(recurrent)
                    for gate, slope in row[j]
                    if gate == g
                )
                for g in range(gates)
            ]
            np.testing.assert_allclose(results[j], np.concatenate(through, axis=1), rtol=1e-12)
