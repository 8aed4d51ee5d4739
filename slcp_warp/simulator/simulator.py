"""The simulator: steps, rollouts and their derivatives for a batch of worlds of one scene."""

from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.device.progress import name_scene
from slcp_warp.kernels.specialisation import Specialisation

from ..description.scene import Scene
from ..gradients import launches, tape
from ..inputs import checks
from ..inputs.arrays import Array, to_numpy
from ..inputs.errors import ArgumentError
from ..options import Options
from ..parameters import Parameters
from ..results import Linearization, Step, Trajectory, contact_impulse
from ..results.simulated import Simulated
from ..stepping.arguments import Arguments, at_step_size, policy_arrays
from ..stepping.arrays import Controls, RolloutArrays, StepArrays
from ..stepping.host import Asked, acts_on_host
from ..stepping.kernels import Kernels
from ..stepping.specialised import taped_policy
from ..stepping.strategy import current_name
from ..storage.printed import Printed, Table
from .felt import Felt

RECORDED = ("controls", "impulse", "gap")
DTYPES = {"float32": wp.float32, "float64": wp.float64}


class Simulator(Printed):
    """Steps many worlds of one scene in parallel.

    Args:
        scene: the mechanism; its topology selects the kernels.
        options: what the step solves.
        device: "cpu", "cuda:0", ...; None: the best one present.
        dtype: "float64" (accurate to 1e-12) or "float32" (fast, 2e-5 of the problem's scale).
        strategy: "specialised" kernels, made for the scene; "generic" ones, for large scenes; "auto": by the
            scene's size. The attribute says which kernels step.
        fast_path: whether specialised kernels without the last resorts of their solvers step first, and those
            with them make the steps that are left; None: on a GPU, in scenes of at most two pairs. States
            differ from those of one kernel by rounding, whatever the batch.

    Attributes:
        params: the scene's parameters.
        spec: what its kernels are made for.
        kernels: made or taken for it.
    """

    def __init__(
        self,
        scene: Scene,
        options: Options | None = None,
        device: str | wp.Device | None = None,
        dtype: str = "float64",
        strategy: str = "auto",
        fast_path: bool | None = None,
    ) -> None:
        checks.instance("scene", scene, Scene, "a slcp_warp.Scene")
        checks.instance("options", options, Options | None, "a slcp_warp.Options")
        checks.choice("dtype", dtype, DTYPES)
        self.options = options or Options()
        if self.options.method.state_noise:
            scene = scene.with_covariances()
        self.scene = scene
        self.device = checks.device(device)
        self.dtype = DTYPES[dtype]
        self.params = Parameters(scene)
        self.spec = Specialisation(scene.structure, self.dtype, self.options.method)
        name_scene(scene.structure, scene.name)
        self.kernels = Kernels(scene.name, self.spec, self.device, current_name(strategy), fast_path)
        self.strategy = self.kernels.strategy
        self._arguments = Arguments(scene.structure, self.dtype, self.device)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles are made anew of the same, with the same parameters."""
        how = str(self.device), self.dtype.__name__, self.strategy, self.kernels.fast_path
        return type(self), (self.scene, self.options, *how), {"params": self.params}

    def _line(self) -> str:
        how = f"{self.dtype.__name__} on {self.device}, {self.strategy} kernels"
        return f"of {self.scene.name!r}: {self.options.residual}, {how}; h = {self.scene.step_size:g} s"

    def _tables(self) -> list[Table]:
        states = list(zip(self.scene.state_names, self.scene.state_units, map(float, self.scene.x0)))
        rows = [(name, str(getattr(self.options, name))) for name in vars(self.options)]
        return [
            Table("options", ("option", "choice"), rows, left=2),
            Table("states", ("state", "unit", "start"), states, left=2),
        ]

    @property
    def nx(self) -> int:
        """State dimension, 2 nv."""
        return 2 * self.scene.nv

    @property
    def nu(self) -> int:
        """Number of controls."""
        return self.scene.nu

    @property
    def nr(self) -> int:
        """Rows of the complementarity problem."""
        return self.scene.structure.nr

    def empty(self, *shape: int) -> wp.array:
        """A zeroed array of the simulator's dtype on its device."""
        return self._arguments.empty(*shape)

    def parameter_array(self, params: Parameters | None, worlds: int) -> wp.array:
        """The parameter table for a number of worlds."""
        return self.params.matching(params, worlds).array(self.dtype, self.device)

    def need_derivatives(self, what: str) -> None:
        """An error that names `what`, which needs a specialised step, where that or derivatives are missing.

        Raises:
            StrategyError: a scene that is meant for generic kernels only.
            OptionError: options without derivatives.
        """
        self.kernels.specialised(what)
        tape.derivatives_exist(self.options.method)

    def step(
        self,
        x: Array,
        u: Array = None,
        params: Parameters | None = None,
        *,
        external_force: Array = None,
        warm_start: Array = None,
    ) -> Step:
        """One time step of every world, (M1) to (M3). Pure: nothing is remembered.

        Recorded on an active `wp.Tape` when x or u are Warp arrays with `requires_grad` or params are
        tracked.

        Args:
            x: (B, nx) or (nx,) states (q, v).
            u: (B, nu) controls, or (nu,) for all worlds, None: zero.
            params: see `Simulator.params`; per-world tables need B rows.
            external_force: (B, bodies, 3) force and torque at the centres of mass [N, N m].
            warm_start: `multiplier` of the worlds' last step.

        Raises:
            ArrayError, ParameterError: bad arguments. A world that cannot be solved has a status instead.
        """
        given = self._arguments
        state = given.batch("x", x, self.nx)
        worlds = state.worlds
        u, warm = given.control(u, worlds), given.warm_start(warm_start, worlds)
        width = self.nr + 2 * len(self.scene.structure.pairs)
        table, force = self.parameter_array(params, worlds), given.external_force(external_force, worlds)
        after, impulse, gap, multiplier = (self.empty(worlds, n) for n in (self.nx, self.nr, self.nr, width))
        status = given.status(worlds)
        arrays = StepArrays(table, state.array, u, force, warm, after, impulse, gap, multiplier, status)
        self.kernels.stepping.step(arrays)
        friction = (params or self.params)["friction"]

        def by_pair() -> Array:
            contact = contact_impulse(self.scene, impulse.numpy(), friction, self.options)
            return state.give(wp.array(contact, dtype=self.dtype, device=self.device))

        give = state.give
        return Step(
            give(after), give(impulse), give(gap), give(multiplier), give(status), by_pair, self.scene
        )

    def rollout(
        self,
        x0: Array,
        controls: Array = None,
        params: Parameters | None = None,
        *,
        policy: Any = None,
        steps: int | None = None,
        external_force: Array = None,
        record: tuple[str, ...] | str = (),
        checkpoint: int | None = None,
    ) -> Trajectory:
        """Step every world N times in one launch; recorded on an active `wp.Tape` as `step` is.

        Args:
            x0: (B, nx) or (nx,).
            controls: (B, N, nu), or (N, nu) for all worlds, open loop, or None with `policy` and `steps`, or
                with `steps` alone where the scene has no actuators.
            params: see `Simulator.params`; per-world tables need B rows.
            policy: `ddp.TrackingPolicy`, a library's, one of `slcp_warp.policies`, or any object with
                `kernel(sim)` -> (PolicyKernel, struct), or a `policies.HostPolicy`.
            external_force: constant over the rollout, as in `step`.
            record: any of "controls", "impulse", "gap", one name or several; NaN where a world's step was not
                solved, and after it.
            checkpoint: keep the states of steps 0, k, 2k, ..., N only, and recompute the others in a backward
                pass (open loop, nothing else recorded): for long horizons, k near the root of N.

        Raises:
            InputError: bad arguments. A world that cannot be solved has a status instead.
        """
        record = checks.names("record", record, RECORDED)
        state = self._arguments.batch("x0", x0, self.nx)
        worlds = state.worlds
        source = self._controls(controls, policy, steps, worlds, params)
        table = self.parameter_array(params, worlds)
        external = self._arguments.external_force(external_force, worlds)
        status = self._arguments.status(worlds)
        simulated = Simulated.of(self, params)
        if checkpoint is not None:
            every = checks.whole("checkpoint", checkpoint)
            if source.us is None or record:
                raise ArgumentError(f"checkpoint is {every}; it needs controls, and no record")
            states = self.kernels.stepping.checkpointed(
                table, state.array, source.us, external, status, every
            )
            kept = (*range(0, source.steps, every), source.steps)
            own: dict[str, Any] = {"simulated": simulated, "kept": kept, "_measured": self.gaps}
            return Trajectory(state.give(states), state.give(status), **own)
        needed = {*record, "controls"} if taped_policy(source, state.array, table) else record
        controls, impulse, gap = recorded = [
            self._arguments.unknown(worlds if name in needed else 0, source.steps, size)
            for name, size in zip(RECORDED, (self.nu, self.nr, self.nr))
        ]
        states = self.empty(worlds, source.steps + 1, self.nx)
        arrays = RolloutArrays(table, state.array, external, states, controls, impulse, gap, status)
        self.kernels.stepping.rollout(arrays, source, record)
        shown: dict[str, Any] = {n: state.give(a) for n, a in zip(RECORDED, recorded) if n in record}
        return Trajectory(
            state.give(states), state.give(status), simulated=simulated, _measured=self.gaps, **shown
        )

    def gaps(self, states: Array, params: Parameters | None = None) -> np.ndarray:
        """Signed distances of rows (B, nr) in states (B, nx) [m, rad], measured by a step."""
        return to_numpy(self.step(states, params=params).gap)

    def linearize(
        self,
        x: Array,
        u: Array = None,
        params: Parameters | None = None,
        *,
        second: bool = False,
        external_force: Array = None,
    ) -> Linearization:
        """Jacobians of the step at (x, u) by the implicit function theorem (M27).

        Worlds that are not solved, or whose derivatives have no digits, have zero derivatives and a status.
        Where rows of hard contact hold more than bodies can follow the step has a kink: specialised kernels
        give under Anitescu's friction what may lie outside of both sides there, generic kernels one side.

        Args:
            x, u, params, external_force: as for `step`.
            second: second derivatives, too, in closed form (M29), by (M55), or by differences (M30).

        Raises:
            OptionError: options without derivatives.
        """
        tape.derivatives_exist(self.options.method)
        checks.flag("second", second)
        given = self._arguments
        state = given.batch("x", x, self.nx)
        worlds = state.worlds
        control = given.control(u, worlds)
        table = self.parameter_array(params, worlds)
        tape.refuse("x, u or params", "linearize is not recorded", state.array, control, table)
        external = given.external_force(external_force, worlds)
        fx, fu, fzz, status = launches.at_states(
            self.spec, self.kernels.stepping.prepare_linearize, table, state.array, control, external, second
        )
        curved = state.give(fzz) if second else None
        return Linearization(state.give(fx), state.give(fu), curved, state.give(status), self.scene)

    def _controls(
        self, controls: Any, policy: Any, steps: Any, worlds: int, params: Parameters | None
    ) -> Controls:
        """Where a rollout's controls come from."""
        if controls is None and policy is None and steps is not None and not self.nu:
            controls = self._arguments.nothing(steps, worlds)
        if (controls is None) == (policy is None):
            raise ArgumentError("give either controls or policy (with steps)")
        if policy is None:
            return self._arguments.open_loop(controls, steps, worlds)
        steps = checks.whole("steps", steps)
        h = self.params.matching(params, worlds)["step_size"]
        if acts_on_host(policy):
            asked = Asked(policy, self, np.arange(worlds), np.atleast_1d(h))
            if asked.senses:
                asked.look = Felt(tuple(asked.senses.values()), Simulated.of(self, params))
            return Controls(asked, None, steps)
        return Controls(*policy_arrays(at_step_size(policy, h), self, worlds), steps)
