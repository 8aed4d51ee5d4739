"""Steps and rollouts as differentiable PyTorch functions: `import slcp_warp.torch`.

Forward and backward are one opaque operator each: `torch.compile` keeps them whole, `torch.func` sees them;
tensors are shared with Warp, not copied. Backward is the implicit adjoint of `slcp_warp.gradients.tape`:
exact to solver tolerance where a world's status is SOLVED, NaN where it is not. It can be taken once: asking
for a second derivative is an error.
"""

from .closed_loop import closed_loop
from .functions import Outcome, rollout, step
from .module import Rollout

__all__ = ["Outcome", "Rollout", "closed_loop", "rollout", "step"]
