"""Multiplication and addition with one rounding.

Written out, since compilers fuse as they like: so a number comes out with the same bits on every processor, in
every kernel, vectorised or not, and on CUDA, and costs half the instructions.
"""

import warp as wp


@wp.func_native(
    snippet="""
#if defined(__CUDA_ARCH__)
    return fmaf(a, b, c);
#elif defined(__FMA__) || defined(__ARM_FEATURE_FMA)
    return __builtin_fmaf(a, b, c);
#else
    return (float)((double)a * (double)b + (double)c);
#endif
    """
)
def fma(a: float, b: float, c: float) -> float:
    """A * b + c, rounded once; processors without the instruction round the sum twice."""
