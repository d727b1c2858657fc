"""Pilots behind the settings that the thesis does not print (section 5.2 and table 5.1).

Each run varies one unprinted setting at the printed batch of 50,000 steps, on flat ground.
``python benchmarks/calibration.py`` trains those that ``results/calibration`` does not have, and
adds them; ``--read FOLDER`` only adds what a folder of runs holds.  With an empty
``results/calibration`` it trains all, some eight hours on one slow core.  Chapter 5's calibration
table is made from it.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from thesis_lib.edition.experiment import read_csv
from thesis_lib.files import replacing
from thesis_lib.training.config import TrainConfig, differences, sensors, settled
from thesis_lib.training.sweep import sweep

ITERATIONS = 100
OUT = Path(__file__).parents[1] / "results" / "calibration"

COLUMNS = {
    "task": "robot, flat ground",
    "architecture": "net",
    "seed": "seed of the run",
    "sensors": "all, or a reading of table 5.1's subset (text, literal, code)",
    "time_constant": "initial time constants of the CTRNN in seconds",
    "head_scale": "what the output layer's initial weights are multiplied with",
    "delta_kl": "bound on the divergence in nats",
    "iteration": "from 1",
    "steps": "control steps learned from so far",
    "mean_return": "mean return of the batch",
}


SETTINGS = tuple(name for name in COLUMNS if name not in ("iteration", "steps", "mean_return"))
"""The columns that tell runs apart."""


def pilots() -> Iterator[TrainConfig]:
    """All runs, those that decide most first."""
    cheetah: dict[str, Any] = {"task": "HalfCheetah", "iterations": ITERATIONS}
    hopper: dict[str, Any] = {"task": "Hopper", "iterations": ITERATIONS}
    for features in ("text", "literal", "code"):
        yield TrainConfig(**hopper, architecture="dtrnn", features=features)
    for seed in (0, 1):
        for tau in (0.1, 0.3):
            yield TrainConfig(**cheetah, architecture="ctrnn", time_constant=tau, seed=seed)
    for features in ("text", "code"):
        yield TrainConfig(**hopper, architecture="dtrnn", features=features, seed=1)
    for seed in (0, 1):
        for tau in (1.0, 0.03):
            yield TrainConfig(**cheetah, architecture="ctrnn", time_constant=tau, seed=seed)
    for net, seeds in {"ffwd": 2, "gru": 3, "lstm": 2, "dtrnn": 2, "esn": 2}.items():
        for seed in range(seeds):
            for scale in (1.0, 0.1):
                yield TrainConfig(**cheetah, architecture=net, head_scale=scale, seed=seed)
    for seed in (0, 1):
        yield TrainConfig(**cheetah, architecture="ffwd", head_scale=0.1, delta_kl=0.1, seed=seed)
    yield TrainConfig(**cheetah, architecture="lstm", head_scale=0.1, delta_kl=0.1)
    for seed in (0, 1):
        for delta in (0.05, 0.1):
            yield TrainConfig(**cheetah, architecture="dffwd", delta_kl=delta, seed=seed)
    yield TrainConfig(**hopper, architecture="ctrnn", features="code", time_constant=0.1)


def stated(config: TrainConfig, record: Mapping[str, Any]) -> dict[str, Any]:
    """The settings of a run that tell it apart; ``record`` has what its defaults came to."""
    return {
        "task": config.task,
        "architecture": config.architecture,
        "seed": config.seed,
        "sensors": sensors(config),
        "time_constant": config.time_constant if config.architecture == "ctrnn" else None,
        "head_scale": record.get("head_scale", settled(config)["head_scale"]),
        "delta_kl": record["delta_kl"],
    }


Run = tuple[dict[str, Any], pd.DataFrame, dict[str, Any]]
"""What tells it apart, its curve and its provenance."""


def committed() -> dict[str, Run]:
    """The runs that :data:`OUT` has, by their settings as JSON."""
    if not (OUT / "curves.json").is_file():
        return {}
    about = json.loads((OUT / "curves.json").read_text(encoding="utf-8"))
    table = read_csv(OUT / "curves.csv")
    runs, first = {}, 0
    for provenance in about["runs"]:
        settings = {name: provenance[name] for name in SETTINGS}
        curve = table.iloc[first : first + provenance["iterations"]]
        runs[json.dumps(settings)] = (settings, curve, provenance)
        first += len(curve)
    return runs


def write(folders: list[Path]) -> None:
    """Add the runs that the folders hold, with their provenance; of two alike the longer stays."""
    runs = committed()
    for path in sorted(p for f in folders for p in f.glob("*/run.json")):
        record = json.loads(path.read_text(encoding="utf-8"))
        curve = pd.read_csv(path.parent / "curve.csv")
        curve = curve[curve.iteration <= ITERATIONS]
        settings = stated(TrainConfig(**record["config"]), record)
        named = ("task", "architecture", "seed", "features", "time_constant")
        shown = {name: record["config"][name] for name in named}
        shown |= {name: settings[name] for name in ("head_scale", "delta_kl")}
        if differences(record, TrainConfig(**shown)):
            continue  # the table has no column that tells these apart
        provenance = {
            **settings,
            "iterations": len(curve),
            "of": ITERATIONS,
            **{k: record[k] for k in ("commit", "code", "versions") if k in record},
            "processor_seconds": round(curve.sampling_seconds.sum() + curve.update_seconds.sum()),
        }
        key = json.dumps(settings)
        if key not in runs or len(runs[key][1]) < len(curve):
            runs[key] = (settings, curve, provenance)
    ordered = [runs[key] for key in sorted(runs)]
    table = pd.concat(
        [curve[["iteration", "steps", "mean_return"]].assign(**s) for s, curve, _ in ordered]
    )
    with replacing(OUT / "curves.csv") as temporary:
        table[list(COLUMNS)].to_csv(temporary, index=False, float_format="%.6g")
    about = {
        "title": "Learning curves of runs that vary one unprinted setting at a time, at the "
        "printed batch.",
        "columns": COLUMNS,
        "command": "python benchmarks/calibration.py",
        "rows": len(table),
        "runs": [provenance for *_, provenance in ordered],
    }
    with replacing(OUT / "curves.json") as temporary:
        temporary.write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")


def main() -> None:
    """Train what is missing and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--read", type=Path, nargs="+", help="folders of runs; train nothing")
    parser.add_argument("--workers", type=int, default=None)
    asked = parser.parse_args()
    if not asked.read:
        folder = Path("_build/runs/calibration")
        done = committed()
        missing = [c for c in pilots() if json.dumps(stated(c, settled(c))) not in done]
        sweep(missing, folder, workers=asked.workers)
        asked.read = [folder]
    write(asked.read)


if __name__ == "__main__":
    main()
