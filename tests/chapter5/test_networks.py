"""Time constants, memory and sizes of the networks of section 5.2, and what is said of them."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
import torch

from thesis_lib.chapter5 import (
    architecture_drawing,
    gain,
    identities,
    live,
    memory,
    reservoirs,
    sizes,
    stability,
)
from thesis_lib.chapter5 import gradients as adjoint
from thesis_lib.chapter5.memory import OPEN_GATE
from thesis_lib.chapter5.reservoirs import exponent
from thesis_lib.chapter5.stability import growth
from thesis_lib.edition.ledger import Verdict
from thesis_lib.policies import CTRNN, RECURRENT_NETS
from thesis_lib.training.run import TIMING_COLUMNS

torch.set_num_threads(1)


# ------------------------------------------------------------------------------------ gradients
@pytest.fixture(scope="module")
def gradients() -> pd.DataFrame:
    config = adjoint.Config(seeds=2, ratios=(0.02, 0.04, 0.5))
    return adjoint.gaps.run(config=config).table


def test_adjoint_equations_at_the_stages_are_backpropagation(gradients: pd.DataFrame) -> None:
    stages = gradients[gradients.places == "stages"]
    assert set(stages.integrator) == {"euler", "heun"}
    assert (stages.difference < 1e-12).all()


def test_adjoint_equations_at_the_ends_agree_to_the_order_of_the_method(
    gradients: pd.DataFrame,
) -> None:
    ends = gradients[gradients.places == "nodes"]
    by = ends.groupby(["integrator", "ratio"]).difference.mean().unstack()
    order = np.log2(by[0.04] / by[0.02])
    assert order.euler == pytest.approx(1, abs=0.15)
    assert order.heun == pytest.approx(2, abs=0.2)
    assert order.midpoint == pytest.approx(2, abs=0.2)


# ------------------------------------------------------------------------------------ stability
@pytest.mark.parametrize("integrator", ["euler", "heun", "midpoint"])
def test_growth_is_that_of_the_policys_own_step(integrator: str) -> None:
    net = CTRNN(
        2,
        1,
        units=5,
        dt=0.1,
        time_constant=0.13,
        integrator=integrator,
        dtype=torch.float64,
        seed=3,
    )
    start = torch.zeros((1, 5), dtype=torch.float64)
    nothing = torch.zeros((1, net.input_size), dtype=torch.float64)
    slope = torch.autograd.functional.jacobian(
        lambda h: net.advance(nothing, h[None])[1][0], start[0]
    )
    K = net.recurrent.weight.detach().numpy()
    values = np.linalg.eigvals(K).astype(complex)
    assert (values.real < 1).all()  # so that growth looks at every mode
    expected = np.abs(np.linalg.eigvals(slope.numpy())).max()
    assert growth(values, 1.3, integrator) == pytest.approx(expected, rel=1e-9)


def test_limits_of_stability_by_hand() -> None:
    leak, flip = np.zeros(1, dtype=complex), -np.ones(1, dtype=complex)
    # 1 - dt/tau is -1 at half a step; 1 - 2 dt/tau is -1 at the step
    assert growth(leak, 0.5, "euler") == pytest.approx(1)
    assert growth(flip, 1.0, "euler") == pytest.approx(1)
    assert growth(flip, 0.5, "heun") == pytest.approx(1 - 4 + 8)
    # a mode that grows in continuous time is not the integrator's fault
    assert growth(np.array([1.5 + 0j]), 0.1, "euler") == 0


def test_stability_table_has_the_leak_alone() -> None:
    table = stability.modes.run(config=stability.Config(seeds=1)).table
    alone = table[(table.task == "leak alone") & (table.integrator == "euler")]
    np.testing.assert_allclose(alone.growth, np.abs(1 - 1 / alone.ratio))


# ----------------------------------------------------------------------------------- identities
def test_a_continuous_net_with_long_steps_is_a_discrete_one() -> None:
    worst = identities.gaps.run("smoke").table.groupby("net").difference.max()
    assert worst["CTRNN by Euler steps of the time constant"] < 1e-12
    assert worst["ESN without leak"] < 1e-12
    assert worst["CTRNN by Heun steps of the time constant"] > 0.01
    assert worst["ESN with the author's leak of 0.5"] > 0.01


# --------------------------------------------------------------------------------------- memory
def test_what_forgets_and_what_does_not() -> None:
    table = memory.impulses.run(config=memory.Config(seeds=2, steps=300)).table
    by = table.groupby("net")
    assert (by.steps.max()[["FFWD", "DFFWD"]] == 1).all()
    kept = table[table.net == OPEN_GATE]
    assert kept.steps.isna().all()
    assert (kept.left > 0.999999).all()


def test_exponent_of_a_quiet_contraction_by_hand() -> None:
    rng = np.random.default_rng(0)
    K = np.diag([0.5, -0.25])
    start, change = rng.uniform(-1, 1, (2, 2))
    # The state fades; about rest tanh is the identity, and the slowest mode is 1 - l + l/2.
    for leak in (1.0, 0.5):
        rate = exponent(K, leak, np.zeros((400, 2)), start, change, settle=100)
        assert rate == pytest.approx(np.log(1 - leak / 2), abs=1e-4)


def test_reservoirs_below_one_forget() -> None:
    table = reservoirs.exponents.run("smoke").table
    assert (table[table.spectral_radius < 1].exponent < 0).all()
    small = table[(table.leak == 1) & (table.spectral_radius == 0.8)]
    np.testing.assert_allclose(small.at_rest, np.log(0.8), rtol=1e-6)


# ---------------------------------------------------------------------------------------- sizes
def test_counts_are_those_of_the_equations() -> None:
    table = sizes.sizes.run("smoke").table
    for row in table[table.architecture.isin([*RECURRENT_NETS, "ffwd"])].itertuples():
        seen = row.features + (row.actions if row.architecture != "ffwd" else 0)
        assert row.learned == sizes.count(row.architecture, seen, row.actions, row.units), row
    # by hand: 9 units, 23 inputs: 207 + 81 weights, 9 biases, 9 initial states, 27 + 3 + 3
    assert sizes.count("dtrnn", 23, 3, 9) == 339


def test_the_reservoirs_weights_are_not_learned() -> None:
    table = sizes.sizes.run("smoke").table
    esn = table[(table.architecture == "esn") & (table.task == "Hopper")].set_index("features")
    assert esn.fixed[11] == 135**2 + 135 * 14
    assert (table[table.architecture != "esn"].fixed == 0).all()


# --------------------------------------------------------------------------------------- judges
def test_gradient_claim_on_both_sides() -> None:
    def table(stages: float) -> pd.DataFrame:
        names = [("euler", "stages"), ("heun", "stages")]
        names += [(name, "nodes") for name in ("euler", "heun", "midpoint")]
        rows = [(i, p, 0.1, stages if p == "stages" else 0.02) for i, p in names]
        return pd.DataFrame(rows, columns=["integrator", "places", "ratio", "difference"])

    for size, verdict in (
        (1e-14, Verdict.REPRODUCED),
        (1e-4, Verdict.DIRECTION),
        (0.1, Verdict.REFUTED),
    ):
        finding = adjoint.gradient_of_the_integrator(table(size))
        assert finding.verdict is verdict


@pytest.mark.parametrize(
    ("euler", "heun", "verdict"),
    [
        ((1.2, 0.9), (1.2, 0.9), Verdict.REPRODUCED),
        ((1.2, 1.2), (1.2, 0.9), Verdict.DIRECTION),  # pooled, half of them: it was hidden
        ((1.2, 0.9), (0.9, 0.9), Verdict.REFUTED),
    ],
)
def test_instability_claim(
    euler: tuple[float, float], heun: tuple[float, float], verdict: Verdict
) -> None:
    """Growth below the step and at it, by integrator: both must do as the text says."""
    rows = [
        (net, integrator, ratio, growth)
        for integrator, own in (("euler", euler), ("heun", heun))
        for net in ("Ant", "leak alone")
        for ratio, growth in zip((0.8, 1.0), own, strict=True)
    ]
    rows += [("leak alone", integrator, 0.4, 1.5) for integrator in ("euler", "heun")]
    table = pd.DataFrame(rows, columns=["task", "integrator", "ratio", "growth"])
    finding = stability.short_time_constants(table)
    assert finding.verdict is verdict
    assert "Euler: " in finding.evidence


def test_what_is_left_of_an_impulse_is_told_apart_by_stability() -> None:
    rows = [("LSTM, forget gate open", np.nan, 1.0, 1.0)]
    rows += [(net, 20.0, 0.0, 0.9) for net in ("LSTM", "GRU", "DTRNN")]
    rows += [("LSTM", np.nan, 0.9, 1.1), ("DTRNN", np.nan, 0.2, 0.999)]
    table = pd.DataFrame(rows, columns=["net", "steps", "left", "growth"]).assign(limit=2000)
    finding = memory.keeps_for_long(table)
    assert finding.verdict is Verdict.REPRODUCED
    assert "1 of 2 are unstable at rest" in finding.evidence
    table.loc[0, "left"] = 0.5
    assert memory.keeps_for_long(table).verdict is Verdict.REFUTED


@pytest.mark.parametrize(
    ("quiet", "loud", "rest", "verdict"),
    [
        (0.1, 0.1, 0.2, Verdict.REPRODUCED),
        (0.1, -0.1, 0.2, Verdict.DIRECTION),
        (-0.1, -0.1, 0.2, Verdict.DIRECTION),
        (-0.1, -0.1, -0.2, Verdict.NOT_REPRODUCED),
    ],
)
def test_reservoir_claims(quiet: float, loud: float, rest: float, verdict: Verdict) -> None:
    rows = [(r, 0.5, n, e, rest) for r in (1.1, 1.5) for n, e in ((0.0, quiet), (1.0, loud))]
    columns = ["spectral_radius", "leak", "noise", "exponent", "at_rest"]
    table = pd.DataFrame(rows, columns=columns)
    assert reservoirs.large_radius_magnifies(table).verdict is verdict
    small = pd.DataFrame([(0.9, 0.5, 0.0, quiet, rest)], columns=columns)
    below = reservoirs.small_radius_forgets(small)
    assert below.verdict is (Verdict.REFUTED if quiet > 0 else Verdict.REPRODUCED)


@pytest.mark.parametrize(
    ("slow", "quick", "verdict"),
    [
        (0.1, 0.2, Verdict.REPRODUCED),
        (0.1, 0.6, Verdict.NOT_REPRODUCED),
        (0.7, 0.6, Verdict.NOT_REPRODUCED),
    ],
)
def test_low_pass_claim(slow: float, quick: float, verdict: Verdict) -> None:
    fast = {"CTRNN, 1 s": slow, "CTRNN, 0.1 s": quick, "ESN": 0.5}
    rows = [
        (net, 0, f, g) for net, left in fast.items() for f, g in ((0.2, 1.0), (2, 0.9), (20, left))
    ]
    table = pd.DataFrame(rows, columns=["net", "seed", "frequency", "gain"])
    finding = gain.low_pass_before_training(table)
    assert finding.verdict is verdict


def test_sizes_claims_from_the_facts() -> None:
    # learned parameters as counted from the author's code (reservoir's initial state fixed)
    counts = {
        "Swimmer": (106, 112, 88, 68, 142 - 46, 6, 46),
        "Ant": (4024, 4048, 4624, 3488, 29320 - 3256, 24, 3256),
    }
    rows = [
        (task, net, True, units, learned)
        for task, (*numbers, vanilla, reservoir) in counts.items()
        for net, learned in zip(("dtrnn", "ctrnn", "lstm", "gru", "esn"), numbers, strict=True)
        for units in (reservoir if net == "esn" else vanilla,)
    ]
    table = pd.DataFrame(rows, columns=["task", "architecture", "thesis", "units", "learned"])
    # Vanilla nets three times as large and one unit wider, reservoirs as large as the LSTM.
    lstm = dict(zip(counts, (88, 4624), strict=True))
    vanilla, reservoir = table.architecture == "dtrnn", table.architecture == "esn"
    learned = np.where(vanilla, 3 * table.learned, table.learned)
    learned = np.where(reservoir, table.task.map(lstm), learned)
    units = np.where((table.task == "Ant") & reservoir, 3328, table.units + vanilla)
    other = table.assign(learned=learned, units=units)
    for judge, counted, otherwise in (
        (sizes.vanilla_as_large_as_lstm, Verdict.REPRODUCED, Verdict.REFUTED),
        (sizes.reservoir_as_large_as_lstm, Verdict.REFUTED, Verdict.REPRODUCED),
        (sizes.ant_reservoir, Verdict.REFUTED, Verdict.REPRODUCED),
        (sizes.largest_vanilla, Verdict.REPRODUCED, Verdict.REFUTED),
    ):
        assert judge(table).verdict is counted, judge.subject
        assert judge(other).verdict is otherwise, judge.subject


def test_euler_steps_of_the_time_constant_claim() -> None:
    table = pd.DataFrame({"net": [identities.EULER, identities.HEUN], "difference": [1e-16, 0.3]})
    assert identities.euler_is_discrete(table).verdict is Verdict.REPRODUCED
    table["difference"] = 0.3
    assert identities.euler_is_discrete(table).verdict is Verdict.REFUTED


# --------------------------------------------------------------------------------------- a page
def test_drawing_and_tables() -> None:
    figure = architecture_drawing.figure()
    assert [ax.get_title() for ax in figure.axes][1:] == ["DTRNN", "CTRNN", "LSTM", "GRU", "ESN"]
    plt.close(figure)
    made = sizes.shown(sizes.sizes.run("smoke").table).set_index("network")
    assert made.Swimmer["DTRNN"] == "106 (6)"
    assert made.Ant["ESN"] == "–"
    config = gain.Config(seeds=1, steps=2048, segment=256)
    gains = gain.shown(gain.untrained.run(config=config).table).set_index("network")
    assert float(gains["noise / gait"]["FFWD"].split()[0]) == pytest.approx(1, abs=0.05)


# ----------------------------------------------------------------------------------------- live
def test_a_live_run_is_a_training_run_and_repeats() -> None:
    config = live.Config(iterations=2, batch_steps=200, horizon=50, seeds=2)
    first = live.curves.run(config=config, workers=1).table
    live.trained.cache_clear()
    second = live.curves.run(config=config, workers=2).table
    pd.testing.assert_frame_equal(
        first.drop(columns=list(TIMING_COLUMNS)), second.drop(columns=list(TIMING_COLUMNS))
    )
    assert first.groupby("seed").size().tolist() == [2, 2]
    assert (first.kl <= first.delta_kl).all()
