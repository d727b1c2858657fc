r"""Policy-gradient algorithms on a task with two parameters (sections 2.3.4 and 2.3.5).

The task is to regulate a scalar linear system; the policy is :math:`a \sim N(ks, \sigma^2)`
with the gain k and :math:`\log\sigma` to be learned.  Returns, state distribution and
divergences have closed forms (see :mod:`thesis_lib.optimisation.regulator`), so that every
step an algorithm makes from samples can be judged without error.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import torch

from thesis_lib.experiments.base import Context, Experiment, rows
from thesis_lib.optimisation import (
    PPO,
    TRPO,
    VPG,
    Learner,
    LinearQuadraticTask,
    NaturalPG,
    collect,
)
from thesis_lib.optimisation.problem import Algorithm
from thesis_lib.policies import FeedforwardPolicy, kl_divergence

HORIZON = 20

NAMES: Mapping[str, str] = {
    "vpg": "vanilla policy gradient",
    "natural": "natural gradient, fixed rate",
    "natural_delta": "natural gradient, fixed length",
    "trpo": "TRPO",
    "ppo": "PPO",
}
"""What each key of the column ``algorithm`` stands for."""


@dataclass(frozen=True)
class Rates:
    """Settings of the algorithms."""

    delta_kl: float = 0.05
    """Bound of TRPO, and length of the natural gradient of fixed length [nat]."""
    vpg_rate: float = 0.02
    """alpha of algorithm 5; 0.06 diverges from the default start."""
    natural_rate: float = 0.5
    """alpha of the natural gradient of fixed rate."""
    ppo_rate: float = 0.01
    """Adam's rate in PPO."""

    def algorithms(self, seed: int) -> dict[str, Algorithm]:
        """A new algorithm of every kind, by the keys of :data:`NAMES`."""
        return {
            "vpg": VPG(learning_rate=self.vpg_rate),
            "natural": NaturalPG(learning_rate=self.natural_rate),
            "natural_delta": NaturalPG(delta=self.delta_kl),
            "trpo": TRPO(delta=self.delta_kl),
            "ppo": PPO(learning_rate=self.ppo_rate, seed=seed),
        }


def linear_policy(gain: float, log_std: float) -> FeedforwardPolicy:
    r"""The policy :math:`a \sim N(ks, \sigma^2)`, in float64."""
    policy = FeedforwardPolicy(
        1, 1, hidden=(), bias=False, initial_log_std=log_std, dtype=torch.float64
    )
    with torch.no_grad():
        policy.head.weight.fill_(gain)
    return policy


def parameters(policy: FeedforwardPolicy) -> tuple[float, float]:
    """The gain and the log standard deviation of a policy."""
    return float(policy.head.weight.detach()), float(policy.log_std.detach())


def expected_return(gain: float, log_std: float) -> float:
    """Exact undiscounted return of an episode."""
    task = LinearQuadraticTask(1, horizon=HORIZON)
    return float(task.expected_return(_matrix(gain), _vector(log_std)))


def expected_divergence(old: tuple[float, float], new: tuple[float, float]) -> float:
    """Exact mean divergence old from new over the states the old policy visits [nat]."""
    task = LinearQuadraticTask(1, horizon=HORIZON)
    square = np.mean([float(m) for m in task.state_moments(_matrix(old[0]), _vector(old[1]))])
    # the mean's difference is (k - k') s, whose mean square is (k - k')^2 E[s^2]
    zero, gap = _matrix(0.0), _matrix((new[0] - old[0]) * np.sqrt(square))
    return float(kl_divergence(zero, _vector(old[1]), gap, _vector(new[1])))


def best_return() -> float:
    """Return of the best gain without any noise, found on a fine grid."""
    return max(expected_return(k, -20.0) for k in np.linspace(-2, 0, 401))


def _matrix(value: float) -> torch.Tensor:
    return torch.tensor([[value]], dtype=torch.float64)


def _vector(value: float) -> torch.Tensor:
    return torch.tensor([value], dtype=torch.float64)


