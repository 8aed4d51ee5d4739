"""How a sweep's task and policies reach other processes: as files in the folder `inputs` of its store.

A task that is data travels as a task file, a policy that is numbers as a policy file. Others travel as the
text that they were given as, `file.py:name`, and the file has to be there wherever a chunk is run.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ...inputs.errors import ArgumentError
from ...policies.saved import content_of, load_policy, save_policy
from ...runs.job import Plain
from ...runs.store import saying
from ...storage.files import FileError
from ...tasks.files import TaskFileError, load_task, save_task, task_content, task_of
from ...tasks.task import Task
from ..tasks import policies_by_name
from ..worlds import Worlds, load_worlds, save_worlds
from .identity import task_identity

Given = tuple[Task, dict[str, Any], dict[str, str]]  # task, policies, and the texts that they came as
FOLDER, TASK, WORLDS = "inputs", "task.json", "worlds.npz"
ADVICE = (
    "other processes cannot run it. Give it as a text, 'file.py:name', of a Python file in which it is made, "
    "or leave out the executor"
)


def given(task: Any, policies: Any) -> Given:
    """Task and policies as a user gives them, objects or texts."""
    texts: dict[str, str] = {}
    if isinstance(task, str | Path):
        texts |= _text("task", task)
        task = load_task(task)
    named = policies_by_name(policies, task)
    for name, policy in named.items():
        if isinstance(policy, str | Path):
            texts |= _text(f"policy {name}", policy)
            named[name] = load_policy(policy)
    return task, named, texts


def _text(what: str, text: str | Path) -> dict[str, str]:
    """A text of a name in a Python file; other files are data."""
    return {what: str(text)} if str(text).rpartition(":")[0].endswith(".py") else {}


def whole(text: str) -> str:
    """`file.py:name` with the file's whole path."""
    file, _, name = text.rpartition(":")
    return f"{Path(file).resolve()}:{name}"


def packing_list(
    task: Task, policies: Mapping[str, Any], texts: Mapping[str, str], worlds: Worlds | None = None
) -> Plain:
    """Where another process finds task, policies and given worlds: names of files in `inputs`, or texts.

    Args:
        texts: how they were given, "task" and "policy NAME", as far as they were given as texts.

    Raises:
        ArgumentError: one is no data, and was not given as a text either.
    """
    if "task" not in texts:
        try:
            content = task_content(task)
        except TaskFileError as error:
            raise ArgumentError(f"task {task.name!r}: {error}; {ADVICE}") from None
        if task_identity(task_of(content)) != task_identity(task):
            raise ArgumentError(f"task {task.name!r} is not what its file would be read as; {ADVICE}")
    named = {}
    for i, (name, policy) in enumerate(policies.items()):
        named[name] = texts.get(f"policy {name}", f"policy{i}.npz")
        if f"policy {name}" not in texts:
            try:
                content_of(policy)
            except ArgumentError as error:
                raise ArgumentError(f"policies[{name!r}]: {error}; {ADVICE}") from None
    found = {"task": texts.get("task", TASK), "policies": named}
    return found if worlds is None else found | {"worlds": WORLDS}


def pack(
    store: Path,
    task: Task,
    policies: Mapping[str, Any],
    texts: Mapping[str, str],
    worlds: Worlds | None = None,
) -> None:
    """Write the files that are not there yet."""
    where = packing_list(task, policies, texts, worlds)
    folder = store / FOLDER
    with saying(store):
        folder.mkdir(exist_ok=True)
        if "task" not in texts and not (folder / TASK).exists():
            save_task(task, folder / TASK)
        if worlds is not None and not (folder / WORLDS).exists():
            save_worlds(worlds, folder / WORLDS)
        for name, policy in policies.items():
            path = folder / where["policies"][name]
            if f"policy {name}" not in texts and not path.exists():
                save_policy(policy, path)


def unpack(store: Path, task: str, policies: Mapping[str, str]) -> Given:
    """Task and policies as `packing_list` says.

    Raises:
        FileError: a file that is not there, or damaged.
    """
    texts = {} if task == TASK else {"task": task}
    texts |= {f"policy {name}": text for name, text in policies.items() if ".py:" in text}

    def at(name: str, text: str) -> str:
        return text if name in texts else str(store / FOLDER / text)

    with _needed(store):
        named = {name: load_policy(at(f"policy {name}", text)) for name, text in policies.items()}
        return load_task(at("task", task)), named, texts


def unpack_worlds(store: Path, name: str) -> Worlds:
    """Given worlds, as `packing_list` says.

    Raises:
        FileError: a file that is not there, or damaged.
    """
    with _needed(store):
        return load_worlds(store / FOLDER / name)


@contextmanager
def _needed(store: Path) -> Iterator[None]:
    try:
        yield
    except FileNotFoundError as error:
        raise FileError(
            f"{error}: it is needed to go on with {store}; make the call that began it again"
        ) from error
