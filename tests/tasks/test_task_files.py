"""Tasks in files: round trips, the schema, the examples, one clear error for everything else."""

import dataclasses
import json
import pathlib
import tomllib

import numpy as np
import pytest
import warp as wp

import slcp_warp as slcp
from slcp_warp import measures as m
from slcp_warp.tasks.files import task_content, task_of
from slcp_warp.tasks.schema import json_schema

EXAMPLES = pathlib.Path(__file__).parents[2] / "examples" / "tasks"
TOML = EXAMPLES / "shove.toml"


def same(first: slcp.Task, second: slcp.Task) -> None:
    for name in ("name", "scene", "options", "horizon", "duration", "disturbances", "measures"):
        assert getattr(first, name) == getattr(second, name), name
    np.testing.assert_array_equal(first.cost.weights, second.cost.weights)
    np.testing.assert_array_equal(first.start, second.start)
    assert first.success.clauses == second.success.clauses


@pytest.mark.parametrize("name", slcp.tasks.NAMED)
def test_round_trips_are_exact(tmp_path, name):
    task = slcp.load_task(name)
    slcp.save_task(task, tmp_path / "task.json")
    same(slcp.load_task(tmp_path / "task.json"), task)
    assert [path.name for path in tmp_path.iterdir()] == ["task.json"]


def rich() -> slcp.Task:
    """A task with something of everything that is data."""
    task = slcp.load_task(TOML)
    touching = (m.contact("face/pusher") > 0.5) & (m.state("block.x", "pusher.shift") < 0.5)
    last = m.settled(touching | (m.time() > 1.0), start=0.5, end=1.4)
    return task.replace(
        options=slcp.Options(residual="hard", gap="end", tolerance=1e-9),
        control_limits=(-np.inf, [3.0]),
        state_limits={"block.vx": (-np.inf, 2.5), "pusher.shift": (-3.0, 3.0)},
        start=task.start + np.outer([0.0, 1.0], np.ones(8)),
        disturbances=slcp.Disturbances(
            start={"block.x": 0.1, "block.y": slcp.Uniform(0.1, 0.12)},
            kick_times=(0.5, 1.0),
            kick=0.2,
            kicks={"block.vx": slcp.Normal(0.1, mean=0.2)},
            sensor={"block.x": 0.01},
            delay=0.04,
            before=(1.5,),
            dropped=0.1,
            parameters={"mass": slcp.LogNormal(0.1, shared=True), "block.com": slcp.Normal(0.01)},
            pushes=(slcp.Push("block", slcp.Uniform(0.1, 0.2), 0.1, (slcp.Normal(2.0), 1.0), at=(0.0, 0.1)),),
            dropouts=(slcp.Dropout(0.3, slcp.LogNormal(0.2, median=0.1)),),
        ),
        measures=task.measures
        | {
            "last": last,
            "push": m.impulse("face/pusher"),
            "u": m.mean(m.control(0)),
            "slid": m.excursion(m.state("block.x", "pusher.shift"), end=1.0),
            "swung": m.largest(abs(m.cosine("block.angle"))),
        },
        success=(m.final("block.x") > 0.1)
        & ((last < 1.0) | m.largest(m.cosine("block.angle")).between(0, 2)),
    )


def test_everything_that_is_data_goes_round(tmp_path):
    slcp.save_task(rich(), tmp_path / "task.json")
    again = slcp.load_task(tmp_path / "task.json")
    same(again, rich())
    assert again.state_limits == {"block.vx": (-np.inf, 2.5), "pusher.shift": (-3.0, 3.0)}
    assert again.control_limits[0] == -np.inf and again.control_limits[1] == [3.0]


def test_a_term_of_no_weight_is_one(tmp_path):
    scene = slcp.scenes.push_block()
    cost = slcp.costs.terms(scene, [slcp.costs.Term("square", 0.0, control=0)])
    slcp.save_task(slcp.Task("idle", scene, cost, 5), tmp_path / "task.json")
    np.testing.assert_array_equal(slcp.load_task(tmp_path / "task.json").cost.weights, cost.weights)


