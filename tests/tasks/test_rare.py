"""Shares of failures by splitting, against formulas and counting; the smallest disturbance that fails."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from simulators import simulator
from test_task_sweep import SCENE, N, plan, task

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp import measures as m
from slcp_warp.ensembles.questions.rare.falsification import Falsification
from slcp_warp.ensembles.questions.rare.falsify import _smallest_parts
from slcp_warp.ensembles.questions.rare.gradient import ClosedLoop
from slcp_warp.ensembles.questions.rare.interval import freedom_of, island_interval, student
from slcp_warp.ensembles.questions.rare.margin import Margin
from slcp_warp.ensembles.questions.rare.numbers import Numbers
from slcp_warp.ensembles.questions.rare.shells import Search
from slcp_warp.ensembles.questions.rare.splitting import Effort, Moves, StuckError, pilot, run_islands
from slcp_warp.ensembles.statistics import share_interval

SMOOTH = slcp.Options()


def halfspace(beta):
    """Falls evenly in one direction: P = Phi(-beta)."""
    return lambda z: beta - z.sum(axis=1) / math.sqrt(z.shape[1]), stats.norm.sf(beta)


def both_sides(beta):
    """Two ways to fail, far from each other."""
    return lambda z: beta - np.abs(z[:, 0]), 2.0 * stats.norm.sf(beta)


def stairs(beta):
    """Falls in steps: many worlds have the same margin."""

    def score(z):
        s = beta - z[:, 0]
        return np.where(s <= 0.0, s, np.ceil(4.0 * s) / 4.0)

    return score, stats.norm.sf(beta)


@pytest.mark.parametrize("made, width, fresh", [(halfspace(3.72), 10, 0), (halfspace(3.09), 40, 2),
                                                (both_sides(3.9), 12, 0), (stairs(3.72), 4, 1)])  # fmt: skip
def test_the_interval_holds_the_probability(made, width, fresh):
    """In at least 17 of 20 repetitions, and the mean of them within 4 standard errors."""
    (score, truth), effort, moves = made, Effort(500, 10), Moves(width, fresh)
    estimates, held = [], 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        levels = pilot(score, moves, effort, 2000, rng)
        found = run_islands(score, levels, moves, effort, 12, rng)
        share, low, high = island_interval(found.shares)
        assert len(levels.scores) < effort.most and (score(found.ended) <= 0.0).all()
        held += low <= truth <= high
        estimates.append(share)
    assert held >= 17
    assert np.mean(estimates) == pytest.approx(truth, abs=4.0 * np.std(estimates) / math.sqrt(20))


def test_slow_chains_leave_the_mean_where_it_is():
    """Moves far too small for the chains to mix: the estimates scatter, around the same probability."""
    score, truth = halfspace(2.33)
    levels = pilot(score, Moves(3), Effort(500, 10), 2000, np.random.default_rng(0))
    slow = replace(levels, sizes=tuple(0.01 for _ in levels.sizes))
    rng = np.random.default_rng(1)
    shares = run_islands(score, slow, Moves(3), Effort(100, 10), 3000, rng).shares
    assert shares.mean() == pytest.approx(truth, abs=4.0 * shares.std() / math.sqrt(3000))
    assert shares.std() > 1.5 * run_islands(score, levels, Moves(3), Effort(100, 10), 3000, rng).shares.std()


def test_moves_keep_the_normal_law():
    rng = np.random.default_rng(0)
    moves = Moves(3, 1)
    z = moves.draw(200_000, rng)
    after = moves.propose(z, 0.6, rng)
    assert np.abs(after.mean(axis=0)).max() < 0.01 and np.abs(after.std(axis=0) - 1.0).max() < 0.01
    assert (after[:, 2] == z[:, 2]).mean() == pytest.approx(0.5, abs=0.01)  # the last is drawn anew or left


def test_students_factor_is_the_distributions():
    for freedom in (1, 2, 10, 30, 31, 50, 400):
        assert student(freedom) == pytest.approx(stats.t.ppf(0.975, freedom), rel=2e-3)
    mean, low, high = island_interval(np.array([0.1, 0.2, 0.3, 0.2]))
    half = stats.t.ppf(0.975, 3) * stats.sem([0.1, 0.2, 0.3, 0.2]) / 0.2
    assert (mean, low, high) == pytest.approx((0.2, 0.2 * math.exp(-half), 0.2 * math.exp(half)), rel=1e-3)
    assert np.isnan(island_interval(np.array([0.1]))[1])


def test_a_margin_that_leads_nowhere_is_said():
    with pytest.raises(StuckError, match="margin of all 32000 worlds is at its lowest, 1"):
        pilot(lambda z: np.ones(len(z)), Moves(2), Effort(), 2000, np.random.default_rng(0))


def test_a_margin_of_few_values_may_fall_seldom():
    """Of 200 worlds of a pilot one in ten finds a lower margin; it looks on until it has one."""
    score = lambda z: np.where(z[:, 0] < 3.29, 1.0, 0.0)  # noqa: E731
    for seed in range(5):
        levels = pilot(score, Moves(2), Effort(200, 10), 200, np.random.default_rng(seed))
        assert levels.scores == (1.0, 0.0)


def test_islands_that_hold_most_of_it_tell_less_of_their_spread():
    even = np.random.default_rng(0).standard_normal((400, 20))
    assert np.median([freedom_of(each) for each in even]) > 17.0
    assert freedom_of(np.arange(20.0)) == 19.0 == freedom_of(np.ones(20))
    assert freedom_of(np.eye(20)[0]) == pytest.approx(40.0 / (18.05 - 17.0 / 19.0), rel=0.01)
    one, spread = np.eye(20)[0] * 20.0, 1.0 + np.linspace(-1.0, 1.0, 20)
    spread = 1.0 + (spread - 1.0) * one.std() / spread.std()
    assert np.divide(*island_interval(one)[:0:-1]) > 1.5 * np.divide(*island_interval(spread)[:0:-1])


def test_margins_have_the_sign_of_the_success():
    """Of random clauses, at random values and at the bounds themselves."""
    rng, first = np.random.default_rng(3), m.first_time(m.state("block.x") > 0.1)
    a, b = m.final("block.x"), m.largest("block.angle")
    both = (a > 0.1) & b.between(-0.5, 0.5)
    for success in (a > 0.2, first > 0.1, (first > 0.1) & (b < 0.2), both, (a < 0.0) | (b > 0.3) & (a < 1.0)):
        judge = Margin(task(success=success))
        values = np.where(rng.random((500, 2)) < 0.1, rng.choice([0.1, 0.2, 0.5], (500, 2)),
                          rng.standard_normal((500, 2)))[:, : len(judge.measures)]  # fmt: skip
        if judge.measures[0] is first:
            values[rng.random(500) < 0.3, 0] = np.inf
        judge.fit(values)
        holds = success.holds({each: values[:, j] for j, each in enumerate(judge.measures)})
        alone = judge.active({each: values[:, j] for j, each in enumerate(judge.measures)})[0]
        np.testing.assert_array_equal(alone > 0.0, holds)
        np.testing.assert_array_equal(judge(values, holds) > 0.0, holds)
        assert (judge(values, np.zeros(500, bool)) <= 0.0).all()  # not solved, whatever is measured
    with pytest.raises(slcp.InputError, match="has no success"):
        Margin(task(success=None))
    with pytest.raises(slcp.InputError, match="margin is 3"):
        Margin(task(), 3)


def test_numbers_are_the_drawn_ones():
    """Of every law, and of numbers that share a draw."""
    drawn = slcp.Disturbances(
        parameters={"mass": 0.1, "friction": slcp.Uniform(0.2, 0.6)},
        start={"block.vx": slcp.Normal(0.3, mean=0.1)}, kick_times=(0.2,), kick=0.5, torque=0.1,
    )  # fmt: skip
    own = task(disturbances=drawn, start=np.stack([SCENE.x0, SCENE.x0 + 1.0]))
    sim = slcp.Simulator(SCENE, SMOOTH)
    numbers = Numbers(sim, own, 0.02)
    z = np.random.default_rng(0).standard_normal((400, numbers.dimension + numbers.fresh))
    worlds, at = numbers.worlds(z), {name: i for i, name in enumerate(numbers.names)}
    assert numbers.fresh == 2 and len(np.unique(worlds.numbers)) == 400
    params = {name: worlds.params[:, start : start + int(np.prod(shape, dtype=int))]
              for name, start, shape in sim.params.layout.columns}  # fmt: skip
    for body, name in enumerate(("pusher", "block")):
        factor = np.exp(0.1 * z[:, at[f"{name}.mass"]])
        np.testing.assert_allclose(params["mass"][:, body] / sim.params["mass"][body], factor)
        np.testing.assert_allclose(
            params["inertia"][:, body], np.broadcast_to(sim.params["inertia"][body], 400)
        )
    even = 0.2 + 0.4 * stats.norm.cdf(z[:, at[f"{SCENE.pair_names[0]}.friction"]])
    np.testing.assert_allclose(params["friction"][:, 0], even, rtol=1e-12)
    vx = SCENE.state_index("block.vx")
    picked = worlds.x0[:, 0] - SCENE.x0[0]
    assert set(picked) == {0.0, 1.0} and 0.4 < picked.mean() < 0.6
    np.testing.assert_allclose(worlds.x0[:, vx], SCENE.x0[vx] + picked + 0.1 + 0.3 * z[:, at["block.vx"]])
    np.testing.assert_allclose(worlds.kicks[:, 0, 1], 0.5 * z[:, at["kick_0_" + SCENE.state_names[5]]])


def reaching(least: float, **changes) -> slcp.Task:
    """The block must get somewhere; how far depends on masses and on a kick."""
    disturbed = slcp.Disturbances(parameters={"mass": 0.1}, kick_times=(0.0,), kick=0.05, torque=0.3)
    return task(success=m.final("block.x") > least, measures={}, disturbances=disturbed, **changes)


@pytest.mark.slow
def test_splitting_counts_as_plain_worlds_do(device):
    """A share of some hundredths, and one of two thousandths, against as many worlds as it takes."""
    own = reaching(0.0)
    x = slcp.sweep(own.replace(measures={"x": m.final("block.x")}), plan(), worlds=30_000, seed=5,
                   cases=SMOOTH, device=device).part("policy")["x"]  # fmt: skip
    for share in (0.03, 2e-3):
        bound = float(np.quantile(x, share))
        counted = float((x <= bound).mean())
        found = slcp.failure_share(reaching(bound), plan(), case=SMOOTH, islands=10, particles=200,
                                   length=10, seed=1, device=device)  # fmt: skip
        slack = 3.0 / math.sqrt(30_000 * counted)  # of the counted share
        assert found.low * (1.0 - slack) < counted < found.high * (1.0 + slack)
        assert found.high < 3.0 * found.share and found.worlds < 20_000
        again = slcp.sweep(reaching(bound), plan(), worlds=found.failing, seed=found.seed, cases=SMOOTH,
                           device=device)  # fmt: skip
        assert not again.part("policy")["success"].any()
    assert f"{found.share:.3g}" in str(found).splitlines()[0] and found.plain_worlds > 0.3 * found.worlds


@pytest.mark.full
@pytest.mark.parametrize("share", [1e-3, 1e-4])
def test_twenty_intervals_hold_a_million_worlds(device, share):
    """At least 17 of 20 hold the share that was counted, which is itself known to 3 or 10 %."""
    own = reaching(0.0).replace(measures={"x": m.final("block.x")})
    x = slcp.sweep(own, plan(), worlds=10**6, seed=99, cases=SMOOTH, device=device).part("policy")["x"]
    task_of = reaching(float(np.quantile(x, share)))
    found = [slcp.failure_share(task_of, plan(), case=SMOOTH, seed=s, device=device) for s in range(20)]
    held = sum(each.low <= share <= each.high for each in found)
    estimates = np.array([each.share for each in found])
    print(f"share {share:g}: {held} of 20 hold it; estimates {estimates.mean():.3g} +- {estimates.std():.2g},"
          f" {np.mean([each.worlds for each in found]):.0f} worlds each;"
          f" {np.mean([each.plain_worlds for each in found]):.0f} plain ones would say as much")  # fmt: skip
    assert held >= 17


def test_what_no_world_reaches_has_an_upper_bound(device):
    found = slcp.failure_share(reaching(-100.0), plan(), case=SMOOTH, islands=3, particles=40, length=10,
                               smallest=1e-3, device=device)  # fmt: skip
    assert found.share == found.low == 0.0 and 0.0 < found.high < 0.1 and found.failing is None
    assert np.isnan(found.spread)


def test_where_plain_worlds_fail_they_are_counted(device):
    """Islands that are all alike say nothing: where all worlds fail, nearly all may."""
    options = {"case": SMOOTH, "islands": 3, "particles": 40, "length": 10, "device": device}
    found = slcp.failure_share(reaching(100.0), plan(), **options)
    assert found.share == found.high == 1.0 and found.low == pytest.approx(share_interval(120, 120)[1])
    assert 0.9 < found.low < 1.0


@pytest.mark.parametrize("width", [2, 9])
def test_the_nearest_of_several_regions_is_found(width):
    """Balls at known distances, the nearest the smallest; and a wavy plane's nearest point."""
    centres, radii = np.zeros((3, width)), np.array([0.6, 2.2, 1.0])
    centres[0, 0], centres[1, -1], centres[2, :2] = 3.0, -4.0, 5.0

    def fails(y):
        return (np.linalg.norm(y[:, None] - centres, axis=2) < radii).any(axis=1)

    found = Search(fails, width, 2048, 0.125, 32.0).run(np.random.default_rng(1))
    assert fails(found.best).all() and 1.8 < np.linalg.norm(found.best[0]) < 1.8 * 1.01
    assert len(found.tried) == len(found.failed) and (fails(found.tried) == found.failed).all()
    thin = np.append(1.2, np.zeros(width - 1))  # too small for shells; known by chance

    def rarely(y):
        return fails(y) | (np.linalg.norm(y - thin, axis=1) < 0.02)

    known = Search(rarely, width, 2048, 0.125, 32.0).run(np.random.default_rng(1), thin[None])
    assert 1.18 < np.linalg.norm(known.best[0]) < 1.181 and len(known.tried) == len(known.failed)
    nothing = Search(lambda y: np.zeros(len(y), bool), width, 512, 0.1, 8.0).run(np.random.default_rng(0))
    assert len(nothing.best) == 0


