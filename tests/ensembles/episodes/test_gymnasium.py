"""An environment as Gymnasium's, under its own wrappers."""

import numpy as np
import pytest

import slcp_warp as slcp

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.wrappers import vector as wrappers  # noqa: E402

WORLDS = 6


def environment(**given):
    return slcp.Environment(slcp.tasks.catch().replace(duration=0.4), WORLDS, seed=2, **given)


def test_spaces_say_what_comes_and_goes(device):
    env = environment(device=device).gymnasium()
    assert isinstance(env, gymnasium.vector.VectorEnv) and env.num_envs == WORLDS
    assert env.metadata["autoreset_mode"] is gymnasium.vector.AutoresetMode.SAME_STEP
    y, info = env.reset(seed=3)
    assert info == {} and env.observation_space.contains(y)
    env.action_space.seed(0)
    moment = env.step(env.action_space.sample())
    assert env.observation_space.contains(moment[0]) and moment[0].dtype == np.float32
    assert [each.shape for each in moment[1:4]] == [(WORLDS,)] * 3
    env.close()


def test_steps_are_those_of_the_environment_and_episodes_are_told(device):
    env, own = environment(device=device).gymnasium(), environment(device=device)
    np.testing.assert_array_equal(env.reset(seed=3)[0], own.reset(seed=3))
    rng, ends = np.random.default_rng(0), 0
    for _ in range(30):
        u = rng.normal(size=(WORLDS, own.controls))
        observation, reward, terminated, truncated, info = env.step(u)
        moment = own.step(u)
        np.testing.assert_array_equal(observation, moment.observation)
        np.testing.assert_array_equal(reward, moment.reward)
        over = terminated | truncated
        ends += over.sum()
        if not over.any():
            assert info == {}
            continue
        np.testing.assert_array_equal(info["_final_obs"], over)
        for slot, world in zip(moment.ended["slot"], moment.ended["world"]):
            np.testing.assert_array_equal(info["final_obs"][slot], moment.last[slot])
            assert info["final_info"]["world"][slot] == world and info["final_info"]["_world"][slot]
        assert all(info["final_obs"][slot] is None for slot in np.flatnonzero(~over))
    assert ends >= WORLDS


def test_wrappers_of_gymnasium_take_it(device):
    env = environment(device=device, autoreset="next_step").gymnasium()
    wrapped = wrappers.RecordEpisodeStatistics(wrappers.NormalizeObservation(env))
    wrapped.reset(seed=1)
    found = []
    for _ in range(60):
        *_, info = wrapped.step(np.zeros((WORLDS, env.environment.controls)))
        if "episode" in info:
            found += info["episode"]["r"][info["_episode"]].tolist()
    own, returns = environment(device=device, autoreset="next_step"), []
    own.reset(seed=1)
    for _ in range(60):
        returns += own.step(np.zeros((WORLDS, own.controls))).ended["return"].tolist()
    assert len(found) >= WORLDS
    np.testing.assert_allclose(found, returns, rtol=1e-9)


def test_options_of_a_reset_are_refused():
    with pytest.raises(slcp.InputError, match="options is"):
        environment().gymnasium().reset(options={"low": 0.0})
