"""Everything prints for people: what it is in a line, tables in `str` and HTML, all of bounded length."""

import re

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp import ddp
from slcp_warp import measures as m
from slcp_warp.ensembles.statistics import share_interval
from slcp_warp.storage.printed import LINE, ROWS, Arrays, Printed, Table, cut, percent, percents

SCENE = slcp.scenes.push_block()
H, W, STATES = 3, 2, (2, 4, 8)


def run():
    sim = slcp.Simulator(SCENE, device="cpu")
    status = np.array([0, int(slcp.Status.INFEASIBLE)])
    known = slcp.results.simulated.Simulated.of(sim)
    return slcp.Trajectory(np.arange(64.0).reshape(STATES), status, gap=np.zeros((2, 3, 6)), simulated=known)


def result(**changes):
    numbers = {name: np.arange(2.0) for name in ("cost", "iterations", "gradient", "min_pivot")}
    numbers |= {name: np.zeros((2, 3, 1)) for name in ("xs", "us", "K", "k", "Vx", "Vxx", "lower", "upper")}
    rows = np.zeros((2, 4, 20))
    return ddp.Result(**numbers, status=np.array([0, 1]), trace=ddp.Trace.from_rows(rows))


def library():
    zeros, ones = np.zeros(3), np.arange(3)
    return ddp.Library(np.zeros((3, 4)), np.zeros((3, 1)), np.zeros((3, 1, 4)), zeros, zeros, ones, ones,
                       ones, np.zeros(4), {"scene": "mine"})  # fmt: skip


def task():
    cost = slcp.costs.terms(SCENE, [slcp.costs.effort(1.0)])
    measures = {"x": m.final("block.x")}
    return slcp.Task(
        "shove", SCENE, cost=cost, horizon=5, measures=measures, success=m.final("block.x") > 1.0
    )


def report():
    columns = {"world": np.arange(4), "x": np.arange(4.0), "status": np.zeros(4, int)}
    out = slcp.Report(task())
    out.source.add(("held", "hard", 0.01, "disturbed"), columns | {"success": np.array([1, 1, 0, 0], bool)})
    return out


def sweep_report():
    cases = [{"residual": "hard", "worlds": 7, "mean_rate": (0.5, 0.25, 0.75), "statuses": {"SOLVED": 7}}]
    return slcp.SweepReport(cases, {}, [], {"scene": "mine"}, complete=False)


STEP = (np.zeros((2, 8)), np.zeros((2, 6)), np.ones((2, 6)), np.zeros((2, 12)), np.zeros(2, int))
THINGS = {  # what: it, and what its line, its text and its page say
    "scene": (lambda: SCENE, "<Scene 'push_block': 2 bodies, ", ("block   (world)", "face  ", "gear")),
    "parameters": (lambda: slcp.Parameters(SCENE), "<Parameters of 'push_block': ", ("friction",)),
    "simulator": (
        lambda: slcp.Simulator(SCENE, device="cpu"),
        "<Simulator of 'push_block': rem-logistic, float64 on cpu, ",
        ("pusher.vshift", "tolerance"),
    ),
    "trajectory": (run, "<Trajectory 'push_block', 2 worlds, 3 steps of 0.01 s: 1 SOLVED, 1 INFEASIBLE; "
                   "recorded: gap>", ("block.vangle", "rad/s")),
    "step": (lambda: slcp.Step(*STEP, None, SCENE), "<Step of 'push_block' in 2 worlds: 2 SOLVED>",
             ("face/pusher +", "gap before")),
    "linearization": (
        lambda: slcp.Linearization(np.zeros((8, 8)), np.zeros((8, 1)), None, np.zeros(1), SCENE),
        "<Linearization of 1 world: A (8, 8), B (8, 1); 1 SOLVED>", ("block.vangle", "control pusher.shift"),
    ),
    "result": (result, "<Result 2 problems, 3 steps: ", ("min_pivot",)),
    "multistart": (lambda: ddp.Multistart(result().select(0), 0, result()), "<Multistart the best is", ()),
    "library": (library, "<Library of 'mine': 3 controllers from 3 plans>", ("gain", "u[0]")),
    "task": (task, "<Task 'shove' with scene 'push_block': plans of 5 steps",
             ("judged by", 'final', "final('block.x') > 1")),
    "report": (report, "<Report of task 'shove': 1 part>", ("50.0 (", "mean x", "1.5")),
    "sweep report": (sweep_report, "<SweepReport of 'mine': 1 case, 7 runs; interrupted>", ("(0.5, 0.25",)),
    "worlds": (lambda: slcp.Worlds(np.zeros((3, 8)), numbers=[4, 5, 6]),
               "<Worlds x0 (3, 8), numbers (3,)>", ()),
    "particles": (
        lambda: slcp.Particles(np.zeros(8), np.zeros(8), np.zeros(6), np.zeros(6), np.eye(8), 5),
        "<Particles state (8,), ", (),
    ),
    "pushforward": (lambda: slcp.Pushforward(np.zeros(STATES), np.zeros(STATES), np.zeros(2)),
                    "<Pushforward tangent (2, 4, 8), states (2, 4, 8), status (2,)>", ()),
}  # fmt: skip