# ------------------------------------------------------------------------------ learning curves
@dataclass(frozen=True)
class CurvesConfig(Rates):
    """Settings of section-2.3.5-learning."""

    iterations: int = 40
    """Iterations of each run."""
    batch_steps: int = 1000
    """Steps of an iteration."""
    runs: int = 10
    """Runs of each algorithm."""
    start: tuple[float, float] = (0.0, 0.0)
    """Gain and log standard deviation to start from."""


def learning_curves(config: CurvesConfig, context: Context) -> pd.DataFrame:
    """Exact return of the policy after every iteration, and the divergence it moved by."""
    jobs = [(key, run) for key in NAMES for run in range(config.runs)]
    best = best_return()

    def learn(job: tuple[str, int]) -> list[dict[str, Any]]:
        key, run = job
        # the seed is that of the run: all algorithms start from the same noise
        task_seed, noise_seed = context.seeds(2, run)
        task = LinearQuadraticTask(50, horizon=HORIZON, seed=task_seed)
        generator = np.random.default_rng(noise_seed)
        policy = linear_policy(*config.start)
        learner = Learner(policy, config.algorithms(run)[key], discount=1.0)
        records = []
        for iteration in range(config.iterations + 1):
            old = parameters(policy)
            record = {
                "algorithm": key,
                "run": run,
                "iteration": iteration,
                "expected_return": expected_return(*old),
                "best_return": best,
                "gain": old[0],
                "log_std": old[1],
            }
            if iteration == config.iterations:
                change = {"kl_sampled": np.nan, "kl_exact": np.nan, "backtracks": np.nan}
            else:
                report = learner.improve(collect(task, policy, config.batch_steps, generator))
                change = {
                    "kl_sampled": report.kl,
                    "kl_exact": expected_divergence(old, parameters(policy)),
                    "backtracks": report.backtracks,
                }
            records.append(record | change | {"delta_kl": config.delta_kl})
        return records

    return rows([record for job in context.map(learn, jobs, "runs") for record in job])


SECTION_2_3_5_LEARNING = Experiment(
    id="section-2.3.5-learning",
    item="Algorithms 5 and 6",
    title="Policy-gradient algorithms on a linear-quadratic task: return, and divergence made",
    function=learning_curves,
    budgets={
        "smoke": CurvesConfig(iterations=3, runs=2, batch_steps=200),
        "book": CurvesConfig(),
        "thesis": CurvesConfig(),
    },
    columns={
        "algorithm": "a key of NAMES",
        "run": "number of the run; its noise is the same for all algorithms at the start",
        "iteration": "updates made so far",
        "expected_return": "exact undiscounted return of the policy",
        "best_return": "the same of the best linear policy without noise",
        "gain": "k",
        "log_std": "log sigma",
        "kl_sampled": "divergence of the next update on its own batch, old from new [nat]",
        "kl_exact": "the same in expectation over the old policy's states [nat]",
        "backtracks": "times the line search shortened the next update",
        "delta_kl": "the bound [nat]",
    },
    seconds={"smoke": 1, "book": 20, "thesis": 20},
)


# --------------------------------------------------------------------- the landscape, and steps
@dataclass(frozen=True)
class LandscapeConfig:
    """Settings of section-2.3.5-landscape."""

    gains: tuple[float, float, int] = (-2.2, 0.6, 57)
    """Lowest gain, highest gain and number of values."""
    log_stds: tuple[float, float, int] = (-2.5, 0.5, 61)
    """Lowest, highest and number of values of the log standard deviation."""
    starts: tuple[tuple[float, float], ...] = ((0.0, 0.0), (-0.2, -1.5), (-1.9, -0.8))
    """Policies whose divergence is mapped."""


