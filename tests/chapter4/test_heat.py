"""The heat domain's experiments: the feature space by hand, and the protocol of section 4.3."""

from dataclasses import fields, is_dataclass, replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from thesis_lib.chapter4 import (
    figure_4_7,
    figure_4_8,
    heat_drawings,
    heat_readings,
    heat_relevance,
    heat_runs,
)
from thesis_lib.chapter4.heat_space import HeatLearner, HeatSpace
from thesis_lib.chapter4.protocol import Protocol
from thesis_lib.domains.heat import HeatTask
from thesis_lib.domains.heat_learning import HeatLearned, sarsa_lambda
from thesis_lib.edition.experiment import Context
from thesis_lib.edition.ledger import Verdict
from thesis_lib.relevance import keep

CONTEXT = Context(seed=1)
SHORT = HeatSpace(learner=HeatLearner(episodes=15))
TINY = heat_runs.Config(
    space=SHORT,
    sensors=(0.02,),
    protocol=Protocol(runs=3, tests=2, tasks_seen=(3, 5)),
    first=2,
    followed=4,
    followed_at=(5,),
)


def cross_task_weights(learned, coding, keep=None):
    """Equation 3.5 feature by feature, for features that agree on the variables kept."""
    names = (*coding.names, "a") if keep is None else keep
    clusters = coding.clusters([name for name in names if name != "a"])
    weighted, total = {}, {}
    cells = [(f, a) for f in range(coding.n_features) for a in range(4)]
    group = {(f, a): (clusters[f], a if "a" in names else -1) for f, a in cells}
    for one in learned:
        for f, a in zip(*np.nonzero(one.visits), strict=True):
            p = one.visits[f, a] / one.visits.sum()
            key = group[f, a]
            weighted[key] = weighted.get(key, 0.0) + p * one.weights[f, a]
            total[key] = total.get(key, 0.0) + p
    means = [weighted[k] / total[k] if (k := group[cell]) in total else 0.0 for cell in cells]
    return np.reshape(means, (coding.n_features, 4))


@pytest.fixture(scope="module")
def learned():
    rng = np.random.default_rng(4)
    return [SHORT.learn(task, rng) for task in SHORT.sample_tasks(4, rng)]


