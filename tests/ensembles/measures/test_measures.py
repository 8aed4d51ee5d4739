"""Measures of recorded worlds against what they are by hand; comparisons; what is refused."""

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import measures as m
from slcp_warp.measures.recorded import Recorded, checked_measures
from slcp_warp.measures.signals import Signal
from slcp_warp.scenes import push_block

H, N = 0.1, 40
T = H * np.arange(N + 1)
SCENE = push_block()
X, VX, TILT = (SCENE.state_index(name) for name in ("block.x", "block.vx", "block.angle"))


def recorded() -> Recorded:
    """Two worlds: x = t^2 and x = 1 - t; the block tilts as a sine; two corners push in a few steps."""
    states = np.zeros((2, N + 1, 2 * SCENE.nv))
    states[0, :, X], states[1, :, X] = T**2, 1.0 - T
    states[:, :, TILT] = np.sin(T)
    controls = np.stack([np.arange(N), -np.arange(N)])[:, :, None]
    impulse, gap = np.zeros((2, N, 3)), np.full((2, N, 3), np.inf)
    impulse[0, 10:15, 0], impulse[0, 12:20, 1], impulse[1, 3, 2] = 2.0, 1.0, 1e-7
    gap[0, 5:20, 0], gap[0, 7, 1] = 0.01, -0.002
    slip = np.zeros((2, N, 3))
    slip[0, 10:15, 0], slip[0, 12:20, 1] = -0.3, 0.2
    tangential = np.zeros((2, N, 3))
    tangential[0, 10:15, 0], tangential[0, 12:20, 1] = -0.5, 0.25
    return Recorded(SCENE, H, states, controls, impulse, gap, slip, tangential)


