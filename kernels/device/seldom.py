"""A hint to the compiler of a CPU: which way a branch hardly ever goes."""

import warp as wp


# what is not executed, an empty instruction, keeps the branch, and what was said of it, until all is inlined
@wp.func_native("""
#if defined(__CUDA_ARCH__)
return condition;
#else
if (__builtin_expect(condition, 0)) { asm volatile(""); return true; }
return false;
#endif
""")
def seldom(condition: bool) -> bool:
    """The condition. What hangs on it is laid out apart, and registers are spilled there, not before it."""
    ...