class TestFeatureSpace:
    def test_the_printed_number_of_features(self):
        assert HeatSpace().coding.n_features == 1664
        assert HeatSpace(layout="positions").coding.n_features == 1664

    def test_pairs_are_the_weights_and_shares_of_visits(self, learned):
        solutions = SHORT.solutions(learned)
        assert solutions.q.shape == (4, 1664 * 4)
        assert solutions.feature_names == ("x", "y", "heading", "heat", "a")
        one, pair = learned[2], 4 * 700 + 3
        assert solutions.p[2, pair] == one.visits[700, 3] / one.visits.sum()
        seen = one.visits.ravel() > 0
        assert np.array_equal(~np.isnan(solutions.q[2]), seen)
        assert np.array_equal(solutions.q[2, seen], one.weights.ravel()[seen])

    def test_uniform_weighting_counts_each_visited_pair_once(self, learned):
        solutions = replace(SHORT, weighting="uniform").solutions(learned)
        n_seen = (learned[0].visits > 0).sum()
        assert set(np.unique(solutions.p[0])) == {0.0, 1 / n_seen}

    @pytest.mark.parametrize("names", [("heat", "a"), ("heading",), ("x", "y", "heat")])
    def test_abstractions_never_merge_tilings(self, learned, names):
        labels = keep(SHORT.solutions(learned), names)
        tiling = np.repeat(SHORT.coding.places[:, 0], 4)
        assert all(len(set(tiling[labels == y])) == 1 for y in np.unique(labels))
        # The abstraction of the domain's own module, made in another way.
        variables = SHORT.coding.clusters([n for n in names if n != "a"])
        action = np.arange(4) if "a" in names else np.zeros(4, int)
        other = (variables[:, None] * 4 + action).ravel()
        pairs = set(zip(labels.tolist(), other.tolist(), strict=True))
        assert len(pairs) == labels.max() + 1 == len(set(other.tolist()))

    def test_the_tiling_can_be_a_feature(self, learned):
        space = replace(SHORT, tilings="feature")
        solutions = space.solutions(learned)
        assert solutions.feature_names[0] == "tiling"
        merged = keep(solutions, ("heat", "a"))
        assert len(set(np.repeat(space.coding.places[:, 0], 4)[merged == merged[0]])) == 4

    @pytest.mark.parametrize("names", [("x", "y", "heading", "heat", "a"), ("heat", "a"), ("x",)])
    def test_potential_is_equation_35_in_feature_space(self, learned, names):
        # Against the domain's own function, which its tests check by hand.
        solutions = SHORT.solutions(learned)
        phi = SHORT.potential(solutions, solutions.mask(names))
        np.testing.assert_allclose(
            phi, cross_task_weights(learned, SHORT.coding, keep=names), atol=1e-12
        )

    def test_constant_potential_by_hand(self, learned):
        solutions = SHORT.solutions(learned)
        phi = SHORT.potential(solutions, np.zeros(5, dtype=bool))
        mean = np.mean([(s.weights * s.visits).sum() / s.visits.sum() for s in learned])
        np.testing.assert_allclose(phi, mean)

    def test_potential_by_hand(self):
        # One pair visited once of four times in task 1 and three of six times in task 2.
        def task(weight, visits, total):
            w, n = np.zeros((1664, 4)), np.zeros((1664, 4), dtype=int)
            w[5, 1], n[5, 1], n[9, 0] = weight, visits, total - visits
            empty = np.zeros(0)
            return HeatLearned(w, n, empty, empty.astype(int), empty.astype(bool))

        pair = [task(8.0, 1, 4), task(2.0, 3, 6)]
        everything = np.ones(5, dtype=bool)
        phi = SHORT.potential(SHORT.solutions(pair), everything)
        assert phi[5, 1] == pytest.approx((0.25 * 8 + 0.5 * 2) / 0.75)
        uniform = replace(SHORT, weighting="uniform", unseen=-3.0)
        phi = uniform.potential(uniform.solutions(pair), everything)
        assert phi[5, 1] == pytest.approx((0.5 * 8 + 0.5 * 2) / 1)
        assert phi[0, 0] == -3.0

    def test_the_learner_is_the_domains(self):
        task = SHORT.sample_tasks(1, np.random.default_rng(0))[0]
        options = {"epsilon": 0.05, "trace_decay": 0.9, "alpha": 0.3}
        expected = sarsa_lambda(task, rng=3, episodes=15, **options)
        np.testing.assert_array_equal(SHORT.learn(task, 3).weights, expected.weights)
        assert HeatLearner().episodes == 500

    def test_sources_can_be_kept_off_the_walls(self):
        inside = replace(SHORT, sources="inside")
        sources = np.array([t.source for t in inside.sample_tasks(200, np.random.default_rng(0))])
        assert sources.min() >= 1
        assert sources.max() <= 9
        # Uniform on [1, 9]^2: standard error 8/sqrt(12 * 200) = .16.
        np.testing.assert_allclose(sources.mean(axis=0), [5, 5], atol=0.65)

    def test_bad_options_are_one_sentence(self):
        with pytest.raises(ValueError, match="layout 'hexagons' does not exist"):
            HeatSpace(layout="hexagons")
        with pytest.raises(ValueError, match="weighting 'none' does not exist"):
            HeatSpace(weighting="none")


@pytest.fixture(scope="module")
def runs():
    return heat_runs.measure_heat(TINY, SHORT.with_noise(0.02), CONTEXT, test=True)