CASES = {
    "initial": (m.initial("block.x"), (0.0, 1.0)),
    "initial later": (m.initial("block.x", start=2.0), (4.0, -1.0)),
    "final": (m.final("block.x"), (16.0, -3.0)),
    "final before": (m.final("block.x", end=1.0), (0.81, 0.1)),
    "by place": (m.final(X), (16.0, -3.0)),
    "difference": (
        m.final(m.state("block.x", minus="block.angle")),
        (16.0 - np.sin(4.0), -3.0 - np.sin(4.0)),
    ),
    "cosine": (m.final(m.cosine("block.x")), (np.cos(16.0), np.cos(3.0))),
    "rate": (m.rate("block.x"), (4.0, -1.0)),
    "rate of a window": (m.rate("block.x", 1.0, 3.05), (4.0, -1.0)),
    "rate of one value": (m.rate("block.x", 1.0, 1.05), (0.0, 0.0)),
    "mean": (m.mean("block.x"), (np.mean(T[:-1] ** 2), np.mean(1.0 - T[:-1]))),
    "integral": (m.integral("block.x"), (H * np.sum(T[:-1] ** 2), H * np.sum(1.0 - T[:-1]))),
    "total of a control": (m.total(m.control("pusher.shift")), (N * (N - 1) / 2, -N * (N - 1) / 2)),
    "largest": (m.largest("block.x"), (16.0, 1.0)),
    "largest control": (m.largest(m.control(0)), (N - 1, 0.0)),
    "smallest": (m.smallest("block.x", end=2.0), (0.0, 1.0 - 1.9)),
    "share of time": (m.share_of_time(m.state("block.x") > 0.995), ((N - 10) / N, 1 / N)),
    "first time": (m.first_time(m.state("block.x") < -0.95), (np.inf, 2.0)),
    "first time of a window": (m.first_time(m.state("block.x") > 0.5, start=2.0), (2.0, np.inf)),
    "settled": (m.settled(m.state("block.angle") < 0.0), (3.2, 3.2)),
    "settled at once": (m.settled(m.time() < 9.0), (0.0, 0.0)),
    "never settled": (m.settled(m.state("block.angle") > 0.0), (np.inf, np.inf)),
    "count": (m.count(m.state("block.angle") > 0.5), (1.0, 1.0)),
    "count of contacts": (m.count(m.contact(SCENE.pair_names[0]) > 0.5), (1.0, 0.0)),
    "count of what holds at once, and at the end": (
        m.count((m.time() < 0.5) | (m.time().between(0.95, 1.45)) | (m.time() > 3.95)),
        (3.0, 3.0),
    ),
    "count in a window": (m.count(m.time() < 1.5, start=1.0), (1.0, 1.0)),
    "count of nothing": (m.count(m.time() > 90.0), (0.0, 0.0)),
    "and": (m.share_of_time((m.state("block.x") > 1.1) & (m.time() < 1.95)), (9 / N, 0.0)),
    "or": (m.first_time((m.state("block.x") > 8.9) | (m.time() > 2.45)), (2.5, 2.5)),
    "contact share": (m.contact_share(), (10 / N, 0.0)),
    "contact share of a pair": (m.contact_share(SCENE.pair_names[0]), (5 / N, 0.0)),
    "lowest gap": (m.lowest_gap(), (-0.002, np.inf)),
    "lowest gap of a pair": (m.lowest_gap(SCENE.pair_names[0]), (0.01, np.inf)),
    "impulse": (m.impulse(), (5 * 2.0 + 8 * 1.0, 1e-7)),
    "impulse of a pair": (m.impulse(1), (8.0, 0.0)),
    "change": (m.change("block.x", end=1.0), (0.81, -0.9)),
    "absolute": (m.smallest(abs(m.state("block.x"))), (0.0, 0.0)),
    "largest absolute": (m.largest(abs(m.state("block.angle"))), (np.abs(np.sin(T)).max(),) * 2),
    "excursion": (m.excursion("block.x", end=2.05), (4.0, 2.0)),
    "excursion of a difference": (
        m.excursion(m.state("block.x", minus="block.angle")),
        (np.abs(T**2 - np.sin(T)).max(), np.abs(T + np.sin(T)).max()),
    ),
    "rms": (m.rms("block.x"), (np.sqrt(np.mean(T[:-1] ** 4)), np.sqrt(np.mean((1.0 - T[:-1]) ** 2)))),
    "rms of what is absolute, where": (
        m.rms(abs(m.state("block.x")), 1.0, where=m.time() < 1.45),
        (np.sqrt(np.mean(T[10:15] ** 4)), np.sqrt(np.mean((1.0 - T[10:15]) ** 2))),
    ),
    "mean where": (m.mean("block.x", where=m.time() < 0.95), (np.mean(T[:10] ** 2), np.mean(1.0 - T[:10]))),
    "mean where it never holds": (m.mean("block.x", where=m.time() > 9.0), (np.nan, np.nan)),
    "sum where it never holds": (m.integral("block.x", where=m.time() > 9.0), (0.0, 0.0)),
    "final where": (m.final("block.x", where=m.contact(0) > 0.5), (1.4**2, np.nan)),
    "largest where one of two": (
        m.largest("block.x", 1.0, where=(m.contact(0) > 0.5) | (m.state("block.x") < -2.45)),
        (1.4**2, -2.5),
    ),
    "count where": (m.count(m.state("block.angle") > 0.5, where=m.time() > 0.95), (1.0, 1.0)),
    "share where": (m.share_of_time(m.contact(1) > 0.5, where=m.contact() > 0.5), (0.8, np.nan)),
    "first time where": (m.first_time(m.time() > 0.5, where=m.contact(1) > 0.5), (1.2, np.inf)),
    "rate where": (m.rate("block.x", where=m.since_start("block.x") < -1.95), (np.nan, -1.0)),
    "impulse where": (m.impulse(where=m.time() > 1.25), (2.0 * 2 + 7.0, 0.0)),
    "contact share of a window where": (m.contact_share(0, 1.0, 1.25, m.contact() > 0.5), (1.0, np.nan)),
    "lowest gap where": (m.lowest_gap(where=m.contact(0) > 0.5), (0.01, np.nan)),
    "impulse of a body": (m.impulse("block"), (18.0, 1e-7)),
    "impulse of two bodies": (m.impulse("pusher/block"), (0.0, 1e-7)),
    "force": (m.largest(m.normal_force("block")), (30.0, 1e-6)),
    "friction": (m.total(m.tangential_impulse("ground/block")), (-2.5 + 2.0, 0.0)),
    "friction force": (m.smallest(m.tangential_force()), (-5.0, 0.0)),
    "slip": (m.largest(abs(m.slip())), (0.3, 0.0)),
    "slip of the fastest": (m.final(m.slip("ground/block"), end=1.3), (-0.3, 0.0)),
    "slid": (m.integral(abs(m.slip("ground/corner1"))), (8 * H * 0.2, 0.0)),
    "since the start": (m.first_time(m.since_start("block.x") < -0.95), (np.inf, 1.0)),
}


