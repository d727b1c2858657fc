"""Learners of this library against those of sb3-contrib, side by side in one run.

Same tasks (the thesis's, through Gymnasium for the peer), same networks, same number of samples
for an update, one thread each.

- DFFWD: our TRPO against ``sb3_contrib.TRPO``: samples a second of processor time end to end, or
  with ``--curves`` the returns over ``--steps`` steps and ``--seeds`` seeds.  Each run's curve is a
  file in ``--runs-in``, and what is there is not run again; ``--out`` gets them in one table.
- LSTM: our TRPO against ``sb3_contrib.RecurrentPPO``: samples a second, of the peer with its
  default minibatch of 128 steps, and with one as long as a world's part of the batch.

The peer keeps its own settings wherever the comparison does not need ours (value network, GAE,
damping, learning rates); the step size and the batch are ours.  For the curves ours takes the
peer's lambda, damping and initial weights, and a value network too.

The peer takes the mean of the divergence over steps *and over the A action dimensions*, so that
its ``target_kl`` of d bounds the divergence by A d nats, and its damping of the Fisher matrix is A
times as strong.  The curves compare like with like, twice: ``--bounds nats`` bounds both by d nats
(the peer's ``target_kl`` is d / A), ``--bounds dimension`` both by A d.

    pip install -c constraints.txt -e '.[benchmark]'
    python benchmarks/sb3_learners.py [--json] [--tasks Hopper HalfCheetah]
    python benchmarks/sb3_learners.py --curves [--bounds nats] [--sides ours peer]
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pandas as pd
import sb3_contrib
import torch
from sb3_contrib import TRPO, RecurrentPPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

from thesis_lib.checkout import environment
from thesis_lib.files import replacing
from thesis_lib.policies import make_policy
from thesis_lib.stats import welch
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.train import train

SIDES = ("ours", "linear", "peer")
BOUNDS = ("nats", "dimension")
TASKS = ("Hopper", "HalfCheetah")
ENVIRONMENTS = 16
DELTA = 0.05
LIKE_THE_PEER = {
    "gae_lambda": 0.95,
    "bootstrap": True,
    "cg_iterations": 15,
    "initialisation": "orthogonal",
    "head_scale": 0.01,
    "baseline": "network",
}
"""The peer's defaults, in the comparison of curves; the thesis's are measured beside some of them
in ``results/options/dffwd``.  ``--sides linear`` keeps the thesis's linear baseline."""
PEER_DAMPING = 0.1
TANH = {"activation_fn": torch.nn.Tanh}


class Returns(BaseCallback):
    """Mean return of the episodes that ended in each batch."""

    def __init__(self) -> None:
        super().__init__()
        self.batches: list[float] = []
        self.ended: list[float] = []

    def _on_step(self) -> bool:
        self.ended += [i["episode"]["r"] for i in self.locals["infos"] if "episode" in i]
        return True

    def _on_rollout_end(self) -> None:
        self.batches.append(float(np.mean(self.ended)) if self.ended else np.nan)
        self.ended = []


def environments(task: str, seed: int) -> VecMonitor:
    def make() -> gymnasium.Env:
        return gymnasium.make(f"thesis/{task}-v0")

    vector = VecMonitor(DummyVecEnv([make] * ENVIRONMENTS))
    vector.seed(seed)
    return vector


def action_dimensions(task: str) -> int:
    return gymnasium.make(f"thesis/{task}-v0").action_space.shape[0]


def peer(
    kind: str,
    task: str,
    seed: int,
    batch: int,
    target_kl: float | None = None,
    minibatch: int | None = None,
) -> BaseAlgorithm:
    vector = environments(task, seed)
    per_world = batch // ENVIRONMENTS
    if kind == "dffwd":
        layers = {"pi": [100, 50, 25], "vf": [100, 50, 25]}
        return TRPO(
            "MlpPolicy",
            vector,
            n_steps=per_world,
            target_kl=target_kl or DELTA / vector.action_space.shape[0],
            cg_damping=PEER_DAMPING,
            seed=seed,
            device="cpu",
            policy_kwargs={"net_arch": layers, **TANH},
        )
    units = make_policy("lstm", *vector.observation_space.shape, *vector.action_space.shape, dt=1.0)
    return RecurrentPPO(
        "MlpLstmPolicy",
        vector,
        n_steps=per_world,
        batch_size=minibatch or per_world,
        seed=seed,
        device="cpu",
        policy_kwargs={"lstm_hidden_size": units.hidden_size, "net_arch": [], **TANH},
    )