def test_parts_that_fail_where_more_does_not_are_found():
    def fails(z):
        size = np.linalg.norm(z, axis=1)
        return (size > 3.0) | ((size > 1.0) & (size < 1.2))

    found = _smallest_parts(fails, np.array([[0.0, 4.0], [3.2, 0.0], [-3.1, 0.5]]))
    near = np.array([[-3.1, 0.5], [3.2, 0.0], [0.0, 4.0]]) * np.array([[21], [21], [17]]) / 64
    np.testing.assert_allclose(found, near, rtol=0, atol=1e-12)
    assert fails(found).all() and (np.diff(np.linalg.norm(found, axis=1)) >= 0.0).all()
    only = _smallest_parts(lambda z: np.abs(z[:, 0]) > 3.0, np.array([[3.01, 0.0]]))
    np.testing.assert_array_equal(only, [[3.01, 0.0]])


@pytest.mark.slow
def test_the_smallest_kick_fails_and_a_smaller_one_does_not(device):
    bound = 0.9 * float(_final(np.zeros((1, 4)), device)[0])
    own = reaching(bound)
    found = slcp.falsify(own, plan(), "kick", case=SMOOTH, worlds=512, strategies=3, device=device)
    kick = np.array([found.values[f"kick_0_{name}"][0] for name in SCENE.state_names[4:]])
    assert found.found and found.margin <= 0.0 and found.size == pytest.approx(np.linalg.norm(kick) / 0.05)
    assert _final(kick[None], device)[0] <= bound < _final(0.97 * kick[None], device)[0]
    rng = np.random.default_rng(0)
    others = rng.standard_normal((400, 4))
    others *= 0.97 * np.linalg.norm(kick) / np.linalg.norm(others, axis=1, keepdims=True)
    assert (_final(others, device) > bound).all()  # nothing smaller fails in any direction
    for dtype in ("float64", "float32"):
        report = slcp.sweep(found.scenario, plan(), worlds=2, cases=SMOOTH, dtype=dtype, device=device)
        assert not report.part("policy")["success"].any()
    assert found.drawn.shape == found.failing.shape == (4096,)
    run = found.replay(plan(), SMOOTH)
    assert run.measure(own.success).tolist() == [False]