class TestProtocol:
    def at(self, method):
        return TINY.protocol.methods.index(method)

    def test_episodes_are_followed_where_asked(self, runs):
        assert runs.returns.shape == (3, 2, 7, 4)
        assert np.isnan(runs.returns[:, 0, :, 2:]).all()
        assert np.isfinite(runs.returns[:, 1]).all()

    def test_first_episodes_do_not_depend_on_how_many_follow(self, runs):
        without = heat_runs.measure_heat(
            replace(TINY, followed=0), SHORT.with_noise(0.02), CONTEXT, test=True
        )
        np.testing.assert_array_equal(without.returns, runs.returns[..., :2])

    def test_fs_tek_removes_nothing_after_three_tasks(self, runs):
        # Three points leave no residual: it is unsure, but of a curve that rises.
        assert runs.support[:, 0, self.at("fs-tek")].all()
        assert (runs.unsure[:, 0, self.at("fs-tek")] > 0).all()
        np.testing.assert_array_equal(
            runs.returns[:, 0, self.at("fs-tek"), :2], runs.returns[:, 0, self.at("none"), :2]
        )

    def test_fixed_keeps_the_relevant_and_constant_nothing(self, runs):
        assert runs.support[:, :, self.at("fixed")].tolist() == [[[0, 0, 0, 1, 1]] * 2] * 3
        assert not runs.support[:, :, self.at("constant")].any()

    def test_returns_are_negative_and_whole_numbers_of_steps_a_test(self, runs):
        steps = runs.returns[:, :, :, :2] * TINY.protocol.tests / SHORT.world.step_reward
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-8)
        assert (steps >= TINY.protocol.tests).all()

    def test_one_run_step_by_step(self, runs):
        """The protocol written out once more for one run, without selection, after 3 tasks."""
        space = SHORT.with_noise(0.02)
        seed = CONTEXT.seeds(3, 4, 20)[1]
        rng, lessons, _ = (np.random.default_rng(s) for s in seed.spawn(3))
        tasks = [HeatTask(space.world.sample_source(rng), space.world) for _ in range(5)]
        solved = [sarsa_lambda(task, rng=lessons, episodes=15) for task in tasks]
        phi = cross_task_weights(solved[:3], space.coding)
        tests = [HeatTask(space.world.sample_source(rng), space.world) for _ in range(2)]
        draws = rng.integers(2**63, size=2)
        got = [
            sarsa_lambda(task, rng=int(draw), episodes=2, initial_weights=phi).episode_returns
            for task, draw in zip(tests, draws, strict=True)
        ]
        np.testing.assert_allclose(runs.returns[1, 0, self.at("none"), :2], np.mean(got, axis=0))

    def test_places_are_the_same_whether_they_were_tested_before_or_not(self, runs, monkeypatch):
        def chosen():
            return heat_runs.measure_heat(TINY, SHORT.with_noise(0.02), CONTEXT, test=False)

        monkeypatch.setattr(heat_runs, "_TESTED", {})
        afresh = chosen()
        assert heat_runs._TESTED == {}
        monkeypatch.setattr(HeatSpace, "learn", None)
        with pytest.raises(TypeError):
            chosen()
        key = repr((TINY, SHORT.with_noise(0.02), CONTEXT.seed))
        heat_runs._TESTED[key] = runs
        kept = chosen()
        for one in (afresh, kept):
            np.testing.assert_array_equal(one.support, runs.support)
            np.testing.assert_array_equal(one.unsure, runs.unsure)
            assert one.returns.shape == runs.returns.shape
            assert np.isnan(one.returns).all()

    def test_observed_tasks_can_be_learned_with_the_potential_so_far(self):
        tasks = SHORT.sample_tasks(3, np.random.default_rng(2))
        shaped = heat_runs.learn_in_turn(SHORT, tasks, np.random.default_rng(5), "shaped")
        rng = np.random.default_rng(5)
        one = SHORT.learn(tasks[0], rng)
        two = SHORT.learn(tasks[1], rng, initial_weights=cross_task_weights([one], SHORT.coding))
        start = cross_task_weights([one, two], SHORT.coding)
        three = SHORT.learn(tasks[2], rng, initial_weights=start)
        np.testing.assert_allclose(shaped[2].weights, three.weights)
        with pytest.raises(ValueError, match="lessons 'none' does not exist"):
            heat_runs.learn_in_turn(SHORT, tasks, rng, "none")

    def test_levels_of_noise_share_their_tasks(self):
        drawn = []

        class Recording(HeatSpace):
            def sample_tasks(self, n, rng):
                tasks = super().sample_tasks(n, rng)
                drawn.append((self.world.sensor, [task.source for task in tasks]))
                return tasks

        space = Recording(learner=SHORT.learner)
        for sensor in (0.01, 0.06):
            heat_runs.measure_heat(TINY, space.with_noise(sensor), CONTEXT, test=False)
        low, high = ([t for s, t in drawn if s == level] for level in (0.01, 0.06))
        assert low == high
        # Each run: the observed tasks, then fresh test tasks for each of two numbers.
        assert [len(t) for t in low] == [5, 2, 2] * 3

    def test_figure_4_7_is_the_runs_told(self, runs):
        table = figure_4_7.by_episodes.function(TINY, CONTEXT)
        own = table[(table.method == "none") & (table.panel == "first episodes")]
        assert (own.last_episode == 2).all()
        first = runs.returns[..., :2].sum(axis=-1)
        gap = first[..., self.at("fs-tek")] - first[..., self.at("none")]
        np.testing.assert_allclose(own.fstek_minus, gap.mean(axis=0))
        np.testing.assert_allclose(own.mean_return, first[..., self.at("none")].mean(axis=0))
        fixed = table[table.method == "fixed"].set_index(["panel", "first_episode"]).mean_return
        own = runs.returns[:, 1, self.at("fixed")]
        assert fixed["all followed", 1].item() == pytest.approx(own.sum(axis=1).mean())
        assert fixed["by episode", 3].item() == pytest.approx(own[:, 2].mean())
        assert set(table.tasks_seen[table.panel != "first episodes"]) == {5}

    @pytest.mark.parametrize("last", [3, 5, 100])
    def test_blocks_of_episodes_widen_and_leave_none_out(self, last):
        spans = figure_4_7.blocks(last)
        assert [e for a, b in spans for e in range(a, b + 1)] == list(range(1, last + 1))
        lengths = [b - a for a, b in spans]
        assert lengths == sorted(lengths)

    def test_figure_4_8_has_the_rates_of_figure_4_7(self):
        rates = figure_4_8.places.function(TINY, CONTEXT).set_index(["method", "tasks_seen"])
        table = figure_4_7.by_episodes.function(TINY, CONTEXT).query("panel == 'first episodes'")
        table = table.set_index(["method", "tasks_seen"])
        assert (rates.fpr == table.fpr[rates.index]).all()
        assert (rates.tpr == table.tpr[rates.index]).all()
        shares = rates[["keeps_x", "keeps_y", "keeps_heading"]].mean(axis=1)
        np.testing.assert_allclose(rates.fpr, shares)

    def test_the_thesis_budget_is_the_thesiss(self):
        config = figure_4_7.by_episodes.config("thesis")
        assert (config.protocol.runs, config.protocol.tests) == (500, 10)
        assert min(config.protocol.tasks_seen) == 3
        assert config.sensors == (0.01, 0.02, 0.04, 0.06)
        assert config.first == 5
        assert config.space.world.slip == 0.1
        learner = config.space.learner
        assert (learner.episodes, learner.trace_decay, learner.epsilon) == (500, 0.9, 0.05)
        assert figure_4_8.places.config("thesis") == config


