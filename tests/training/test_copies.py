"""A copied run learns what the run it was copied from learns, bit for bit."""

import copy
import pickle

import pytest
import torch

from thesis_lib.policies import ARCHITECTURES
from thesis_lib.training.config import TrainConfig
from thesis_lib.training.run import Training

TIMES = ("sampling_seconds", "update_seconds", "wall_seconds")
WAYS = {"deepcopy": copy.deepcopy, "pickle": lambda made: pickle.loads(pickle.dumps(made))}
SETTINGS = [
    *({"architecture": name} for name in ARCHITECTURES),
    {"algorithm": "ppo"},
    {"baseline": "network"},
    {"algorithm": "vpg", "terrain": "hill", "maps": 2},
]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("settings", SETTINGS, ids=lambda s: "-".join(map(str, s.values())))
def test_a_copied_run_goes_on_alike(settings, way):
    run = Training(
        TrainConfig(task="Hopper", batch_steps=100, horizon=30, iterations=3, **settings)
    )
    run.step()
    twin = WAYS[way](run)
    assert twin.learner.policy is twin.policy
    for _ in range(2):
        ahead, after = twin.step(), run.step()
        assert {k: v for k, v in ahead.items() if k not in TIMES} == {
            k: v for k, v in after.items() if k not in TIMES
        }
    assert torch.equal(twin.policy.parameter_vector(), run.policy.parameter_vector())
