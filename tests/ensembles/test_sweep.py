"""Sweeps: the same numbers whatever the split, worlds as asked for, honest statistics, bounded memory."""

import math
import warnings

import numpy as np
import pytest
import scipy.stats
import sweeps
import warp as wp
from sweeps import FINGER, drawn, run, sweep_of

import slcp_warp as slcp
from slcp_warp import Status
from slcp_warp.ensembles import launch as launches
from slcp_warp.ensembles import run_worlds, statistics, summary
from slcp_warp.ensembles.statistics.intervals import quantile_ranks, shares_interval
from slcp_warp.ensembles.sweep import sweep_scene, task_of
from slcp_warp.ensembles.worlds import draws
from slcp_warp.kernels.device import launch as launching


def assert_equal(a, b, rows=slice(None)):
    for name, column in a.table.items():
        np.testing.assert_array_equal(column, b.table[name][rows], err_msg=name)
    for mine, other in zip(a.samples, b.samples, strict=True):
        np.testing.assert_array_equal(mine, other[rows])


BUSY = {"torque_sd": 0.5, "kick_times": (0.5, 1.0), "parameter_sd": {"mass": 0.2, "friction": 0.3}}


@pytest.mark.parametrize("chunk", [1, 7, 40, 1000])
def test_the_split_into_chunks_changes_nothing(device, chunk):
    assert_equal(run(device, **BUSY), run(device, chunk=chunk, **BUSY))


def test_the_way_of_before_there_were_tasks_says_so():
    """... where it is called; the paper's commands have it from below."""
    with pytest.warns(DeprecationWarning, match="give a slcp.Task") as told:
        found = run(worlds=1)
    assert told[0].filename == sweeps.__file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert_equal(
            found, sweep_scene(FINGER, sweeps.idle(), sweeps.spec(worlds=1), device="cpu", **sweeps.OPTIONS)
        )


@pytest.mark.parametrize("threads", [1, 3])
def test_the_number_of_threads_changes_nothing(monkeypatch, threads):
    before = run(**BUSY)
    monkeypatch.setattr(launching, "_default_threads", threads)
    assert_equal(before, run(**BUSY))


def test_more_worlds_begin_with_the_same_ones(device):
    assert_equal(run(device, worlds=15, **BUSY), run(device, **BUSY), slice(0, 15))


def test_another_seed_gives_other_worlds(device):
    assert (run(device).samples[0][:, -1] != run(device, seed=4).samples[0][:, -1]).all()


def test_parameters_vary_as_asked(device):
    worlds, sd = 20_000, 0.2
    columns, _, base = drawn(
        device, worlds, parameter_sd={"mass": sd, "inertia": sd, "friction": 0.1, "radius": sd}
    )
    factor = np.log(columns["mass"] / np.ravel(base["mass"]))
    np.testing.assert_allclose(factor.mean(axis=0), 0.0, atol=4.5 * sd / math.sqrt(worlds))
    np.testing.assert_allclose(factor.std(axis=0), sd, rtol=4.5 / math.sqrt(2 * worlds))
    assert (scipy.stats.kstest(factor / sd, "norm").pvalue > 1e-4).all()
    assert np.abs(np.corrcoef(factor.T) - np.eye(3)).max() < 4.5 / math.sqrt(worlds), "bodies vary together"
    np.testing.assert_allclose(columns["inertia"] / np.ravel(base["inertia"]), np.exp(factor), rtol=1e-5)
    radius = (columns["radius"] / np.ravel(base["radius"])).reshape(worlds, -1, 2)
    np.testing.assert_allclose(radius[..., 0], radius[..., 1], rtol=1e-5)  # a shape keeps its proportions
    assert abs(np.log(columns["friction"] / 0.5).std() - 0.1) < 0.01
    for name in ("step_size", "damping", "gravity", "com", "sigma"):
        np.testing.assert_array_equal(columns[name], np.broadcast_to(columns[name][:1], columns[name].shape))