def ours_rate(
    kind: str, task: str, batch: int, iterations: int, settings: Mapping[str, Any]
) -> float:
    config = TrainConfig(
        task=task,
        architecture=kind,
        delta_kl=DELTA,
        batch_steps=batch,
        iterations=iterations,
        features="full",
        **settings,
    )
    curve = train(config).curve.iloc[1:]  # the first iteration warms up
    seconds = curve.sampling_seconds.sum() + curve.update_seconds.sum()
    return float(np.diff(curve.steps).sum() + batch) / seconds


def peer_rate(
    kind: str, task: str, batch: int, iterations: int, minibatch: int | None = None
) -> float:
    model = peer(kind, task, 0, batch, minibatch=minibatch)
    model.learn(batch)
    start = time.process_time()
    model.learn((iterations - 1) * batch, reset_num_timesteps=False)
    return (iterations - 1) * batch / (time.process_time() - start)


def rates(tasks: list[str], batch: int, iterations: int) -> list[dict[str, Any]]:
    rows = []
    for task in tasks:
        for name, kind, settings, minibatch in (
            ("TRPO, DFFWD", "dffwd", {}, None),
            ("TRPO, DFFWD, the peer's settings", "dffwd", LIKE_THE_PEER, None),
            ("LSTM, TRPO against RecurrentPPO, minibatch 128", "lstm", {}, 128),
            ("LSTM, TRPO against RecurrentPPO, longest", "lstm", {}, None),
        ):
            mine = ours_rate(kind, task, batch, iterations, settings)
            theirs = peer_rate(kind, task, batch, iterations, minibatch)
            rows.append(
                {
                    "name": f"{name}, {task}",
                    "ours": mine,
                    "peer": theirs,
                    "ratio": mine / theirs,
                    "unit": "steps per processor s",
                }
            )
    return rows


