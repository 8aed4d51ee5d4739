"""What the texts refer to is there: files, commands and their options, tests; and code blocks run."""

import contextlib
import io
import re
import shlex

import pytest
from plan import LAYERS, ROOT, source_files

TEXTS = sorted([ROOT / "README.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").rglob("*.md")])
CODE = source_files(*LAYERS, "tests", "examples")
FOLDERS = "kernels|slcp_warp|ddp|scripts|tests|docs|examples"
FILE = re.compile(
    rf"(?<![\w/.-])(?:\./)?((?:{FOLDERS})/[\w./*{{}},-]*\.(?:py|md|toml|xml|sh|png|gif|json|csv))\b"
)
ABSENT = re.compile(r"\b(DESIGN|ROADMAP|TODO|FIXME)\b")
NOT_FILES = {"examples/NAME.py", "kernels/" + "nowhere.py"}  # a pattern, and what a test says is absent
LINK = re.compile(r"\]\(([^)\s]+)\)")


def name(path):
    return str(path.relative_to(ROOT))


def there(pattern: str) -> bool:
    """Whether a path with * is in the tree."""
    return any(ROOT.glob(pattern))


def test_files_that_are_named_are_there():
    absent = {}
    for path in (*TEXTS, *CODE):
        named = set(FILE.findall(path.read_text(encoding="utf-8"))) - NOT_FILES
        absent[name(path)] = sorted(file for file in named if not there(file))
    assert {path: files for path, files in absent.items() if files} == {}


def test_nothing_refers_to_what_a_reader_does_not_have():
    found = {}
    for path in (*TEXTS, *(path for path in CODE if path.name != "test_docs.py")):
        found[name(path)] = ABSENT.findall(path.read_text(encoding="utf-8"))
    assert {path: words for path, words in found.items() if words} == {}


@pytest.mark.parametrize("path", TEXTS, ids=name)
def test_links_lead_somewhere(path):
    for link in LINK.findall(path.read_text(encoding="utf-8")):
        if link.startswith(("http:", "https:")):
            continue
        file, _, anchor = link.partition("#")
        target = path.parent / file if file else path
        assert target.exists(), link
        if anchor:
            heads = re.findall(r"^#+ (.*)$", target.read_text(encoding="utf-8"), re.MULTILINE)
            assert anchor in {re.sub(r"[^\w -]", "", head.lower()).replace(" ", "-") for head in heads}, link


def quoted(text: str) -> list[str]:
    """What stands in backticks, on one line or broken over two, and lines of blocks without a language."""
    blocks = re.findall(r"^```(?:bash)?\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines()]
    rest = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    indented = re.findall(r"^    (slcp .*)$", rest, re.MULTILINE)
    return lines + indented + [" ".join(part.split()) for part in re.findall(r"`([^`]+)`", rest)]


@pytest.mark.parametrize("path", TEXTS, ids=name)
def test_commands_and_their_options_are_there(path):
    typer = pytest.importorskip("typer")
    pytest.importorskip("matplotlib")
    from slcp_warp.scripts.app import app

    root = typer.main.get_command(app)
    for line in quoted(path.read_text(encoding="utf-8")):
        if not line.startswith("slcp "):
            continue
        words = shlex.split(line.split("#")[0].replace("...", " "), comments=False)[1:]
        command, at = root, 0
        while at < len(words) and hasattr(command, "commands"):
            word = words[at].rstrip(",;")
            if not re.fullmatch(r"[a-z][\w-]*", word):
                break
            assert word in command.commands, f"{line}: no command {word!r}"
            at += 1
            if words[at - 1].endswith(","):  # a list of commands of one level
                continue
            command = command.commands[word]
        known = {
            option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)
        }
        for word in words[at:]:
            if word.startswith("--"):
                assert word.split("=")[0] in known | {"--help"}, f"{line}: no option {word}"


@pytest.mark.parametrize("path", TEXTS, ids=name)
def test_tests_that_are_named_are_there(path):
    for line in quoted(path.read_text(encoding="utf-8")):
        if not re.match(r"(time )?pytest\b", line):
            continue
        files = re.findall(r"tests/[\w./]+\.py", line)
        words = re.search(r'-k (?:"([^"]+)"|(\S+))', line)
        text = "".join((ROOT / file).read_text(encoding="utf-8") for file in files)
        for word in re.findall(r"\w+", (words[1] or words[2]) if words else ""):
            assert word in {"and", "or", "not"} or word in text, f"{line}: nothing matches {word!r}"


def blocks(path):
    return re.findall(r"^```python\n(.*?)^```", path.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


@pytest.mark.docs
@pytest.mark.parametrize("path", [path for path in TEXTS if blocks(path)], ids=name)
def test_code_in_texts_runs(path, tmp_path, monkeypatch):
    """The blocks of a page are one program, run where the examples are and files may be written."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    program: dict = {"__name__": "page"}
    for number, block in enumerate(blocks(path)):
        file = tmp_path / f"block{number}.py"  # Warp reads the source of a kernel's functions
        file.write_text(block, encoding="utf-8")
        for package in re.findall(
            r"^(?:import|from) (torch|jax|pandas|pyarrow|polars|duckdb)\b", block, re.MULTILINE
        ):
            pytest.importorskip(package)
        said = io.StringIO()
        with contextlib.redirect_stdout(said):
            exec(compile(block, str(file), "exec"), program)
        assert ("print(" not in block) or said.getvalue().strip()