@pytest.mark.parametrize("name", THINGS)
def test_it_says_what_it_is(name):
    make, line, within = THINGS[name]
    thing = make()
    text, page = str(thing), thing._repr_html_()
    assert repr(thing).startswith(line), repr(thing)
    assert "\n" not in repr(thing) and len(repr(thing)) <= LINE + 40
    assert text.splitlines()[0] in repr(thing)
    for each in within:
        assert each in text, text
    assert len(text) < 8000 and max(map(len, text.splitlines())) < 300
    assert page.startswith("<div>") and page.count("<tr>") == page.count("</tr>") and len(page) < 40_000
    assert page.count("<table>") == page.count("</table>")


@pytest.mark.parametrize("name", sorted(slcp.scenes.NAMED))
def test_every_named_scene_prints(name):
    scene = slcp.scenes.NAMED[name]()
    text = str(scene)
    assert all(body.name in text for body in scene.bodies[:ROWS]) and len(text) < 8000
    assert repr(name) in repr(scene) and scene.bodies[0].name in scene._repr_html_()


def test_tables_are_bounded_and_escaped():
    table = Table("many", [f"c{j}" for j in range(40)], [["<b>" + 99 * "x", *range(39)]] * 1000)
    text, page = table.text(), table.html()
    assert text.splitlines()[-1].strip() == f"... {1000 - ROWS} more" and len(text) < 4000
    assert text.splitlines()[1].endswith("... 30 more")
    assert "<b>" not in page and "&lt;b&gt;" in page and page.count("<tr>") == ROWS + 2
    assert cut("a  b\nc", 10) == "a b c" and cut("x" * 50, 10) == "x" * 7 + "..."


def test_columns_stand_below_each_other():
    lines = Table("", ("name", "value"), [("a", 1.0), ("long one", 123.456)]).text().splitlines()
    assert lines == ["  name      value", "  a             1", "  long one  123.5"]


def test_what_prints_must_say_what_it_is():
    with pytest.raises(NotImplementedError):
        repr(Printed())

    class Some(Arrays):
        def __init__(self):
            self.x, self.n, self.none, self._hidden = np.zeros((2, 3)), 4, None, 5

    assert repr(Some()) == "<Some x (2, 3), n 4>"


EXPRESSIONS = (
    "final('block.x')",
    "rate('block.x', start=1, end=3.5)",
    "share_of_time((state('block.vx') > 0.01) & (time() < 0.9))",
    "first_time((contact('face/pusher') > 0.5) | (gap() < -0.02))",
    "smallest(state('block.x', 'pusher.shift')).between(-1, 2.5)",
    "((final('block.x') > 0.05) & (mean(control(0)) < 3)) | (largest(cosine('block.angle')) > 0.5)",
    "total(normal_impulse())",
)


@pytest.mark.parametrize("text", EXPRESSIONS)
def test_measures_print_as_the_expression_that_makes_them(text):
    made = eval(text, {name: getattr(m, name) for name in m.__all__})
    assert eval(repr(made), {name: getattr(m, name) for name in m.__all__}) == made
    squeezed = re.sub(r"[()\s]", "", repr(made))
    assert squeezed == re.sub(r"[()\s]", "", text)


@pytest.mark.parametrize("worlds", [0, 2])
def test_what_has_no_rows_and_no_controls_prints(worlds):
    sc = slcp.Scene(name="swing", bodies=(slcp.Body("bob", mass=1.0, inertia=0.1, joint="revolute"),))
    assert (sc.structure.nr, sc.nu) == (0, 0)
    state, none, status = np.zeros((worlds, 2)), np.zeros((worlds, 0)), np.zeros(worlds, np.int32)
    step = slcp.Step(state, none, none, none, status, lambda: none, sc)
    slopes = slcp.Linearization(np.zeros((worlds, 2, 2)), np.zeros((worlds, 2, 0)), None, status, sc)
    known = slcp.results.simulated.Simulated.of(slcp.Simulator(sc, device="cpu"))
    run = slcp.Trajectory(np.zeros((worlds, 3, 2)), status, simulated=known)
    for thing in (step, slopes, run):
        assert f"{worlds} worlds" in str(thing)


def test_shares_are_told_from_all_and_from_none():
    """Nine failures of 200,000 were "100.0 (100.0 to 100.0)"."""
    assert [percent(share) for share in (0.0, 1.0, 0.948)] == ["0.0", "100.0", "94.8"]
    assert percent(1.0 - 9 / 200_000) == "99.996" and percent(2e-6) == "0.0002"
    assert percents(share_interval(199_991, 200_000)) == "99.996 (99.99 to 99.998)"