def test_a_term_of_a_control_less_a_state_is_one(tmp_path):
    scene = slcp.scenes.push_block()
    term = slcp.costs.Term("absolute", 2.0, control="pusher.shift", minus="pusher.vshift", target=0.1)
    task = slcp.Task("apart", scene, slcp.costs.terms(scene, [term]), 5)
    slcp.save_task(task, tmp_path / "task.json")
    np.testing.assert_array_equal(slcp.load_task(tmp_path / "task.json").cost.weights, task.cost.weights)
    told = json.loads((tmp_path / "task.json").read_text())["cost"]["running"][0]
    assert told["control"] == "pusher.shift" and told["minus"] == "pusher.vshift" and task.goal() is None


def test_short_reductions_are_those_of_python():
    content = tomllib.loads(TOML.read_text())
    apart = {"kind": "state", "which": "block.x", "minus": "pusher.shift"}
    content["measures"] |= {
        "moved": {"reduction": "change", "of": "block.x", "end": 1.0},
        "slid": {"reduction": "excursion", "of": apart, "start": 0.5},
        "far": {"reduction": "largest", "of": apart | {"absolute": True}},
    }
    content["failure"] = {"of": apart | {"since_start": True, "absolute": True}, "above": 0.3}
    found, away = task_of(content), m.state("block.x", "pusher.shift")
    assert found.measures["moved"] == m.change("block.x", 1.0)
    assert found.measures["slid"] == m.excursion(away, 0.5) and found.measures["far"] == m.largest(abs(away))
    assert found.failure == (abs(m.since_start(away)) > 0.3)
    assert repr(found.measures["slid"]) == "excursion(state('block.x', 'pusher.shift'), start=0.5)"
    assert repr(found.failure) == "abs(since_start(state('block.x', 'pusher.shift'))) > 0.3"


def test_the_toml_example_is_the_same_as_python():
    """Read from the file and written with the classes."""
    scene = slcp.scenes.push_block()
    task = slcp.load_task(TOML)
    assert len(TOML.read_text().splitlines()) < 40 and task.scene.step_size == 0.02
    assert task.scene.bodies == scene.bodies and task.steps == 80
    assert task.start.tolist() == [scene.state({"pusher.vshift": 0.0}).tolist()]
    place, still = m.final("block.x"), m.settled(m.state("block.vx").between(-0.02, 0.02))
    assert task.measures == {"place": place, "still": still}
    assert task.success.clauses == (place.between(0.45, 0.55) & (still < 1.6)).clauses
    Term = slcp.costs.Term
    cost = slcp.costs.terms(
        scene, [slcp.costs.effort(1e-4)],
        [Term("square", 200.0, state="block.x", target=0.5), Term("square", 20.0, state="block.vx")],
    )  # fmt: skip
    np.testing.assert_array_equal(task.cost.weights, cost.weights)


def test_the_python_example_is_a_task():
    file = EXAMPLES / "knock.py"
    assert len(file.read_text().splitlines()) <= 30
    task = slcp.load_task(f"{file}:knock")
    assert task.name == "knock" and task.scene.state_names[:3] == ("cue.shift", "middle.shift", "last.shift")


def test_files_fit_the_schema():
    fastjsonschema = pytest.importorskip("fastjsonschema")
    schema = json_schema() | {"$schema": "http://json-schema.org/draft-07/schema#"}  # the newest it knows
    valid = fastjsonschema.compile(schema)
    for task in (rich(), *(make() for make in slcp.tasks.NAMED.values())):
        valid(json.loads(json.dumps(task_content(task))))
    good = tomllib.loads(TOML.read_text())
    valid(good)
    for key, wrong in (("version", 3), ("horizon", 0), ("colour", 1), ("cost", {"final": [{"kind": "x"}]}),
                       ("measures", {"a": {"reduction": "final"}}), ("success", {"all": []})):  # fmt: skip
        with pytest.raises(fastjsonschema.JsonSchemaException):
            valid(good | {key: wrong})


