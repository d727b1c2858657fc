r"""Policy-gradient algorithms on a task with two parameters (sections 2.3.4 and 2.3.5).

The task is to regulate a scalar linear system; the policy is :math:`a \sim N(ks, \sigma^2)`
with the gain k and :math:`\log\sigma` to be learned.  Returns, state distribution and
divergences have closed forms (see :mod:`thesis_lib.optimisation.regulator`), so that every
step an algorithm makes from samples can be judged without error.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray

from thesis_lib.edition.experiment import Context, Experiment, rows
from thesis_lib.optimisation import (
    PPO,
    TRPO,
    VPG,
    Learner,
    LinearQuadraticTask,
    NaturalPG,
    UpdateReport,
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
    square = mean_square_state(*old)
    # the mean's difference is (k - k') s, whose mean square is (k - k')^2 E[s^2]
    zero, gap = _matrix(0.0), _matrix((new[0] - old[0]) * np.sqrt(square))
    return float(kl_divergence(zero, _vector(old[1]), gap, _vector(new[1])))


def mean_square_state(gain: float, log_std: float) -> float:
    """Exact mean of the squared state over the steps of an episode."""
    task = LinearQuadraticTask(1, horizon=HORIZON)
    moments = task.state_moments(_matrix(gain), _vector(log_std))
    return float(np.mean([float(m) for m in moments]))


def fisher(gain: float, log_std: float) -> NDArray[np.float64]:
    r"""Exact Fisher information of the policy, shape ``(2, 2)``.

    The score is :math:`(zs/\sigma,\; z^2 - 1)` with z standard normal, so that the matrix is
    :math:`\mathrm{diag}(E[s^2]/\sigma^2,\; 2)`.
    """
    return np.diag([mean_square_state(gain, log_std) * np.exp(-2 * log_std), 2.0])


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
        records = []
        algorithm = config.algorithms(run)[key]
        for iteration, (old, report, new) in enumerate(
            _iterations(
                algorithm, config.start, config.iterations, config.batch_steps, context, run
            )
        ):
            records.append(
                {
                    "algorithm": key,
                    "run": run,
                    "iteration": iteration,
                    "expected_return": expected_return(*old),
                    "best_return": best,
                    "gain": old[0],
                    "log_std": old[1],
                    "kl_sampled": np.nan if report is None else report.kl,
                    "kl_exact": np.nan if report is None else expected_divergence(old, new),
                    "backtracks": np.nan if report is None else report.backtracks,
                    "delta_kl": config.delta_kl,
                }
            )
        return records

    return rows([record for job in context.map(learn, jobs, "runs") for record in job])


def _iterations(
    algorithm: Algorithm,
    start: tuple[float, float],
    iterations: int,
    batch_steps: int,
    context: Context,
    run: int,
) -> Iterator[tuple[tuple[float, float], UpdateReport | None, tuple[float, float]]]:
    """Parameters before each update, its report, and parameters after it; the last is no update.

    The random numbers are those of the run: all algorithms start from the same noise.
    """
    task_seed, noise_seed = context.seeds(2, run)
    task = LinearQuadraticTask(50, horizon=HORIZON, seed=task_seed)
    generator = np.random.default_rng(noise_seed)
    policy = linear_policy(*start)
    learner = Learner(policy, algorithm, discount=1.0)
    for _ in range(iterations):
        old = parameters(policy)
        report = learner.improve(collect(task, policy, batch_steps, generator))
        yield old, report, parameters(policy)
    yield parameters(policy), None, parameters(policy)


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


# ------------------------------------------------------------------------- settings, good and bad
LOST = -1e6
"""A run whose expected return falls below this is given up: its policy drives the state away."""

ENOUGH = 0.9
"""Share of the possible gain in return at which a run counts as arrived."""


@dataclass(frozen=True)
class SettingsConfig:
    """Settings of section-2.3.5-settings."""

    vpg: tuple[float, ...] = (0.0002, 0.001, 0.005, 0.01, 0.02, 0.05, 0.1)
    """Rates alpha of algorithm 5."""
    natural: tuple[float, ...] = (0.01, 0.05, 0.2, 0.5, 1.0, 2.0, 4.0, 8.0)
    """Rates of the natural gradient: one over the price of the divergence."""
    trpo: tuple[float, ...] = (0.0005, 0.005, 0.02, 0.05, 0.2, 0.5, 1.0, 2.0, 5.0)
    """Bounds delta_KL of TRPO [nat]."""
    iterations: int = 30
    """Iterations of each run."""
    batch_steps: int = 1000
    """Steps of an iteration."""
    runs: int = 10
    """Runs of each setting."""
    start: tuple[float, float] = (0.0, 0.0)
    """Gain and log standard deviation to start from."""

    def algorithm(self, key: str, setting: float) -> Algorithm:
        """An algorithm of :data:`NAMES` with its one setting."""
        if key == "vpg":
            return VPG(learning_rate=setting)
        return NaturalPG(learning_rate=setting) if key == "natural" else TRPO(delta=setting)


def settings(config: SettingsConfig, context: Context) -> pd.DataFrame:
    """What becomes of runs with steps from much too short to much too long."""
    jobs = [
        (key, setting, run)
        for key in ("vpg", "natural", "trpo")
        for setting in getattr(config, key)
        for run in range(config.runs)
    ]
    first, best = expected_return(*config.start), best_return()

    def learn(job: tuple[str, float, int]) -> dict[str, Any]:
        key, setting, run = job
        algorithm = config.algorithm(key, setting)
        returns = []
        for old, _, _ in _iterations(
            algorithm, config.start, config.iterations, config.batch_steps, context, run
        ):
            returns.append(expected_return(*old))
            if returns[-1] < LOST:
                break
        share = (np.array(returns) - first) / (best - first)
        arrived = np.flatnonzero(share >= ENOUGH)
        return {
            "algorithm": key,
            "setting": setting,
            "run": run,
            "arrived": arrived[0] if len(arrived) else np.nan,
            "mean_share": share.mean(),
            "last_share": share[-1],
            "lowest_share": share.min(),
            "lost": bool(returns[-1] < LOST),
            "iterations": config.iterations,
        }

    return rows(context.map(learn, jobs, "runs"))


SECTION_2_3_5_SETTINGS = Experiment(
    id="section-2.3.5-settings",
    item="Section 2.3.5",
    title="Policy-gradient algorithms with steps from too short to too long",
    function=settings,
    budgets={
        "smoke": SettingsConfig(
            vpg=(0.01, 0.1), natural=(0.2, 1.0), trpo=(0.05,), iterations=2, runs=2, batch_steps=200
        ),
        "book": SettingsConfig(),
        "thesis": SettingsConfig(),
    },
    columns={
        "algorithm": "vpg, natural (fixed rate) or trpo",
        "setting": "learning rate, or delta_KL [nat]",
        "run": "number of the run",
        "arrived": "first iteration with 90% of the possible gain in exact return; empty if none",
        "mean_share": "mean over iterations of the share of the possible gain",
        "last_share": "that share at the end",
        "lowest_share": "the lowest one on the way",
        "lost": "whether the run was given up at an expected return below -10^6",
        "iterations": "iterations a run may take",
    },
    seconds={"smoke": 1, "book": 20, "thesis": 20},
)


def good_range(table: pd.DataFrame, algorithm: str) -> float:
    """How far apart in length steps may be with which every run arrives and stays.

    A step is as long as the rate of a gradient, and as the root of TRPO's bound; in length
    the ranges of both can be compared.

    Parameters
    ----------
    table
        Table ``section-2.3.5-settings``.
    algorithm
        vpg, natural or trpo.

    Returns
    -------
    float
        The longest over the shortest, among the settings tried; NaN when there is none.
    """
    own = table[table.algorithm == algorithm]
    stays = own.arrived.notna() & (own.last_share >= ENOUGH)
    good = stays.groupby(own.setting).all()
    lengths = good.index[good].to_numpy(dtype=float)
    if len(lengths) == 0:
        return float("nan")
    ratio = float(lengths.max() / lengths.min())
    return ratio**0.5 if algorithm == "trpo" else ratio


# --------------------------------------------------------------------- the landscape, and steps
STARTS = ((0.0, 0.0), (-0.2, -2.3), (-1.9, -0.8))
"""Policies (gain, log sigma) from which one step is made: exploring much, hardly, and too hard."""

Window = tuple[tuple[float, float], tuple[float, float]]


@dataclass(frozen=True)
class LandscapeConfig:
    """Settings of section-2.3.5-landscape."""

    starts: tuple[tuple[float, float], ...] = STARTS
    """Policies about which return and divergence are mapped."""
    windows: tuple[Window, ...] = (
        ((-0.45, 0.35), (-0.35, 0.3)),
        ((-0.4, -0.05), (-2.75, -1.95)),
        ((-2.4, -1.4), (-1.15, -0.5)),
    )
    """Lowest and highest gain and log standard deviation of each map."""
    resolution: int = 57
    """Values along each side of a map."""


def landscape(config: LandscapeConfig, context: Context) -> pd.DataFrame:
    """Exact return of the policies about some, and their divergence from it."""
    records = []
    for i, (start, window) in enumerate(zip(config.starts, config.windows, strict=True)):
        for gain in np.linspace(*window[0], config.resolution):
            for log_std in np.linspace(*window[1], config.resolution):
                records.append(
                    {
                        "gain": gain,
                        "log_std": log_std,
                        "expected_return": expected_return(gain, log_std),
                        "start": i,
                        "kl": expected_divergence(start, (gain, log_std)),
                    }
                )
    return rows(records)


SECTION_2_3_5_LANDSCAPE = Experiment(
    id="section-2.3.5-landscape",
    item="Section 2.3.5",
    title="Return of two-parameter policies, and their divergence from where steps start",
    function=landscape,
    budgets={
        "smoke": LandscapeConfig(resolution=9),
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

    starts: tuple[tuple[float, float], ...] = STARTS
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
    seconds={"smoke": 1, "book": 2, "thesis": 2},
)

EXPERIMENTS: tuple[Experiment[Any], ...] = (
    SECTION_2_3_5_LEARNING,
    SECTION_2_3_5_SETTINGS,
    SECTION_2_3_5_LANDSCAPE,
    SECTION_2_3_5_STEPS,
)
"""Those of this module, in the order of the chapter."""
