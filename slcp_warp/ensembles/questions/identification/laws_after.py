"""What is known after the logs, each number by itself, in the words of `Disturbances.parameters`."""

from collections.abc import Mapping
from dataclasses import replace
from math import sqrt

import numpy as np

from slcp_warp.kernels.ensembles.draws import LAWS

from ....description.scene import Scene
from ....parameters import Parameters
from ....tasks.disturbances import Distribution, LogNormal, Normal, Uniform, UniformFactor, laws
from ....tasks.disturbances.laws import Laws
from ...worlds.normals import normal_share

Law = LogNormal | Normal | Uniform | UniformFactor
DIGITS = 12  # of numbers, by which laws of several columns are the same


def laws_after(
    scene: Scene, prior: Mapping[str, Distribution], table: Laws, mean: np.ndarray, sd: np.ndarray
) -> dict[str, Law]:
    """Laws by name, around the scene's numbers.

    Args:
        prior: what was known before.
        table: the columns of the parameters.
        mean, sd: (columns that vary,) of the normal numbers that they are drawn from now.
    """
    base = Parameters(scene).table()[0]
    factors = {key for key, law in prior.items() if isinstance(law, UniformFactor)}
    of_factor = {
        c for key in factors for c in laws.parameter_laws(scene, base, {key: prior[key]}).varied.tolist()
    }
    groups: dict[tuple[int, int, Law], list[int]] = {}
    for c, m, s in zip(table.varied.tolist(), mean, sd):
        law = _after(table, c, float(m), float(s), float(base[c]), c in of_factor)
        groups.setdefault((int(table.stream[c]), int(table.step[c]), law), []).append(c)
    whole: dict[tuple[int, ...], tuple[str, bool | str]] = {}
    for key, before in prior.items():
        alone = laws.parameter_laws(scene, base, {key: before}).varied
        whole[tuple(alone.tolist())] = key, before.shared
    out: dict[str, Law] = {}
    for (_, _, now), columns in groups.items():
        of_parts = ", ".join(dict.fromkeys(laws.key_of(scene, c) for c in columns))
        key, shared = whole.get(tuple(columns), (of_parts, False))
        out[key] = replace(now, shared=shared)
    return out


def _after(table: Laws, c: int, mean: float, sd: float, base: float, factor: bool) -> Law:
    """The law of a column; of an even one that even one which has the spread, within the ends it had; of a
    factor on nothing, which the filter's model had and the scene has not, likewise an even one.
    """
    law, first, second = LAWS[table.law[c]], float(table.first[c]), float(table.second[c])
    around = float(np.ravel(table.base[..., c])[0])
    if law == "log-normal" and base == 0.0:
        value, half = around * np.exp(first * mean), around * np.exp(first * mean) * first * sd * sqrt(3.0)
        return Uniform(_digits(value - half), _digits(value + half))
    if law == "log-normal":
        return LogNormal(_digits(first * sd), median=_digits(around * np.exp(first * mean) / base))
    if law == "normal":
        return Normal(_digits(first * sd), mean=_digits(around + first * mean - base))
    ends = sorted((first, second))
    share = float(normal_share(np.array(mean)))
    value = first + (second - first) * share
    half = abs(second - first) * np.exp(-0.5 * mean**2) / sqrt(2.0 * np.pi) * sd * sqrt(3.0)
    low, high = max(ends[0], value - half), min(ends[1], value + half)
    if factor and base != 0.0:
        factors = low / base, high / base
        return UniformFactor(_digits(min(factors)), _digits(max(factors)))
    return Uniform(_digits(low), _digits(high))


def _digits(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
