"""Sums and products of signals: a force times a velocity, a force less its limit."""

from collections.abc import Iterable
from typing import Any

from ..inputs.checks import number, numeric, shown
from ..inputs.errors import ArgumentError, ArgumentTypeError

SUM = "sum"
MOST_FACTORS = 2
MOST_TERMS = 256
Term = tuple[float, tuple[Any, ...]]  # a weight, and the signals that it is multiplied by


class Arithmetic:
    """`+`, `-`, `*` of signals and numbers, `/` by numbers: a sum of products of at most two signals."""

    def __add__(self, other: Any) -> Any:
        return _sum(self, [*_terms("+", self), *_terms("+", other)])

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        return _sum(self, [*_terms("-", self), *_times(-1.0, _terms("-", other))])

    def __rsub__(self, other: Any) -> Any:
        return _sum(self, [*_terms("-", other), *_times(-1.0, _terms("-", self))])

    def __neg__(self) -> Any:
        return _sum(self, _times(-1.0, _terms("-", self)))

    def __mul__(self, other: Any) -> Any:
        ours, theirs = _terms("*", self), _terms("*", other)
        products = [(a * b, left + right) for a, left in ours for b, right in theirs]
        if any(len(factors) > MOST_FACTORS for _, factors in products):
            raise ArgumentError(
                f"* of {shown(self)} and {shown(other)} has products of more than {MOST_FACTORS} signals; a "
                "measures.function can have them"
            )
        return _sum(self, products)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        if numeric(other) is None:
            raise ArgumentTypeError(f"/ is by {shown(other)}; a number is needed")
        return self * (1.0 / _divisor(other))


def _divisor(given: Any) -> float:
    found = number("the number after /", given)
    if not found:
        raise ArgumentError("the number after / is 0; another one is needed")
    return found


def _terms(sign: str, given: Any) -> list[Term]:
    """What a signal or a number adds up from."""
    if not isinstance(given, Arithmetic):
        if numeric(given) is None:
            raise ArgumentTypeError(
                f"{sign} joins a signal and {shown(given)}; a signal or a number is needed"
            )
        return [(number(f"the number of {sign}", given), ())]
    terms: tuple[Term, ...] = getattr(given, "terms", ())
    if not terms:
        return [(1.0, (given,))]
    if getattr(given, "absolute", False):
        raise ArgumentError(f"{sign} is of {shown(given)}; an absolute value of a sum stands alone")
    return list(terms)


def _times(weight: float, terms: Iterable[Term]) -> list[Term]:
    return [(weight * own, factors) for own, factors in terms]


def _sum(like: Any, terms: Iterable[Term]) -> Any:
    """A signal of these terms, of the same factors once; one signal as it is."""
    merged: dict[tuple[Any, ...], float] = {}
    for weight, factors in terms:
        key = tuple(sorted(factors, key=repr))
        merged[key] = merged.get(key, 0.0) + weight
    found = [(weight, key) for key, weight in merged.items() if weight != 0.0] or [(0.0, ())]
    if len(found) > MOST_TERMS:
        raise ArgumentError(f"a sum of {len(found)} terms is too long; at most {MOST_TERMS} are possible")
    if len(found) == 1 and found[0][0] == 1.0 and len(found[0][1]) == 1:
        return found[0][1][0]
    return type(like)(SUM, terms=tuple(found))


def check_terms(signal: Any) -> None:
    """Raise an error for a sum without terms, terms that are no products, and those of what is no sum."""
    if (signal.kind == SUM) != (signal.terms != ()):
        raise ArgumentError(
            f"terms of a {signal.kind} is {shown(signal.terms)}; a sum has some, and nothing else has"
        )
    if signal.kind != SUM:
        return
    if signal.which is not None or signal.function is not None:
        raise ArgumentError(f"which of a sum is {shown(signal.which)}; it has terms alone")
    if not isinstance(signal.terms, tuple) or len(signal.terms) > MOST_TERMS:
        raise ArgumentTypeError(f"terms is {shown(signal.terms)}; a tuple of at most {MOST_TERMS} is needed")
    for n, term in enumerate(signal.terms):
        given = term if isinstance(term, tuple) and len(term) == 2 else (None, None)
        factors = given[1] if isinstance(given[1], tuple) else (None,)
        if len(factors) > MOST_FACTORS or not all(
            isinstance(each, Arithmetic) and not getattr(each, "terms", ()) for each in factors
        ):
            raise ArgumentTypeError(
                f"terms[{n}] is {shown(term)}; a weight and a tuple of at most {MOST_FACTORS} signals that "
                "are no sums are needed"
            )
        number(f"terms[{n}][0]", given[0])


def in_words(terms: Iterable[Term]) -> str:
    """The expression that makes a sum."""
    out = ""
    for weight, factors in terms:
        size = abs(weight)
        parts = [] if size == 1.0 and factors else [f"{size:.12g}"]
        sign = "-" if weight < 0.0 else "+"
        out += f" {sign} " if out else sign.replace("+", "")
        out += " * ".join([*parts, *map(repr, factors)])
    return out
