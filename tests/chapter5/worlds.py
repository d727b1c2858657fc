"""Made-up benchmarks, written as a results store: what the criteria must and must not pass."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

ROBOTS = ("Ant", "HalfCheetah", "Hopper", "Swimmer", "Walker2d")
NETS = ("CTRNN", "DTRNN", "ESN", "DFFWD", "FFWD", "GRU", "LSTM")
SCALE = dict(zip(ROBOTS, (3000.0, 4000.0, 2000.0, 300.0, 2000.0), strict=True))
#: Robots differ more than nets do; the half-cheetah is the most robust, the hopper the least.
EASE = dict(zip(ROBOTS, (0.06, 0.12, -0.12, 0.0, -0.02), strict=True))


@dataclass
class World:
    """Shares of a robot's scale, by net; with what varies between its seeds.

    ``kept`` is by ground trained on and condition; ``base`` and ``kept_on`` replace cells.
    """

    learning: Mapping[str, float]
    kept: Mapping[tuple[str, str], Mapping[str, float]]
    learning_on: Mapping[tuple[str, str], float] = field(default_factory=dict)
    base: Mapping[tuple[str, str, str], float] = field(default_factory=dict)
    kept_on: Mapping[tuple[str, str, str], float] = field(default_factory=dict)
    without_memory: Mapping[str, float] = field(default_factory=lambda: {"flat": 0.7, "hill": 0.7})
    spread: Mapping[str, float] = field(default_factory=lambda: dict.fromkeys(NETS, 0.03))
    test_spread: float = 0.002
    ease: Mapping[str, float] = field(default_factory=lambda: EASE)
    extra: float = 0.4

    def write(self, folder: Path, seeds: int = 5, iterations: int = 500, seed: int = 0) -> Path:
        """Write its runs as one layer of a store."""
        rng = np.random.default_rng(seed)
        curves, tests = [], []
        extras = {"DFFWD-SOFTPLUS": self.extra, "FFWD-400": self.extra}
        for ground in ("flat", "hill"):
            for robot in ROBOTS:
                for net in (*NETS, *extras):
                    if net in extras and ground == "hill":
                        continue
                    for run in range(seeds):
                        at = {
                            "task": robot,
                            "terrain": ground,
                            "architecture": net.lower(),
                            "seed": run,
                            "variant": "default",
                        }
                        share = self.learning_on.get((robot, net), self.learning.get(net, 0.5))
                        value = share + self.spread.get(net, 0.01) * rng.normal()
                        for i in (1, iterations):
                            reward = SCALE[robot] * value
                            point = {"iteration": i, "steps": i * 50_000, "mean_return": reward}
                            curves.append(at | point)
                        base = self.base.get((ground, robot, net), 1.0)
                        base *= 1 + self.test_spread * rng.normal()
                        for condition in ("base", "noise", "switch"):
                            kept = 1.0
                            if condition != "base":
                                kept = extras.get(net) or self.kept[ground, condition][net]
                                kept = self.kept_on.get((condition, robot, net), kept)
                                kept += self.ease[robot] + self.test_spread * rng.normal()
                            result = {"condition": condition, "correlation": 0.0}
                            result |= {"intervention": "none", "test": 0}
                            tests.append(at | result | {"return": SCALE[robot] * base * kept})
                        left = self.without_memory[ground] + self.test_spread * rng.normal()
                        zeroed = {"condition": "base", "correlation": 0.0, "test": 0}
                        zeroed |= {"intervention": "no memory"}
                        tests.append(at | zeroed | {"return": SCALE[robot] * base * left})
        layer = folder / "depth"
        layer.mkdir(parents=True)
        pd.DataFrame(curves).to_csv(layer / "curves.csv", index=False)
        pd.DataFrame(tests).to_parquet(layer / "tests.parquet")
        return folder


def by_net(*values: float) -> dict[str, float]:
    return dict(zip(NETS, values, strict=True))


def ranked(*order: str) -> dict[str, float]:
    """Base returns a few per cent apart, the first net best."""
    return {net: 1.06 - 0.01 * place for place, net in enumerate(order)}


_BY_GAIT = ranked("FFWD", "DFFWD", "CTRNN", "DTRNN", "ESN", "GRU", "LSTM")
_BASE = {
    **{("flat", r, n): v for r in ROBOTS[:4] for n, v in _BY_GAIT.items()},
    ("flat", "Walker2d", "ESN"): 1.06,
    **{("hill", r, "CTRNN"): 1.06 for r in ROBOTS},
    **{("hill", r, n): 1.04 for r in ROBOTS for n in ("DFFWD", "FFWD")},
}

#: Everything is as the text says.
THESIS = World(
    learning=by_net(0.6, 0.7, 0.3, 1.0, 0.9, 0.45, 0.4),
    learning_on={("Hopper", "CTRNN"): 0.4, ("Hopper", "DTRNN"): 0.5}
    | {("Hopper", n): 0.1 for n in ("ESN", "GRU", "LSTM")},
    kept={
        ("flat", "noise"): by_net(0.62, 0.40, 0.45, 0.55, 0.42, 0.25, 0.22),
        ("hill", "noise"): by_net(0.80, 0.60, 0.48, 0.55, 0.42, 0.36, 0.33),
        ("flat", "switch"): by_net(0.50, 0.48, 0.40, 0.70, 0.72, 0.36, 0.32),
        ("hill", "switch"): by_net(0.76, 0.60, 0.44, 0.70, 0.72, 0.50, 0.46),
    },
    base=_BASE,
    kept_on={("noise", "Walker2d", "DFFWD"): 0.64},
    without_memory={"flat": 0.9, "hill": 0.5},
    spread=by_net(0.03, 0.03, 0.03, 0.005, 0.005, 0.03, 0.03),
)

#: Nets are all alike, robots too, and hills change nothing.
NULL = World(
    learning=dict.fromkeys(NETS, 0.5),
    kept={(g, c): dict.fromkeys(NETS, 0.5) for g in ("flat", "hill") for c in ("noise", "switch")},
    test_spread=0.02,
    spread=dict.fromkeys(NETS, 0.03),
    ease=dict.fromkeys(ROBOTS, 0.0),
    extra=0.5,
)

#: The ESN is best at everything, and hill training helps FNNs alone.
OPPOSITE = World(
    learning=by_net(0.45, 0.4, 1.0, 0.3, 0.3, 0.7, 0.75),
    kept={
        ("flat", "noise"): by_net(0.40, 0.42, 0.80, 0.30, 0.50, 0.60, 0.62),
        ("hill", "noise"): by_net(0.30, 0.30, 0.70, 0.60, 0.65, 0.40, 0.41),
        ("flat", "switch"): by_net(0.60, 0.40, 0.80, 0.30, 0.32, 0.50, 0.50),
        ("hill", "switch"): by_net(0.05, 0.30, 0.85, 0.60, 0.62, 0.20, 0.25),
    },
    base={(g, r, "ESN"): 1.5 for g in ("flat", "hill") for r in ROBOTS}
    | {(g, r, n): 0.9 for g in ("flat", "hill") for r in ROBOTS for n in ("DFFWD", "FFWD")},
    without_memory={"flat": 0.5, "hill": 0.9},
    spread=by_net(0.005, 0.005, 0.005, 0.03, 0.03, 0.005, 0.005),
    ease=dict(zip(ROBOTS, (-0.1, -0.1, 0.1, 0.05, 0.05), strict=True)),
    extra=0.9,
)
