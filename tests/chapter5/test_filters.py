"""The architectures as filters, reservoirs and integrators."""

import numpy as np
import pytest
import torch

from thesis_lib.chapter5 import gain, integrators, reservoirs, responses
from thesis_lib.chapter5.networks import NETS, untrained_net

torch.set_num_threads(1)


def test_feedforward_nets_pass_all_frequencies_and_slow_units_do_not() -> None:
    config = gain.Config(seeds=1, steps=4096, segment=256)
    table = gain.untrained.run(config=config).table
    assert set(table.net) == set(NETS)
    fast, slow = table[table.frequency > 15], table[table.frequency < 0.5]
    ratio = fast.groupby("net").gain.mean() / slow.groupby("net").gain.mean()
    assert pytest.approx(1, abs=0.1) == ratio.FFWD
    assert ratio["CTRNN, 1 s"] < 0.2
    # twice tau, half the gain well above the corner frequency
    high = fast.groupby("net").small_signal_gain.mean()
    assert high["CTRNN, 0.1 s"] / high["CTRNN, 1 s"] == pytest.approx(10, rel=0.15)


def test_feedforward_nets_forget_at_once() -> None:
    table = responses.moments.run("smoke").table
    impulse = table[(table.signal == "impulse") & table.net.isin(["FFWD", "DFFWD"])]
    assert (impulse[impulse.time != 0].response == 0).all()
    assert (impulse[impulse.time == 0].response > 0).all()
    before = table[table.time < 0]
    assert (before.response == 0).all()


def test_reservoirs_have_the_radii_of_table_5_1() -> None:
    table = reservoirs.eigenvalues.run("smoke").table
    size = np.hypot(table.real, table.imaginary).groupby(table.net).max()
    assert size["ESN, Hopper"] == pytest.approx(1.1, rel=1e-5)
    assert size["ESN, Ant"] == pytest.approx(1.5, rel=1e-5)
    assert (table.groupby("net").size() == [24, 50, 216]).all()


def test_errors_fall_with_the_order_of_the_integrator() -> None:
    config = integrators.Config(seeds=2, ratios=(0.02, 0.04, 1.0))
    table = integrators.errors.run(config=config).table
    error = table.groupby(["integrator", "ratio"]).error.mean().unstack()
    order = np.log2(error[0.04] / error[0.02])
    np.testing.assert_allclose(integrators.orders(table), order)
    assert order.euler == pytest.approx(1, abs=0.15)
    assert order.heun == pytest.approx(2, abs=0.2)
    assert order.midpoint == pytest.approx(2, abs=0.2)
    assert (error[1.0] > 0.1).all()  # where the clamp lets time constants go, nothing is exact


def test_nets_have_the_sizes_of_their_task() -> None:
    net = untrained_net("CTRNN, 0.1 s", "Walker2d", 0)
    assert (net.observation_size, net.action_size, net.hidden_size) == (21, 6, 18)
