"""Device code of warpsim: Warp functions, structs and kernels, and nothing else.

Imports go one way: this package imports warp, functools and itself. One source runs on the CPU device and on CUDA.
Every kernel writes only what its thread owns, so results do not depend on launch order or thread count.
"""