@pytest.mark.slow
def test_what_was_found_is_told_from_the_largest_on():
    nothing = {"world": None, "scenario": None, "margin": -1.0, "status": slcp.Status.SOLVED, "most": 32.0,
               "rounds": 3, "by_gradient": 0, "by_draws": 0, "tried": 12345,
               "options": SMOOTH}  # fmt: skip
    values = {"a": (0.1, 0.5), "b": (-3.0, -2.0), "c": (1.0, 1.0)}
    drawn, failing = np.array([1.0, 2.5]), np.array([False, True])
    size = math.sqrt(5.25)
    told = str(Falsification(task(), size, values, drawn=drawn, failing=failing, **nothing)).splitlines()
    head = "fails from 2.291 standard deviations on; 50 % of worlds draw as much, in whatever direction"
    assert head in told[0] and [line.split()[0] for line in told[3:]] == ["b", "c", "a"]
    for size, text in ((0.0, "all that is drawn has its median"), (math.inf, "nothing up to 32 standard")):
        assert text in repr(Falsification(task(), size, {}, drawn=drawn, failing=failing, **nothing))
    nothing |= {"by": ("kick",), "left": ("start", "parameters")}
    told = repr(Falsification(task(), 2.0, {}, drawn=drawn, failing=failing, **nothing))
    assert "of task 'push' by kick, without start, parameters: fails from 2 standard deviations" in told


