"""Programs that a user could pick instead, given the same work: NumPy, a tuned Numba program, GalSim, sdasim.

They are told where each source of each frame is and how bright, before the clock starts; ours works it out from orbits,
catalog and attitudes. All draw point sources, integrated over pixels but by sdasim, add fresh Gaussian noise, clip, and
leave uint16 in host memory. The packages are the extra `peers`; sdasim is the extra `peer-sdasim`, for it brings
PyTorch.

SatSim is not here: its package pulls TensorFlow and could not be run with the others.
"""
