"""The heat domain: its dynamics by hand, its learner against a plain transcription."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import thesis_lib.domains  # noqa: F401  (registers the environment)
from thesis_lib.domains.heat import HeatTask, HeatWorld, distance_to, move, place, sense
from thesis_lib.domains.heat_environment import HeatEnv
from thesis_lib.domains.heat_learning import TRACE_CUT_OFF, HeatLearned, sarsa_lambda
from thesis_lib.domains.tiles import TileCoding

STILL = HeatWorld(slip=0.0, sensor=0.0)


def moved(state, action, world=STILL, seed=0):
    new = np.array(state, dtype=float)
    move(np.random.default_rng(seed), world.parameters, new, action)
    return new


class TestDynamics:
    def test_the_reward_of_a_step(self):
        assert STILL.step_reward == pytest.approx(-0.71, abs=0.005)

    def test_forward_and_backward_follow_the_heading(self):
        np.testing.assert_allclose(moved([5, 5, 0], 0), [5.5, 5, 0])
        np.testing.assert_allclose(moved([5, 5, np.pi / 2], 0), [5, 5.5, np.pi / 2])
        np.testing.assert_allclose(moved([5, 5, 0], 1), [4.5, 5, 0])

    def test_turns_wrap(self):
        np.testing.assert_allclose(moved([5, 5, 0], 2), [5, 5, np.pi / 8])
        np.testing.assert_allclose(moved([5, 5, 0], 3), [5, 5, 2 * np.pi - np.pi / 8])

    def test_the_robot_stays_a_radius_from_the_walls_and_slides_along_them(self):
        np.testing.assert_allclose(moved([8.9, 5, 0], 0), [9, 5, 0])
        side = np.sqrt(0.5) / 2
        np.testing.assert_allclose(moved([9, 5, np.pi / 4], 0), [9, 5 + side, np.pi / 4])

    def test_slip_is_normal_noise_on_how_far_an_action_goes(self):
        world = HeatWorld(slip=0.1)
        far = np.array([moved([5, 5, 0], 0, world, seed)[0] - 5 for seed in range(2000)])
        turned = np.array([moved([5, 5, 1], 3, world, seed)[2] - 1 for seed in range(2000)])
        # Standard errors: .1/sqrt(2000) = .0022 of the mean, .0016 of the deviation.
        assert far.mean() == pytest.approx(0.5, abs=0.01)
        assert far.std() == pytest.approx(0.1, abs=0.008)
        assert turned.mean() == pytest.approx(-np.pi / 8, abs=0.01)

    def test_heat_laws(self):
        d = np.array([0.5, 1.0, 2.0, 4.0])
        np.testing.assert_allclose(
            HeatWorld(intensity="inverse_square").heat(d), [1, 1, 1 / 4, 1 / 16]
        )
        np.testing.assert_allclose(HeatWorld(intensity="exponential").heat(d), np.exp(-d / 3))
        np.testing.assert_allclose(
            HeatWorld(intensity="linear").heat(d), 1 - d / np.sqrt(200), rtol=1e-12
        )

    def read(self, world, n=3000):
        state, source, out = np.array([4.0, 5.0, 3.0]), np.array([7.0, 5.0]), np.empty((n, 4))
        rng = np.random.default_rng(2)
        for row in out:
            sense(rng, world.parameters, source, state, row)
        return out

    def test_sensors_without_noise(self):
        np.testing.assert_allclose(self.read(STILL, 1)[0], [4, 5, 3, 1 / 9])

    def test_sensor_noise_is_the_same_for_all_sensors_or_scaled_by_their_ranges(self):
        raw = self.read(HeatWorld(sensor=0.02))
        np.testing.assert_allclose(raw.mean(axis=0), [4, 5, 3, 1 / 9], atol=0.002)
        np.testing.assert_allclose(raw.std(axis=0), [0.02] * 4, rtol=0.07)
        scaled = self.read(HeatWorld(sensor=0.02, noise_scale="range"))
        np.testing.assert_allclose(
            scaled.std(axis=0), [0.2, 0.2, 0.02 * 2 * np.pi, 0.02], rtol=0.07
        )

    def test_readings_stay_in_their_ranges(self):
        raw = self.read(HeatWorld(sensor=5.0))
        assert (raw >= 0).all()
        assert (raw <= [10, 10, 2 * np.pi, 1]).all()

    def test_episodes_start_anywhere_but_at_the_source(self):
        rng, state, source = np.random.default_rng(1), np.empty(3), np.array([5.0, 5.0])
        seen = []
        for _ in range(2000):
            place(rng, STILL.parameters, source, state)
            assert distance_to(state, source) > 1
            seen.append(state.copy())
        seen = np.array(seen)
        assert seen[:, :2].min() >= 1
        assert seen[:, :2].max() <= 9
        # By symmetry the means are the middle: standard error about 8/sqrt(12 * 2000) = .05.
        np.testing.assert_allclose(seen.mean(axis=0), [5, 5, np.pi], atol=0.25)

    def test_sources_are_where_the_robot_can_reach_them(self):
        rng = np.random.default_rng(4)
        sources = np.array([STILL.sample_source(rng) for _ in range(3000)])
        nearest = np.clip(sources, 1, 9)
        assert np.hypot(*(sources - nearest).T).max() <= 1
        # They fill 100 - (4 - pi) of the area; the share with x < 1 is (8 + pi/2) of that.
        share = (sources[:, 0] < 1).mean()
        assert share == pytest.approx((8 + np.pi / 2) / (96 + np.pi), abs=0.025)


def naive_sarsa(task, coding, seed, episodes, cap, alpha, epsilon, lam, replacing):
    """Sarsa(lambda) with a full table of traces, straight from the textbook."""
    rng = np.random.default_rng(seed)
    parameters, source = task.world.parameters, np.array(task.source)
    w, visits = np.zeros((coding.n_features, 4)), np.zeros((coding.n_features, 4), int)
    lengths = []
    state, reading = np.empty(3), np.empty(4)

    def choose(active):
        q = w[active].sum(axis=0)
        u = rng.random()
        if u < epsilon:
            return min(int(u / epsilon * 4), 3)
        best, ties, action = -np.inf, 0, 0
        for b in range(4):
            if q[b] > best:
                best, ties, action = q[b], 1, b
            elif q[b] == best:
                ties += 1
                if rng.random() * ties < 1:
                    action = b
        return action

    def look():
        sense(rng, parameters, source, state, reading)
        return coding.active(reading)

    for _ in range(episodes):
        trace = np.zeros_like(w)
        place(rng, parameters, source, state)
        active = look()
        action = choose(active)
        step, done = 0, False
        while not done and step < cap:
            step += 1
            trace[active, action] = 1 if replacing else trace[active, action] + 1
            visits[active, action] += 1
            q = w[active, action].sum()
            move(rng, parameters, state, action)
            done = distance_to(state, source) <= 1
            target = task.world.step_reward
            if not done:
                following = look()
                next_action = choose(following)
                target += w[following, next_action].sum()
            w += alpha / 4 * (target - q) * trace
            trace *= lam
            trace[trace < TRACE_CUT_OFF] = 0
            if not done:
                active, action = following, next_action
        lengths.append(step)
    return w, visits, lengths


class TestSarsa:
    @pytest.mark.parametrize("traces", ["replacing", "accumulating"])
    def test_against_a_plain_transcription(self, traces):
        task = HeatTask((6.0, 3.0))
        coding = task.world.coding()
        w, visits, lengths = naive_sarsa(
            task, coding, 11, 6, 150, 0.3, 0.05, 0.9, traces == "replacing"
        )
        got = sarsa_lambda(task, rng=11, episodes=6, max_episode_steps=150, traces=traces)
        assert got.episode_lengths.tolist() == lengths
        np.testing.assert_array_equal(got.visits, visits)
        np.testing.assert_allclose(got.weights, w, atol=1e-12)
        np.testing.assert_allclose(got.episode_returns, np.array(lengths) * -10 / np.sqrt(200))
        assert got.truncated.tolist() == [n == 150 for n in lengths]

    def test_the_first_update_by_hand(self):
        # One step from weights 0: w = alpha/4 * reward on the four active features of the action.
        task = HeatTask((6.0, 3.0))
        got = sarsa_lambda(task, rng=0, episodes=1, max_episode_steps=1, alpha=0.4)
        assert (got.visits.sum(), (got.visits > 0).sum()) == (4, 4)
        np.testing.assert_allclose(got.weights[got.visits > 0], 0.1 * -10 / np.sqrt(200))
        assert (got.weights[got.visits == 0] == 0).all()

    def test_learning_finds_the_source_sooner(self):
        # The straight way takes at most 9 m / .5 m a step plus 8 turns; a random walk hundreds.
        got = sarsa_lambda(HeatTask((7.0, 4.0)), rng=3, episodes=300)
        assert got.episode_lengths[:5].mean() > 100
        assert got.episode_lengths[-100:].mean() < 35

    def test_the_same_seed_gives_the_same_weights(self):
        task = HeatTask((3.0, 3.0))
        one, two, other = (sarsa_lambda(task, rng=s, episodes=5) for s in (7, 7, 8))
        np.testing.assert_array_equal(one.weights, two.weights)
        assert (one.weights != other.weights).any()

    def test_initial_weights_are_where_learning_starts(self):
        task = HeatTask((3.0, 3.0))
        learned = sarsa_lambda(task, rng=0, episodes=200)
        start = learned.weights.copy()
        again = sarsa_lambda(task, rng=1, episodes=20, initial_weights=start)
        assert again.episode_lengths.mean() < 60
        np.testing.assert_array_equal(start, learned.weights)

    def test_bad_input_is_one_sentence(self):
        task = HeatTask((3.0, 3.0))
        with pytest.raises(ValueError, match=r"alpha is 1\.5, but it must be in \(0, 1\]"):
            sarsa_lambda(task, rng=0, alpha=1.5)
        with pytest.raises(ValueError, match="episodes is 0"):
            sarsa_lambda(task, rng=0, episodes=0)
        with pytest.raises(ValueError, match="traces 'dutch' does not exist"):
            sarsa_lambda(task, rng=0, traces="dutch")
        with pytest.raises(ValueError, match=r"epsilon is -0\.1"):
            sarsa_lambda(task, rng=0, epsilon=-0.1)
        with pytest.raises(ValueError, match="rng is -1"):
            sarsa_lambda(task, rng=-1)
        with pytest.raises(ValueError, match=r"initial_weights has shape \(3,\)"):
            sarsa_lambda(task, rng=0, initial_weights=[1, 2, 3])
        with pytest.raises(ValueError, match="6656 values that are not finite"):
            sarsa_lambda(task, rng=0, initial_weights=np.full((1664, 4), np.nan))


def test_pairs_list_what_was_visited():
    # Four features (u, v) = (0,0), (0,1), (1,0), (1,1) and four actions; only action 0 is used.
    coding = TileCoding(("u", "v"), (0.0, 0.0), (1.0, 1.0), (2, 2), (True, True), 1)
    weights, visits, empty = np.zeros((4, 4)), np.zeros((4, 4), dtype=int), np.zeros(0)
    weights[:, 0], visits[:, 0] = [1, 2, 3, 4], [1, 1, 2, 0]
    learned = HeatLearned(weights, visits, empty, empty.astype(int), empty.astype(bool))
    names, columns, q, p = learned.pairs(coding)
    assert names == ("tiling", "u", "v", "a")
    assert columns.tolist() == [[0, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0]]
    assert q.tolist() == [1, 2, 3]
    assert p.tolist() == [0.25, 0.25, 0.5]


class TestEnvironment:
    @pytest.mark.parametrize("options", [{}, {"source": (3.0, 8.0), "sensor": 0.06, "slip": 0.0}])
    def test_gymnasium_finds_nothing_to_complain_about(self, options):
        env = gymnasium.make("thesis/Heat-v0", **options)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            check_env(env.unwrapped, skip_render_check=True)

    def test_an_episode_ends_at_the_source(self):
        env = HeatEnv((5.0, 5.0), slip=0.0)
        env.reset(seed=0)
        env._state[:] = 7.2, 5.0, np.pi
        ends = [env.step(0)[2] for _ in range(3)]
        assert ends == [False, False, True]  # distances 1.7, 1.2 and .7

    def test_a_domain_environment_draws_a_task_at_every_reset(self):
        env = HeatEnv()
        sources = {tuple(env.reset(seed=s)[1]["source"]) for s in range(5)}
        assert len(sources) == 5

    def test_a_source_may_be_an_array(self):
        seen = [HeatEnv(at).reset(seed=0) for at in ((3.0, 4.0), np.array([3.0, 4.0]))]
        np.testing.assert_array_equal(seen[1][1]["source"], [3.0, 4.0])
        np.testing.assert_array_equal(seen[1][0], seen[0][0])

    def test_it_is_the_world_the_learner_lives_in(self):
        # The same generator and actions give the same readings as the compiled functions.
        env = HeatEnv((6.0, 3.0))
        observation, _ = env.reset(seed=5)
        rng, state, reading = np.random.default_rng(5), np.empty(3), np.empty(4)
        parameters, source = HeatWorld().parameters, np.array([6.0, 3.0])
        place(rng, parameters, source, state)
        sense(rng, parameters, source, state, reading)
        np.testing.assert_array_equal(observation, reading)
        for action in (0, 2, 1, 3):
            observation, reward, *_ = env.step(action)
            move(rng, parameters, state, action)
            sense(rng, parameters, source, state, reading)
            np.testing.assert_array_equal(observation, reading)
            assert reward == pytest.approx(-10 / np.sqrt(200))

    def test_bad_input_is_one_sentence(self):
        with pytest.raises(ValueError, match="come within its radius"):
            HeatEnv((0.0, 0.0))
        with pytest.raises(ValueError, match=r"source is 3\.0, but a pair"):
            HeatTask(3.0)
        with pytest.raises(ValueError, match=r"radius is 6\.0"):
            HeatWorld(radius=6.0)
        with pytest.raises(ValueError, match=r"slip is -0\.1"):
            HeatWorld(slip=-0.1)
        with pytest.raises(ValueError, match="intensity 'cubic' does not exist"):
            HeatWorld(intensity="cubic")
        env = HeatEnv()
        with pytest.raises(gymnasium.error.ResetNeeded):
            env.step(0)
        env.reset(seed=0)
        with pytest.raises(ValueError, match="action is 4"):
            env.step(4)