def test_what_was_found_is_a_task_of_its_own(device):
    """Factors, starts, pushes and dropouts, of every law, as numbers: run again, it fails again."""
    by = slcp.Disturbances(
        parameters={"mass": 0.1, "friction": slcp.Uniform(0.2, 0.6), "com": slcp.Uniform(-0.01, 0.01)},
        start={"block.vx": 0.1}, torque=1.0,
        pushes=(slcp.Push("block", slcp.Uniform(0.2, 0.4), 0.3, (slcp.Normal(3.0), 0.0), at=(0.0, 0.05)),),
        dropouts=(slcp.Dropout(0.5, slcp.LogNormal(0.5, median=0.1)),),
    )  # fmt: skip
    own = reaching(0.8 * float(_final(np.zeros((1, 4)), device)[0]))
    found = slcp.falsify(own, plan(), by, case=SMOOTH, worlds=256, rounds=6, device=device)
    assert found.found and set(found.values) > {
        "pusher.mass",
        "face/pusher.friction",
        "block.com_x",
        "block.vx",
        "push_0_start",
    }
    once = found.scenario
    assert once.disturbances.torque == 0.0
    drawn = slcp.draw_worlds(once, 3, device=device).numpy()
    for name in ("x0", "params", "pushes", "dropouts"):
        np.testing.assert_allclose(getattr(drawn, name)[:1], getattr(found.world.numpy(), name), rtol=1e-6)
        assert np.ptp(getattr(drawn, name), axis=0).max() == 0.0
    assert found.options == once.options == found.replay(plan()).options == SMOOTH
    report = slcp.sweep(once, plan(), worlds=1, cases=SMOOTH, device=device)
    assert not report.part("policy")["success"].any()


