"""Claims of chapter 5, and where this edition differs from it.

So far those of sections 5.1 (tasks, terrain, noise), 5.2 (architectures), 5.3 (the robustness
score) and the sizes of section 5.4.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from thesis_lib import published
from thesis_lib.claims import Claim, Difference, Finding, Tables, Verdict
from thesis_lib.experiments.chapter5.architectures import FAST, GAIT, SLOW, gait_band
from thesis_lib.robustness import score
from thesis_lib.stats import equivalence, mean_ci, welch

ALPHA = 0.05

SIGNIFICANT_SHARE = 0.5
"""Noise counts as a significant perturbation of a sensor from this share of its own standard
deviation on: it then takes a fifth of what the sensor's variance tells."""

RECOVERY_MARGIN = 0.25
"""Ways that differ by less than this share count as equal."""

RIGHT_ANGLE = 1.5707963267948966

ROUNDING = 1e-9
"""Computations in float64 that agree to this, relatively, count as the same."""

SAME_SIZE = (0.75, 4 / 3)
"""Two networks have roughly the same number of parameters if the ratio lies between these."""


# ------------------------------------------------------------------------------ section 5.1


def observation_sizes(tables: Tables) -> Finding:
    """Entries of the observation against the printed ones, under either reading."""
    table = tables["tasks-5.1"].set_index("robot")
    agree = table.observation == table.observation_printed
    told = ", ".join(f"{robot} {size}" for robot, size in table.observation.items())
    evidence = f"The author's code gives {told}."
    for robot in table.index[~agree]:
        row = table.loc[robot]
        evidence += (
            f" The text says {row.observation_printed} for the {robot}; with the previous action, "
            f"which recurrent networks are fed, it has {row.observation_text}."
        )
    return Finding(Verdict.REPRODUCED if agree.all() else Verdict.NOT_REPRODUCED, evidence)


def links_and_joints(tables: Tables) -> Finding:
    """Rigid bodies and actuators of the models against the printed ones."""
    table = tables["tasks-5.1"].set_index("robot")
    links, joints = table.links == table.links_printed, table.joints == table.joints_printed
    evidence = f"Actuated joints agree for {joints.sum()} of {len(table)} robots, links for "
    evidence += f"{links.sum()}."
    for robot in table.index[~links]:
        row = table.loc[robot]
        evidence += f" The {robot} has {row.links} rigid bodies, not {row.links_printed}."
    if links.all() and joints.all():
        return Finding(Verdict.REPRODUCED, evidence)
    return Finding(Verdict.REFUTED, evidence)


def _plain_maps(table: pd.DataFrame, preset: str) -> pd.DataFrame:
    return table[(table.preset == preset) & ~table.colour_map]


def hilltop_density(tables: Tables) -> Finding:
    """Visible hilltops per square unit against 0.3."""
    told, near = [], []
    for preset in ("author", "text"):
        maps = _plain_maps(tables["terrain-5.1"], preset)
        maps = maps[(maps.robot == "Hopper") & (maps.difficulty == 1)]
        tops = mean_ci(maps.tops)
        near.append(abs(tops.mean - 0.3) < 0.03)
        told.append(f"{preset} preset {tops.mean:.3f} ± {tops.half_width:.3f} (n = {tops.n} maps)")
    return Finding(
        Verdict.REPRODUCED if all(near) else Verdict.NOT_REPRODUCED,
        f"Visible hilltops per square unit: {'; '.join(told)}.",
    )


def height_is_difficulty(tables: Tables) -> Finding:
    """Height of the highest hill over difficulty, by robot."""
    maps = _plain_maps(tables["terrain-5.1"], "author")
    ratio = (maps.highest / maps.difficulty).groupby(maps.robot).mean()
    equal = (ratio - 1).abs() < 0.02
    others = ratio[~equal]
    evidence = f"The highest hill is as high as the difficulty for {', '.join(ratio.index[equal])}"
    evidence += "".join(f"; for the {r} it is {v:.2f} times that" for r, v in others.items())
    evidence += ". Only the narrowest hills are: the widest are half as high as the narrowest."
    return Finding(Verdict.REPRODUCED if equal.all() else Verdict.DIRECTION, evidence)


def higher_is_steeper(tables: Tables) -> Finding:
    """Height and slope at difficulty 1 over those at 0.5, on the same maps."""
    maps = _plain_maps(tables["terrain-5.1"], "author")
    by = maps.groupby(["robot", "map", "difficulty"])[["highest", "p95_slope"]].mean()
    ratio = by.xs(1.0, level="difficulty") / by.xs(0.5, level="difficulty")
    both = bool((ratio > 1).all().all())
    return Finding(
        Verdict.REPRODUCED if both else Verdict.REFUTED,
        f"From difficulty 0.5 to 1 height grows by a factor {ratio.highest.mean():.3f} and the "
        f"95th percentile of the slope by {ratio.p95_slope.mean():.3f} on every one of the "
        f"{len(ratio)} maps: the ground is scaled.",
    )


def joint_angle_range(tables: Tables) -> Finding:
    """Largest joint angle seen in each robot."""
    table = tables["noise-5.1"]
    angles = table[table.group == "joint angle"]
    largest = angles[["low", "high"]].abs().max(axis=1).groupby(angles.robot).max()
    beyond = largest[largest > RIGHT_ANGLE]
    told = ", ".join(f"{robot} {value:.2f}" for robot, value in largest.items())
    evidence = f"Largest joint angles seen, rad, to be compared with π/2 = 1.57: {told}."
    if beyond.empty:
        return Finding(Verdict.REPRODUCED, evidence)
    return Finding(
        Verdict.REFUTED, f"{evidence} {', '.join(beyond.index)} go beyond, within their limits."
    )


def velocities_range_wider(tables: Tables) -> Finding:
    """Spread of joint velocities over that of joint angles, by robot and controller."""
    table = tables["noise-5.1"]
    spread = table.groupby(["robot", "controller", "group"]).sd.median().unstack()
    ratio = spread["joint velocity"] / spread["joint angle"]
    return Finding(
        Verdict.REPRODUCED if (ratio > 1).all() else Verdict.NOT_REPRODUCED,
        "Numbers in rad/s spread "
        f"{ratio.min():.1f} to {ratio.max():.1f} times as wide as numbers in rad, over "
        f"{len(ratio)} pairs of robot and controller.",
    )


def sigma_is_significant(tables: Tables) -> Finding:
    """Share of sensors whose own spread is at most twice the noise, by robot."""
    table = tables["noise-5.1"]
    table = table[(table.controller == "metronome") & (table.sd > 0)]
    hit = (table.sigma / table.sd >= SIGNIFICANT_SHARE).groupby(table.robot).mean()
    told = ", ".join(f"{robot} {share:.0%}" for robot, share in hit.items())
    evidence = (
        f"Sensors hit by at least {SIGNIFICANT_SHARE:g} of their own standard deviation under the "
        f"metronome: {told}; sensors that never move are left out."
    )
    return Finding(
        Verdict.REPRODUCED if (hit > 0.5).all() else Verdict.NOT_REPRODUCED,
        evidence,
    )


