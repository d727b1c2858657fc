"""Hill maps: how fast they are drawn, and what their resolution costs and changes.

    python benchmarks/terrain.py [--json] [--repeats 5]

Three questions, each answered side by side in one run, medians of several interleaved rounds,
in CPU seconds of one thread (so that other work on the machine matters little).

1. Drawing a map: ours against evaluating every hill's density on the whole grid with scipy,
   which is what the author's code did with matplotlib's bivariate_normal.
2. Stepping robots on hills at several resolutions, and on the plane.
3. What the resolution does to the slopes: quantiles over several maps, against a fine grid.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from statistics import median

import numpy as np
from scipy.stats import multivariate_normal

from thesis_lib.locomotion.batch import BatchTask
from thesis_lib.locomotion.height_field import HeightField
from thesis_lib.locomotion.robots import ROBOTS
from thesis_lib.locomotion.tasks import make_task
from thesis_lib.locomotion.terrain import PRESETS, hills

FACTORS = (0.5, 1.0, 1.5, 2.0, 4.0)
"""Distances between nodes, as multiples of the default."""


def cpu_seconds(function: Callable[[], object]) -> float:
    start = time.process_time()
    function()
    return time.process_time() - start


def medians(functions: dict[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Median CPU seconds of each, the functions taking turns; one round to warm up."""
    rounds = [{k: cpu_seconds(f) for k, f in functions.items()} for _ in range(repeats + 1)][1:]
    return {k: median(r[k] for r in rounds) for k in functions}


# ------------------------------------------------------------------------------ 1. drawing


def draw_with_scipy(seed: int = 0) -> np.ndarray:
    """The author's procedure on the author's map: 400 x 400 nodes, 506 densities, their maximum."""
    rng = np.random.default_rng(seed)
    axis = np.arange(-20, 20, 0.1)
    nodes = np.stack(np.meshgrid(axis, axis), axis=-1)
    pitch = 40 / np.sqrt(500)
    field = np.zeros(nodes.shape[:2])
    for x in np.arange(-18, 20, pitch):
        for y in np.arange(-20, 20, pitch):
            centre = np.array([x, y]) + rng.normal(0, np.sqrt(0.4), 2)
            variance = 0.4 + 0.4 * rng.random()
            field = np.maximum(field, multivariate_normal(centre, variance).pdf(nodes))
    return field / field.max()


def drawing(repeats: int) -> list[dict[str, object]]:
    ours: dict[str, Callable[[], object]] = {
        "the author's map (40 units square)": lambda: hills(
            1.0, 0, robot="Hopper", extent="author", flat_patch="author"
        )
    }
    for robot in ROBOTS:
        ours[f"default map of {robot}"] = lambda robot=robot: hills(1.0, 0, robot=robot)
    for robot in ("Hopper", "Ant"):
        ours[f"the text's hills for {robot}"] = lambda robot=robot: hills(
            1.0, 0, robot=robot, preset="text"
        )
    times = medians(ours, repeats)
    peer = median(cpu_seconds(draw_with_scipy) for _ in range(2))
    return [
        {
            "name": f"draw {name}",
            "ours": 1e3 * seconds,
            "peer": 1e3 * peer if i == 0 else None,
            "ratio": peer / seconds if i == 0 else None,
            "unit": "CPU ms",
        }
        for i, (name, seconds) in enumerate(times.items())
    ]


# ----------------------------------------------------------------------------- 2. stepping


def worlds_on(robot: str, field: HeightField | None, n: int = 32) -> BatchTask:
    """Worlds whose robots stand all over the map, clear of the start square."""
    made = BatchTask(
        make_task(robot, termination="never"), n, terrain=field, max_episode_steps=None
    )
    made.reset()
    rng = np.random.default_rng(1)
    qpos, qvel = made.qpos, made.qvel
    free = robot in ("Swimmer", "Ant")
    x = rng.uniform(6, 30, n)
    y = rng.uniform(-15, 15, n) if free else np.zeros(n)
    qpos[:, 0] += x
    if free:
        qpos[:, 1] += y
    if field is not None:
        # The highest ground under any part of the robot, which reaches 1.6 m at most.
        around = np.linspace(-1.6, 1.6, 17)
        ground = [field.ground_z(x + a, y + b * free) for a in around for b in around]
        plane = -0.1 if robot == "Swimmer" else 0.0
        qpos[:, ROBOTS[robot].height_index] += np.max(ground, axis=0) - plane
    made.set_state(qpos, qvel)
    return made


def stepping(repeats: int, steps: int = 100) -> list[dict[str, object]]:
    rows: list[dict[str, object]] = []
    for robot in ROBOTS:
        unit = 0.1 * PRESETS["author"].metres[robot]
        fields: dict[str, HeightField | None] = {"plane": None}
        for factor in FACTORS:
            step = factor * unit
            fields[f"{step:.3g} m"] = hills(1.0, 0, robot=robot, resolution=step)
        made = {name: worlds_on(robot, field) for name, field in fields.items()}
        rng = np.random.default_rng(2)
        actions = rng.uniform(-1, 1, (steps, 32, ROBOTS[robot].action_size))

        def run(name: str, made=made, actions=actions) -> None:  # type: ignore[no-untyped-def]
            for action in actions:
                made[name].step(action)

        for world in made.values():  # let the robots come down
            for action in actions[:50]:
                world.step(action)
        times = medians({name: (lambda name=name: run(name)) for name in made}, repeats)
        default = f"{unit:.3g} m"
        for name, seconds in times.items():
            rows.append(
                {
                    "name": f"step {robot} on {'the ' if name == 'plane' else 'hills, '}{name}",
                    "ours": steps * 32 / seconds,
                    "peer": steps * 32 / times[default],
                    "ratio": times[default] / seconds,
                    "unit": "control steps / CPU s (peer: default resolution)",
                }
            )
    return rows


# ------------------------------------------------------------------------------- 3. slopes


def slopes(maps: int = 8) -> list[dict[str, object]]:
    rows: list[dict[str, object]] = []
    robot = "Hopper"
    unit = 0.1 * PRESETS["author"].metres[robot]

    def quantiles(step: float) -> np.ndarray:
        """Median and 95th percentile slope, and median height, averaged over maps."""
        found = []
        for seed in range(maps):
            field = hills(
                1.0, seed, robot=robot, resolution=step, flat_patch=None, extent=((-40, 40),) * 2
            )
            found.append([*np.quantile(field.slope(), [0.5, 0.95]), np.median(field.heights)])
        return np.mean(found, axis=0)

    fine = quantiles(0.25 * unit)
    for factor in FACTORS:
        found = quantiles(factor * unit)
        for k, what in enumerate(("median slope", "95 % slope", "median height [m]")):
            rows.append(
                {
                    "name": f"{what} at {factor * unit:.3g} m",
                    "ours": found[k],
                    "peer": fine[k],
                    "ratio": found[k] / fine[k],
                    "unit": f"difficulty 1, {maps} maps (peer: {0.25 * unit:.3g} m)",
                }
            )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print rows as JSON")
    parser.add_argument("--repeats", type=int, default=5, help="rounds whose median is taken")
    options = parser.parse_args()
    rows = drawing(options.repeats) + stepping(options.repeats) + slopes()
    if options.json:
        print(json.dumps(rows, indent=1))
        return
    for row in rows:
        peer = "" if row["peer"] is None else f"{row['peer']:12.4g} {row['ratio']:8.3f}x"
        print(f"{row['name']:44s} {row['ours']:12.4g} {peer:22s} {row['unit']}")


if __name__ == "__main__":
    main()
