"""Policies written down for others: the same weights, the same actions, nothing that runs."""

import io
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch

from thesis_lib.policies import ARCHITECTURES, FeedforwardPolicy, make_policy
from thesis_lib.policies.portable import card, dumps, loads, to_onnx

QUICK = ("ctrnn", "ffwd")
NETS = [
    name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in ARCHITECTURES
]


def odd(name, dtype=torch.float32):
    """A policy of which nothing is as by default, its initial state included."""
    options = {
        "ctrnn": {"integrator": "midpoint", "constraint": "softplus"},
        "lstm": {"candidate": "logistic", "forget_bias": 0.5},
        "esn": {"leak": 0.3},
    }.get(name, {})
    policy = make_policy(
        name, 5, 2, dt=0.1, seed=3, features=[4, 0, 1], initial_log_std=-0.5, dtype=dtype, **options
    )
    generator = torch.Generator().manual_seed(1)
    theta = policy.parameter_vector()
    noise = torch.randn(theta.shape, generator=generator, dtype=torch.float64).to(dtype)
    policy.set_parameter_vector(theta + 0.1 * noise)
    return policy


@pytest.mark.parametrize("name", ARCHITECTURES)
def test_an_archive_is_the_policy(name):
    policy = odd(name)
    data = dumps(policy)
    twin = loads(data)
    assert type(twin) is type(policy)
    assert card(twin) == card(policy)
    ours, theirs = policy.state_dict(), twin.state_dict()
    assert list(ours) == list(theirs)
    assert all(torch.equal(ours[key], theirs[key]) for key in ours)
    observations = torch.randn(7, 3, 5, generator=torch.Generator().manual_seed(2))
    actions = torch.zeros(7, 3, 2)
    for a, b in zip(policy(observations, actions), twin(observations, actions), strict=True):
        assert torch.equal(a, b)


def test_a_policy_made_with_numpy_numbers_is_the_same():
    made = [
        make_policy("esn", n(5), n(2), dt=x(0.1), seed=n(3), units=n(9), features=f, leak=x(0.3))
        for n, x, f in ((int, float, [0, 4]), (np.int64, np.float64, np.array([0, 4])))
    ]
    assert card(made[1]) == card(made[0])
    assert card(loads(dumps(made[1]))) == card(made[0])


def test_layers_in_place_of_units_are_read_again():
    policy = make_policy("ffwd", 5, 2, dt=0.1, hidden=(4, 3))
    told = card(policy)
    assert told["recipe"]["units"] is None
    weights = [tuple(w.shape) for w in loads(dumps(policy)).state_dict().values() if w.ndim == 2]
    assert sorted(weights) == [(2, 3), (3, 4), (4, 5)]
    before = told | {"recipe": told["recipe"] | {"units": 6}}
    assert card(loads(changed(dumps(policy), **{"card.json": json.dumps(before)}))) == told


def test_numpy_and_an_unpacker_are_enough_to_read_it():
    policy = odd("ffwd", torch.float64)
    archive = np.load(io.BytesIO(dumps(policy)), allow_pickle=False)
    with zipfile.ZipFile(io.BytesIO(dumps(policy))) as packed:
        told = json.loads(packed.read("card.json"))
    assert told["inputs"] == {"observation": 5}
    assert told["outputs"] == {"mean": 2}
    observation = np.random.default_rng(0).normal(size=5)
    seen = observation[told["recipe"]["features"]]
    hidden = np.tanh(archive["layers.0.weight"] @ seen + archive["layers.0.bias"])
    by_hand = archive["head.weight"] @ hidden + archive["head.bias"]
    mean, _ = policy.step(
        torch.from_numpy(observation[None]), torch.zeros(1, 2), policy.initial_state(1)
    )
    np.testing.assert_allclose(mean.detach().numpy()[0], by_hand, rtol=1e-12)
    np.testing.assert_array_equal(told["log_std"], archive["log_std"])


def changed(data, **entries):
    """The archive with other entries, None for one that lacks."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(out, "w") as new:
        for name in old.namelist():
            if name not in entries:
                new.writestr(name, old.read(name))
        for name, content in entries.items():
            if content is not None:
                new.writestr(name, content)
    return out.getvalue()


class Alarm:
    def __reduce__(self):
        return (Path.touch, (Path("alarm"),))


def test_bad_archives_are_refused_and_run_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    data = dumps(odd("ffwd"))
    loaded = io.BytesIO()
    np.save(loaded, np.array([Alarm()], dtype=object), allow_pickle=True)
    alone = io.BytesIO()
    np.save(alone, np.zeros(3))
    told = card(odd("ffwd"))
    for bad in (
        b"",
        b"no archive",
        data[:-100],
        alone.getvalue(),
        changed(data, **{"card.json": None}),
        changed(data, **{"card.json": "[1]"}),
        changed(data, **{"log_std.npy": loaded.getvalue()}),
    ):
        with pytest.raises(ValueError, match="not a policy as thesis_lib writes it"):
            loads(bad)
    assert not (tmp_path / "alarm").exists()
    with pytest.raises(ValueError, match=r"format 2, but this version of thesis_lib reads 1"):
        loads(changed(data, **{"card.json": json.dumps(told | {"format": 2})}))
    for recipe in ({"action_size": 3}, {"dtype": "hub"}, {"colour": "red"}):
        other = told | {"recipe": told["recipe"] | recipe}
        with pytest.raises(ValueError, match=r"do not fit|does not take"):
            loads(changed(data, **{"card.json": json.dumps(other)}))
    with pytest.raises(ValueError, match="do not fit the card"):
        loads(changed(data, **{"log_std.npy": None}))


def test_a_policy_made_by_hand_has_no_card():
    with pytest.raises(ValueError, match="FeedforwardPolicy was not made by make_policy"):
        dumps(FeedforwardPolicy(3, 1, hidden=(2,)))


@pytest.mark.parametrize("name", NETS)
def test_onnxruntime_acts_as_the_policy(name):
    runtime = pytest.importorskip("onnxruntime", reason="needs the extra onnx")
    pytest.importorskip("onnxscript", reason="needs the extra onnx")
    policy = odd(name)
    data = to_onnx(policy)
    assert str(Path(__file__).parents[2]).encode() not in data
    session = runtime.InferenceSession(data)
    told = json.loads(session.get_modelmeta().custom_metadata_map["card"])
    assert [i.name for i in session.get_inputs()] == list(told["inputs"])
    assert [o.name for o in session.get_outputs()] == list(told["outputs"])
    rng = np.random.default_rng(0)
    n = 3
    state = policy.initial_state(n)
    theirs = np.tile(np.array(told["initial_state"], np.float32), (n, 1))
    before = np.zeros((n, 2), np.float32)
    for _ in range(10):
        given = {
            "observation": rng.normal(size=(n, 5)).astype(np.float32),
            "previous_action": before,
            "state": theirs,
        }
        with torch.no_grad():
            mean, state = policy.step(
                torch.from_numpy(given["observation"]), torch.from_numpy(before), state
            )
        answer = session.run(None, {name: given[name] for name in told["inputs"]})
        np.testing.assert_allclose(answer[0], mean.numpy(), rtol=1e-5, atol=1e-6)
        if "state" in told["inputs"]:
            theirs = answer[1]
            np.testing.assert_allclose(theirs, state.numpy(), rtol=1e-5, atol=1e-6)
        before = mean.numpy()
