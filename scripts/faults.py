"""Small faults put into the sources one at a time: does the suite notice them?

    python scripts/faults.py [NAME ...] [--workers 2] [--expected-only] [--list]

The faults are data, tests/faults/*.toml; each changes one place of one file, as a rule:

    [[fault]]
    name = "parameter-axis"                 # unique
    file = "slcp_warp/parameters.py"
    find = "text that is there exactly once"
    replace = "what stands there instead"
    tests = ["tests/ensembles/test_sweep.py::test_y"] # expected to notice it
    equivalent = "why no result changes"    # instead of tests, where none can notice
    also = [["file", "find", "replace"]]    # where more places hold what one of them would hold alone

Every fault goes into a copy of the tree. The tests expected to notice it run first, the others only if these
pass. In the end the tests that noticed run without a fault: one that fails then proves nothing. Kernels
are compiled into a folder of their own where the fault is in one. The exit status is 1 where a fault no
longer fits the sources, or fewer than 95 % of the faults that are not equivalent are noticed.
"""

import argparse
import concurrent.futures
import os
import queue
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LISTS = ROOT / "tests" / "faults"
FOLDERS = ("kernels", "ddp", "scripts")  # packages below slcp_warp
WANTED = 0.95  # share of the faults that are not equivalent
SECONDS = 1800  # a test that hangs has noticed


@dataclass(frozen=True)
class Fault:
    """A change of one place of one file, or of several; see the head of this file."""

    name: str
    file: str
    find: str
    replace: str
    tests: tuple[str, ...] = ()
    equivalent: str = ""
    also: tuple[tuple[str, str, str], ...] = ()

    @property
    def places(self) -> tuple[tuple[str, str, str], ...]:
        """File, text and what stands there instead of every place."""
        return ((self.file, self.find, self.replace), *self.also)

    def problem(self, root: Path = ROOT) -> str:
        """Why it cannot be put in; empty where it can."""
        for file, find, replace in self.places:
            path = root / file
            if not path.is_file():
                return f"there is no {file}"
            count = path.read_text(encoding="utf-8").count(find)
            if count != 1:
                return f"its text is in {file} {count} times; once is needed"
            if find == replace:
                return "it changes nothing"
        if bool(self.tests) == bool(self.equivalent):
            return "either tests or equivalent is needed"
        missing = [test for test in self.tests if not (root / test.split("::")[0]).is_file()]
        return f"there is no {missing[0]}" if missing else ""

    def put_in(self, root: Path) -> dict[Path, bytes]:
        """Change the files below `root`; what they were."""
        before: dict[Path, bytes] = {}
        for file, find, replace in self.places:
            path = root / file
            before.setdefault(path, path.read_bytes())
            text = path.read_text(encoding="utf-8")
            path.write_text(text.replace(find, replace), encoding="utf-8")
        return before


def read_faults(folder: Path = LISTS) -> list[Fault]:
    """All faults of the lists in a folder, by file and order."""
    faults = []
    for path in sorted(folder.glob("*.toml")):
        for entry in tomllib.loads(path.read_text(encoding="utf-8"))["fault"]:
            also = tuple(tuple(place) for place in entry.get("also", ()))
            faults.append(Fault(**{**entry, "tests": tuple(entry.get("tests", ())), "also": also}))
    names = [fault.name for fault in faults]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"faults of the same name: {', '.join(twice)}")
    return faults