def contacts_are_sparse(tables: Tables) -> Finding:
    """Share of the ant's contact entries that are exactly zero."""
    table = tables["noise-5.1"]
    zero = table[table.group == "contact force"].groupby("controller").zero.mean()
    told = ", ".join(f"{controller} {share:.0%}" for controller, share in zero.items())
    return Finding(
        Verdict.REPRODUCED if (zero > 0.5).all() else Verdict.NOT_REPRODUCED,
        f"Share of the ant's contact entries that are exactly 0: {told}.",
    )


def swimmer_recovers(tables: Tables) -> Finding:
    """How far a metronome moves the swimmer after a struggle and from a fresh start."""
    table = tables["recovery-5.1"]
    ways = {
        start: group.way.to_numpy()
        for start, group in table[table.robot == "Swimmer"].groupby("start")
    }
    fresh, after = mean_ci(ways["reset"]), mean_ci(ways["struggle"])
    margin = RECOVERY_MARGIN * fresh.mean
    test = equivalence(ways["struggle"], ways["reset"], margin)
    worse = welch(ways["struggle"], ways["reset"])
    evidence = (
        f"The same metronome covers {fresh.mean:.2f} ± {fresh.half_width:.2f} m from a reset and "
        f"{after.mean:.2f} ± {after.half_width:.2f} m after random actions (n = {fresh.n} each); "
        f"equal within {RECOVERY_MARGIN:.0%} with p = {test.p_value:.2g}; least way after random "
        f"actions {min(ways['struggle']):.2f} m."
    )
    if test.p_value < ALPHA or worse.low > -margin:
        return Finding(Verdict.REPRODUCED, evidence)
    if worse.high < -margin:
        return Finding(Verdict.REFUTED, evidence)
    return Finding(Verdict.INCONCLUSIVE, evidence)


# ------------------------------------------------------------------------------ section 5.3


def score_range(tables: Tables) -> Finding:
    """A controller that runs backwards under the perturbation, and one that does so always."""
    turned, backward = score(100, -50, best=100), score(-50, -50, best=100)
    evidence = (
        "Returns can be negative. With a best return of 100, base return 100 and perturbed return "
        f"-50 score {turned:.2f}, and -50 twice scores {backward:.2f}; for returns from 0 to the "
        "best the score is indeed in [0, 1]."
    )
    outside = min(turned, backward) < 0 or max(turned, backward) > 1
    verdict = Verdict.REFUTED if outside else Verdict.REPRODUCED
    return Finding(verdict, evidence.replace("-", "−"))


def score_of_the_best(tables: Tables) -> Finding:
    """The score is 1 exactly when both returns are the best."""
    both = score(100, 100, best=100)
    least_loss = [score(b, p, best=100) for b, p in ((99.9, 100), (100, 99.9), (99.9, 99.9))]
    holds = both == 1 and max(least_loss) < 1
    return Finding(
        Verdict.REPRODUCED if holds else Verdict.REFUTED,
        "With base and perturbed return both the best on the pair the score is "
        f"{both:.3g}; a thousandth less in either or both gives at most {max(least_loss):.4f}.",
    )


def score_depends_on_others(tables: Tables) -> Finding:
    """One controller, two competitors."""
    alone, beside = score(80, 60, best=80), score(80, 60, best=200)
    return Finding(
        Verdict.REPRODUCED if alone != beside else Verdict.REFUTED,
        f"Returns of 80 and 60 score {alone:.2f} if 80 is the best return and {beside:.2f} if "
        "another controller reaches 200.",
    )


def self_scoring(tables: Tables) -> Finding:
    """A poor but steady controller, scored by its own best return and by another's."""
    own, other = score(1, 1, best=1), score(1, 1, best=1000)
    return Finding(
        Verdict.REPRODUCED if own == 1 and other < 0.01 else Verdict.REFUTED,
        f"Returns of 1 and 1 score {own:.3g} by the controller's own best and {other:.3g} beside a "
        "best of 1000.",
    )


def slowing_beats_turning(tables: Tables) -> Finding:
    """Half speed, standing or turning aside, and going back, after a good base run."""
    slow, aside, back = (score(100, p, best=100) for p in (50, 0, -50))
    return Finding(
        Verdict.REPRODUCED if slow > aside > back else Verdict.REFUTED,
        f"After a base return of 100, half the speed on the hills scores {slow:.2f}, moving at "
        f"right angles {aside:.2f} and moving back −{abs(back):.2f}.",
    )


# ------------------------------------------------------------------------------ section 5.2


def euler_is_discrete(tables: Tables) -> Finding:
    """Euler steps of the time constant against the discrete-time network."""
    worst = tables["section-5.2-identities"].groupby("net").difference.max()
    euler = worst["CTRNN by Euler steps of the time constant"]
    heun = worst["CTRNN by Heun steps of the time constant"]
    return Finding(
        Verdict.REPRODUCED if euler < ROUNDING else Verdict.REFUTED,
        f"Over random inputs no unit differs by more than {euler:.0e}. By the author's midpoint "
        f"steps of the same length the two differ by up to {heun:.2f}.",
    )


def gradient_of_the_integrator(tables: Tables) -> Finding:
    """Backpropagation through an integrator against integrating the adjoint equations."""
    table = tables["section-5.2.2-gradients"]
    worst = table.groupby(["integrator", "places"]).difference.max()
    middle = table.groupby(["integrator", "places", "ratio"]).difference.median()
    ratio = min(table.ratio, key=lambda r: abs(r - 0.1))
    exact = {name: worst[name, "stages"] for name in ("euler", "heun")}
    evidence = (
        "If the backward step takes the states at which the forward step evaluated its slopes, "
        f"they agree to {exact['euler']:.0e} for Euler and {exact['heun']:.0e} for the author's "
        "midpoint. From the states at the steps' ends alone they differ, at a step of "
        f"{ratio:g} time constants, by {middle['euler', 'nodes', ratio]:.1%} and "
        f"{middle['heun', 'nodes', ratio]:.2%}; those of the true midpoint by "
        f"{middle['midpoint', 'nodes', ratio]:.2%}."
    )
    if max(exact.values()) < ROUNDING:
        return Finding(Verdict.REPRODUCED, evidence)
    close = max(middle[name, "stages", ratio] for name in exact) < 0.01
    return Finding(Verdict.DIRECTION if close else Verdict.REFUTED, evidence)