@pytest.mark.parametrize("name", CASES)
def test_measures_are_what_they_say(name):
    measure, expected = CASES[name]
    np.testing.assert_allclose(recorded().value(measure), expected, rtol=1e-12, atol=1e-12)


def test_a_measure_prints_as_what_makes_it():
    names = {name: getattr(m, name) for name in m.__all__}
    for measure, _ in CASES.values():
        assert eval(repr(measure), names) == measure, measure
    assert repr(m.excursion("block.x", 1.0)) == "excursion('block.x', start=1)"


def test_every_world_has_its_own_times():
    worlds = recorded()
    slow = Recorded(SCENE, [H, 2.0 * H], worlds.states)
    np.testing.assert_allclose(slow.value(m.rate("block.x")), [4.0, -0.5], rtol=1e-12)
    np.testing.assert_allclose(slow.value(m.final(m.time())), [4.0, 8.0], rtol=1e-12)


def test_success_joins_comparisons():
    far, slow = m.final("block.x") > 10.0, m.rate("block.x").between(-2.0, 0.0)
    worlds = recorded()
    for success, expected in ((far, (1, 0)), (slow, (0, 1)), (far & slow, (0, 0)), (far | slow, (1, 1))):
        assert worlds.success(success).tolist() == [bool(each) for each in expected]
    both = (far | slow) & (m.final("block.x") < 10.0)
    assert worlds.success(both).tolist() == [False, True] and len(both.parts()) == 2
    nothing = m.mean("block.x", start=100.0) > 0.0  # no step counts: NaN is no success
    assert worlds.success(nothing | (m.mean("block.x", start=100.0) < 1.0)).tolist() == [False, False]


def test_infinite_values_keep_to_the_bounds_there_are():
    """A time that nothing reaches is later than any, and no time within bounds; NaN keeps to none."""
    never = m.first_time(m.state("block.x") > 1e6)
    worlds = recorded()
    assert np.isinf(worlds.value(never)).all()
    for success, expected in (
        (never > 0.5, True),
        (never < 0.5, False),
        (never.between(0.5, 9.0), False),
        ((never > 0.5) & (m.final("block.x") < 1e6), True),
    ):
        assert worlds.success(success).tolist() == [expected] * 2
    value = np.array([-np.inf, 0.0, np.inf, np.nan])
    above, below = (never > 0.0).parts(), (never < 0.0).parts()
    assert (never > 0.0).holds({above[0]: value}).tolist() == [False, False, True, False]
    assert (never < 0.0).holds({below[0]: value}).tolist() == [True, False, False, False]


SHORT = np.zeros((1, 3, 2 * SCENE.nv))