def test_starts_vary_as_asked(device):
    start = np.stack([FINGER.x0, FINGER.x0 + [0, 0, 50.0, 0, 0, 0]])
    _, x0, _ = drawn(device, 20_000, start=start, position_sd=0.3, velocity_sd=2.0)
    second = x0[:, 2] > 25.0
    assert abs(second.mean() - 0.5) < 4.5 * 0.5 / math.sqrt(len(x0))
    deviation = x0 - start[second.astype(int)]
    np.testing.assert_allclose(deviation.mean(axis=0), 0.0, atol=0.1)
    np.testing.assert_allclose(deviation.std(axis=0), [0.3] * 3 + [2.0] * 3, rtol=0.03)
    assert np.abs(np.corrcoef(deviation.T) - np.eye(6)).max() < 0.04


def test_kicks_come_at_their_times_and_sizes(device):
    """The observed rate of the free ellipse: nothing before a kick, then the kick less drag."""
    h, kick_sd = 0.05, 0.5  # small: the finger stays away
    quiet = {
        "worlds": 4000,
        "velocity_sd": 0.0,
        "observe": 5,
        "sample_every": h,
        "duration": 0.4,
        "window": h,
    }
    plain = run(device, **quiet).samples[0]
    kicked = run(device, kick_times=(0.1, 0.25), kick_sd=kick_sd, **quiet).samples[0]
    change = (kicked - plain).astype(float)
    assert not change[:, :3].any()  # samples at 0, .05 and .1 s, the last one just before the kick
    keep = 1.0 - h * 0.7 / FINGER.bodies[2].inertia
    assert abs(change[:, 3].std() / (kick_sd * keep) - 1.0) < 0.05
    assert abs(change[:, 3].mean()) < 4.5 * kick_sd / math.sqrt(len(change))
    growth = change[:, 1:] - keep * change[:, :-1]
    early = np.abs(growth[:, [3, 4]]).max()  # between the kicks: drag only (the finger is far away at first)
    assert early < 1e-4 and abs(growth[:, 5].std() / (kick_sd * keep) - 1.0) < 0.05
    assert abs(np.corrcoef(change[:, 3], growth[:, 5])[0, 1]) < 4.5 / math.sqrt(len(change))


def test_failures_are_counted_by_status(device):
    start = np.stack([FINGER.x0, FINGER.x0 + [0, 0, 0, 3e37, -3e37, 3e37]])
    report = run(device, worlds=60, start=start)
    status = report.table["status"]
    statuses = report.cases[0]["statuses"]
    assert 10 < (status != Status.SOLVED).sum() < 50, "half the worlds start at an absurd speed"
    assert statuses == {s.name: int((status == s).sum()) for s in Status} and sum(statuses.values()) == 60
    failed = status != Status.SOLVED
    assert not report.table["spinning"][failed].any()
    assert np.isinf(report.table["recovery_time"][failed]).all()
    assert np.isfinite(report.samples[0]).all()
    assert report.cases[0]["share_spinning"][0] <= 1.0 - failed.mean()


def test_an_interrupt_leaves_what_is_finished(device):
    def stop(done, total):
        if done >= 50:
            raise KeyboardInterrupt

    whole = run(device, step_sizes=(0.05, 0.04))
    report = run(device, chunk=10, progress=stop, step_sizes=(0.05, 0.04))
    assert whole.complete and not report.complete
    assert [c["worlds"] for c in report.cases] == [40, 10] and len(report.table["world"]) == 50
    for name, column in report.table.items():
        np.testing.assert_array_equal(column, whole.table[name][:50])
    nothing = run(device, chunk=10, progress=lambda done, total: stop(50, total))
    assert not nothing.complete and len(nothing.table["world"]) == 10


