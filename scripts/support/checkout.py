"""Benchmarks and studies lie in a checkout of the project, not in the wheel: finding them there."""

import importlib.util
import tomllib
from collections.abc import Iterable
from pathlib import Path

import slcp_warp

ROOMS = ("benchmarks", "studies")  # folders of scripts/ that a wheel leaves out


class CheckoutError(ValueError):
    """What was asked for lies in a checkout of the project, and this is none."""


def checkout_scripts(folder: Path) -> Path | None:
    """The folder scripts/ of the checkout that `folder` is in; None outside of one of this version."""
    for root in (folder, *folder.parents):
        try:
            project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        except (OSError, ValueError, KeyError):
            continue
        if isinstance(project, dict) and project.get("name") == "slcp-warp":
            same = project.get("version") == slcp_warp.__version__
            return root / "scripts" if same and _whole(root / "scripts") else None
    return None


def _whole(scripts: Path) -> bool:
    return all((scripts / room).is_dir() for room in ROOMS)


def further_folders(here: Iterable[str]) -> list[str]:
    """Folders to search for the rooms of ROOMS beside those of the installed package, `here`.

    None where the package has them (an editable install); else those of the checkout around the working
    directory, where it is of the same version.
    """
    if any(_whole(Path(folder)) for folder in here):
        return []
    try:
        found = checkout_scripts(Path.cwd())
    except FileNotFoundError:  # the working directory was deleted
        found = None
    return [] if found is None else [str(found)]


def has_checkout() -> bool:
    """Whether the benchmarks and studies can be imported."""
    return all(importlib.util.find_spec(f"slcp_warp.scripts.{room}") is not None for room in ROOMS)


def need_checkout(what: str) -> None:
    """Raise CheckoutError unless the benchmarks and studies are there."""
    if not has_checkout():
        raise CheckoutError(
            f"{what}: only inside of a checkout of slcp-warp {slcp_warp.__version__}, which has "
            f"scripts/{' and scripts/'.join(ROOMS)}; the installed package has not"
        )