def short_time_constants(tables: Tables) -> Finding:
    """Share of networks with a mode that an integrator lets grow, by time constant."""
    table = tables["section-5.2.2-stability"]
    nets = table[table.net != "leak alone"]
    growing = (nets.growth > 1 + ROUNDING).groupby([nets.integrator, nets.ratio]).mean()
    unstable = growing.unstack("integrator")
    alone = table[(table.net == "leak alone") & (table.growth > 1 + ROUNDING)]
    alone = alone.groupby("integrator").ratio.max()
    below, above = unstable[unstable.index < 1], unstable[unstable.index >= 1]
    names = {"euler": "Euler", "heun": "the author's midpoint, Heun"}
    told = "; ".join(
        f"{names[name]}: " + ", ".join(f"{share:.0%} at {ratio:g}" for ratio, share in own.items())
        for name, own in unstable.items()
    )
    evidence = (
        "Share of untrained networks with a mode about rest that should decay and grows, by time "
        f"constant over step. {told}. The leak by itself grows at {alone['euler']:g} of a step by "
        f"Euler's method and at {alone['heun']:g} by Heun's, and at nothing longer that was tried."
    )
    if (below > 0.5).all(axis=None) and (above < 0.5).all(axis=None):
        return Finding(Verdict.REPRODUCED, evidence)
    some = (below.max() > 0.5).all()
    return Finding(Verdict.DIRECTION if some else Verdict.REFUTED, evidence)


def keeps_for_long(tables: Tables) -> Finding:
    """An impulse in an LSTM, at the start of training and with its forget gates open."""
    table = tables["section-5.2.3-memory"]
    held = table[table.net == "LSTM, forget gate open"].left.min()
    gone = table.groupby("net").steps.agg(["median", "count", "size"])
    told = ", ".join(
        f"{n.Index} {n.count_} of {n.size_} (median {n.median_:.0f} steps)"
        for n in gone.add_suffix("_").loc[["LSTM", "GRU", "DTRNN"]].itertuples()
    )
    evidence = (
        f"With the forget gates open at least {held:.2%} of an impulse is left after "
        f"{table.limit.iloc[0]} steps. Before training less than 1% is left by then in: {told}; of "
        f"the others {_unstable(table, ['LSTM', 'GRU', 'DTRNN'])}."
    )
    return Finding(Verdict.REPRODUCED if held > 0.99 else Verdict.REFUTED, evidence)


def _unstable(table: pd.DataFrame, nets: list[str]) -> str:
    """Of the networks that still feel the impulse, how many were unstable at rest."""
    still = table[table.steps.isna() & table.net.isin(nets)]
    if still.empty:
        return "there are none"
    return f"{(still.growth > 1).sum()} of {len(still)} are unstable at rest"


def small_radius_forgets(tables: Tables) -> Finding:
    """Lyapunov exponents of reservoirs with a spectral radius below 1."""
    table = tables["section-5.2.5-radius"]
    below = table[table.spectral_radius < 1]
    worst = below.exponent.max()
    return Finding(
        Verdict.REPRODUCED if worst < 0 else Verdict.REFUTED,
        f"The largest exponent of {len(below)} runs is {worst:.3f} a step, so that the slowest "
        f"difference halves in {np.log(2) / -worst:.0f} steps."
        if worst < 0
        else f"The largest exponent of {len(below)} runs is {worst:.3f} a step.",
    )


def large_radius_magnifies(tables: Tables) -> Finding:
    """Lyapunov exponents of reservoirs with a spectral radius above 1, with and without input."""
    table = tables["section-5.2.5-radius"]
    above = table[table.spectral_radius > 1].assign(grows=lambda t: t.exponent > 0)
    share = above.groupby("noise").grows.mean()
    quiet, loud = share.index.min(), share.index.max()
    rest = (above.at_rest > 0).mean()
    used = above[(above.spectral_radius == 1.1) & (above.leak == 0.5)].groupby("noise")
    evidence = (
        f"Of the runs with a radius above 1 {share[quiet]:.0%} have a positive exponent without "
        f"input and {share[loud]:.0%} with noise of standard deviation {loud:g} on every input"
    )
    evidence += f"; about rest differences grow in {rest:.0%} of them"
    if not used.ngroups:
        evidence += "."
    else:
        mean = used.exponent.mean()
        evidence += (
            f". With the values used in most tasks, 1.1 and a leak of 0.5, the exponents are "
            f"{mean[quiet]:.3f} and {mean[loud]:.3f} a step."
        )
    if share[quiet] > 0.5 and share[loud] > 0.5:
        return Finding(Verdict.REPRODUCED, evidence)
    return Finding(Verdict.DIRECTION if rest > 0.5 else Verdict.NOT_REPRODUCED, evidence)


def low_pass(tables: Tables) -> Finding:
    """Gain at the frequencies of noise over that of slow signals, before training."""
    return _low_pass(tables["section-5.2-gain"], "before training")


def low_pass_trained(tables: Tables) -> Finding:
    """The same of the networks that training ended with."""
    table = tables["section-5.2-gain-trained"]
    return _low_pass(table[table.stage == "after"], "after training")


def _low_pass(table: pd.DataFrame, stage: str) -> Finding:
    """Whether the CTRNN takes the most of fast signals, whatever its initial time constant."""
    bands = {
        "slow": table.frequency < SLOW,
        "gait": gait_band(table.frequency),
        "fast": table.frequency > FAST,
    }
    gain = pd.DataFrame(
        {band: table[rows].groupby(["net", "seed"]).gain.mean() for band, rows in bands.items()}
    )
    ratio = (gain.fast / gain.slow).unstack()
    kept = (gain.gait / gain.slow).unstack().mean(axis=1)
    ours = ratio.index.str.startswith("CTRNN")
    least = ratio[~ours].min()
    wins = (ratio[ours] < least).mean(axis=1)
    mean = ratio.mean(axis=1)
    best = mean[~ours].idxmin()
    evidence = (
        f"Gain above {FAST:g} Hz over that below {SLOW:g} Hz, {stage}: "
        + ", ".join(f"{net} {mean[net]:.3f}" for net in mean.index[ours])
        + f"; the next is {best} with {mean[best]:.2f}. At {GAIT:g} Hz, taken for a gait, "
        + " and ".join(f"{kept[net]:.2f}" for net in mean.index[ours])
        + f" of the slow gain is left ({best}: {kept[best]:.2f})."
    )
    if (wins == 1).all():
        return Finding(Verdict.REPRODUCED, evidence)
    return Finding(Verdict.DIRECTION if wins.mean() > 0.5 else Verdict.NOT_REPRODUCED, evidence)


# ------------------------------------------------------------------------------ section 5.4


def _against_lstm(tables: Tables) -> pd.DataFrame:
    """Learned parameters over those of the LSTM: tasks by nets, as the thesis sets them up."""
    table = tables["section-5.4-sizes"]
    learned = table[table.thesis].set_index(["task", "net"]).learned.unstack()
    return learned.div(learned.lstm, axis=0)


