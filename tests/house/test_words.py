"""One meaning for each word (docs/reference/glossary.md): other uses of them are not in sources and texts."""

import ast
import re

import pytest
from plan import LAYERS, ROOT, source_files

import slcp_warp as slcp

TEXTS = [ROOT / "README.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").rglob("*.md")]
GLOSSARY = ROOT / "docs/reference/glossary.md"
WORDS = {  # what holds: the pattern of what says otherwise; files and folders that may say it
    "a sweep is a robustness ensemble, no elimination and no pass through time": (
        r"\b(backward|forward|reverse|elimination|riccati|gauss-seidel|jacobi) sweeps?\b"
        r"|\bsweeps? (back|forth|over (the )?(rows|time|steps|horizon|contacts))"
        r"|\bmake_sweep\b|\bsweep\.(factor|back|forward)\b",
        (),
    ),
    "kernels are specialised or generic, not of registers or memory": (
        r"\b(memory|registers?)[ -](kernels?|strategy|path|simulators?)\b"
        r"|\bkernels? (in|of) (memory|registers)\b|^In (memory|registers) |\| (memory|registers) \|"
        r"|strategy *(=|==|:) *[\"'](memory|registers)[\"']",
        (),
    ),
    "the former names of strategies are taken in one place": (
        r"[\"'`](memory|registers)[\"'`]",
        (
            "slcp_warp/stepping/strategy.py",
            "CHANGELOG.md",
            "scripts/benchmarks/cost/",
        ),  # of GPU code: its registers
    ),
    "kernels for any scene are generic, not large": (
        r"\b(make_)?large_(step|rollout|sweep|solver|contact)\w*\b",
        (),
    ),
}


def sources():
    for path in (*source_files(*LAYERS, "examples"), *TEXTS):
        yield str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")


def uses(pattern: str, text: str) -> list[int]:
    """The lines on which the pattern is found."""
    found = re.finditer(pattern, text, re.IGNORECASE | re.MULTILINE)
    return [text[: match.start()].count("\n") + 1 for match in found]


@pytest.mark.parametrize("meaning", WORDS)
def test_a_word_means_one_thing(meaning):
    pattern, places = WORDS[meaning]
    found = {name: uses(pattern, text) for name, text in sources() if not name.startswith(places)}
    assert {name: lines for name, lines in found.items() if lines} == {}


def test_sweep_is_a_word_of_ensembles_alone_among_the_kernels():
    rooms = {
        path.relative_to(ROOT).parts[1] for path in source_files("kernels") if "sweep" in path.read_text()
    }
    assert rooms == {"ensembles"}


@pytest.mark.parametrize(
    "meaning, text",
    [
        (0, "The backward sweep of (10)."),
        (0, "a Gauss-Seidel sweep"),
        (0, "    sweep = make_sweep(s, dtype)"),
        (1, "the memory kernels"),
        (1, 'Simulator(scene, strategy="memory")'),
        (1, "| memory | hard |"),
        (2, 'if strategy == "registers":'),
        (3, "kernel = make_large_step(dtype)"),
    ],
)
def test_other_uses_are_seen(meaning, text):
    assert uses(list(WORDS.values())[meaning][0], f"First line.\n{text}\n") == [2]


def test_what_is_meant_is_not_seen():
    for text in (
        "a sweep of 4 x 1000 worlds",
        "slcp.sweep(scene, policy)",
        "it needs more memory than there is",
    ):
        assert not any(uses(pattern, text) for pattern, _ in WORDS.values()), text


def test_the_glossary_explains_each_word_once():
    words = re.findall(r"^\| ([^|]+) \|", GLOSSARY.read_text(encoding="utf-8"), re.MULTILINE)[2:]
    assert len(words) == len(set(words)) and words == sorted(words, key=str.lower)
    assert {"ensemble", "sweep", "specialised", "generic", "world", "scene", "policy", "pass"} <= set(words)


OF_SCENES = (
    "scenes",
    "tasks",
    "studies",
    "paper",
    "benchmarks",
    "quickstart",
)  # folders and files that name some
NAMED = {*slcp.scenes.NAMED, *slcp.tasks.NAMED, "finger"}


def named_in(source: str) -> list[str]:
    """Scenes and tasks that a source names: texts, and long names of what it reads."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value in NAMED:
            found.append(node.value)
        name = node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""
        if name in NAMED and "_" in name:
            found.append(name)
    return found


def test_shared_code_names_no_scene_and_no_task():
    sources = {
        str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in source_files(*LAYERS)
    }
    shared = {name: text for name, text in sources.items() if not any(part in name for part in OF_SCENES)}
    assert len(shared) > 250
    assert {name: named_in(text) for name, text in shared.items() if named_in(text)} == {}


def test_names_of_scenes_are_seen():
    assert named_in('SECONDS = {"grasp": 0.6}') == ["grasp"]
    assert named_in("cost = ddp.costs.flicking_finger()") == ["flicking_finger"]
    assert named_in("np.stack(rows); slope = 1.0; print('a stack of boxes')") == []
