"""Pictures of tasks: what the cost asks for, and that every named task and one of a function can be drawn."""

import numpy as np
import pytest

import slcp_warp as slcp
from slcp_warp.costs import Term, effort, terms

SCENE = slcp.scenes.push_block()


def task(running, final=(), **changes):
    cost = terms(SCENE, [effort(1.0), *running], list(final))
    return slcp.Task(**({"name": "push", "scene": SCENE, "cost": cost, "horizon": 5} | changes))


def at(name):
    return SCENE.state_index(name)


def test_the_goal_is_where_the_terms_are_least():
    running = [
        Term("square", 1.0, state="block.x", target=0.3),
        Term("square", 1.0, state="block.vx", target=2.0),
    ]
    final = [
        Term("absolute", 1.0, state="block.x", target=0.7),
        Term("cosine", 1.0, state="block.angle", target=np.pi),
        Term("square", 1.0, state="pusher.shift", minus="block.x", target=-0.2),
    ]
    goal = task(running, final).goal()
    assert goal[at("block.x")] == 0.7 and goal[at("block.angle")] == np.pi
    assert goal[at("pusher.shift")] == pytest.approx(0.5)
    assert goal[at("block.y")] == SCENE.x0[at("block.y")] and not goal[SCENE.nv :].any()


def test_differences_lead_from_what_has_a_target():
    """In chains, whatever comes first; what has a target keeps it."""
    x, shift, y = (at(name) for name in ("block.x", "pusher.shift", "block.y"))
    first = Term("square", 1.0, state="pusher.shift", minus="block.y", target=0.1)
    second = Term("square", 1.0, state="block.y", minus="block.x", target=0.1)
    whole = Term("square", 1.0, state="block.x", target=1.0)
    last = Term("square", 1.0, state="pusher.shift", target=0.7)
    for order in ([whole, first, second], [second, whole, first], [first, second, whole]):
        np.testing.assert_allclose(task(order).goal()[[shift, y, x]], [1.2, 1.1, 1.0])
        np.testing.assert_allclose(task([], order).goal()[[shift, y, x]], [1.2, 1.1, 1.0])
    np.testing.assert_allclose(task([last, first, second]).goal()[[shift, y, x]], [0.7, 0.6, 0.5])
    np.testing.assert_allclose(task([whole, last, first, second]).goal()[[shift, x]], [0.7, 1.0])
    alone = task([first]).goal()
    assert alone[shift] == pytest.approx(SCENE.x0[y] + 0.1) and alone[y] == SCENE.x0[y]


def test_terms_of_points_leave_the_goal_of_the_others():
    near = Term("square", 2.0, point=slcp.costs.Point("block", (0.1, 0.0)), minus=slcp.costs.Point("pusher"))
    own = [
        Term("square", 1.0, state="block.x", target=0.3),
        Term("cosine", 1.0, state="block.angle", target=1.0),
    ]
    expected = task(own).goal()
    for running, final in (([*own, near], ()), ([near, own[0]], [own[1], near])):
        np.testing.assert_array_equal(task(running, final).goal(), expected)
    assert task([near]).goal() is None


def test_a_cost_that_asks_for_no_place_has_no_goal():
    assert task([Term("linear", -1.0, state="block.x"), Term("square", 1.0, state="block.vx")]).goal() is None
    assert task([Term("square", 0.0, state="block.x", target=1.0)]).goal() is None
    assert slcp.tasks.flicking_finger().goal() is None
    quadratic = slcp.costs.quadratic(np.eye(8), np.eye(1))
    assert task([]).replace(cost=quadratic).goal() is None


@pytest.mark.parametrize("name", slcp.tasks.NAMED)
def test_every_named_task_is_drawn(name):
    plt = pytest.importorskip("matplotlib.pyplot")
    figure = slcp.tasks.NAMED[name]().plot()
    (ax,) = figure.axes
    dashed = [patch for patch in ax.patches if patch.get_linestyle() == "--"]
    moved = slcp.tasks.NAMED[name]().goal() is not None and name != "grasp_hold"
    assert ax.get_title() == name and bool(dashed) == moved
    plt.close(figure)


def test_starts_are_drawn_pale():
    plt = pytest.importorskip("matplotlib.pyplot")
    starts = SCENE.x0 + np.outer([0.0, 0.2, 0.9], np.eye(8)[at("block.x")])
    figures = [task([], start=starts[:count]).plot() for count in (1, 3)]
    one, three = (len(figure.axes[0].patches) for figure in figures)
    assert three == 3 * one
    assert figures[0].axes[0].get_xlim()[1] < starts[2, at("block.x")] < figures[1].axes[0].get_xlim()[1]
    plt.close("all")