def test_the_shipped_schema_is_the_one_of_the_classes():
    path = pathlib.Path(slcp.__file__).parent / "tasks" / "task_schema.json"
    assert json.loads(path.read_text()) == json_schema()  # python -m slcp_warp.tasks.schema


def test_a_scene_lies_beside_the_task_or_in_it(tmp_path):
    good = tomllib.loads(TOML.read_text()) | {"scene": "scene.json"}
    scene = slcp.scenes.push_block()
    slcp.save_scene(scene, tmp_path / "scene.json")
    (tmp_path / "task.json").write_text(json.dumps(good))
    beside = slcp.load_task(tmp_path / "task.json")
    same(beside, slcp.load_task(TOML))
    inline = json.loads((tmp_path / "scene.json").read_text())
    same(task_of(good | {"scene": inline}), beside)
    for name in ("absent.json", "../scene.json", str(tmp_path / "scene.json")):
        (tmp_path / "task.json").write_text(json.dumps(good | {"scene": name}))
        with pytest.raises(slcp.TaskFileError, match=r"task.json cannot be read as a task: scene: "):
            slcp.load_task(tmp_path / "task.json")


X = {"reduction": "final", "of": "block.x"}
PUSH = {"body": "block", "start": 0.1, "duration": 0.1}
TERM = {"kind": "square", "weight": 1.0, "state": "block.x"}