def vanilla_as_large_as_lstm(tables: Tables) -> Finding:
    """Parameters of DTRNN, CTRNN and GRU over those of the LSTM."""
    ratio = _against_lstm(tables)[["dtrnn", "ctrnn", "gru"]]
    near = (ratio >= SAME_SIZE[0]) & (ratio <= SAME_SIZE[1])
    told = ", ".join(
        f"{net.upper()} {ratio[net].min():.2f} to {ratio[net].max():.2f}" for net in ratio
    )
    return Finding(
        Verdict.REPRODUCED if near[["dtrnn", "ctrnn"]].all(axis=None) else Verdict.REFUTED,
        f"Learned parameters over those of the LSTM, by task: {told}.",
    )


def reservoir_as_large_as_lstm(tables: Tables) -> Finding:
    """Learned parameters of the ESN over those of the LSTM."""
    ratio = _against_lstm(tables)["esn"].dropna()
    near = ratio.between(*SAME_SIZE)
    told = ", ".join(f"{task} {value:.1f}" for task, value in ratio.items())
    return Finding(
        Verdict.REPRODUCED if near.all() else Verdict.REFUTED,
        f"Learned parameters over those of the LSTM: {told}. The formula counts the weights of a "
        "GRU and gives the reservoir that many units, each of which has a weight to every action.",
    )


def ant_reservoir(tables: Tables) -> Finding:
    """Units of the Ant's reservoir by the formula of section 5.4."""
    table = tables["section-5.4-sizes"].set_index(["task", "net"])
    units = int(table.loc[("Ant", "esn"), "units"])
    return Finding(
        Verdict.REPRODUCED if units == 3328 else Verdict.REFUTED,
        f"The formula of section 5.4 gives {units} for 125 observations and 8 actions; 3328 would "
        "need 128 observations.",
    )


def largest_vanilla(tables: Tables) -> Finding:
    """Units of the largest DTRNN."""
    table = tables["section-5.4-sizes"]
    units = table[table.net == "dtrnn"].groupby("task").units.max()
    return Finding(
        Verdict.REPRODUCED if units.max() == 24 else Verdict.REFUTED,
        f"The largest, that of the {units.idxmax()}, has {units.max()} hidden units.",
    )


# ------------------------------------------------------------------------------ settings


def _options(tables: Tables, changed: str) -> pd.Series:
    """The CTRNN's row of the sweep of settings in which one was changed."""
    table = tables["section-5.5.1-options"]
    found = table[(table.architecture == "ctrnn") & (table.changed == changed)]
    if len(found) != 1:
        raise ValueError(
            f"section-5.5.1-options has {len(found)} rows for the CTRNN with {changed!r}, but "
            "exactly 1 is needed."
        )
    return found.iloc[0]


def _compared(name: str, row: pd.Series) -> str:
    return (
        f"{name} {row.mean_changed:.0f} (difference {row.difference:.0f}, 95% interval "
        f"{row.low:.0f} to {row.high:.0f}, p = {row.p_holm:.2g} after Holm)"
    ).replace("-", "−")


def clamp_is_best(tables: Tables) -> Finding:
    """Mean return over training of the clamp against two reparameterisations."""
    others = {name: _options(tables, f"constraint={name}") for name in ("softplus", "exponential")}
    first = others["softplus"]
    evidence = (
        f"Mean return over training ({first.task}, {first.n} seeds in pairs): "
        f"{first.mean_reference:.0f} with the clamp; "
        + "; ".join(_compared(name, row) for name, row in others.items())
        + ". A penalty was not tried."
    )
    below = [row.difference < 0 for row in others.values()]
    clear = [row.p_holm < ALPHA for row in others.values()]
    if all(below) and all(clear):
        return Finding(Verdict.REPRODUCED, evidence)
    if all(below):
        return Finding(Verdict.DIRECTION, evidence)
    better = any(c and not b for b, c in zip(below, clear, strict=True))
    return Finding(Verdict.REFUTED if better else Verdict.NOT_REPRODUCED, evidence)


def midpoint_learns_better(tables: Tables) -> Finding:
    """Mean return over training of Euler's method against the author's midpoint."""
    euler, midpoint = (_options(tables, f"integrator={n}") for n in ("euler", "midpoint"))
    evidence = (
        f"Mean return over training ({euler.task}, {euler.n} seeds in pairs): "
        f"{euler.mean_reference:.0f} with the author's midpoint (Heun); "
        f"{_compared('Euler', euler)}; {_compared('the true midpoint', midpoint)}."
    )
    if euler.p_holm < ALPHA:
        worse = euler.difference < 0
        return Finding(Verdict.REPRODUCED if worse else Verdict.REFUTED, evidence)
    return Finding(Verdict.DIRECTION if euler.difference < 0 else Verdict.NOT_REPRODUCED, evidence)


