"""Frames for other processes in real time: packets over ZeroMQ and in a ring of shared memory."""
