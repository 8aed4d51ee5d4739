"""Policies on the host that feel contacts: what they are told, in rollouts and sweeps, and a guarded move."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import measures as m
from slcp_warp import policies
from slcp_warp.ensembles.worlds.nominal import nominal
from slcp_warp.inputs.errors import ArgumentError, ArgumentTypeError
from slcp_warp.policies import Callback, Estimated, KalmanFilter, Sensor

H, STEPS = 0.01, 60
PROBE = slcp.Scene(  # a probe on a rail before a wall, whose place is drawn
    "probe",
    bodies=(slcp.Body("probe", 0.5, 0.01, joint="prismatic", damping=1.0),),
    shapes=(
        slcp.Shape("tip", "probe", "disc", 0.02),
        slcp.Shape("wall", None, "halfplane", offset=(0.2, 0.0), angle=np.pi),
    ),
    contacts=(slcp.Contact("tip", "wall"),),
    actuators=(slcp.Actuator("probe"),),
    gravity=(0.0, 0.0),
    step_size=H,
)
TWO = slcp.Scene(  # two pucks in a row on a floor: kernels for any scene
    "two pucks",
    bodies=(slcp.Body("one", 0.5, 0.01, joint="free"), slcp.Body("two", 0.4, 0.01, joint="free")),
    shapes=(
        slcp.Shape("one", "one", "disc", 0.1),
        slcp.Shape("two", "two", "disc", 0.1),
        slcp.Shape("floor", None, "halfplane", angle=np.pi / 2),
    ),
    contacts=(
        slcp.Contact("floor", "one", friction=0.4),
        slcp.Contact("floor", "two", friction=0.3),
        slcp.Contact("one", "two", friction=0.2),
    ),
    actuators=(slcp.Actuator("one", 0),),
    tendons=(slcp.Tendon("band", ("one.x", "two.x"), (1.0, -1.0), stiffness=20.0, length=-0.3),),
    step_size=H,
)
OF_TWO = {
    "load": m.normal_force("floor/two"),
    "hit": m.contact("one/two"),
    "gap": m.gap("one/two"),
    "slip": m.slip("floor/one"),
    "band": m.tendon_force("band"),
    "rub": 2.0 * m.tangential_impulse("floor/one") + m.tangential_impulse("floor/two"),
}
PUSH = policies.Callback(lambda x, time: np.full((len(x), 1), 6.0))


class Told:
    """Pushes, and keeps what it is told."""

    def __init__(self, senses, period=None, push=6.0):
        self.senses, self.period, self.push, self.runs = senses, period, push, []

    def begin(self, sim, worlds):
        self.runs.append([])

    def feel(self, shown):
        self.runs[-1].append(shown)

    @property
    def kept(self):
        """Of the run with most worlds."""
        return max(self.runs, key=lambda run: len(run[0][next(iter(self.senses))]))

    def act(self, x, time, worlds):
        return np.full((len(x), 1), self.push)

    def felt(self, name):
        return np.stack([shown[name] for shown in self.kept], axis=1)


def simulator(scene, **options):
    return slcp.Simulator(scene, slcp.Options("hard", **options), device="cpu", dtype="float64")


def starts():
    rows = np.tile(TWO.state({"one.y": 0.1, "two.x": 0.3, "two.y": 0.1}), (3, 1))
    rows[1:, 1] += [0.05, 0.2]
    return rows


@pytest.mark.parametrize("scene", [PROBE, TWO])
def test_a_rollout_tells_what_it_records_a_step_later(scene):
    sim = simulator(scene, friction="coulomb")
    senses = {"wall": m.normal_force("tip/wall"), "gap": m.gap()} if scene is PROBE else OF_TWO
    x0 = np.array([[0.1, 0.0], [0.15, 1.0], [0.18, 0.0]]) if scene is PROBE else starts()
    policy = Told(senses)
    run = sim.rollout(x0, policy=policy, steps=STEPS, record=("controls", "impulse", "gap"))
    assert not run.status.any() and list(policy.kept[0]) == list(senses)
    for name, signal in senses.items():
        felt = policy.felt(name)
        assert np.isnan(felt[:, 0]).all() and felt.shape == (3, STEPS)
        np.testing.assert_allclose(felt[:, 1:], run.series(signal)[:, : STEPS - 1], rtol=0, atol=1e-12)
        assert np.ptp(felt[:, 1:]) > 0.0, name


def task(scene, **changes):
    x0 = np.zeros(2) if scene is PROBE else starts()[1]
    fields = {
        "name": "felt", "scene": scene, "duration": STEPS * H, "start": x0,
        "options": slcp.Options("hard", friction="coulomb"), "success": m.final(0) < 9.0,
    }  # fmt: skip
    return slcp.Task(**(fields | changes))


@pytest.mark.parametrize("scene", [PROBE, TWO])
def test_a_sweep_tells_what_a_rollout_does(scene):
    senses = {"wall": m.normal_force("tip/wall"), "gap": m.gap()} if scene is PROBE else OF_TWO
    state = "probe.vshift" if scene is PROBE else "one.vx"
    of = task(scene, disturbances=slcp.Disturbances(start={state: 0.5}))
    worlds = slcp.draw_worlds(of, 6, seed=2, dtype="float64", device="cpu")
    policy, chosen = Told(senses), {"dtype": "float64", "device": "cpu"}
    swept = slcp.sweep(of, policy, worlds=worlds, cases=of.options, **chosen)
    told = {name: policy.felt(name) for name in senses}
    sim = of.simulator(**chosen)
    run = sim.rollout(
        np.asarray(worlds.x0), policy=Told(senses), steps=STEPS, record=("controls", "impulse", "gap")
    )
    assert swept.part("policy")["success"].all()
    for name, signal in senses.items():
        assert np.isnan(told[name][:, 0]).all()
        np.testing.assert_allclose(told[name][:, 1:], run.series(signal)[:, : STEPS - 1], rtol=0, atol=1e-10)


def test_own_measures_and_chunks_change_nothing():
    """What is felt is no column of a report, whatever measures are asked for beside it."""
    of = task(PROBE, measures={"push": m.largest(m.normal_force("tip/wall"))},
              disturbances=slcp.Disturbances(start={"probe.vshift": 0.5}))  # fmt: skip
    chosen = {"worlds": 10, "seed": 1, "dtype": "float64", "device": "cpu", "cases": of.options}
    felt, plain = guarded(), guarded()
    one = slcp.sweep(of, felt, **chosen).table
    parts = slcp.sweep(of, plain, chunk=3, **chosen).table
    assert list(one) == list(slcp.sweep(of, PUSH, **chosen).table)
    for name in ("push", "success"):
        np.testing.assert_array_equal(one[name], parts[name])


def guarded(least=0.5):
    """Moves on until it feels the wall, then presses gently."""

    def control(x, time, felt):
        touched = felt["wall"] > least
        return np.where(touched, 2.0, 4.0 * (0.2 - x[:, 1]))[:, None]

    return Callback(control, senses={"wall": m.normal_force("tip/wall")})


def test_a_guarded_move_finds_a_wall_that_nobody_knows():
    """A wall anywhere in 10 cm: feeling it, the probe ends pressing by 2 N; blind it pushes on."""
    of = task(
        PROBE, duration=2.0, success=m.final(m.normal_force("tip/wall")).between(1.5, 2.5),
        disturbances=slcp.Disturbances(parameters={"wall.shape_offset_x": slcp.Uniform(0.1, 0.2)}),
    )  # fmt: skip
    blind = Callback(lambda x, time: 4.0 * (0.2 - x[:, 1:2]))
    found = slcp.sweep(of, {"feels": guarded(), "blind": blind}, worlds=50, dtype="float64", device="cpu")
    share = {name: found.part(name, arm="disturbed")["success"].mean() for name in ("feels", "blind")}
    assert share == {"feels": 1.0, "blind": 0.0}


def test_delay_hold_noise_and_limits_keep_what_is_felt():
    of = task(
        PROBE, control_limits=(-1.0, 1.0),
        disturbances=slcp.Disturbances(delay=2 * H, hold=3 * H, sensor=0.01, start={"probe.vshift": 0.2}),
    )  # fmt: skip
    policy = Told({"wall": m.normal_force("tip/wall")}, push=9.0)
    slcp.sweep(of, policy, worlds=4, seed=1, dtype="float64", device="cpu", cases=of.options)
    assert policy.felt("wall").shape[1] == STEPS // 3
    drawn = slcp.draw_worlds(of, 4, seed=1, dtype="float64", device="cpu")
    run = slcp.replay(of, Told(policy.senses, push=9.0), drawn, seed=1, record=("controls", "impulse"),
                      dtype="float64", device="cpu")  # fmt: skip
    own = run.series(policy.senses["wall"])
    np.testing.assert_allclose(policy.felt("wall")[:, 1:], own[:, 2 : STEPS - 1 : 3], rtol=0, atol=1e-12)
    assert policy.felt("wall")[:, -1].min() == pytest.approx(1.0, abs=1e-6)


def test_a_period_is_told_of_its_last_step():
    sim, policy = simulator(PROBE), Told({"wall": m.normal_force("tip/wall")}, period=4 * H)
    run = sim.rollout(np.array([[0.17, 0.4]]), policy=policy, steps=STEPS, record=("controls", "impulse"))
    own = run.series(policy.senses["wall"])
    np.testing.assert_allclose(policy.felt("wall")[:, 1:], own[:, 3 : STEPS - 1 : 4], rtol=0, atol=1e-12)


def test_an_estimate_is_told_of_forces_too():
    """Pressed on a wall whose place is known, a load cell alone tells where the probe is, and how fast."""
    sensors = {"load": Sensor(m.normal_force("tip/wall"), 0.02)}
    sim = simulator(PROBE)
    start = {"probe.shift": 0.002, "probe.vshift": 0.02}
    filter = KalmanFilter(sim, sensors, 0.01, start, x0=(0.175, 0.3))
    policy = Estimated(policies.Linear(np.zeros((1, 2)), [0.0, 0.0], [3.0]), filter, keep=True)
    x0 = np.array([0.175, 0.3]) + [0.002, 0.02] * np.random.default_rng(0).normal(size=(40, 2))
    run = sim.rollout(x0, policy=policy, steps=30, record=("controls", "impulse"))
    before, after = policy.kept[0][1], policy.kept[-1][1]
    np.testing.assert_allclose(before.mean, np.tile([0.175, 0.3], (40, 1)))
    off = np.abs(after.mean - run.states[:, 29])
    sd = np.sqrt(np.diagonal(after.covariance, axis1=1, axis2=2))
    assert (off < 4.5 * sd + 1e-9).all() and off[:, 0].max() < 2e-3 and sd[:, 0].max() < 2e-3
    assert list(policy.senses) == ["load"]


@pytest.mark.parametrize(
    "senses, error, text",
    [
        (
            {"x": m.state("probe.shift")},
            ArgumentTypeError,
            r"policy.senses\['x'\] is .*; a sig",
        ),
        ({"x": 3.0}, ArgumentTypeError, r"policy.senses\['x'\] is 3.0; a signal of contacts or tendons"),
        ([m.contact()], ArgumentTypeError, "policy.senses is .*; a dict of signals by name"),
        ({"x": m.normal_force("tip/lid")}, ArgumentError, "'tip/lid'"),
        ({"x": m.contact() * m.time()}, ArgumentError, r"\['x'\] is .*, with time\(\); contacts and"),
        ({"x": m.contact() + m.state("probe.shift")}, ArgumentError, r"with state\('probe.shift'\); con"),
    ],
)
def test_errors_name_what_came(senses, error, text):
    for asks in (
        lambda: simulator(PROBE).rollout(np.zeros((1, 2)), policy=Told(senses), steps=3),
        lambda: slcp.sweep(task(PROBE), Told(senses), worlds=2, device="cpu", dtype="float64"),
    ):
        with pytest.raises(error, match=text):
            asks()


def test_who_cannot_feel_says_so():
    class Numb:
        senses = {"wall": m.normal_force("tip/wall")}

        def act(self, x, time, worlds):
            return np.zeros(1)

    with pytest.raises(ArgumentTypeError, match="policy is a Numb with senses; it needs a method `feel`"):
        simulator(PROBE).rollout(np.zeros((1, 2)), policy=Numb(), steps=3)
    filter = KalmanFilter(simulator(PROBE), {"probe.shift": 0.01}, 0.1)
    with pytest.raises(ArgumentError, match="policy is a Told with senses, behind another one"):
        simulator(PROBE).rollout(np.zeros((1, 2)), policy=Estimated(Told(Numb.senses), filter), steps=3)
    with pytest.raises(ArgumentTypeError, match="f is .*; it must take 3 arguments"):
        Callback(lambda x, time: x, senses=Numb.senses)


def test_a_policy_behind_a_hold_feels_when_it_is_asked():
    """In rollouts of a task, too, whose hold and limits are around it: not in steps in between."""
    of = task(PROBE, control_limits=(-1.0, 1.0), disturbances=slcp.Disturbances(hold=4 * H, delay=2 * H))
    policy = Told({"wall": m.normal_force("tip/wall")})
    around = nominal(policy, of, H)
    of.simulator(dtype="float64", device="cpu").rollout(np.zeros((1, 2)), policy=around, steps=STEPS)
    assert len(policy.kept) == STEPS // 4


def test_a_world_that_fails_ends_no_other():
    scene = replace(
        PROBE,
        shapes=(*PROBE.shapes, slcp.Shape("lid", None, "halfplane", offset=(0.1, 0.0))),
        contacts=(*PROBE.contacts, slcp.Contact("tip", "lid")),
    )
    sim = simulator(scene)
    offset = np.zeros((2, 3, 2))
    offset[:, 1:, 0] = [[0.2, 0.1], [0.16, 0.15]]  # no room in the second
    params = sim.params.replace(shape_offset=offset)

    def press(x, time, felt):
        return np.full((len(x), 1), 1.0) if time == 0.0 else 1.0 + 0.1 * felt["wall"][:, None]

    policy = Callback(press, senses={"wall": m.normal_force("tip/wall")})
    run = sim.rollout(np.tile([0.15, 0.0], (2, 1)), policy=policy, steps=STEPS, params=params)
    assert run.status[0] == 0 and run.status[1] != 0


def test_one_callback_in_several_threads_feels_its_own_run():
    def control(x, time, felt):
        assert len(felt["wall"]) == len(x)
        return np.zeros((len(x), 1))

    policy, sim = Callback(control, senses={"wall": m.normal_force("tip/wall")}), simulator(PROBE)
    with ThreadPoolExecutor(4) as pool:
        runs = [pool.submit(sim.rollout, np.zeros((n, 2)), policy=policy, steps=STEPS) for n in range(1, 9)]
        assert all(not each.result().status.any() for each in runs)
