"""Checks and measurements of a host with a GPU, as one program: `python -m benchmarks.gpu`."""