class Tree:
    """A copy of the sources that tests import from."""

    def __init__(self, folder: Path) -> None:
        self.root = folder / "tree"
        listed = subprocess.run(
            ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
            cwd=ROOT, check=True, capture_output=True,
        ).stdout.decode()  # fmt: skip
        for name in filter(None, listed.split("\0")):
            if (ROOT / name).is_file():
                (self.root / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, self.root / name)
        package = folder / "site" / "slcp_warp"
        package.mkdir(parents=True)
        for path in (self.root / "slcp_warp").iterdir():
            (package / path.name).symlink_to(path)
        for name in FOLDERS:
            (package / name).symlink_to(self.root / name)
        self.site, self.cache = package.parent, folder / "kernels"

    def pytest(self, arguments: list[str], own_cache: bool) -> tuple[int, str]:
        """Exit status (0 passed, 1 failed) and output of the tests; hanging counts as failing."""
        environment = os.environ | {"PYTHONPATH": str(self.site), "PYTHONSAFEPATH": "1",
                                    "PYTHONDONTWRITEBYTECODE": "1"}  # fmt: skip
        if own_cache:
            environment["WARP_CACHE_PATH"] = str(self.cache)
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--tb=no", *arguments]
        try:
            done = subprocess.run(command, cwd=self.root, env=environment, timeout=SECONDS,
                                  capture_output=True, text=True)  # fmt: skip
        except subprocess.TimeoutExpired:
            return 1, "FAILED (did not come back)"
        finally:
            shutil.rmtree(self.cache, ignore_errors=True)
        return done.returncode, done.stdout + done.stderr

    def judge(self, fault: Fault, expected_only: bool) -> "Outcome":
        """Put a fault in, run the tests, take it out."""
        began = time.perf_counter()
        before = fault.put_in(self.root)
        try:
            kernel = any(file.startswith("kernels/") for file, _, _ in fault.places)
            code, output = self.pytest(["-x", "--full", *fault.tests], kernel)
            expected = True
            if code == 0 and not expected_only:
                code, output = self.pytest(["-x", "--deselect", "tests/house/test_faults.py"], kernel)
                expected = False
        finally:
            for path, content in before.items():
                path.write_bytes(content)
        who = re.search(r"^(?:FAILED|ERROR) ([^\n]*?)(?: - |$)", output, re.MULTILINE)
        failure = "" if code == 0 else who[1] if who else output.strip().splitlines()[-1][:90]
        if code < 0:
            failure = f"the tests' process, by signal {-code}"
        elif code not in (0, 1, 2):  # no such test, no pytest
            raise RuntimeError(f"{fault.name}: pytest ended with {code}:\n{output[-2000:]}")
        return Outcome(fault, failure, expected, time.perf_counter() - began)


@dataclass(frozen=True)
class Outcome:
    """Who noticed a fault ("" nobody), whether among the tests expected to, and how long it took [s]."""

    fault: Fault
    by: str
    expected: bool
    seconds: float

    def line(self) -> str:
        """One line of the report."""
        said = self.by or "NOT NOTICED"
        return f"{self.fault.name:38} {self.seconds:6.0f} s  {'' if self.expected else 'others: '}{said}"


def failing(tree: Tree, outcomes: list[Outcome]) -> str:
    """The output of the tests that noticed, on sources without a fault, where one of them fails."""
    tests = sorted({outcome.by for outcome in outcomes if "::" in outcome.by})
    code, output = tree.pytest(["--full", *tests], False) if tests else (0, "")
    return "" if code == 0 else output


def run(faults: list[Fault], workers: int, expected_only: bool) -> list[Outcome]:
    """Judge all faults, `workers` at a time; prints a line for each."""
    with tempfile.TemporaryDirectory() as folder:
        trees: queue.Queue[Tree] = queue.Queue()
        for i in range(workers):
            trees.put(Tree(Path(folder) / str(i)))

        def judge(fault: Fault) -> Outcome:
            tree = trees.get()
            try:
                outcome = tree.judge(fault, expected_only)
            finally:
                trees.put(tree)
            print(outcome.line(), flush=True)
            return outcome

        with concurrent.futures.ThreadPoolExecutor(workers) as pool:
            outcomes = list(pool.map(judge, faults))
        without = failing(trees.get(), outcomes)
        if without:
            raise RuntimeError(f"tests that noticed a fault fail without one, too:\n{without[-3000:]}")
        return outcomes


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("names", nargs="*", help="parts of their files or names; default: all")
    parser.add_argument("--workers", type=int, default=2, help="faults at a time (2)")
    parser.add_argument("--expected-only", action="store_true", help="run no other tests")
    parser.add_argument("--list", action="store_true", help="check that all fit the sources, run nothing")
    options = parser.parse_args()
    faults = read_faults()
    wrong = [f"{fault.name}: {fault.problem()}" for fault in faults if fault.problem()]
    if wrong:
        print("\n".join(wrong), file=sys.stderr)
        return 1
    if options.names:
        faults = [
            fault for fault in faults if any(name in f"{fault.file} {fault.name}" for name in options.names)
        ]
    real = [fault for fault in faults if not fault.equivalent]
    print(f"{len(faults)} faults, {len(faults) - len(real)} of them equivalent")
    if options.list or not real:
        return 0
    try:
        outcomes = run(real, options.workers, options.expected_only)
    except RuntimeError as error:
        print(error, file=sys.stderr)
        return 1
    missed = [outcome.fault.name for outcome in outcomes if not outcome.by]
    share = 1.0 - len(missed) / len(outcomes)
    print(f"noticed {len(outcomes) - len(missed)} of {len(outcomes)} ({share:.1%})")
    print("".join(f"not noticed: {name}\n" for name in missed), end="")
    return int(share < WANTED)


if __name__ == "__main__":
    sys.exit(main())
