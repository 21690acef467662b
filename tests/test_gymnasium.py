"""The Gymnasium environments: the interface's own checks, the episodes of the training, seeds, vectors, pictures."""

import json
import subprocess
import sys
import warnings

import numpy as np
import pytest
from handmade import TINY
from lidar_worlds import SMALL as BY_LIDAR

from baselines.training.episodes import play
from explore_bench.errors import RequestError
from explore_bench.strategies.contract import Target
from explore_bench.trial.decision_process import Course
from explore_bench.trial.features import CANDIDATE_COLUMNS, STATE_COLUMNS, features
from explore_bench.trial.reward import REWARD_WEIGHTS, RewardWeights
from explore_bench.world.kinds import draw_world
from explore_bench.world.scenario import Scenario
from explore_bench.world.scenarios import PAPER, STAGE

gymnasium = pytest.importorskip("gymnasium", reason="gymnasium is missing: install the extra 'gym'")

import explore_bench.gymnasium as ours  # noqa: E402

IDS = ("ExploreBench-20m-v0", "ExploreBench-30m-v0", "ExploreBench-40m-v0", "ExploreBench-Stage-v0")
SHORT = PAPER.replace(steps_per_cell=0.25)
"""100 cells, 25 steps: too few to explore."""
CREEPING = PAPER.replace(path_tolerance=1e-9, step_length=0.01, stuck_decisions=1)
"""A decision ends after a step of 1 cm, within its cell."""


@pytest.fixture
def env():
    return ours.ExploreEnv(scenario=TINY)


def episode(env, seed=None, choose=lambda mask: 0):
    """Play one; return everything that it gave, and its actions."""
    seen, info = env.reset(seed=seed)
    given, actions, over = [(seen, info)], [], False
    while not over:
        actions.append(choose(env.unwrapped.action_masks()))
        given.append(env.step(actions[-1]))
        over = given[-1][2] or given[-1][3]
    return given, actions


def at_random(rng):
    return lambda mask: int(rng.choice(np.flatnonzero(mask)))


def same(a, b):
    """Whether two results, dictionaries of arrays among them, are equal."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, tuple | list):
        return len(a) == len(b) and all(map(same, a, b))
    return np.array_equal(a, b)


def in_another_process(source):
    """Run lines in a fresh interpreter; return what they print."""
    done = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout


# The interface


@pytest.mark.parametrize("name", IDS)
@pytest.mark.filterwarnings("error")
def test_gymnasium_s_own_checker_has_nothing_to_say(name):
    from gymnasium.utils.env_checker import check_env

    env = gymnasium.make(name, render_mode="rgb_array")
    check_env(env.unwrapped)
    env.close()


@pytest.mark.filterwarnings("error", "ignore:Your observation candidates has an unconventional shape")
def test_stable_baselines3_s_checker_has_nothing_to_say(env):
    """But that a table is no vector; its policies for dictionaries flatten it."""
    reason = "stable-baselines3 is missing: install the extra 'test'"
    pytest.importorskip("stable_baselines3.common.env_checker", reason=reason).check_env(env)


@pytest.mark.parametrize(
    ("name", "scenario", "width"),
    [
        (IDS[0], PAPER, 14),
        (IDS[1], PAPER.replace(size=30.0), 26),
        (IDS[2], PAPER.replace(size=40.0), 41),
        (IDS[3], STAGE, 20),
    ],
)
def test_the_registered_environments(name, scenario, width):
    env = gymnasium.make(name)
    assert tuple(ours.ENVIRONMENTS) == IDS
    assert env.unwrapped.scenario == scenario
    assert env.action_space == gymnasium.spaces.Discrete(width)
    assert env.observation_space["candidates"].shape == (width, 9)
    assert env.observation_space["state"].shape == (7,)


def test_an_environment_can_be_made_by_naming_the_module():
    """No import needed beforehand; nothing is drawn, so matplotlib stays out, and torch is never needed."""
    lines = """
