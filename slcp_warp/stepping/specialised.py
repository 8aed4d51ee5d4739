"""Launches of the kernels made for one scene, recorded on a `wp.Tape` where an input requires a gradient."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import warp as wp

from slcp_warp.kernels.device import relay
from slcp_warp.kernels.device.launch import launch
from slcp_warp.kernels.gradients.adjoint import make_adjoint_kernel
from slcp_warp.kernels.policies.open_loop import OPEN_LOOP, make_open_loop
from slcp_warp.kernels.policies.tracking import make_tracking
from slcp_warp.kernels.specialisation import Specialisation
from slcp_warp.kernels.step import relayed, rollout

from ..gradients import launches, tape
from ..gradients.checkpoint import checkpointed
from .arrays import Controls, RolloutArrays, StepArrays
from .host import Asked
from .single import rollout_by_steps
from .taped import record_rollout, record_step


class SpecialisedKernels:
    """The kernels made for one scene, precision and method, on one device.

    Attributes:
        both: of the kernels that step first, and of those that make the steps which these leave; None: those
            of `spec` make all steps.
    """

    def __init__(self, spec: Specialisation, device: Any, fast_path: bool = False) -> None:
        self.spec, self.device = spec, device
        parts = [spec._replace(method=replace(spec.method, part=part)) for part in ("fast", "rest")]
        self.both = (parts[0], parts[1]) if fast_path else None

    def step(self, a: StepArrays) -> None:
        """One step of every world."""
        self._step(a)
        record_step(self, a)

    def _step(self, a: StepArrays) -> None:
        if self.both is None:
            launch(rollout.make_step_kernel(self.spec), a.worlds, a.in_order(), self.device)
            return
        fast, full = (relayed.make_step_relay(spec) for spec in self.both)
        relay.Run(fast, full, a.worlds, 1, a.in_order(), self.device)()

    def rollout(self, a: RolloutArrays, controls: Controls, record: tuple[str, ...]) -> None:
        """All steps of every world.

        Args:
            a: where `controls` has room for all worlds if a tape follows the policy (`taped_policy`).
            record: names of the outputs that the caller gets.
        """
        if isinstance(controls.policy, Asked):
            rollout_by_steps(self._step, self.spec.structure, a, controls.policy, controls.steps)
            return
        self._rollout(a, controls, "gap" in record)
        if controls.us is not None or taped_policy(controls, a.x0, a.table):
            record_rollout(self, a, controls, record)

    def _rollout(self, a: RolloutArrays, controls: Controls, exact_gap: bool) -> None:
        inputs, grain = a.in_order(controls.struct), max(1, 128 // controls.steps)
        if self.both is None:
            kernel = rollout.make_rollout_kernel(self.spec, controls.policy, exact_gap)
            launch(kernel, a.worlds, inputs, self.device, grain=grain)
            return
        (s, dtype, _), policy = self.spec, controls.policy
        assert not isinstance(policy, Asked)
        sizes = s.nr + 2 * len(s.pairs), policy.functions(2 * s.nv, s.nu, dtype).memory
        kept = [wp.empty((a.worlds, size), dtype=dtype, device=self.device) for size in sizes]
        fast, full = (relayed.make_rollout_relay(spec, policy, exact_gap) for spec in self.both)
        relay.Run(fast, full, a.worlds, controls.steps, [*kept, *inputs], self.device, grain)()

    def prepare_linearize(
        self,
        params: wp.array,
        xs: wp.array,
        us: wp.array,
        external: wp.array,
        active: wp.array,
        outputs: tuple[wp.array, wp.array, wp.array, wp.array],
        second: bool,
    ) -> Callable[[], Any]:
        """As `gradients.launches.prepare`."""
        return launches.prepare(
            self.spec, self.device, params, xs, us, external, active, outputs, second, self.both
        )

    def checkpointed(
        self, table: wp.array, x0: wp.array, us: wp.array, external: wp.array, status: wp.array, every: int
    ) -> wp.array:
        """States of steps 0, every, 2 every, ..., N of an open-loop rollout, (B, S+1, nx)."""
        return checkpointed(self, table, x0, us, external, status, every)

    def roll_out(
        self,
        table: wp.array,
        x0: wp.array,
        us: wp.array,
        external: wp.array,
        states: wp.array,
        status: wp.array,
    ) -> None:
        """See `tape.Differentiable`."""
        structure, dtype, _ = self.spec
        worlds, steps = us.shape[:2]
        policy = make_open_loop(x0.shape[1], structure.nu, dtype).Struct()
        policy.us = us
        nothing = [wp.zeros((0, steps, 1), dtype=dtype, device=x0.device)] * 3
        kernel = rollout.make_rollout_kernel(self.spec, OPEN_LOOP, False)
        inputs = [table, x0, policy, external, states, *nothing, status]
        launch(kernel, worlds, inputs, x0.device, grain=max(1, 128 // steps))

    def pull_back(self, run: tape.Recorded, states_grad: wp.array, found: tape.Found) -> None:
        """See `tape.Differentiable`."""
        structure, dtype, _ = self.spec
        policy = run.policy
        if policy is None:
            policy = make_tracking(run.x0.shape[1], structure.nu, dtype).Struct()
        kernel = make_adjoint_kernel(self.spec, run.table.requires_grad, run.policy is not None)
        inputs = [run.table, run.us, policy, run.external, run.states, run.status, states_grad]
        inputs += [found.x0, found.us, found.xs, found.gain, found.table]
        launch(kernel, run.x0.shape[0], inputs, run.x0.device, grain=max(1, 64 // run.us.shape[1]))


def taped_policy(controls: Controls, x0: wp.array, table: wp.array) -> bool:
    """Whether a tape records a rollout under a policy: its controls are kept, whoever asks for them.

    Raises:
        ArgumentError: a gradient is wanted through a policy that has none.
    """
    if controls.us is not None:
        return False
    if isinstance(controls.policy, Asked):
        tape.refuse("x0 or params", "no gradient flows through a policy on the host", x0, table)
        return False
    return tape.differentiable_policy(controls.policy, controls.struct, x0, table)