def _final(kicks: np.ndarray, device) -> np.ndarray:
    """Where the block ends after kicks at the beginning, by a plain rollout."""
    sim = slcp.Simulator(SCENE, SMOOTH, device=device)
    x0 = SCENE.x0 + np.concatenate([np.zeros_like(kicks), kicks], axis=1)
    return sim.rollout(x0, policy=plan(), steps=N).states[:, -1, SCENE.state_index("block.x")]


@pytest.mark.slow
def test_slopes_of_margins_are_differences(device):
    """By kicks and by parameters, under a plan with gains and under feedback of the state alone."""
    rng, scene = np.random.default_rng(4), slcp.scenes.NAMED["flicking_finger"]()
    gains, us = 0.3 * rng.standard_normal((20, 2, 6)), rng.standard_normal((20, 2))
    along = SimpleNamespace(us=us, xs=np.tile(scene.x0, (21, 1)), K=gains)
    own = slcp.Task(
        "turn", scene, slcp.costs.terms(scene, [slcp.costs.effort(1.0)]), 20, slcp.Options(scaling="none"),
        disturbances=slcp.Disturbances(
            parameters={"mass": 0.1}, follow={"link1.angle": {"link2.mass": 0.3}}, kick_times=(0.0,), kick=0.5
        ),
        success=(m.final("ellipse.angle") > 0.3) & (m.mean(m.cosine("link1.angle")) < 1.5),
    )  # fmt: skip
    sim = simulator("flicking_finger", device, scaling="none")
    numbers, judge = Numbers(sim, own, scene.step_size), Margin(own)
    judge.fit(rng.standard_normal((50, 2)))
    for policy in (ddp.TrackingPolicy(along), slcp.policies.Linear(gains[0], scene.x0, us[0])):
        loop = ClosedLoop(sim, own, policy)
        z = 0.5 * rng.standard_normal((1, numbers.dimension))
        step = 1e-4 * np.eye(numbers.dimension)
        up, down = (loop.margins(z + sign * step, numbers, judge)[0] for sign in (1.0, -1.0))
        slope = loop.margins(z, numbers, judge)[1][0]
        np.testing.assert_allclose(slope, (up - down) / 2e-4, rtol=1e-4, atol=1e-5 * np.abs(slope).max())
        assert np.abs(slope).max() > 0.01