import json, sys, gymnasium
env = gymnasium.make("explore_bench.gymnasium:ExploreBench-20m-v0")
env.reset(seed=0)
env.step(0)
print(json.dumps([env.spec.id, [name for name in ("matplotlib", "torch", "joblib") if name in sys.modules]]))
"""
    assert json.loads(in_another_process(lines)) == ["ExploreBench-20m-v0", []]


def test_registering_again_changes_nothing_and_says_nothing():
    before = dict(gymnasium.registry)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ours.register()
    assert gymnasium.registry == before


def test_the_specification_is_plain():
    spec = gymnasium.spec(IDS[0])
    assert gymnasium.envs.registration.EnvSpec.from_json(spec.to_json()).make().unwrapped.scenario.size == 20.0


def test_without_gymnasium_the_message_names_the_extra():
    lines = """
import sys
sys.modules["gymnasium"] = None
try:
    import explore_bench.gymnasium
except ModuleNotFoundError as error:
    print(error)
"""
    assert "pip install 'explore-bench[gym]'" in in_another_process(lines)


def test_a_given_map_keeps_its_own_size():
    rows = ["...#....", "...#....", "........", "...#....", "...##.##", "........", "...#....", "...#...."]
    env = gymnasium.make(IDS[0], scenario=Scenario(map=rows), size=None)
    given, _ = episode(env, 0)
    assert env.unwrapped.scenario.size == 16.0
    assert given[-1][-1]["status"] == "explored"
    assert all(one[0] in env.observation_space for one in given)


def test_a_wrapper_of_time_can_shorten_an_episode():
    env = gymnasium.make(IDS[0], max_episode_steps=2)
    given, _ = episode(env, 0)
    assert len(given) == 3
    assert given[-1][2:4] == (False, True)


# The episodes are those of the training


@pytest.mark.parametrize("weights", [REWARD_WEIGHTS, RewardWeights(uncertainty=1.0, turning=2.0, length=3.0)])
@pytest.mark.parametrize("scenario", [TINY, SHORT, BY_LIDAR])
def test_rewards_steps_and_endings_are_those_of_training_episodes(scenario, weights):
    def nearest(waiting, observations):
        return [int(features(one).order[0]) for one in observations]

    env = ours.ExploreEnv(scenario=scenario, weights=weights)
    for number, wanted in enumerate(play(Course(scenario, "train", 3, weights), [0, 1], nearest)):
        given, _ = episode(env, seed=3 if number == 0 else None)
        assert [one[1] for one in given[1:]] == wanted.rewards
        info = given[-1][-1]
        assert (info["trial"], info["status"]) == (number, wanted.status.value)
        assert (info["step"], info["explored"], info["uncertainty"]) == (
            wanted.last.step,
            wanted.last.explored,
            wanted.last.uncertainty,
        )


@pytest.mark.parametrize("scenario", [PAPER, BY_LIDAR])
def test_the_observation_holds_the_features_of_what_a_strategy_would_see(scenario):
    env = ours.ExploreEnv(scenario=scenario)
    seen, _ = env.reset(seed=4)
    expected = features(Course(scenario, "train", 4).begin(0).observation)
    np.testing.assert_array_equal(seen["candidates"], expected.candidates)
    np.testing.assert_array_equal(seen["state"], expected.state)


@pytest.mark.parametrize(
    ("scenario", "status", "ending"),
    [
        (TINY, "explored", (True, False)),
        (SHORT, "step_limit", (False, True)),
        (CREEPING, "stuck", (False, True)),
    ],
)
def test_an_explored_map_terminates_an_episode_and_everything_else_truncates_it(scenario, status, ending):
    given, _ = episode(ours.ExploreEnv(scenario=scenario), 1)
    assert all(one[2:4] == (False, False) and one[4]["status"] == "" for one in given[1:-1])
    assert given[-1][2:4] == ending
    assert given[-1][4]["status"] == status


def test_the_observation_at_the_end_has_the_last_belief_and_no_candidate(env):
    given, _ = episode(env, 0)
    seen, info = given[-1][0], given[-1][-1]
    assert not seen["candidates"].any()
    assert seen["state"][0] == np.float32(info["explored"])
    assert seen["state"][-1] == 0.0
    assert not env.action_masks().any()
    assert seen in env.observation_space


# Actions


def test_the_mask_tells_which_actions_are_candidates(env):
    rng = np.random.default_rng(0)

    def choose(mask):
        count = len(env.unwrapped._process.observation.candidates)
        np.testing.assert_array_equal(mask, np.arange(env.width) < count)
        return at_random(rng)(mask)

    given, _ = episode(env, 1, choose)
    assert all(one[-1]["action_was_candidate"] for one in given[1:])


def test_the_mask_in_the_info_can_be_sampled_with(env):
    _, info = env.reset(seed=0)
    assert info["action_mask"].dtype == np.int8
    drawn = {int(env.action_space.sample(mask=info["action_mask"])) for _ in range(200)}
    assert drawn == set(np.flatnonzero(env.action_masks()))


def test_an_action_that_is_no_candidate_counts_modulo_their_number(env):
    _, info = env.reset(seed=2)
    count = int(info["action_mask"].sum())
    assert count < env.width
    for action in range(count, env.width):
        env.reset(seed=2)
        beyond = env.step(action)
        env.reset(seed=2)
        within = env.step(action % count)
        assert beyond[4].pop("action_was_candidate") is False
        assert within[4].pop("action_was_candidate") is True
        assert same(beyond, within)


def test_each_candidate_is_another_decision(env):
    _, info = env.reset(seed=2)
    ends = []
    for action in range(int(info["action_mask"].sum())):
        env.reset(seed=2)
        ends.append(env.step(action)[1])
    assert len(set(ends)) == len(ends) > 1


@pytest.mark.parametrize("action", [-1, 10**6, 1.5, "a", None])
def test_what_is_not_in_the_action_space_is_refused(env, action):
    env.reset(seed=0)
    with pytest.raises(gymnasium.error.InvalidAction, match=f"0 to {env.width - 1}"):
        env.step(action)
    env.step(np.int64(0))  # nothing is lost


def test_a_step_needs_an_episode(env):
    for call in (lambda: env.step(0), env.action_masks, env.render):
        with pytest.raises(gymnasium.error.ResetNeeded, match="reset"):
            call()
    episode(env, 0)
    with pytest.raises(gymnasium.error.ResetNeeded, match="ended"):
        env.step(0)


@pytest.mark.parametrize("scenario", [PAPER, PAPER.replace(size=40.0, steps_per_cell=0.5)])
def test_no_decision_has_more_candidates_than_there_are_actions(scenario):
    env, most = ours.ExploreEnv(scenario=scenario), 0
    for number in range(2):
        given, _ = episode(env, 0 if number == 0 else None, at_random(np.random.default_rng(number)))
        most = max(most, *(int(one[-1]["action_mask"].sum()) for one in given))
    assert 5 < most <= env.width


# By lidar


def test_a_random_walk_in_a_lidar_world_keeps_to_its_spaces_and_its_seed():
    """Candidates are clusters of frontiers here, at most 20 of them, and nothing is known of any landmark."""
    first, other = (ours.ExploreEnv(scenario=BY_LIDAR) for _ in range(2))
    for number in range(3):
        seed = 5 if number == 0 else None
        given, actions = episode(first, seed, at_random(np.random.default_rng(number)))
        assert same(given, episode(other, seed, at_random(np.random.default_rng(number)))[0])
        assert len(actions) > 2
        assert all(one[-1]["action_was_candidate"] for one in given[1:])
        assert given[-1][2:4] in ((True, False), (False, True))
        states = np.array([one[0]["state"] for one in given])
        tables = np.array([one[0]["candidates"] for one in given])
        assert all(one[0] in first.observation_space for one in given)
        state = dict(zip(STATE_COLUMNS, states.T, strict=True))
        assert not state["landmarks"].any()
        assert (np.diff(state["steps"]) > 0).all()
        assert state["explored"][-1] > state["explored"][0]
        np.testing.assert_array_equal(state["candidates"], [np.float32(one[-1]["action_mask"].mean()) for one in given])
        candidate = dict(zip(CANDIDATE_COLUMNS, np.moveaxis(tables, -1, 0), strict=True))
        assert not candidate["landmark"].any()
        for name in ("ahead", "left", "length", "turn", "unknown", "trace"):
            assert len(set(candidate[name][candidate["present"] == 1].tolist())) > 3, name


def test_a_target_is_driven_to_in_a_lidar_world():
    env = ours.ExploreEnv(scenario=BY_LIDAR)
    env.reset(seed=1)
    cells, lengths = env.reachable()
    x, y = env._process.observation.roads.grid.centre_of(int(cells[lengths.argmax()]))
    info = env.step(Target((x, y)))[-1]
    assert info["step"] > 0
    assert not info["action_was_candidate"]
    last = env._process.rows[-1]
    assert np.hypot(last.x - x, last.y - y) < 0.6
    with pytest.raises(gymnasium.error.InvalidAction, match="outside the map"):
        env.step(Target((-1.0, 2.0)))


def test_a_frame_of_a_lidar_world_shows_its_walls():
    from explore_bench.report import scene

    env = ours.ExploreEnv(scenario=BY_LIDAR, render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    env.step(0)
    frame = env.render()
    assert frame.shape == (480, 480, 3)
    assert count(frame, scene.ESTIMATE) > 5
    assert (first != frame).any()


# Worlds and seeds


def test_a_seed_gives_the_same_episodes_again(env):
    first = [episode(env, 6, at_random(np.random.default_rng(0))), episode(env)]
    other = ours.ExploreEnv(scenario=TINY)
    other.reset(seed=1)
    assert same(first, [episode(other, 6, at_random(np.random.default_rng(0))), episode(other)])


def test_a_reset_without_a_seed_goes_on_to_the_next_world(env):
    worlds = [env.reset(seed=6) and env._process.world.digest] + [env.reset() and env._process.world.digest]
    course = Course(TINY, "train", 6)
    assert worlds == [draw_world(TINY, course.generator(i, "world")).digest for i in (0, 1)]


def test_without_any_seed_two_environments_meet_different_worlds():
    infos = [ours.ExploreEnv(scenario=TINY).reset()[1] for _ in range(2)]
    assert infos[0]["root"] != infos[1]["root"]
    again = ours.ExploreEnv(scenario=TINY).reset(seed=infos[0]["root"])[1]
    assert again["uncertainty"] == infos[0]["uncertainty"]


@pytest.mark.parametrize("purpose", ["train", "validate"])
def test_no_world_is_one_of_the_evaluation(purpose):
    def digests(purpose):
        courses = [Course(TINY, purpose, root) for root in (0, 1)]
        return {draw_world(TINY, course.generator(i, "world")).digest for course in courses for i in range(10)}

    env, met = ours.ExploreEnv(scenario=TINY, purpose=purpose), set()
    for seed in (0, 1):
        for i in range(10):
            env.reset(seed=seed if i == 0 else None)
            met.add(env._process.world.digest)
    assert met == digests(purpose)
    assert not met & digests("evaluate")


@pytest.mark.parametrize("seed", [-1, 2**32])
def test_a_seed_that_is_no_root_seed_is_refused(env, seed):
    with pytest.raises(RequestError, match=str(seed)):
        env.reset(seed=seed)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"purpose": "evaluate"}, "purpose 'evaluate'"),
        ({"render_mode": "human"}, "rgb_array"),
        ({"scenario": "nowhere"}, "nowhere"),
        ({"size": 21.0}, "21"),
    ],
)
def test_wrong_options_are_refused(options, words):
    with pytest.raises(RequestError, match=words):
        ours.ExploreEnv(**options)


def test_worlds_without_a_decision_are_passed_over(monkeypatch):
    monkeypatch.setattr(ours, "MAX_TRIVIAL", 3)
    seen_at_once = PAPER.replace(size=4.0, landmark_count=0, obstacle_count=0)
    with pytest.raises(RequestError, match="no decision"):
        ours.ExploreEnv(scenario=seen_at_once).reset(seed=0)
    begun = []

    def begin(course, number):
        begun.append(number)
        return original(course if number > 0 else Course(seen_at_once, "train", 0), number)

    original = Course.begin
    monkeypatch.setattr(Course, "begin", begin)
    _, info = ours.ExploreEnv(scenario=TINY).reset(seed=0)
    assert (info["trial"], begun) == (1, [0, 1])


# Several at once


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_vectorized_environments_are_those_alone(mode):
    """Two environments, each reset by itself as its episode ends; two seeds that are equal give equal episodes."""
    envs = gymnasium.make_vec(IDS[0], num_envs=2, vectorization_mode=mode, scenario=TINY, size=None)
    try:
        for seeds in ([7, 7], [7, 8]):
            alone = [ours.ExploreEnv(scenario=TINY) for _ in seeds]
            seen, info = envs.reset(seed=seeds)
            own = [one.reset(seed=seed) for one, seed in zip(alone, seeds, strict=True)]
            over = np.zeros(2, dtype=bool)
            for _ in range(6):
                for name in ("candidates", "state"):
                    np.testing.assert_array_equal(seen[name], [one[0][name] for one in own])
                np.testing.assert_array_equal(envs.call("action_masks"), [one.action_masks() for one in alone])
                np.testing.assert_array_equal(info["action_mask"], [one[-1]["action_mask"] for one in own])
                seen, rewards, terminated, truncated, info = envs.step(np.array([0, 0]))
                own = [
                    (*one.reset()[:1], 0.0, False, False, one._info()) if ended else one.step(0)
                    for one, ended in zip(alone, over, strict=True)
                ]
                assert rewards.tolist() == [one[1] for one in own]
                assert terminated.tolist() == [one[2] for one in own]
                over = terminated | truncated
            assert (same(seen["state"][0], seen["state"][1])) == (seeds[0] == seeds[1])
    finally:
        envs.close()


# Pictures


@pytest.fixture
def drawing():
    """Return an environment that draws, after its first decision."""
    env = ours.ExploreEnv(render_mode="rgb_array")
    env.reset(seed=0)
    env.step(0)
    return env


def test_a_frame_is_an_rgb_picture_that_changes_with_the_episode(drawing):
    frames, over = [drawing.render()], False
    while not over:
        _, _, terminated, truncated, _ = drawing.step(0)
        over = terminated or truncated
        frames.append(drawing.render())
    for frame in frames:
        assert frame.shape == (480, 480, 3)
        assert frame.dtype == np.uint8
    assert len({frame.tobytes() for frame in frames}) == len(frames) > 2
    np.testing.assert_array_equal(drawing.render(), frames[-1])


def count(frame, color):
    """Pixels of nearly a colour "#rrggbb"."""
    wanted = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)])
    return int((np.abs(frame.astype(int) - wanted).max(axis=-1) < 30).sum())


def blue_lines(frame):
    """Pixels of the ellipses, whose thin lines are blended with what lies below."""
    red, green, blue = np.moveaxis(frame.astype(int), -1, 0)
    return int(((blue - red > 40) & (green > 100)).sum())


def test_a_frame_shows_map_trajectory_ellipses_and_candidates(drawing):
    """The candidates vanish at the end of the episode."""
    from explore_bench.report import scene

    frame = drawing.render()
    assert count(frame, scene.UNKNOWN) > 0.2 * frame.shape[0] * frame.shape[1]
    for color in (scene.OCCUPIED, scene.ESTIMATE, scene.TRUE, scene.CANDIDATE):
        assert count(frame, color) > 5, color
    assert blue_lines(frame) > 100
    over = False
    while not over:
        _, _, terminated, truncated, _ = drawing.step(0)
        over = terminated or truncated
    assert not count(drawing.render(), scene.CANDIDATE)


def test_without_a_render_mode_nothing_is_drawn_and_that_is_said(env):
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="rgb_array"):
        assert env.render() is None
