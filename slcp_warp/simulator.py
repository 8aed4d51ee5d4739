"""The simulator: steps, rollouts and their derivatives for a batch of worlds of one scene."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.device.progress import name_scene
from slcp_warp.kernels.mechanism.kinematics import make_types
from slcp_warp.kernels.specialisation import Specialisation
from slcp_warp.kernels.step import rollout
from slcp_warp.kernels.step.step import make_step
from slcp_warp.kernels.structure import MOST_ROWS

from .description.scene import Scene
from .gradients import launches, tape
from .gradients.checkpoint import checkpointed
from .inputs import checks
from .inputs.arrays import ArrayError, Batch, from_batch, policy_arrays, same_worlds, to_batch
from .inputs.errors import ArgumentError, ArgumentTypeError
from .options import Options
from .parameters import Parameters
from .results import Linearization, Step, Trajectory, contact_impulse
from .strategy import GenericKernels, StrategyError, choose, current_name

RECORDED = ("controls", "impulse", "gap")
DTYPES = {"float32": wp.float32, "float64": wp.float64}


class Simulator:
    """Steps many worlds of one scene in parallel.

    Args:
        scene: the mechanism; its topology selects the kernels.
        options: what the step solves.
        device: "cpu", "cuda:0", ...; None: the best one present.
        dtype: "float64" (accurate to 1e-12) or "float32" (fast, 2e-5 of the problem's scale).
        strategy: "specialised" kernels, made for the scene; "generic" ones, for large scenes, without
            derivatives and policies; "auto": steps and open-loop rollouts by the scene's size, the rest
            specialised while the scene has at most 31 rows. The attribute says which kernels step.
    """

    def __init__(
        self,
        scene: Scene,
        options: Options | None = None,
        device: Any = None,
        dtype: str = "float64",
        strategy: str = "auto",
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
        self.strategy = choose(current_name(strategy), scene.structure, self.options.method, self.device)
        self._only_generic = self.strategy == "generic" and (strategy != "auto" or self.nr > MOST_ROWS)
        self._generic = GenericKernels(self.spec, self.device) if self.strategy == "generic" else None
        self._none = wp.zeros((0, 0), dtype=self.dtype, device=self.device)

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
        if math.prod(shape) > checks.FEW:
            size = wp.types.type_size_in_bytes(self.dtype)
            checks.memory(f"an array {shape}", math.prod(shape), size, self.device)
        return wp.zeros(shape, dtype=self.dtype, device=self.device)

    def batch(self, name: str, value: Any, *shape: int | str) -> Batch:
        """An argument on the device, checked."""
        return to_batch(name, value, shape, self.dtype, self.device)

    def parameter_array(self, params: Parameters | None, worlds: int) -> wp.array:
        """The parameter table for a number of worlds."""
        params = self.params if params is None else params
        if not isinstance(params, Parameters):
            raise ArgumentTypeError(f"params is a {type(params).__name__}; use sim.params.replace(...)")
        if params.scene.structure != self.scene.structure:
            raise ArgumentError(
                f"params belong to scene {params.scene.name!r}; this simulator has {self.scene.name!r}"
            )
        if params.worlds not in (None, worlds):
            raise ArrayError(f"params are given for {params.worlds} worlds, the arrays for {worlds}")
        return params.array(self.dtype, self.device)

    def _need_specialised(self, what: str) -> None:
        """An error where the scene has no specialised kernels, or was not meant to use them."""
        if self._only_generic:
            raise StrategyError(
                f"{what} needs specialised kernels; scene {self.scene.name!r} ({self.scene.nv} degrees of "
                f"freedom, {self.nr} rows) runs with the generic ones"
            )

    def _need_derivatives(self, what: str) -> None:
        """An error where the scene's kernels or the options have no derivatives."""
        self._need_specialised(what)
        tape.derivatives_exist(self.options.method)

    def _generic_for(self, *arrays: wp.array | None) -> GenericKernels | None:
        """The generic kernels if a step is theirs: not where a tape records."""
        if self._generic is not None and tape.wants_gradient(*arrays):
            self._need_specialised("a gradient on a wp.Tape")
            return None
        return self._generic

    def _external(self, external_force: Any, worlds: int) -> wp.array:
        if external_force is None:
            return self._none
        nb = self.scene.structure.nb
        force = self.batch("external_force", external_force, nb, 3).array
        tape.refuse("external_force", "forces have none: give them as controls of an actuator", force)
        same_worlds("external_force", force.shape[0], worlds)
        return force.contiguous().reshape((worlds, 3 * nb))

    def _controls(self, u: Any, worlds: int) -> wp.array:
        if u is None:
            return self.empty(worlds, max(self.nu, 1))
        control = self.batch("u", u, self.nu).array
        same_worlds("u", control.shape[0], worlds)
        return control if self.nu else self.empty(worlds, 1)

    def step(
        self,
        x: Any,
        u: Any = None,
        params: Parameters | None = None,
        *,
        external_force: Any = None,
        warm_start: Any = None,
    ) -> Step:
        """One time step of every world, (M1) to (M3). Pure: nothing is remembered.

        Recorded on an active `wp.Tape` when x or u are Warp arrays with `requires_grad` or params are
        tracked.

        Args:
            x: (B, nx) or (nx,) states (q, v).
            u: (B, nu) controls, None: zero.
            params: see `Simulator.params`; per-world tables need B rows.
            external_force: (B, bodies, 3) force and torque at the centres of mass [N, N m].
            warm_start: `multiplier` of the worlds' last step.

        Raises:
            ArrayError, ParameterError: bad arguments. A world that cannot be solved has a status instead.
        """
        state = self.batch("x", x, self.nx)
        worlds = state.array.shape[0]
        control = self._controls(u, worlds)
        pairs = len(self.scene.structure.pairs)
        warm = self._none
        if warm_start is not None:
            warm = self.batch("warm_start", warm_start, self.nr + 2 * pairs).array
            same_worlds("warm_start", warm.shape[0], worlds)
        out = [self.empty(worlds, n) for n in (self.nx, self.nr, self.nr, self.nr + 2 * pairs)]
        status = wp.zeros(worlds, dtype=wp.int32, device=self.device)
        table = self.parameter_array(params, worlds)
        inputs = [
            table,
            state.array,
            control,
            self._external(external_force, worlds),
            warm,
            *out,
            status,
        ]
        generic = self._generic_for(table, state.array, control)
        if generic is not None:
            generic.step(worlds, inputs)
        else:
            launch(rollout.make_step_kernel(self.spec), worlds, inputs, self.device)
            run = tape.Recorded(self.spec, table, state.array, control, inputs[3], out[0], status)
            tape.record_step(replace(run, blocked=(("impulse", out[1]), ("gap", out[2]))))
        friction = (params or self.params)["friction"]

        def give(a: wp.array) -> Any:
            return from_batch(a, state.kind, state.batched)

        def by_pair() -> Any:
            contact = contact_impulse(self.scene, out[1].numpy(), friction, self.options)
            return give(wp.array(contact, dtype=self.dtype, device=self.device))

        return Step(give(out[0]), give(out[1]), give(out[2]), give(out[3]), give(status), by_pair)

    def rollout(
        self,
        x0: Any,
        controls: Any = None,
        params: Parameters | None = None,
        *,
        policy: Any = None,
        steps: int | None = None,
        external_force: Any = None,
        record: tuple[str, ...] | str = (),
        checkpoint: int | None = None,
    ) -> Trajectory:
        """Step every world N times in one launch; recorded on an active `wp.Tape` as `step` is.

        Args:
            x0: (B, nx) or (nx,).
            controls: (B, N, nu), open loop, or None with `policy` and `steps`, or with `steps` alone where
                the scene has no actuators.
            policy: an object with `arrays(sim)` -> (name, struct), see `slcp_warp.ddp` policies.
            external_force: constant over the rollout, as in `step`.
            record: any of "controls", "impulse", "gap", one name or several.
            checkpoint: keep the states of steps 0, k, 2k, ..., N only, and recompute the others in a backward
                pass (open loop, nothing else recorded): for long horizons, k near the root of N.

        Raises:
            InputError: bad arguments. A world that cannot be solved has a status instead.
        """
        record = checks.names("record", record, RECORDED)
        state = self.batch("x0", x0, self.nx)
        worlds = state.array.shape[0]
        if controls is None and policy is None and steps is not None and not self.nu:
            steps = checks.whole("steps", steps)
            checks.memory(f"steps = {steps}: the states", worlds * (steps + 1) * self.nx, 8, self.device)
            controls = np.zeros((worlds, steps, 0))
        if (controls is None) == (policy is None):
            raise ArgumentError("give either controls or policy (with steps)")
        if policy is None:
            us = self.batch("controls", controls, "N", self.nu).array
            same_worlds("controls", us.shape[0], worlds)
            name, struct = "open_loop", rollout.POLICIES["open_loop"](self.nx, self.nu, self.dtype).Struct()
            struct.us = us
            if steps is not None and checks.whole("steps", steps) != us.shape[1]:
                raise ArgumentError(
                    f"steps is {steps}, but controls are given for {us.shape[1]}; leave it out"
                )
            steps = us.shape[1]
            if steps < 1:
                raise ArrayError(f"controls has shape {us.shape}; at least one step is needed")
        else:
            steps = checks.whole("steps", steps)
            us = None
            self._need_specialised("a rollout under a policy")
            name, struct = policy_arrays(policy, self, worlds)
        status = wp.zeros(worlds, dtype=wp.int32, device=self.device)
        table = self.parameter_array(params, worlds)
        external = self._external(external_force, worlds)
        give = lambda a: from_batch(a, state.kind, state.batched)  # noqa: E731
        if checkpoint is not None:
            checkpoint = checks.whole("checkpoint", checkpoint)
            if us is None or record:
                raise ArgumentError(f"checkpoint is {checkpoint}; it needs controls, and no record")
            self._need_specialised("a rollout with checkpoints")
            kept = checkpointed(self.spec, table, state.array, us, external, status, checkpoint)
            return Trajectory(give(kept), give(status), None, None, None)
        states = self.empty(worlds, steps + 1, self.nx)
        taped = us is None and tape.differentiable_policy(name, struct, state.array, table)
        stored = {*record, "controls"} if taped else record
        recorded = {
            key: self.empty(worlds if key in stored else 0, steps, max(size, 1))
            for key, size in (("controls", self.nu), ("impulse", self.nr), ("gap", self.nr))
        }
        shown = recorded["controls"] if "controls" in record and self.nu else None
        outputs = [external, states, *recorded.values(), status]
        generic = self._generic_for(table, state.array, us) if us is not None else None
        if generic is not None:
            generic.rollout(worlds, "gap" in record, [table, state.array, us, *outputs])
        else:
            kernel = rollout.make_rollout_kernel(self.spec, name, "gap" in record)
            inputs = [table, state.array, struct, *outputs]
            launch(kernel, worlds, inputs, self.device, grain=max(1, 128 // steps))
        if taped or (us is not None and generic is None):
            used, feedback = (us, None) if us is not None else (recorded["controls"], struct)
            start = state.array
            run = tape.Recorded(self.spec, table, start, used, external, states, status, feedback, shown)
            blocked = tuple((key, recorded[key]) for key in ("impulse", "gap") if key in record)
            tape.record_rollout(replace(run, blocked=blocked))
        return Trajectory(
            give(states), give(status), *(give(recorded[k]) if k in record else None for k in recorded)
        )

    def linearize(
        self,
        x: Any,
        u: Any = None,
        params: Parameters | None = None,
        *,
        second: bool = False,
        external_force: Any = None,
    ) -> Linearization:
        """Jacobians of the step at (x, u) by the implicit function theorem (M27).

        `second` adds second derivatives, in closed form (M29), or by differences (M30) for methods that have
        none. Worlds that are not solved have zero derivatives and a status.
        """
        self._need_derivatives("linearize")
        checks.flag("second", second)
        state = self.batch("x", x, self.nx)
        worlds = state.array.shape[0]
        control = self._controls(u, worlds)
        table = self.parameter_array(params, worlds)
        tape.refuse("x, u or params", "linearize is not recorded", state.array, control, table)
        nz = self.nx + self.nu
        fx, fu = self.empty(worlds, 1, self.nx, self.nx), self.empty(worlds, 1, self.nx, self.nu)
        fzz = self.empty(worlds if second else 0, self.nw, nz, nz)
        status = wp.zeros((worlds, 1), dtype=wp.int32, device=self.device)
        inputs = (
            table,
            1,
            state.array.contiguous().reshape((worlds, 1, self.nx)),
            control.contiguous().reshape((worlds, 1, max(self.nu, 1))),
            self._external(external_force, worlds),
            wp.zeros(0, dtype=wp.int32, device=self.device),
            (fx, fu, fzz, status),
        )
        launches.prepare(self.spec, self.device, *inputs, second)()

        def give(a: wp.array) -> Any:
            return from_batch(a.reshape((worlds, *a.shape[2:])), state.kind, state.batched)

        curved = from_batch(fzz, state.kind, state.batched) if second else None
        return Linearization(give(fx), give(fu), curved, give(status))

    # --- the protocol that slcp_warp.ddp asks of its dynamics ---

    @property
    def nw(self) -> int:
        """Outputs whose second derivatives are independent, see `launches.curved_outputs`."""
        return launches.curved_outputs(self.spec)

    @property
    def state_type(self) -> Any:
        """Warp vector type of a state."""
        return make_types(self.scene.structure, self.dtype).VX

    @property
    def control_type(self) -> Any:
        """Warp vector type of a control."""
        return make_types(self.scene.structure, self.dtype).VU

    @property
    def carry_type(self) -> Any:
        """Warp struct that a rollout passes from step to step (warm start)."""
        self._need_derivatives("the protocol of slcp_warp.ddp")
        return make_step(self.spec, False).Carry

    def step_function(self) -> wp.Function:
        """Warp function (params, row, x, u, carry) -> (x', carry', status)."""
        self._need_derivatives("the protocol of slcp_warp.ddp")
        return rollout.make_transition(self.spec).advance

    def initial_carry(self) -> wp.Function:
        """Warp function () -> carry of a cold start."""
        return rollout.make_transition(self.spec).cold_carry

    def prepare_linearize(
        self,
        xs: wp.array,
        us: wp.array,
        params: wp.array,
        fx: wp.array,
        fu: wp.array,
        second: wp.array | None,
        status: wp.array,
        active: wp.array,
    ) -> Callable[[], None]:
        """A repeatable launch: derivatives along trajectories (B, N+1, nx), (B, N, nu) into given arrays."""
        self._need_derivatives("linearize")
        steps = us.shape[1]
        fzz = self.empty(0, 0, 0, 0) if second is None else second
        inputs = (params, steps, xs, us, self._none, active, (fx, fu, fzz, status))
        return launches.prepare(self.spec, self.device, *inputs, second is not None)

    def linearize_into(self, *arrays: Any) -> None:
        """As `prepare_linearize`, once."""
        self.prepare_linearize(*arrays)()

    def lift_into(self, params: wp.array, lift: wp.array) -> None:
        """lift (B, nw, nx): V . f_zz = sum_i (lift V)_i second[i], see `launches.lift`."""
        values = np.broadcast_to(launches.lift(self.spec, params.numpy()[:, 0]), lift.shape)
        lift.assign(values.astype(wp.dtype_to_numpy(self.dtype)))