@pytest.mark.parametrize(
    "given, text",
    [
        ({"islands": 1}, "islands is 1"),
        ({"particles": 30, "length": 20}, "at least two chains"),
        ({"smallest": 0.9}, "smallest"),
        ({"margin": "x"}, "margin is 'x'"),
        ({"case": "hard"}, "case is 'hard'"),
        ({"task": task(disturbances=slcp.Disturbances())}, "no disturbances"),
        ({"task": SCENE}, "task"),
    ],
)
def test_shares_that_cannot_be_estimated(given, text):
    with pytest.raises(slcp.InputError, match=text):
        slcp.failure_share(given.pop("task", task()), plan(), device="cpu", **given)


@pytest.mark.parametrize(
    "given, text",
    [
        ({"by": "mouse"}, "by is 'mouse'"),
        ({"by": 3}, "by is 3"),
        ({"time": 9.0}, "time is 9.0 s; a run"),
        ({"by": "push", "body": "mouse"}, "body"),
        ({"body": "block"}, "body is 'block', and by is 'kick'; it is for push"),
        ({"at": (0.0, 0.1)}, "at is .* and by is 'kick'"),
        ({"by": "parameters", "time": 0.1}, "time is 0.1, and by is 'parameters'; it is for kick and push"),
        ({"by": "push", "duration": float("nan")}, "duration is nan"),
        ({"duration": 0.2}, "duration is 0.2, and by is 'kick'; it is for push"),
        ({"most": 0.0}, "most"),
        ({"task": task(disturbances=slcp.Disturbances()), "by": "start"}, "disturbs nothing of this kind"),
        ({"task": task(success=None)}, "has no success"),
        ({"by": slcp.Disturbances()}, "nothing is disturbed"),
    ],
)
def test_searches_that_cannot_be_made(given, text):
    with pytest.raises(slcp.InputError, match=text):
        slcp.falsify(given.pop("task", task()), plan(), device="cpu", **given)
