"""Steps and rollouts as differentiable functions of JAX arrays: `import slcp_warp.jax`.

Forward and backward are one foreign function call each: `jax.jit` calls them, `jax.vmap` folds its dimension
into the worlds, `jax.grad` and `jax.vjp` go through. Backward is the implicit adjoint of
`slcp_warp.gradients.tape`: exact to solver tolerance where a world's status is SOLVED, NaN where it is not.
It can be taken once, and in reverse mode: a second derivative or `jax.jvp` is an error.
"""

from .functions import Jacobians, Outcome, linearize, rollout, step

__all__ = ["Jacobians", "Outcome", "linearize", "rollout", "step"]