class TestRelevance:
    def test_more_removed_is_more_lost(self, smoke):
        table = smoke["ch4-heat-relevance"].set_index("removed")
        assert table.share["all"] == pytest.approx(1)
        assert table.task_share["all"] == pytest.approx(1)
        nested = ["x", "x, y", "x, y, heading", "x, y, heading, a", "all"]
        assert table.task_relevance[nested].is_monotonic_increasing

    def test_estimates_find_a_planted_feature(self):
        # Weights that depend on the heat alone, the same in every task, plus noise of its own.
        rng = np.random.default_rng(0)
        heat_tile = SHORT.coding.places[:, 4]
        visits = np.full((1664, 4), 3)
        empty = np.zeros(0)

        def task():
            w = heat_tile[:, None] + rng.normal(size=(1664, 4))
            return HeatLearned(w, visits, empty, empty.astype(int), empty.astype(bool))

        solutions = SHORT.solutions([task() for _ in range(30)])
        # 13 equally frequent tiles have variance (13^2 - 1)/12 = 14; 6656 noises average out.
        assert heat_relevance.estimates(solutions, ("heat",))[1] == pytest.approx(14, rel=0.02)
        for name in ("x", "heading", "a"):
            one, limit = heat_relevance.estimates(solutions, (name,))
            assert one > 0.3
            assert abs(limit) < 0.03


def options(value, path=""):
    """Leaves of a nested dataclass."""
    if not is_dataclass(value):
        return {path: value}
    out = {}
    for f in fields(value):
        out |= options(getattr(value, f.name), f"{path}.{f.name}")
    return out