def landscape(config: LandscapeConfig, context: Context) -> pd.DataFrame:
    """Exact return of every policy of a grid, and its divergence from some of them."""
    records = []
    for gain in np.linspace(*config.gains):
        for log_std in np.linspace(*config.log_stds):
            value = expected_return(gain, log_std)
            for i, start in enumerate(config.starts):
                records.append(
                    {
                        "gain": gain,
                        "log_std": log_std,
                        "expected_return": value,
                        "start": i,
                        "kl": expected_divergence(start, (gain, log_std)),
                    }
                )
    return rows(records)


SECTION_2_3_5_LANDSCAPE = Experiment(
    id="section-2.3.5-landscape",
    item="Section 2.3.5",
    title="Return of every two-parameter policy, and its divergence from where steps start",
    function=landscape,
    budgets={
        "smoke": LandscapeConfig(gains=(-2.2, 0.6, 8), log_stds=(-2.5, 0.5, 7)),
        "book": LandscapeConfig(),
        "thesis": LandscapeConfig(),
    },
    columns={
        "gain": "k",
        "log_std": "log sigma",
        "expected_return": "exact undiscounted return of an episode",
        "start": "number of the policy the divergence is from, as in section-2.3.5-steps",
        "kl": "divergence of that policy from this one over its own states [nat]",
    },
    seconds={"smoke": 0.1, "book": 4, "thesis": 4},
)


@dataclass(frozen=True)
class StepsConfig(Rates):
    """Settings of section-2.3.5-steps."""

    starts: tuple[tuple[float, float], ...] = LandscapeConfig.starts
    """Policies (gain, log sigma) from which one step is made."""
    batch_steps: int = 20_000
    """Steps the direction is estimated from."""
    repeats: int = 10
    """Independent batches."""


def steps(config: StepsConfig, context: Context) -> pd.DataFrame:
    """One step of every algorithm from the same batch."""
    records = []
    for i, start in enumerate(config.starts):
        for repeat in range(config.repeats):
            task_seed, noise_seed = context.seeds(2, i, repeat)
            task = LinearQuadraticTask(100, horizon=HORIZON, seed=task_seed)
            generator = np.random.default_rng(noise_seed)
            rollouts = collect(task, linear_policy(*start), config.batch_steps, generator)
            for key, algorithm in config.algorithms(repeat).items():
                policy = linear_policy(*start)
                report = Learner(policy, algorithm, discount=1.0).improve(rollouts)
                end = parameters(policy)
                records.append(
                    {
                        "algorithm": key,
                        "start": i,
                        "repeat": repeat,
                        "gain": start[0],
                        "log_std": start[1],
                        "new_gain": end[0],
                        "new_log_std": end[1],
                        "kl_sampled": report.kl,
                        "kl_exact": expected_divergence(start, end),
                        "gain_in_return": expected_return(*end) - expected_return(*start),
                        "backtracks": report.backtracks,
                        "delta_kl": config.delta_kl,
                    }
                )
    return rows(records)


SECTION_2_3_5_STEPS = Experiment(
    id="section-2.3.5-steps",
    item="Section 2.3.5",
    title="The step each policy-gradient algorithm makes in a two-parameter policy",
    function=steps,
    budgets={
        "smoke": StepsConfig(batch_steps=400, repeats=2),
        "book": StepsConfig(),
        "thesis": StepsConfig(),
    },
    columns={
        "algorithm": "a key of NAMES",
        "start": "number of the starting policy",
        "repeat": "number of the batch",
        "gain": "k before the step",
        "log_std": "log sigma before the step",
        "new_gain": "k after it",
        "new_log_std": "log sigma after it",
        "kl_sampled": "divergence of the step on its batch, old from new [nat]",
        "kl_exact": "the same in expectation over the old policy's states [nat]",
        "gain_in_return": "exact return after the step less that before",
        "backtracks": "times the line search shortened it",
        "delta_kl": "the bound [nat]",
    },
    seconds={"smoke": 1, "book": 5, "thesis": 5},
)

EXPERIMENTS: tuple[Experiment[Any], ...] = (
    SECTION_2_3_5_LEARNING,
    SECTION_2_3_5_LANDSCAPE,
    SECTION_2_3_5_STEPS,
)
"""To be listed with chapter 2."""
