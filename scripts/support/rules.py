"""What the steps solve, as the options of a command say it: groups of options that commands share."""

import dataclasses
import functools
import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, get_type_hints

import typer

import slcp_warp as slcp
from slcp_warp.options import CHOICES

RESIDUALS = {"smoothed": "rem-logistic", **{name: name for name in CHOICES["residual"]}}
OF_HARD, OF_SMOOTHED = ("friction", "gap"), ("noise", "deviation")  # rules of some residuals only
NOT_OF_ERM = ("tolerance", "depenetration_speed")

Residual = Annotated[
    str | None, typer.Option(help="smoothed, hard, rem-normal, ..; default: the task's, or smoothed.")
]
HardResidual = Annotated[str | None, typer.Option(help="smoothed, hard, rem-normal, ..")]
Scaling = Annotated[str | None, typer.Option(help="inertia or none; default: the task's, or inertia.")]
Friction = Annotated[
    str | None, typer.Option(help="anitescu, or coulomb with the hard residual; default: the task's.")
]
Integrator = Annotated[str | None, typer.Option(help="euler, leapfrog or trapezoidal; default: the task's.")]
Gap = Annotated[str | None, typer.Option(help="start, or end with the hard residual; default: the task's.")]
Noise = Annotated[
    str | None, typer.Option(help="row, or state with a smoothed residual; default: the task's.")
]
Deviation = Annotated[
    str | None, typer.Option(help="What sigma is: scale or standard-deviation; default: the task's.")
]
Tolerance = Annotated[
    float | None, typer.Option(help="At which Newton's iteration stops; default: the task's, or rounding.")
]
Depenetration = Annotated[
    float | None,
    typer.Option(
        help="Largest speed at which overlaps are pushed out, which stay where nothing lets them; default: "
        "the task's, or in one step, or not at all."
    ),
]


@dataclass(frozen=True)
class Rules:
    """Options of the steps beside the residual; None: the task's own, or as of `slcp_warp.Options`."""

    scaling: Scaling = None
    friction: Friction = None
    integrator: Integrator = None
    gap: Gap = None
    noise: Noise = None
    deviation: Deviation = None
    tolerance: Tolerance = None
    depenetration_speed: Depenetration = None

    @property
    def given(self) -> dict[str, Any]:
        """Those that are given."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(Rules)}
        return {name: value for name, value in values.items() if value is not None}

    def of(self, options: slcp.Options) -> slcp.Options:
        """Options with these."""
        return dataclasses.replace(options, **self.given)

    def cases(self, options: slcp.Options, residuals: str) -> dict[str, slcp.Options]:
        """Options with these and each of some residuals, by name; rules that one has not got do not touch it.

        Args:
            residuals: names, with commas.
        """
        names, found = [name.strip() for name in residuals.split(",")], {}
        unused = set(self.given)
        for name in names:
            residual = residual_of(name, "--residuals")
            own = self._of_residual(residual)
            case = dataclasses.replace(options.with_residual(residual), **own)
            label = _label(name, own, case)
            if label in found:
                raise ValueError(f"--residuals is {residuals!r}, which names {name} more than once")
            found[label] = case
            unused -= set(own)
        if unused:
            rule = min(unused)
            kind = "hard" if rule in OF_HARD else "hard or REM" if rule in NOT_OF_ERM else "smoothed"
            raise ValueError(
                f"--{rule} is {self.given[rule]!r}, which is of the {kind} problem; --residuals is "
                f"{residuals}"
            )
        return found

    def variants(self, options: slcp.Options) -> list[slcp.Options]:
        """Options and those of the hard problem, if they are not, with what each of them has of these."""
        residuals = [options.residual] if options.hard else [options.residual, "hard"]
        return [
            dataclasses.replace(options.with_residual(each), **self._of_residual(each)) for each in residuals
        ]

    def _of_residual(self, residual: str) -> dict[str, Any]:
        without: tuple[str, ...] = OF_SMOOTHED if residual == "hard" else OF_HARD
        without += NOT_OF_ERM if residual.startswith("erm") else ()
        if residual.startswith("erm") and self.integrator == "leapfrog":
            without += ("integrator",)
        return {rule: value for rule, value in self.given.items() if rule not in without}


WORDS = {"friction": "", "integrator": "", "gap": "gap ", "depenetration_speed": "depenetration "}


def _label(name: str, own: dict[str, Any], case: slcp.Options) -> str:
    """What a case is called: its residual, and what is given, or the task's, that it has not by itself."""
    words, plain = WORDS, slcp.Options()
    has = [rule for rule in words if rule in own or getattr(case, rule) != getattr(plain, rule)]
    return ", ".join((name, *(f"{words[rule]}{getattr(case, rule)}" for rule in has)))


def told(options: slcp.Options) -> list[str]:
    """Options in words: the residual, and what is not as it is by itself."""
    plain, own = slcp.Options(), dataclasses.asdict(options)
    return [
        options.residual,
        *(f"{w}{own[name]}" for name, w in WORDS.items() if own[name] != getattr(plain, name)),
    ]


@dataclass(frozen=True)
class OneRule(Rules):
    """The same with a residual."""

    residual: Residual = None

    def of(self, options: slcp.Options) -> slcp.Options:
        """Options with these."""
        if self.residual is not None:
            options = options.with_residual(residual_of(self.residual, "--residual"))
        return super().of(options)


@dataclass(frozen=True)
class HardRule(OneRule):
    """The same, of the hard problem unless another residual is given."""

    residual: HardResidual = "hard"


RULES = tuple(field.name for field in dataclasses.fields(OneRule))  # options, by name
NO_RULES, NO_RULE, HARD_RULE = Rules(), OneRule(), HardRule()


def residual_of(name: str, option: str) -> str:
    """The residual of a name; ValueError names the option and lists the names there are."""
    if name not in RESIDUALS:
        raise ValueError(f"{option} is {name!r}; choose one of {', '.join(RESIDUALS)}")
    return RESIDUALS[name]


def with_rules(command: Callable[..., None]) -> Callable[..., None]:
    """A command whose parameter of a group of options has become the options of the group."""
    hints = get_type_hints(command, include_extras=True)
    found = ((name, kind) for name, kind in hints.items() if isinstance(kind, type))
    name, group = next((name, kind) for name, kind in found if issubclass(kind, Rules))
    parts = get_type_hints(group, include_extras=True)
    own = [
        inspect.Parameter(
            field.name, inspect.Parameter.KEYWORD_ONLY, default=field.default, annotation=parts[field.name]
        )
        for field in _in_order(group)
    ]

    @functools.wraps(command)
    def run(*args: Any, **kwargs: Any) -> None:
        made = group(**{each.name: kwargs.pop(each.name) for each in own})
        command(*args, **kwargs, **{name: made})

    parameters: list[inspect.Parameter] = []
    for each in inspect.signature(command).parameters.values():
        kept = each.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=hints[each.name])
        parameters += own if each.name == name else [kept]
    signature = inspect.Signature(parameters)
    run.__signature__ = signature  # type: ignore[attr-defined]
    run.__annotations__ = {each.name: each.annotation for each in parameters}
    return run


def _in_order(group: Any) -> Sequence[Any]:
    """A group's fields, the residual first."""
    return sorted(dataclasses.fields(group), key=lambda field: field.name != "residual")