@pytest.mark.parametrize("reading", list(heat_readings.READINGS))
def test_a_reading_changes_what_it_names_and_nothing_else(reading):
    base = heat_readings.Config().base
    before, after = options(base), options(heat_readings.changed(base, reading))
    differ = [name for name in before if before[name] != after[name]]
    assert len(differ) == {"as used": 0, "accumulating traces": 2}.get(reading, 1)


# Claims.


def gains(by, ci=1.0, none=-100.0, **extra):
    """A table of figure 4.7 with given gains of FS-TEK over no selection, {(sensor, n): gain}."""
    rows = []
    for (sensor, n), gain in by.items():
        for method in ("none", "fs-tek", "fixed", "jackknife"):
            own = gain if method == "fs-tek" else 0.0
            row = {"sensor": sensor, "tasks_seen": n, "method": method, "n_runs": 9, **extra}
            row |= {"mean_return": none + own, "fstek_minus": gain - own, "none_minus": -own}
            rows.append(row)
    return pd.DataFrame(rows).assign(fstek_minus_ci95=ci, none_minus_ci95=ci)


def first_five(by, **options):
    options = {"first_episode": 1, "last_episode": 5, "panel": "first episodes"} | options
    return gains(by, **options)


EVERY = {(s, n): g for s, g in ((0.01, 5), (0.02, 20), (0.04, 9), (0.06, 8)) for n in (4, 5, 6)}


def test_verdicts_on_hand_made_tables():
    held = first_five(EVERY | {(s, 12): 0.5 for s in (0.01, 0.02, 0.04, 0.06)})
    for judge in (
        figure_4_7.jumps,
        figure_4_7.grows_with_noise,
        figure_4_7.peaks,
        figure_4_7.on_a_par,
    ):
        assert judge(held).verdict == Verdict.REPRODUCED, judge.subject
    assert figure_4_7.helps_most_when_few(held).verdict == Verdict.REPRODUCED
    opposite = first_five({(s, n): -g for (s, n), g in EVERY.items()} | {(0.01, 12): 30})
    assert figure_4_7.jumps(opposite).verdict == Verdict.NOT_REPRODUCED
    assert figure_4_7.grows_with_noise(opposite).verdict == Verdict.REFUTED
    assert figure_4_7.peaks(opposite).verdict == Verdict.REFUTED
    assert figure_4_7.on_a_par(opposite).verdict == Verdict.REFUTED
    assert figure_4_7.helps_most_when_few(opposite).verdict == Verdict.REFUTED
    wide = first_five(EVERY, ci=50.0)
    assert figure_4_7.jumps(wide).verdict == Verdict.INCONCLUSIVE
    assert figure_4_7.grows_with_noise(wide).verdict == Verdict.INCONCLUSIVE
    rising = first_five({(s, n): 100 * s for s in (0.01, 0.02, 0.04, 0.06) for n in (4, 5)}, ci=2)
    assert figure_4_7.grows_with_noise(rising).verdict == Verdict.DIRECTION
    assert figure_4_7.on_a_par(wide).verdict == Verdict.INCONCLUSIVE


def by_all_episodes(rng, ci=1.0):
    """Gains of both panels and of the total that are noise alone."""
    sensors, seen = (0.01, 0.02, 0.04, 0.06), (4, 5, 6, 8, 10, 12)

    def draw(keys, ci):
        return {key: ci / 1.96 * rng.standard_normal() for key in keys}

    keys = [(s, n) for s in sensors for n in seen]
    parts = [first_five(draw(keys, ci), ci=ci)]
    spans = [("by episode", *block) for block in figure_4_7.blocks(100)]
    for panel, first, last in [("all followed", 1, 100), *spans]:
        length = last - first + 1
        by = draw([(0.02, n) for n in seen], ci * length)
        span = {"first_episode": first, "last_episode": last, "panel": panel}
        parts.append(gains(by, ci * length, -100.0 * length, **span))
    return pd.concat(parts)


@pytest.fixture(scope="module")
def noises():
    rng = np.random.default_rng(0)
    return [by_all_episodes(rng) for _ in range(40)]