CLAIMS: tuple[Claim, ...] = (
    Claim(
        "5.1-observation-sizes",
        "5.1.1",
        "Observations have 22 (Swimmer), 20 (Hopper), 21 (Walker), 20 (Half-Cheetah) and 125 "
        "(Ant) entries.",
        ("tasks-5.1",),
        "All five sizes equal those of the author's code.",
        observation_sizes,
    ),
    Claim(
        "5.1-links-joints",
        "5.1.1",
        "The robots have 3, 4, 7, 9 and 13 rigid links and 2, 3, 6, 6 and 8 actuated joints "
        "(Swimmer, Hopper, Walker, Half-Cheetah, Ant).",
        ("tasks-5.1",),
        "Bodies and actuators of all five models are as many as stated.",
        links_and_joints,
    ),
    Claim(
        "5.1-hilltop-density",
        "5.1",
        "The terrain has 0.3 hilltops per square unit on average.",
        ("terrain-5.1",),
        "Hilltops counted on maps of both presets are within 10% of 0.3 per square unit.",
        hilltop_density,
    ),
    Claim(
        "5.1-height-difficulty",
        "5.1",
        "The hills' height equals the difficulty.",
        ("terrain-5.1",),
        "The highest hill of the author's terrain is within 2% of the difficulty, for every robot.",
        height_is_difficulty,
    ),
    Claim(
        "5.1-steepness-difficulty",
        "5.1",
        "A higher difficulty means higher and steeper hills.",
        ("terrain-5.1",),
        "Height and 95th percentile of slope are larger at difficulty 1 than at 0.5 on every map.",
        higher_is_steeper,
    ),
    Claim(
        "5.1-joint-angles",
        "5.1",
        "Joint angles take values between −π/2 and π/2.",
        ("noise-5.1",),
        "No joint angle beyond ±π/2 is seen in any robot.",
        joint_angle_range,
    ),
    Claim(
        "5.1-joint-velocities",
        "5.1",
        "Joint angular velocities range wider than joint angles.",
        ("noise-5.1",),
        "The median standard deviation of joint velocities exceeds that of joint angles in every "
        "robot under both controllers.",
        velocities_range_wider,
    ),
    Claim(
        "5.1-sigma-significant",
        "5.1",
        "Noise of standard deviation 1 is a significant perturbation for most sensors.",
        ("noise-5.1",),
        "In every robot more than half of the sensors get noise of at least half their own "
        "standard deviation under a moving controller.",
        sigma_is_significant,
        headline=True,
    ),
    Claim(
        "5.1-swimmer-recovers",
        "5.1.1",
        "The swimmer has no irrecoverable states in which it gets stuck.",
        ("recovery-5.1",),
        "After 200 random steps a fixed gait covers as much ground as from a fresh start, within "
        "25% (two one-sided tests) or more.",
        swimmer_recovers,
    ),
    Claim(
        "5.1-contacts-sparse",
        "5.1.1",
        "The ant's vector of contact forces is usually sparse.",
        ("noise-5.1",),
        "More than half of its entries are exactly 0 under both controllers.",
        contacts_are_sparse,
    ),
    Claim(
        "5.2.2-euler-is-dtrnn",
        "5.2.2",
        "A CTRNN stepped by Euler's method with its time constant as the step is the DTRNN.",
        ("section-5.2-identities",),
        "No unit differs by more than rounding in any step of random runs.",
        euler_is_discrete,
    ),
    Claim(
        "5.2.2-gradient",
        "5.2.2",
        "The gradient of an Euler or midpoint approximation is the same as integrating the "
        "differential equations of the gradient numerically.",
        ("section-5.2.2-gradients",),
        "For Euler and the author's midpoint (Heun) the two agree to a relative 1e-9 at all steps, "
        "the adjoint equations being integrated by the same method at the same states.",
        gradient_of_the_integrator,
    ),
    Claim(
        "5.2.2-instability",
        "5.2.2",
        "A time constant smaller than the step leads to instability.",
        ("section-5.2.2-stability",),
        "With Euler's method, and with the author's midpoint (Heun) too, most untrained networks "
        "have a mode that should decay and grows at every time constant below the step, and most "
        "have none at the step and above; direction only if most have one somewhere below it.",
        short_time_constants,
    ),
    Claim(
        "5.2.3-lstm-keeps",
        "5.2.3",
        "An LSTM can hold on to a feature of the state for arbitrarily long times.",
        ("section-5.2.3-memory",),
        "There is one of which at least 99% of an impulse is left after 2000 steps.",
        keeps_for_long,
    ),
    Claim(
        "5.2.5-small-radius",
        "5.2.5",
        "With a spectral radius below 1 the past is forgotten quickly.",
        ("section-5.2.5-radius",),
        "The largest Lyapunov exponent is negative in every run with a radius below 1.",
        small_radius_forgets,
    ),
    Claim(
        "5.2.5-large-radius",
        "5.2.5",
        "With a spectral radius above 1 differences are magnified, possibly into chaos.",
        ("section-5.2.5-radius",),
        "Most runs with a radius above 1 have a positive Lyapunov exponent, without input and with "
        "noise of standard deviation 1 on every input; direction only if in most of them "
        "differences grow about rest.",
        large_radius_magnifies,
    ),
    Claim(
        "5.2-low-pass",
        "5.5.2",
        "The CTRNN is a more efficient low-pass filter than the other networks (here: before "
        "training).",
        ("section-5.2-gain",),
        f"In every seed the gain above {FAST:g} Hz, over that below {SLOW:g} Hz, is lower for the "
        "CTRNN with either initial time constant than for every other network.",
        low_pass,
    ),
    Claim(
        "5.2-low-pass-trained",
        "5.5.2",
        "The CTRNN is a more efficient low-pass filter than the other networks (here: after "
        "training on the flat half-cheetah).",
        ("section-5.2-gain-trained",),
        f"In every seed the gain above {FAST:g} Hz, over that below {SLOW:g} Hz, is lower for the "
        "CTRNN with either initial time constant than for every other recurrent network.",
        low_pass_trained,
    ),
    Claim(
        "5.4-vanilla-size",
        "5.4",
        "With three units for each action DTRNN and CTRNN have about as many parameters as the "
        "LSTM.",
        ("section-5.4-sizes",),
        "On every task the ratio lies between 3/4 and 4/3.",
        vanilla_as_large_as_lstm,
    ),
    Claim(
        "5.4-esn-size",
        "5.4",
        "The size of the ESN is chosen for the same reason: as many free parameters as the LSTM.",
        ("section-5.4-sizes",),
        "On every task the ratio lies between 3/4 and 4/3.",
        reservoir_as_large_as_lstm,
    ),
    Claim(
        "5.4-ant-reservoir",
        "5.5.1",
        "The Ant's ESN has 3328 hidden units.",
        ("section-5.4-sizes",),
        "The formula of section 5.4 gives this number.",
        ant_reservoir,
    ),
    Claim(
        "5.4-largest-dtrnn",
        "5.5.1",
        "The largest DTRNN has 24 hidden units.",
        ("section-5.4-sizes",),
        "The rule of section 5.4 gives this number.",
        largest_vanilla,
    ),
    Claim(
        "5.3-score-range",
        "5.3",
        "The robustness score lies in [0, 1].",
        (),
        "Equation 5.4 stays in [0, 1] for all returns the tasks can give.",
        score_range,
    ),
    Claim(
        "5.3-score-one",
        "5.3",
        "The best controller on a task pair scores 1 if the perturbation does not affect it.",
        (),
        "Equation 5.4 gives 1 for two best returns and less for any smaller one.",
        score_of_the_best,
    ),
    Claim(
        "5.3-score-others",
        "5.3",
        "A controller's score depends partly on the other controllers.",
        (),
        "Equation 5.4 gives one pair of returns different scores beside different competitors.",
        score_depends_on_others,
    ),
    Claim(
        "5.3-self-scoring",
        "5.3",
        "Scored by its own best, a poor controller that is equally poor under perturbation would "
        "get a high score.",
        (),
        "Equation 5.4 gives such a controller 1 by its own best and under 0.01 beside a good one.",
        self_scoring,
    ),
    Claim(
        "5.3-slowing",
        "5.3",
        "Slowing down on a hill scores better than moving on smoothly sideways or backwards.",
        (),
        "Equation 5.4 orders them so.",
        slowing_beats_turning,
    ),
    Claim(
        "5.2.2-clamp",
        "5.2.2",
        "Raising time constants to the step after each update, the crudest way, led to better "
        "results than a reparameterisation or a penalty.",
        ("section-5.5.1-options",),
        "Return averaged over training (half-cheetah, same seeds in pairs) is lower with either "
        "reparameterisation, softplus and exponential, than with the clamp, both by a paired "
        "t-test, p < .05 after Holm; direction only if both are lower; refuted if one is higher "
        "with p < .05.",
        clamp_is_best,
    ),
    Claim(
        "5.5.1-midpoint",
        "5.5.1",
        "The CTRNN learned significantly better with the midpoint method than with Euler's on most "
        "tasks (here: on one, the half-cheetah).",
        ("section-5.5.1-options",),
        "Return averaged over training (half-cheetah, same seeds in pairs) is lower with Euler's "
        "method than with the author's midpoint (Heun), by a paired t-test, p < .05 after Holm; "
        "direction only if lower; refuted if higher with p < .05.",
        midpoint_learns_better,
    ),
)


