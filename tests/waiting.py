"""Waiting for what other threads and processes do."""

import time


def until(condition, seconds=60.0):
    """Whether a condition comes to hold: a thread of a busy machine may be late by seconds."""
    end_s = time.monotonic() + seconds
    while not condition() and time.monotonic() < end_s:
        time.sleep(0.01)
    return condition()
