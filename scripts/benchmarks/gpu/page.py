"""The page of a check: what is wrong first, then every section's checks and figures in Markdown's tables."""

from pathlib import Path
from typing import Any

from slcp_warp.storage.files import write_text

from .against import SLOWER
from .record import wrong


def write_page(path: Path, content: dict[str, Any], compared: dict[str, list[dict[str, Any]]] | None) -> None:
    """Write the page of a run's content, with a comparison if there is one."""
    lines = [f"# The kernels on {content['device']}", ""]
    program, here = content["program"], content["surroundings"]
    source = here["commit"] or program["sources"]
    lines += [f"slcp-warp {program['slcp-warp']} ({source}), Warp {program['warp-lang']}, {here['time']}, on "
              f"{here['cpu']}: `{here['command']}`", ""]  # fmt: skip
    bad = wrong(content)
    lines += ["## Wrong", "", *(f"- {text}" for text in bad)] if bad else ["Nothing is wrong."]
    lines += ["", *_states(content)]
    if compared is not None:
        lines += _comparison(compared)
    for name, section in content["sections"].items():
        lines += _section(name, section)
    write_text(path, "\n".join(lines) + "\n")


def _states(content: dict[str, Any]) -> list[str]:
    rows = []
    for name, section in content["sections"].items():
        bad = sum(not check["right"] for check in section["checks"])
        counts = {"checks": len(section["checks"]), "wrong": bad}
        rows.append({"section": name, "": section["status"], "seconds": section["seconds"], **counts})
    return [*table(rows), ""]


def _comparison(compared: dict[str, list[dict[str, Any]]]) -> list[str]:
    lines = ["## Against the earlier run", ""]
    for name, rows in compared.items():
        lines += [f"### {name}", "", *(table(rows) if rows else ["none"]), ""]
    ratios = [row["ratio"] for row in compared["rates"]]
    slower = sum(ratio < SLOWER for ratio in ratios)
    return [*lines, f"{slower} of {len(ratios)} rates are below {SLOWER:g} of the earlier ones.", ""]


def _section(name: str, section: dict[str, Any]) -> list[str]:
    lines = [f"## {name}", ""]
    if "error" in section:
        lines += [f"{section['status']}: {section['error']}", ""]
    if "traceback" in section:
        lines += ["```text", section["traceback"].rstrip(), "```", ""]
    lines += [f"- {note}" for note in section["notes"]] + [""] * bool(section["notes"])
    for rows in (section["checks"], *_alike(section["rows"])):
        if rows:
            lines += [*table(rows), ""]
    return lines


def _alike(rows: list[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    """Rows with the same columns, together."""
    groups: dict[tuple[str, ...], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault(tuple(row), []).append(row)
    return list(groups.values())


def table(rows: list[dict[str, Any]]) -> list[str]:
    """Lines of a Markdown table; columns in order of first appearance."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    lines = [f"| {' | '.join(columns)} |", f"|{'---|' * len(columns)}"]
    return lines + [f"| {' | '.join(_cell(name, row.get(name, '')) for name in columns)} |" for row in rows]


def _cell(name: str, value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "**no**" if name == "right" else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    text = ", ".join(map(str, value)) if isinstance(value, list) else str(value)
    return text.replace("|", "\\|").replace("\n", " ")