# ------------------------------------------------------------------------------ differences


def _cheetah_cost(tables: Tables) -> str:
    table = tables["baseline-5.1"]
    table = table[(table.robot == "HalfCheetah") & (table.ground == "plane")]
    cost = -table.control.mean()
    return (
        "At most 0.27 a step, for full torque on all six joints. The untrained controller pays "
        f"{cost:.0f} in 500 steps here and {cost / 10:.0f} by the text."
    )


def _start_patch(tables: Tables) -> str:
    table = tables["starts-5.1"]
    table = table[table.difficulty.isin([0.0, 1.0])]
    depth = table.groupby(["patch", "robot"]).depth.max().unstack()
    ground = table[table.patch == "author"].ground.max()
    ours = (depth.loc["centred"] - depth.loc["flat floor"]).abs().max()
    told = ", ".join(f"{robot} {100 * d:.0f}" for robot, d in depth.loc["author"].items())
    return (
        f"Beside the author's patch the ground under the robot reaches {ground:.2f} m at "
        f"difficulty 1, and the deepest contact at a reset is, in cm: {told}. On the centred patch "
        f"it differs from the flat floor's by {1000 * ours:.1f} mm."
    )


def _terrain_scale(tables: Tables) -> str:
    table = tables["terrain-5.1"]
    at = (table.robot == "Hopper") & (table.difficulty == 1) & ~table.colour_map
    slopes = table[at].groupby("preset")[["p95_slope", "steepest_flank"]].mean()
    author, text = slopes.loc["author"], slopes.loc["text"]
    return (
        f"At difficulty 1 the 95th percentile of the slope is {author.p95_slope:.2f} with the "
        f"author's numbers and {text.p95_slope:.2f} with the text's taken in metres; the steepest "
        f"flank {author.steepest_flank:.2f} and {text.steepest_flank:.2f}, which none of these "
        "robots can climb."
    )


def _colour_map(tables: Tables) -> str:
    table = tables["terrain-5.1"]
    at = (table.robot == "Hopper") & (table.difficulty == 1) & (table.preset == "author")
    by = table[at].groupby("colour_map")[["median_height", "p95_slope"]].mean()
    return (
        f"Median height {by.loc[True, 'median_height']:.2f} m in place of "
        f"{by.loc[False, 'median_height']:.2f} m, 95th percentile of slope "
        f"{by.loc[True, 'p95_slope']:.2f} in place of {by.loc[False, 'p95_slope']:.2f} "
        "(Hopper, difficulty 1)."
    )


def _flat_field(tables: Tables) -> str:
    table = tables["metronome-5.4"]
    table = table[table.robot.isin(["HalfCheetah", "Ant"])]
    by = table.groupby(["robot", "condition"])["return"].mean().unstack()
    told = "; ".join(
        f"{robot} {row['regular']:.0f} on the plane, {row['flat field']:.0f} on a flat height field"
        for robot, row in by.iterrows()
    )
    return (
        "A height field of height 0 makes several times as many contacts as a plane. The same "
        f"gaits earn in 1000 steps: {told}. Here the ground before the switch is the plane itself."
    )


def _valleys(tables: Tables) -> str:
    maps = _plain_maps(tables["terrain-5.1"], "author")
    low = maps[maps.robot == "Hopper"].groupby("difficulty").below_floor.mean()
    told = " and ".join(f"{share:.1%} at difficulty {d:g}" for d, share in low.items())
    return f"Ground that deep is {told} of the hopper's maps."


def _divergences(tables: Tables) -> str:
    table = tables["baseline-5.1"]
    return (
        f"{int((table.divergence != 0).sum())} of {len(table)} episodes of the baseline diverged."
    )


def _way_of_the_best(tables: Tables) -> str:
    tasks = tables["tasks-5.1"].set_index("robot")
    printed = published.load("table-c.1")
    told = []
    for name, task in (("Hopper", "hopper"), ("Ant", "ant")):
        best = printed[(printed.task == task) & (printed.trained_on == "flat")].value.max()
        # Forward velocity is summed over steps, so a return of R is R / rate metres.
        way = (best - 1000 * tasks.loc[name, "alive_bonus"]) / tasks.loc[name, "control_hz"]
        told.append(f"{way:.0f} m ({name})")
    return (
        f"The best printed returns on flat ground mean ways of at least {' and '.join(told)} in "
        "1000 steps, off the author's maps."
    )


def _swimmer_after_hills(tables: Tables) -> str:
    printed, switch = published.load("table-c.1"), published.load("table-c.3")
    at = {
        name: t[(t.task == "swimmer") & (t.trained_on == "hill")].value
        for name, t in (("regular", printed), ("switch", switch))
    }
    return (
        f"The printed swimmers trained on hills earn {at['regular'].min():.0f} to "
        f"{at['regular'].max():.0f} in this test and {at['switch'].min():.0f} to "
        f"{at['switch'].max():.0f} where hills come after the switch."
    )


def _heun(tables: Tables) -> str:
    table = tables["section-5.2.2-integrators"]
    error = table.groupby(["integrator", "ratio"]).error.mean().unstack()
    small, large = error.columns.min(), error.columns.max()
    return (
        f"At a step of {small:g} time constants the errors are {error.loc['euler', small]:.1%} "
        f"(Euler), {error.loc['heun', small]:.2%} (Heun) and {error.loc['midpoint', small]:.2%} "
        f"(midpoint), at {large:g} they are {error.loc['euler', large]:.0%}, "
        f"{error.loc['heun', large]:.0%} and {error.loc['midpoint', large]:.0%}."
    )


def _esn_leak(tables: Tables) -> str:
    table = tables["section-5.2.5-radius"]
    at = table[(table.spectral_radius == 1.1) & (table.noise == table.noise.max())]
    mean = at.groupby("leak").exponent.mean()
    return (
        "The leak makes the reservoir a bank of low-pass filters of two steps. With noise on every "
        f"input and a radius of 1.1 the largest exponent is {mean[0.5]:.3f} a step with the leak "
        f"and {mean[1.0]:.3f} without."
    )


