"""Two runs of the check beside each other: what was right and is wrong now, and rates."""

from typing import Any

SLOWER = 0.9  # of an earlier rate: less is said to be slower


def compare(now: dict[str, Any], before: dict[str, Any]) -> dict[str, list[dict[str, Any]]]:
    """What differs between the contents of two runs.

    Returns:
        "newly wrong" and "newly right" checks, and "rates" with the ratio of now to before, slowest first.
    """
    checks = [{key: c["right"] for key, c in _items(content, "checks", "what")} for content in (now, before)]
    both = [key for key in checks[0] if key in checks[1]]
    out: dict[str, list[dict[str, Any]]] = {
        "newly wrong": [_named(k) for k in both if checks[1][k] and not checks[0][k]],
        "newly right": [_named(k) for k in both if checks[0][k] and not checks[1][k]],
    }
    earlier = dict(_items(before, "rows", "case"))
    rates = []
    for key, row in _items(now, "rows", "case"):
        old = earlier.get(key, {})
        rate, before_rate = row.get("rate"), old.get("rate")
        if isinstance(rate, float) and isinstance(before_rate, float) and before_rate > 0.0:
            ratio = rate / before_rate
            rates.append(_named(key) | {"before": before_rate, "now": rate, "ratio": ratio})
    out["rates"] = sorted(rates, key=lambda each: each["ratio"])
    return out


def _items(content: dict[str, Any], part: str, name: str) -> list[tuple[tuple[str, str], dict[str, Any]]]:
    return [
        ((title, str(each[name])), each)
        for title, section in content["sections"].items()
        for each in section[part]
    ]


def _named(key: tuple[str, str]) -> dict[str, Any]:
    return {"section": key[0], "case": key[1]}