@pytest.mark.parametrize(
    "changes, text",
    [
        (
            {"format": "slcp-scene"},
            "format is 'slcp-scene'; a task file has format = 'slcp-task'; a scene alone is given by --scene",
        ),
        ({"version": 3}, "version is 3; this program reads 1, 2"),
        ({"horzion": 3}, "no field 'horzion'; did you mean 'horizon'"),
        ({"cost": None}, "cost: None; a table of fields is needed"),
        ({"scene": "pushblock"}, "scene: 'pushblock'; a table, a .toml, .json or .xml file or one of"),
        ({"scene": {"name": "a", "bodys": []}}, "scene: no field 'bodys'; did you mean 'bodies'"),
        ({"step_size": "fast"}, "step_size is 'fast'"),
        ({"horizon": 1.5}, "Task.horizon is 1.5; a whole number"),
        ({"duration": -1}, "Task.duration is -1"),
        ({"cost": {"finally": []}}, "cost: no field 'finally'; did you mean 'final'"),
        ({"cost": {"final": 3}}, "cost, final: 3; a list is needed"),
        ({"cost": {"final": [{"kind": "square"}]}}, r"cost, final\[0\]: weight is missing"),
        ({"cost": {"final": [TERM | {"kind": "cube"}]}}, r"final\[0\]: Term.kind is"),
        ({"cost": {"final": [TERM | {"weight": "1 kg"}]}}, r"final\[0\]: Term.weight is"),
        ({"cost": {"final": [TERM | {"state": "block.z"}]}}, r"cost: final\[0\].state"),
        ({"options": {"residual": "soft"}}, "options: Options.residual is 'soft'"),
        ({"options": {"frction": "coulomb"}}, "options: no field 'frction'; did you mean 'friction'"),
        ({"control_limits": 3.0}, r"control_limits: 3.0; \[lower, upper\] is needed"),
        ({"state_limits": 3.0}, "state_limits"),
        ({"state_limits": {"wheel": [0.0, 1.0]}}, "Task.state_limits: .*wheel"),
        ({"state_limits": {"block.x": 3.0}}, r"state_limits, block.x: 3.0; \[lower, upper\] is needed"),
        ({"state_limits": {"block.x": [1.0, 0.0]}}, "block.x.*a lower limit and an upper one above it"),
        ({"control_limits": [1.0, -1.0]}, "a lower limit is above the upper one"),
        ({"control_limits": ["low", 1.0]}, "control_limits: lower limit must be numbers, got 'low'"),
        ({"start": {"block.z": 1.0}}, "'block.z'"),
        ({"start": [0.0, 1.0]}, "Task.start has shape"),
        ({"disturbances": {"torque": -1.0}}, "disturbances: Disturbances.torque is -1.0"),
        ({"disturbances": {"torq": 1.0}}, "disturbances: no field 'torq'; did you mean 'torque'"),
        ({"disturbances": {"start": {"cart.x": 1.0}}}, "'cart.x'"),
        ({"disturbances": {"start": {"block.x": {"unifrm": [0, 1]}}}}, "block.x: no field 'unifrm'; did"),
        ({"disturbances": {"start": {"block.x": {}}}}, "start, block.x: no distribution; one of log_normal"),
        ({"disturbances": {"kicks": {"block.vx": {"uniform": 1.0}}}}, r"uniform: 1.0; \[low, high\]"),
        ({"disturbances": {"parameters": {"mass": {"log_normal": 3.0}}}}, "mass: LogNormal.sd is 3.0"),
        ({"disturbances": {"pushes": [{"body": "block"}]}}, r"disturbances, pushes\[0\]: start is missing"),
        ({"disturbances": {"pushes": [PUSH | {"force": [1.0]}]}}, r"pushes\[0\]: Push.force is \[1.0\]"),
        ({"disturbances": {"pushes": [PUSH | {"force": [{"normal": -1}, 0]}]}}, "force: Normal.sd is -1"),
        ({"disturbances": {"dropouts": [{"start": 0.1}]}}, r"dropouts\[0\]: duration is missing"),
        ({"disturbances": {"sensor": {"block.z": 0.1}}}, "'block.z'"),
        ({"failure": {"of": "block.x"}}, "failure: no bound"),
        ({"observation": ["block.z"]}, "Task.observation: .*'block.z'"),
        ({"periods": {"block.x": "turn"}}, "Task.periods names 'block.x'"),
        ({"measures": [1]}, r"measures: \[1\]; a table of fields is needed"),
        ({"measures": {"a": {"of": "block.x"}}}, "measures, a: reduction is missing"),
        ({"measures": {"a": X | {"reduction": "last"}}}, "measures, a, reduction is 'last'; choose one of"),
        ({"measures": {"a": X | {"of": 1.5}}}, "measures, a, of: .*1.5"),
        ({"measures": {"a": X | {"of": {"kind": "function"}}}}, "measures, a, of, kind is 'function'"),
        ({"measures": {"a": X | {"of": {"which": "x"}}}}, "measures, a, of: kind is missing"),
        ({"measures": {"a": X | {"of": {"kind": "state", "which": [1]}}}}, r"of, which: \[1\]; a name"),
        ({"measures": {"a": X | {"of": "block.z"}}}, r"Task.measures\['a'\]: .*'block.z'"),
        ({"measures": {"a": X | {"start": "soon"}}}, "measures, a: start is 'soon'"),
        ({"measures": {"a": X | {"reduction": "change", "start": 1.0}}}, "measures, a, start: a change is"),
        ({"measures": {"a": {"reduction": "excursion", "of": {"kind": "gap"}}}}, "a: Signal.since_start is"),
        ({"measures": {"a": X | {"of": {"kind": "time", "absolute": 1}}}}, "a, of: Signal.absolute is 1"),
        ({"measures": {"a": X | {"reduction": "settled"}}}, "measures, a, of: 'block.x'; a table of fields"),
        ({"success": {"measure": "place"}}, "success: no bound; one of above, below, between is needed"),
        ({"success": {"measure": "plaice", "above": 1}}, "no measure 'plaice'; there are place, still"),
        ({"success": X | {"between": [1.0]}}, r"success, between: \[1.0\]; \[low, high\] is needed"),
        ({"success": X | {"between": [2.0, 1.0]}}, "success, between: between has low 2.0 and high 1.0"),
        ({"success": X | {"above": 1.0, "below": 2.0}}, "success: above and below; one of"),
        ({"success": X | {"above": "high"}}, "success, above: the bound of > is 'high'"),
        ({"success": {"all": [X | {"above": 1.0}], "any": []}}, "all, any together; all stands alone"),
        ({"success": {"any": [X | {"above": 1.0}, {"of": "block.x"}]}}, r"any\[1\]: reduction is missing"),
        ({"success": {"any": []}}, "success, any: at least one comparison is needed"),
        ({"success": {"all": [{"any": [X | {"above": i} for i in range(9)]}] * 3}}, "more than 256"),
        ({"name": ""}, "Task.name is ''"),
    ],
)  # fmt: skip
def test_what_is_no_task_is_one_error_with_its_place(tmp_path, changes, text):
    own = {} if "success" in changes else {"success": X | {"above": 0.0}}
    content = tomllib.loads(TOML.read_text()) | own | changes
    (tmp_path / "task.json").write_text(json.dumps(content))
    with pytest.raises(slcp.TaskFileError, match=f"task.json cannot be read as a task: .*{text}") as caught:
        slcp.load_task(tmp_path / "task.json")
    assert len(str(caught.value)) < 600 and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text, message",
    [
        ('name = "a"\nname = "b"', "not readable as TOML"),
        ("[[", "not readable as TOML"),
        ("", "format is None"),
    ],
)
def test_what_is_no_toml(tmp_path, text, message):
    (tmp_path / "task.toml").write_text(text)
    with pytest.raises(slcp.TaskFileError, match=f"task.toml cannot be read as a task: {message}"):
        slcp.load_task(tmp_path / "task.toml")