def last(values: np.ndarray, batch: int) -> float:
    """Mean over the last 100,000 steps."""
    return float(np.nanmean(values[-max(1, 100_000 // batch) :]))


def learn(side: str, task: str, bound: str, seed: int, batch: int, steps: int) -> np.ndarray:
    """Mean return of each batch's episodes in one run of ours or of the peer."""
    dimensions = action_dimensions(task)
    delta = DELTA * (dimensions if bound == "dimension" else 1)
    if side != "peer":
        settings = LIKE_THE_PEER | ({"baseline": "linear"} if side == "linear" else {})
        config = TrainConfig(
            task=task,
            architecture="dffwd",
            seed=seed,
            delta_kl=delta,
            damping=PEER_DAMPING * dimensions,
            batch_steps=batch,
            iterations=steps // batch,
            **settings,
        )
        return train(config).curve.mean_return.to_numpy()
    callback = Returns()
    peer("dffwd", task, seed, batch, delta / dimensions).learn(steps, callback=callback)
    return np.array(callback.batches)


def run_file(folder: Path, task: str, bound: str, side: str, seed: int) -> Path:
    """Where a run's curve is kept, beside its provenance."""
    return folder / bound / f"{task.lower()}-{side}-{seed}.csv"


def curve(
    folder: Path, task: str, bound: str, side: str, seed: int, batch: int, steps: int
) -> np.ndarray:
    """One run's learning curve, from its file if an earlier call has finished it."""
    path = run_file(folder, task, bound, side, seed)
    if not path.exists():
        start = time.process_time()
        values = learn(side, task, bound, seed, batch, steps)
        seconds = time.process_time() - start
        with replacing(path) as temporary:
            index = pd.RangeIndex(1, len(values) + 1, name="batch")
            pd.DataFrame({"mean_return": values}, index=index).to_csv(temporary)
        settings = {
            "batch_steps": batch,
            "steps": steps,
            "delta_kl": DELTA,
            "peer_damping": PEER_DAMPING,
            "ours": LIKE_THE_PEER,
            "processor_seconds": round(seconds, 1),
            **environment(),
            "sb3_contrib": sb3_contrib.__version__,
        }
        with replacing(path.with_suffix(".json")) as temporary:
            temporary.write_text(json.dumps(settings, indent=1) + "\n")
        print(
            f"{task} {bound} {side} seed {seed}: last 100,000 steps {last(values, batch):.1f}, "
            f"{seconds:.0f} processor s",
            file=sys.stderr,
            flush=True,
        )
    return pd.read_csv(path).mean_return.to_numpy()


def curves(
    tasks: list[str],
    sides: list[str],
    bounds: list[str],
    folder: Path,
    batch: int,
    steps: int,
    seeds: int,
) -> list[dict[str, Any]]:
    """Learning curves of all sides, and Welch's test of their ends and of their means."""
    for bound in bounds:
        (folder / bound).mkdir(parents=True, exist_ok=True)
    rows = []
    for task, bound in product(tasks, bounds):
        runs = {
            side: [curve(folder, task, bound, side, seed, batch, steps) for seed in range(seeds)]
            for side in sides
        }
        if "peer" not in sides:
            continue
        for label, of in (
            ("end", lambda values: last(values, batch)),
            ("mean of the curve", lambda values: float(np.nanmean(values))),
        ):
            ends = {side: [of(values) for values in runs[side]] for side in sides}
            for side in sides:
                if side == "peer":
                    continue
                ours, theirs = ends[side], ends["peer"]
                rows.append(
                    {
                        "name": f"{task}, {bound}, {side}: {label}",
                        "ours": float(np.mean(ours)),
                        "peer": float(np.mean(theirs)),
                        "ratio": float(np.mean(ours) / np.mean(theirs)),
                        "unit": f"return over {seeds} seeds",
                        "test": repr(welch(ours, theirs)),
                        "all": {"ours": ours, "peer": theirs},
                    }
                )
    return rows


def merge(folder: Path, out: Path) -> None:
    """Put all runs into ``curves.csv``, and what made them into ``curves.json``."""
    tables, records = [], []
    for path in sorted(folder.glob("*/*.csv")):
        task, side, seed = path.stem.split("-")
        own = pd.read_csv(path)
        settings = json.loads(path.with_suffix(".json").read_text())
        keys = {
            "task": next(name for name in TASKS if name.lower() == task),
            "bound": path.parent.name,
            "side": side,
            "seed": int(seed),
        }
        own.insert(1, "steps", own.batch * settings["batch_steps"])
        tables.append(pd.DataFrame(keys, index=own.index).join(own))
        records.append(keys | settings)
    shared = {
        name: value
        for name, value in records[0].items()
        if all(record.get(name) == value for record in records)
    }
    provenance = {
        "id": "curves",
        "title": "Learning curves of TRPO, ours and that of sb3-contrib.",
        "command": "python benchmarks/sb3_learners.py --curves",
        **shared,
        "runs": [{k: v for k, v in r.items() if k not in shared} for r in records],
        "table": "curves.csv",
    }
    out.mkdir(parents=True, exist_ok=True)
    with replacing(out / "curves.csv") as temporary:
        pd.concat(tables).to_csv(temporary, index=False)
    with replacing(out / "curves.json") as temporary:
        temporary.write_text(json.dumps(provenance, indent=1) + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--json", action="store_true", help="print rows as JSON")
    parser.add_argument("--curves", action="store_true", help="learning curves, not rates (hours)")
    parser.add_argument("--tasks", nargs="*", default=list(TASKS))
    parser.add_argument("--batch-steps", type=int, default=50_000)
    parser.add_argument("--curve-batch-steps", type=int, default=10_000)
    parser.add_argument("--iterations", type=int, default=4)
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--sides", nargs="*", default=list(SIDES), choices=SIDES)
    parser.add_argument("--bounds", nargs="*", default=list(BOUNDS), choices=BOUNDS)
    parser.add_argument("--runs-in", type=Path, default=Path("_build/runs/peers"))
    parser.add_argument("--out", type=Path, default=Path("_build/results/peers"))
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    if arguments.curves:
        rows = curves(
            arguments.tasks,
            arguments.sides,
            arguments.bounds,
            arguments.runs_in,
            arguments.curve_batch_steps,
            arguments.steps,
            arguments.seeds,
        )
        merge(arguments.runs_in, arguments.out)
    else:
        rows = rates(arguments.tasks, arguments.batch_steps, arguments.iterations)
    if arguments.json:
        print(json.dumps(rows, indent=1))
        return
    for row in rows:
        print(
            f"{row['name']:60} ours {row['ours']:9.1f}  peer {row['peer']:9.1f}  "
            f"ratio {row['ratio']:5.2f}  {row['unit']}"
        )
        if "test" in row:
            print(f"    {row['test']}")


if __name__ == "__main__":
    main()