def test_an_interrupt_before_anything_leaves_an_empty_report(monkeypatch):
    def stop(self, *arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(launches.Case, "launch", stop)
    report = run()
    assert not report.complete and report.cases == [] and report.table == {} and report.samples == []


def test_progress_counts_the_worlds(device):
    seen = []
    run(device, chunk=15, progress=lambda done, total: seen.append((done, total)), step_sizes=(0.05, 0.04))
    assert seen == [(15, 80), (30, 80), (40, 80), (55, 80), (70, 80), (80, 80)]


def test_save_and_load(device, tmp_path):
    report = run(device, step_sizes=(0.05, 0.04))
    loaded = slcp.SweepReport.load(report.save(tmp_path / "sweep.npz"))
    assert_equal(report, loaded)
    assert loaded.complete and loaded.spec == report.spec
    assert [c["statuses"] for c in loaded.cases] == [c["statuses"] for c in report.cases]
    lines = report.save(tmp_path / "sweep.csv").read_text().splitlines()
    assert lines[0].split(",") == list(report.table) and len(lines) == 81
    assert not list(tmp_path.glob("*.part"))
    with pytest.raises(ValueError, match=r"ends in '\.txt'; \.csv or \.npz"):
        report.save(tmp_path / "sweep.txt")


def test_memory_does_not_grow_with_the_worlds(monkeypatch):
    sizes = []

    def measured(original):
        def measure(kernel, dim, inputs, *rest, **options):
            sizes.append(sum(a.capacity for a in inputs if isinstance(a, wp.array)))
            return original(kernel, dim, inputs, *rest, **options)

        return measure

    monkeypatch.setattr(run_worlds, "Prepared", measured(run_worlds.Prepared))
    monkeypatch.setattr(draws, "launch", measured(draws.launch))
    monkeypatch.setattr(launches, "CHUNK_BYTES", 64_000)
    run(worlds=400, duration=1.0)
    few, count = max(sizes), len(sizes)
    sizes.clear()
    run(worlds=1600, duration=1.0)
    assert max(sizes) == few < 200_000 and len(sizes) > 3 * count


def test_a_million_worlds_are_cut_into_chunks(device):
    work = sweep_of(device, worlds=10**6, duration=20.0)
    (part,), (sim,) = work.chunks.parts, work.simulators.values()
    records = work.record.count(20.0)
    assert records == 201 and part.worlds == 10**6
    assert part.at_once * (8 * (sim.params.layout.width + 6) + 4 * records) < 130 * 2**20


# --- statistics ---


def test_wilson_interval_against_scipy():
    for successes, total in ((0, 10), (3, 10), (10, 10), (450, 512), (1, 4096)):
        share, low, high = statistics.share_interval(successes, total)
        exact = scipy.stats.binomtest(successes, total).proportion_ci(0.95, method="wilson")
        np.testing.assert_allclose((share, low, high), (successes / total, exact.low, exact.high), atol=1e-12)
    assert all(math.isnan(v) for v in statistics.share_interval(0, 0))


def test_mean_interval_against_scipy():
    values = np.random.default_rng(0).normal(2.0, 3.0, 400)
    mean, low, high = statistics.mean_interval(np.append(values, [np.nan, np.inf]))
    exact = scipy.stats.norm.interval(0.95, values.mean(), scipy.stats.sem(values))
    np.testing.assert_allclose((mean, low, high), (values.mean(), *exact), rtol=1e-12)


@pytest.mark.parametrize(
    "count, q", [(200, 0.5), (200, 0.9), (100, 0.01), (20, 0.05), (1000, 0.999), (3, 0.5)]
)
def test_quantile_interval_covers_the_quantile_as_often_as_it_says(count, q):
    """Also where no value is far enough out: of 100 worlds the quantile of 1 % is covered in .62 if the least
    value is the end.
    """
    rng, exact = np.random.default_rng(1), -math.log(1.0 - q)
    found = np.array([statistics.quantile_interval(rng.exponential(size=count), q) for _ in range(2000)])
    assert 0.94 < np.mean((found[:, 1] <= exact) & (exact <= found[:, 2]))
    ranks = quantile_ranks(count, q)
    for end, rank in zip(found.T[1:], ranks[1:]):
        assert np.isfinite(end).all() == (0 <= rank < count)
    law = scipy.stats.binom(count, q)  # the narrowest ends that cover
    assert law.cdf(ranks[1]) <= 0.025 < law.cdf(ranks[1] + 1)
    assert law.sf(ranks[2]) <= 0.025 < law.sf(ranks[2] - 1)


def test_quantile_ranks_of_many_worlds_are_those_of_the_normal_law():
    _, low, high = quantile_ranks(10**9, 0.5)
    half = scipy.stats.norm.isf(0.025) * math.sqrt(10**9) / 2.0
    assert abs(5e8 - half - low) < 3 and abs(5e8 + half - high) < 3


@pytest.mark.parametrize("first, second, count", [(0.004, 0.0, 128), (0.3, 0.25, 128), (0.01, 0.005, 1000)])
def test_a_difference_of_shares_is_covered(first, second, count):
    """Where no world of the sweep tells two policies apart, too."""
    rng, exact = np.random.default_rng(2), first - second
    counts = rng.multinomial(count, [first, second, 1.0 - first - second], 2000)
    found = np.array([shares_interval(int(a), int(b), count) for a, b, _ in counts])
    assert 0.94 < np.mean((found[:, 1] <= exact) & (exact <= found[:, 2]))
    assert (found[:, 1] < found[:, 2]).all()
    np.testing.assert_allclose(found[:, 0], (counts[:, 0] - counts[:, 1]) / count, atol=1e-15)


def test_quantile_interval_with_infinite_values():
    value, low, high = statistics.quantile_interval(np.array([1.0] * 30 + [np.inf] * 70))
    assert value == np.inf and low == np.inf and high == np.inf
    assert statistics.quantile_interval(np.array([1.0] * 90 + [np.inf] * 10)) == (1.0, 1.0, 1.0)


def test_rates_are_those_of_the_record(device):
    """Measures, of the run and of its second half, or from the last kick on if that is later."""
    for kicks, begin in (((), 5), ((0.2,), 5), ((0.55,), 6)):
        report = run(device, duration=1.0, sample_every=0.1, window=0.4, kick_times=kicks)
        samples, table = report.samples[0], report.table
        late = (samples[:, -1] - samples[:, begin]) / (0.1 * (10 - begin))
        np.testing.assert_allclose(table["rate"], samples[:, -1], rtol=1e-4, atol=1e-6)
        np.testing.assert_allclose(table["late_rate"], late, rtol=1e-4, atol=1e-5)
        np.testing.assert_array_equal(table["spinning"], table["late_rate"] > 0.5)


def test_the_time_to_recover_is_that_of_a_measure(device):
    """With a window of a step the rate that is looked at is the velocity after it: recorded, and measured."""
    h = FINGER.step_size
    spec = sweeps.spec(sample_every=h, window=h, threshold=0.5)
    task = task_of(FINGER, spec)
    fast = slcp.measures.state("ellipse.vangle") > spec.threshold
    first = slcp.measures.first_time(fast, start=h)
    own = task.replace(options=slcp.Options(scaling="none"), measures={"first": first})
    found = slcp.sweep(
        own, sweeps.idle(), worlds=spec.worlds, seed=spec.seed, cases=own.options, device=device
    )
    measured = found.part("policy")["first"] - h
    record = run(device, sample_every=h, window=h, threshold=0.5).table["recovery_time"]
    assert 5 < np.isfinite(record).sum() < spec.worlds
    np.testing.assert_allclose(record, measured, rtol=0, atol=1e-4)


def test_recovery_of_known_motions():
    time = np.arange(0.0, 10.01, 0.5)
    steady, still = 0.8 * time, 0.0 * time
    stopped = np.minimum(time, 4.0)
    late = np.where(time < 6.0, 0.0, 2.0 * (time - 6.0))  # recovers one second after the kick at 5 s
    found = summary.recovery_times(np.stack([steady, still, stopped, late]), 0.5, 2.0, 0.5, (5.0,))
    # the rate over the next two seconds exceeds .5: at once, never, never, at once (2 rad in 5..7 s)
    np.testing.assert_array_equal(found, [0.0, np.inf, np.inf, 0.0])
    slow = np.where(time < 7.5, 0.0, 2.0 * (time - 7.5))
    found = summary.recovery_times(slow[None], 0.5, 2.0, 0.5, (5.0,))
    np.testing.assert_array_equal(
        found, [1.5]
    )  # 1.5 s after the kick: .5 s of motion at 2 rad/s is half a rad/s