def _esn_start(tables: Tables) -> str:
    table = tables["section-5.4-sizes"]
    esn = table[(table.net == "esn") & table.thesis].set_index("task").units
    return (
        f"{esn.min()} to {esn.max()} more learned numbers in the author's code, for something that "
        "a reservoir forgets; learning them needs backpropagation through the reservoir."
    )


def _previous_action(tables: Tables) -> str:
    table = tables["section-5.4-sizes"]
    own = table[(table.net == "dtrnn") & table.thesis].set_index("task")
    share = own.actions * own.units / own.learned
    return (
        f"{share.min():.0%} to {share.max():.0%} of a DTRNN's parameters read the previous action."
    )


DIFFERENCES: tuple[Difference, ...] = (
    Difference(
        "5.1-engine",
        "5.1",
        "Physics engine",
        "MuJoCo; the author's code loads version 1.31.",
        "MuJoCo 4.0, with the author's timesteps, integrators, contact softness, friction, gears "
        "and joints set on Gymnasium's models. Masses and inertias are the same.",
        "`thesis_lib.locomotion.robots`",
        "Where the author's files load in 4.0, trajectories agree to rounding. What 1.31 computed "
        "differently (its solver, contact defaults it does not state) cannot be tested any more.",
    ),
    Difference(
        "5.1-rates",
        "5.1",
        "Control rate",
        "Not stated.",
        "The author's: 40 (Swimmer), 50 (Hopper, Ant), 100 (Half-Cheetah) and 200 actions a second "
        "(Walker), which is also the step of the continuous-time networks.",
        "`ROBOTS[name].timestep`, `frame_skip`",
        "500 steps last between 2.5 and 12.5 seconds. Gymnasium's own tasks run at 20 to 125 "
        "actions a second, so returns do not compare.",
    ),
    Difference(
        "5.1-walker-friction",
        "5.1",
        "The walker's feet",
        "Not stated.",
        "Friction 0.9 on the right foot and 1.9 on the left, as in the author's model and "
        "Gymnasium's `walker2d.xml`; Gymnasium's current default has 1.9 on both.",
        "`ROBOTS['Walker2d'].xml`",
        "The walker limps a little by design.",
    ),
    Difference(
        "5.1-com",
        "5.1.1",
        "Forward velocity",
        '"Forward velocity", and "coordinates of the center of mass".',
        "Velocity and position of the whole robot's centre of mass, both at the state after the "
        "step, as in the author's code.",
        "`Task.reward`",
        "Gymnasium's tasks use the displacement of the torso, which swings about the centre of "
        "mass within a stride.",
    ),
    Difference(
        "5.1-cheetah-cost",
        "5.1.1",
        "The half-cheetah's control cost",
        "0.005 per squared action.",
        "0.05, as in the author's code and, by all we know, in Duan et al.",
        "`make_task('HalfCheetah', reading='text')` or `control_cost=`",
        _cheetah_cost,
        ("baseline-5.1",),
    ),
    Difference(
        "5.1-hopper-alive",
        "5.1.1",
        "The hopper's alive bonus",
        "0.1 instead of Duan et al.'s 1.",
        "0.1 everywhere. The author's class gives 1 unless told otherwise.",
        "`make_task('Hopper', reading='duan')` or `alive_bonus=`",
        "450 in an episode of 500 steps, for standing.",
    ),
    Difference(
        "5.1-swimmer-observation",
        "5.1.1",
        "The swimmer's observation",
        "22 entries.",
        "20 entries, as in the author's code. 22 is what a recurrent network sees, which is also "
        "fed its last action.",
        "`make_task('Swimmer', reading='text')`",
        "Two redundant entries for a recurrent network; two useful ones for a feedforward one.",
    ),
    Difference(
        "5.1-raw-observations",
        "5.1.1",
        "Scaling of observations",
        "Not stated.",
        "None, as in the author's code: every task shows the absolute x of the centre of mass, and "
        "the ant all 84 contact entries, of which the first six, the world's own, are always 0.",
        "`SensorSubset` to hide entries",
        "A test of 1000 steps leads to values of x no episode of 500 steps has shown; noise of "
        "standard deviation 1 is nothing to x and everything to an angle.",
    ),
    Difference(
        "5.1-reset",
        "5.1.1",
        "Starting states",
        "Not stated.",
        "Normal noise of standard deviation 0.01 on every position and 0.1 on every velocity, as "
        "in the author's code, also on the entries of a quaternion, which the first observation "
        "therefore shows a little off unit length.",
        "`RESET_POSITION_NOISE`, `RESET_VELOCITY_NOISE`",
        "Gymnasium's tasks start with less or more, depending on the robot.",
    ),
    Difference(
        "5.1-termination-tests",
        "5.1.1",
        "Termination in tests",
        "The limits of training; whether they hold in tests is not said.",
        "Both are offered. The author's code has a test mode that nothing in it switches on: no "
        "limit for the ant, none on the walker's height, wider ones for the hopper.",
        "`make_task(name, termination='train' | 'test' | 'never')`",
        "Heights are absolute. With training limits a walker that stands 1.25 m high ends on a "
        "hill of 0.75 m, and an ant that stands 0.55 m high on one of 0.45 m.",
    ),
    Difference(
        "5.1-divergence",
        "5.1",
        "Diverging worlds",
        "Not stated.",
        "A world whose state or action stops being a sensible number ends with reward −1000, as in "
        "the author's sampler, and a flag; the others go on.",
        "`DIVERGENCE_REWARD`, `info.diverged`",
        _divergences,
        ("baseline-5.1",),
    ),
    Difference(
        "5.1-terrain-scale",
        "5.1",
        "Size of the hills",
        "0.3 hilltops per square unit, variances from 0.1 to 0.2, height equal to the difficulty; "
        "units are not named.",
        "The author's numbers: 0.3125 hilltops per square unit, variances from 0.4 to 0.8, and a "
        "unit of 2 m (2.5 m for the half-cheetah and the ant).",
        "`hills(..., preset='text')`",
        _terrain_scale,
        ("terrain-5.1",),
    ),
    Difference(
        "5.1-terrain-envelope",
        "5.1",
        "How hills join",
        "A mixture of Gaussians.",
        "The highest of them at each place, as in the author's code, not their sum. A hill is as "
        "high as its density, so that wide hills are low.",
        "`thesis_lib.locomotion.terrain.HillLaw`",
        "With a sum, overlapping hills would tower above the others, and dividing by the highest "
        "would leave most of the ground lower.",
    ),
    Difference(
        "5.1-terrain-swimmer",
        "5.1",
        "The swimmer's hills",
        "Height equals difficulty.",
        "Half the difficulty, as in the author's code.",
        "`PRESETS['author'].height`",
        "The text's preset gives the swimmer hills of full height.",
    ),
    Difference(
        "5.1-terrain-colours",
        "5.1",
        "Hills as pictures",
        "Not stated.",
        "Heights are numbers. The author's code drew the map in a colour scale and the simulator "
        "read the red channel, which flattens valleys and steepens flanks.",
        "`hills(..., colour_map=True)`",
        _colour_map,
        ("terrain-5.1",),
    ),
    Difference(
        "5.1-terrain-valleys",
        "5.1",
        "Level of the valleys",
        "Not stated.",
        "Valleys reach 0.1 m below the flat floor (the swimmer's do not), as in the author's code, "
        "but robots start at floor level. After a switch, valleys deeper than the floor are filled "
        "to it.",
        "`hills(..., valley=)`",
        _valleys,
        ("terrain-5.1",),
    ),
    Difference(
        "5.1-terrain-patch",
        "5.1",
        "Where robots start on hills",
        "Not stated.",
        "On a flat square of 4 m centred under the robot, blended into the hills no more steeply "
        "than a hill. The author's code clears a box beside the robot.",
        "`hills(..., flat_patch='author')`",
        _start_patch,
        ("starts-5.1",),
    ),
    Difference(
        "5.1-terrain-extent",
        "5.1",
        "Size of the map",
        "Not stated.",
        "As far as 1000 steps can lead, 60 to 120 m ahead; the author's maps end 40 or 50 m ahead "
        "of the start. A robot that leaves its map ends its episode with a flag.",
        "`hills(..., extent='author')`, `info.off_map`",
        _way_of_the_best,
        ("tasks-5.1",),
    ),
    Difference(
        "5.1-terrain-switch",
        "5.4",
        "Where the terrain switches",
        "At a task-dependent position.",
        "At 2 m for the swimmer and the walker and at 5 m for the others: about a tenth of the way "
        "of a good controller, as the noise begins after a tenth of the steps, but never under the "
        "robot. The published code has no switch.",
        "`TerrainSwitch(switch_at=)`, `SWITCH_AT`",
        "Returns under the switch scale with the way before it; compare them between controllers, "
        "not with the printed ones.",
    ),
    Difference(
        "5.1-flat-field",
        "5.4",
        "Flat ground in a switch test",
        "Not stated.",
        "The flat task's own plane, through which the hills rise after the switch.",
        "`TerrainSwitch`; `hills(0.0, ...)` is the flat height field",
        _flat_field,
        ("metronome-5.4",),
    ),
    Difference(
        "5.1-terrain-maps",
        "5.4",
        "Maps seen in training",
        "Not stated for training; the same 20 random terrains for every network in tests.",
        "One fixed map a run for every network by default, decided by the run's seed, as the "
        "author's sampler gave all but the LSTM; any number of maps can be asked for. Tests: world "
        "i gets map i of a seed that is part of the test.",
        "`BatchTask(terrain=)`, `hill_maps(n, ...)`, `TerrainSwitch(seed=)`",
        "A network may learn one map by heart; absolute x is among its inputs.",
    ),
    Difference(
        "5.1-noise",
        "5.4",
        "What noise falls on",
        "All sensors, from step 100 on.",
        "What the policy sees from the observation of step 100 on, in each sensor's own unit. "
        "Rewards, termination and the fed-back action stay true. The published code has a noise "
        "wrapper without a starting step.",
        "`WhiteNoise(sigma=1.0, onset=100)`",
        "One number means very different things to different sensors; the chapter measures it.",
    ),
    Difference(
        "5.2-previous-action",
        "5.2",
        "The previous action as an input",
        "Not stated.",
        "Recurrent networks also see the action they took last, before clipping (the mean when "
        "greedy), as all of the author's recurrent policies do by default and Duan et al.'s did; "
        "feedforward ones do not.",
        "`make_policy(..., previous_action=)`",
        _previous_action,
        ("section-5.4-sizes",),
    ),
    Difference(
        "5.2-bias",
        "5.2.1",
        "Biases",
        "None in equation 5.1; section 2.4 counts a constant 1 among the inputs.",
        "Every affine map of an input has a bias that starts at 0, except the reservoir's, as in "
        "the author's code.",
        "`DTRNN(bias=)`",
        "Without a bias a network of tanh units answers the negative input with the negative "
        "action.",
    ),
    Difference(
        "5.2-initial-state",
        "5.2",
        "The state before the first step",
        "Not stated.",
        "Learned for DTRNN and CTRNN, where it starts at 0; 0 for LSTM, GRU and ESN. The author's "
        "code learns the ESN's as well.",
        "`make_policy(..., trainable_initial_state=)`",
        _esn_start,
        ("section-5.4-sizes",),
    ),
    Difference(
        "5.2.2-midpoint",
        "5.2.2",
        "The midpoint method",
        "An Euler or midpoint approximation; results are those of the midpoint.",
        "Heun's method by default, which is what the author's midpoint class computes: the mean of "
        "two Euler slopes. The true midpoint and Euler are options.",
        "`CTRNN(integrator='heun' | 'midpoint' | 'euler')`",
        _heun,
        ("section-5.2.2-integrators",),
    ),
    Difference(
        "5.2.3-candidate",
        "5.2.3",
        "Transfer function of the LSTM's cell",
        "Logistic, as for the gates.",
        "tanh, as in the author's code, with a constant 1 added in the forget gate and orthogonal "
        "recurrent weights of gain 1.1.",
        "`LSTM(candidate='tanh' | 'logistic', forget_bias=, initialisation=)`",
        "A logistic candidate is never negative, so that a cell could only be filled by its input "
        "and emptied by forgetting.",
    ),
    Difference(
        "5.2.5-leak",
        "5.2.5",
        "The reservoir's leak",
        "The same architecture as the vanilla network.",
        "A leak of 0.5, as in the author's code: the new state is the mean of the old one and "
        "tanh(...).",
        "`ESN(leak=)`",
        _esn_leak,
        ("section-5.2.5-radius",),
    ),
    Difference(
        "5.4-other-step-sizes",
        "Table 5.1",
        "Step sizes of FFWD, DFFWD and LSTM",
        "Those of Duan et al., which are not printed.",
        "0.1 for the swimmer, which Duan et al. state for their feedforward network; 0.05 on the "
        "other tasks, a value that scripts of their group use. Their supplement, which lists the "
        "rest, was not at hand.",
        "`TrainConfig(delta_kl=)`",
        "Unknown: the thesis's values for the other networks range from 0.02 to 0.5.",
    ),
    Difference(
        "5.1-regular-test",
        "5.4",
        "The regular test of controllers trained on hills",
        "Section 5.4: the task they were trained on; captions of Tables 5.3 and C.1: flat terrain.",
        "Flat terrain, which fits the printed returns.",
        "`BatchTask(terrain=None)`",
        _swimmer_after_hills,
    ),
)