@pytest.mark.parametrize(
    "judge",
    [
        *(figure_4_7.jumps, figure_4_7.grows_with_noise, figure_4_7.peaks, figure_4_7.dips),
        *(figure_4_7.pays_in_the_end, figure_4_7.is_overcome, figure_4_7.helps_most_when_few),
    ],
    ids=lambda judge: judge.subject,
)
def test_noise_shows_nothing_on_the_heat_domain(judge, noises):
    """Nor does the choice of the best of six numbers of tasks at four levels of noise."""
    found = [judge(table).verdict for table in noises]
    assert found.count(Verdict.REPRODUCED) <= 4
    assert found.count(Verdict.REFUTED) <= 6


def test_the_largest_gain_is_corrected_for_the_choice():
    """A difference of two gains ± 1 is at most ± 2, and ± 2.63 for the choice among five others."""
    every = {(s, n): 0.0 for s in (0.01, 0.02) for n in (5, 6, 8, 10, 12)}
    hardly = first_five(every | {(s, 4): 2.6 for s in (0.01, 0.02)})
    assert figure_4_7.helps_most_when_few(hardly).verdict == Verdict.DIRECTION
    surely = first_five(every | {(s, 4): 2.7 for s in (0.01, 0.02)})
    assert figure_4_7.helps_most_when_few(surely).verdict == Verdict.REPRODUCED
    # Of three numbers above six at two levels it is norm.isf(.025 / 6) / norm.isf(.025) = 1.346
    # times as wide: ± 2.69.
    for late, verdict in ((2.6, Verdict.INCONCLUSIVE), (2.8, Verdict.REFUTED)):
        rising = first_five(every | {(0.01, 4): 0.0, (0.02, 4): 0.0, (0.02, 12): late})
        assert figure_4_7.helps_most_when_few(rising).verdict == verdict
    one = first_five(every | {(0.02, n): g for n, g in ((4, 0.0), (12, 8.5))})
    assert figure_4_7.on_a_par(one).verdict == Verdict.REPRODUCED
    far = first_five(every | {(0.02, 4): 0.0, (0.02, 12): 11.5})
    assert figure_4_7.on_a_par(far).verdict == Verdict.REFUTED  # 11.5 ± 1.3 of 100
    maybe = first_five(every | {(0.02, 4): 0.0, (0.02, 12): 11.1})
    assert figure_4_7.on_a_par(maybe).verdict == Verdict.INCONCLUSIVE


def test_a_constant_that_earns_as_much_is_no_sign_of_the_features_kept():
    less = first_five(EVERY).assign(method="constant")
    assert figure_4_7.constant_earns_less(less).verdict == Verdict.REPRODUCED
    alike = less.assign(fstek_minus=0.5)
    assert figure_4_7.constant_earns_less(alike).verdict == Verdict.INCONCLUSIVE
    more = less.assign(fstek_minus=-less.fstek_minus)
    assert figure_4_7.constant_earns_less(more).verdict == Verdict.REFUTED