def test_python_files_say_what_is_wrong_with_them(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(
        "import slcp_warp as slcp\ngood = slcp.tasks.catch()\nwrong = 3\ndef bad(): return 1 / 0\n"
    )
    assert slcp.load_task(f"{file}:good").name == "catch"
    for name, text in (("wrong", "wrong is 3; a slcp_warp.Task, .* tasks in it: good"),
                       ("absent", "absent is None"), ("bad", "mine.py:bad: ZeroDivisionError")):  # fmt: skip
        with pytest.raises(slcp.TaskFileError, match=text):
            slcp.load_task(f"{file}:{name}")
    file.write_text("def (")
    with pytest.raises(slcp.TaskFileError, match="mine.py:good: SyntaxError"):
        slcp.load_task(f"{file}:good")
    for absent in (f"{tmp_path}/no.py:good", tmp_path / "no.toml"):
        with pytest.raises(FileNotFoundError, match="no such file"):
            slcp.load_task(absent)
    for no_name in ("juggle", "task.txt", "mine.py"):
        with pytest.raises(
            slcp.TaskFileError, match=r"is no task; a .toml or .json file, .* or one of flicking"
        ):
            slcp.load_task(no_name)


def test_what_is_no_data_is_not_written(tmp_path):
    task = slcp.tasks.catch()
    own = task.replace(measures={"mine": m.final(m.function(wp.abs))})
    quadratic = task.replace(cost=slcp.costs.quadratic(np.eye(10), np.eye(2)), success=None)
    for wrong, text in (
        (own, "measures, mine: a measure of a function is no data"),
        (quadratic, "cost: no sum"),
    ):
        with pytest.raises(slcp.TaskFileError, match=text):
            slcp.save_task(wrong, tmp_path / "task.json")
    with pytest.raises(slcp.TaskFileError, match="tasks are written as .json, not as .toml"):
        slcp.save_task(task, tmp_path / "task.toml")
    assert list(tmp_path.iterdir()) == []


def test_tasks_are_equal_by_what_is_in_them():
    """And not where anything differs; none of it is ambiguous."""
    one, other = slcp.load_task(TOML), slcp.load_task(TOML)
    assert one == other and hash(one) == hash(other) and len({one, other}) == 1
    assert slcp.tasks.catch() == slcp.tasks.catch() != one
    changed = [
        one.replace(name="push"), one.replace(start=one.start + 1e-9), one.replace(duration=1.0),
        one.replace(cost=one.cost.with_weights(np.where(one.cost.fixed, 1.0, 2.0) * one.cost.weights)),
        one.replace(measures={}), one.replace(scene=dataclasses.replace(one.scene, step_size=0.01)),
    ]  # fmt: skip
    assert all(each != one for each in changed) and one != "shove"