@pytest.mark.parametrize(
    "make, kind, text",
    [
        (lambda: m.final(1.5), slcp.ArgumentTypeError, "final is of 1.5"),
        (lambda: m.final(True), slcp.ArgumentTypeError, "final is of True"),
        (lambda: m.settled("block.x"), slcp.ArgumentTypeError, "a comparison of a signal is needed"),
        (lambda: m.largest(m.time() > 1.0), slcp.ArgumentTypeError, "largest is of"),
        (
            lambda: 0.0 < m.final(0) < 1.0,
            slcp.ArgumentTypeError,
            r"& and \|, .*between two bounds is .between",
        ),
        (
            lambda: (m.final(0) > 0.0) and (m.final(1) > 0.0),
            slcp.ArgumentTypeError,
            "with & and",
        ),
        (lambda: (m.final(0) > 0.0) & (m.state(0) > 0.0), slcp.ArgumentTypeError, "& joins success and"),
        (lambda: m.final(0).between(2.0, 1.0), slcp.ArgumentError, "low 2.0 and high 1.0"),
        (lambda: m.final(0) > "far", slcp.InputError, "the bound of >"),
        (lambda: m.mean(0, start=-1.0), slcp.InputError, "start"),
        (lambda: m.mean(0, start=2.0, end=1.0), slcp.InputError, "end"),
        (lambda: m.mean(0, where="contact"), slcp.ArgumentTypeError, "where is 'contact'; a comparison of a"),
        (
            lambda: m.final(Signal("gap", 0, minus=1)),
            slcp.ArgumentError,
            "minus of a gap is 1; it is of state",
        ),
        (lambda: m.excursion(m.slip()), slcp.ArgumentError, "since_start is of a slip"),
        (
            lambda: recorded().value(m.impulse("blok")),
            slcp.ArgumentError,
            "'blok', no pair, body or shape; there are ground/corner0, ground/corner1, face/pusher$",
        ),
        (lambda: m.contact(1.5), slcp.ArgumentTypeError, "pair is 1.5"),
        (lambda: m.function(3), slcp.ArgumentTypeError, "f is 3"),
        (lambda: m.excursion(m.gap()), slcp.ArgumentError, "since_start is of a gap; of state, cosine"),
        (lambda: m.since_start(abs(m.state("x"))), slcp.ArgumentError, r"abs\(since_start\(...\)\) is what"),
        (lambda: m.since_start(1.5), slcp.ArgumentTypeError, "which is 1.5"),
        (
            lambda: recorded().value(m.final("block.z")),
            slcp.ArgumentError,
            "'block.z'; there are",
        ),
        (lambda: recorded().value(m.impulse("a/b")), slcp.ArgumentError, "contact pair is 'a/b'"),
        (lambda: Recorded(SCENE, H, SHORT).value(m.impulse()), slcp.ArgumentError, "not recorded"),
        (lambda: Recorded(SCENE, H, SHORT[..., 1:]), slcp.ArgumentError, "states has shape"),
        (lambda: Recorded(SCENE, H, SHORT[:, :1]), slcp.ArgumentError, "at least one step"),
        (lambda: checked_measures([m.final(0)]), slcp.ArgumentTypeError, "a dict of measures"),
        (
            lambda: checked_measures({"a\nb": m.final(0)}),
            slcp.ArgumentTypeError,
            r"measures has the name 'a\\nb'; a text of printable characters",
        ),
        (lambda: checked_measures({"x": m.state(0)}), slcp.ArgumentTypeError, r"measures\['x'\] is"),
    ],
)
def test_what_is_no_measure_is_refused(make, kind, text):
    with pytest.raises(kind, match=text):
        make()


@pytest.mark.parametrize("restitution", [None, 0.5])
def test_two_shapes_that_touch_in_several_places_are_one_by_their_names(restitution):
    """In own kernels, in generic ones and on what was recorded."""
    shapes = (slcp.Shape("ground", None, "halfplane", angle=np.pi / 2),
              slcp.Shape("bar", "bar", "capsule", (0.05, 0.2)),
              slcp.Shape("lid", None, "halfplane", angle=-np.pi / 2, offset=(0.0, 5.0)))  # fmt: skip
    contacts = (slcp.Contact("lid", "bar"), slcp.Contact("ground", "bar", restitution=restitution))
    bodies = (slcp.Body("bar", 1.0, 0.01, joint="free"),)
    scene = slcp.Scene(
        "bar", bodies, shapes, contacts, actuators=(slcp.Actuator("bar", 0, 1.0),), step_size=0.01
    )
    assert scene.pair_names[2:] == ("ground/bar(-)", "ground/bar(+)")
    assert scene.pairs_of("bar/ground") == (2, 3)
    asked = {
        "one": m.impulse("ground/bar(+)"),
        "other": m.impulse(3),
        "both": m.impulse("ground/bar"),
        "turned": m.impulse("bar/ground"),
        "all": m.impulse(),
        "lid": m.impulse("lid/bar"),
        "low": m.lowest_gap("ground/bar"),
        "high": m.lowest_gap("lid/bar"),
        "touches": m.contact_share("ground/bar"),
    }
    x0 = (0.0, 0.1, 0.05, 0.0, -1.0, 0.0)
    task = slcp.Task("bar", scene, start=x0, duration=0.4, measures=asked)
    found = slcp.sweep(task, slcp.policies.Linear(np.zeros((1, 6)), np.zeros(6), [0.0]), worlds=1).table
    run = slcp.Simulator(scene).rollout(np.array(x0), np.zeros((40, 1)), record=("impulse", "gap"))
    for name, measure in asked.items():
        np.testing.assert_allclose(found[name][0], run.measure(measure), rtol=2e-4, atol=1e-6, err_msg=name)
    assert found["one"][0] > 0.1 and found["other"][0] > 0.1 and found["lid"][0] == 0.0
    assert abs(found["both"][0] - found["one"][0] - found["other"][0]) < 1e-4 * found["both"][0]
    with pytest.raises(slcp.ArgumentError, match="contact pair is 'ground/bat'"):
        m.impulse("ground/bat").of.place(scene)