def test_the_dip_is_a_significant_loss_after_many_tasks():
    def table(gain):
        """Gains of blocks, given the gain of each episode."""
        parts = []
        for first, last in figure_4_7.blocks(100):
            by = {(0.02, n): sum(gain(n, e) for e in range(first, last + 1)) for n in (4, 12)}
            ci, none = 0.5 * (last - first + 1), -100.0 * (last - first + 1)
            parts.append(
                gains(by, ci, none, first_episode=first, last_episode=last, panel="by episode")
            )
        total = {(0.02, n): sum(gain(n, e) for e in range(1, 101)) for n in (4, 12)}
        parts.append(gains(total, first_episode=1, last_episode=100, panel="all followed"))
        return pd.concat(parts)

    late = table(lambda n, e: 6.0 if n == 4 else (-3.0 if e < 50 else 0.0))
    assert figure_4_7.dips(late).verdict == Verdict.REPRODUCED
    assert figure_4_7.is_overcome(late).verdict == Verdict.REPRODUCED
    never = table(lambda n, e: 6.0 if n == 4 else -6.0)
    assert figure_4_7.is_overcome(never).verdict == Verdict.REFUTED  # still 6 of 100 behind
    slowly = table(lambda n, e: 6.0 if n == 4 else -4.8)
    assert figure_4_7.is_overcome(slowly).verdict == Verdict.INCONCLUSIVE  # 4.8 ± .5 of 100
    always = table(lambda n, e: -3.0)
    assert figure_4_7.dips(always).verdict == Verdict.DIRECTION  # but no more with more tasks
    soon = table(lambda n, e: -2.0 if n == 4 else 0.2)
    assert figure_4_7.dips(soon).verdict == Verdict.DIRECTION
    # Of two numbers of tasks .5 is widened to .57.
    hardly = table(lambda n, e: -0.55 if n == 4 else 0.0)
    assert figure_4_7.dips(hardly).verdict == Verdict.INCONCLUSIVE
    assert "-2.0 ± 0.5 after 4 and +0.2 ± 0.5 after 12" in figure_4_7.dips(soon).evidence
    none = table(lambda n, e: 0.1)
    assert figure_4_7.dips(none).verdict == Verdict.INCONCLUSIVE
    assert figure_4_7.is_overcome(none).verdict == Verdict.INCONCLUSIVE  # there is no bias
    assert figure_4_7.dips(table(lambda n, e: 1.0)).verdict == Verdict.NOT_REPRODUCED
    # Totals after 4 and 12 tasks: 600 and -147, -200 and 20, 10 and 10.
    assert figure_4_7.pays_in_the_end(late).verdict == Verdict.DIRECTION
    assert (
        "FS-TEK +600 ± 1 after 4 and -147 ± 1 after 12" in figure_4_7.pays_in_the_end(late).evidence
    )
    assert figure_4_7.pays_in_the_end(soon).verdict == Verdict.DIRECTION
    assert figure_4_7.pays_in_the_end(none).verdict == Verdict.REPRODUCED


def test_the_false_positive_rate_is_judged_between_the_ends():
    def table(first, last):
        rows = [(0.01, first), (0.06, last)]
        keeps = ("keeps_x", "keeps_y", "keeps_heading")
        return pd.DataFrame(
            [
                {"method": "fs-tek", "tasks_seen": 5, "sensor": sensor, "fpr": rate}
                | {"fpr_ci95": 0.05}
                | dict.fromkeys(keeps, rate)
                for sensor, rate in rows
            ]
        )

    assert figure_4_8.false_positives(table(0.2, 0.4)).verdict == Verdict.REPRODUCED
    assert figure_4_8.false_positives(table(0.4, 0.2)).verdict == Verdict.REFUTED
    assert figure_4_8.false_positives(table(0.30, 0.31)).verdict == Verdict.INCONCLUSIVE


def test_exact_claims():
    assert heat_relevance.reward().verdict == Verdict.REPRODUCED
    assert heat_relevance.number_of_features().verdict == Verdict.REPRODUCED


def test_another_area_and_other_tiles_turn_them(monkeypatch):
    tiles = SimpleNamespace(tilings=4, tiles=(4, 4, 4, 4), n_features=1024)
    world = SimpleNamespace(step_reward=-1.0, coding=lambda intervals: tiles)
    monkeypatch.setattr(heat_relevance, "HeatWorld", lambda: world)
    assert heat_relevance.reward().verdict == Verdict.REFUTED
    assert heat_relevance.number_of_features().verdict == Verdict.REFUTED


# Figures.


def test_figures_draw_at_smoke(smoke):
    seven, eight = smoke["figure-4.7"], smoke["figure-4.8"]
    task = SHORT.sample_tasks(1, np.random.default_rng(0))[0]
    states = np.array([[3.0, 3.0, 0.1], [3.5, 3.0, 0.1]])
    phi = np.zeros((1664, 4))
    sources = [(2.0, 3.0), (5.0, 5.0)]
    drawn = [
        heat_drawings.walk(task, states, [30, 20, 10]),
        figure_4_7.figure(seven),
        figure_4_7.methods_figure(seven),
        figure_4_7.episodes_figure(seven, ("fixed", "jackknife")),
        heat_drawings.potentials(SHORT, (phi, phi - 1), ("one", "other"), task, sources),
    ]
    assert all(isinstance(fig, Figure) for fig in drawn)
    # Clockwise from the top left: the second level of noise is at the top right.
    titles = [ax.get_title() for ax in figure_4_8.figure(eight).axes[:2]]
    assert "0.02" in titles[0]
    assert "0.06" in titles[1]
