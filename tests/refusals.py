"""Errors that are one line."""

from contextlib import contextmanager

import pytest

import warpsim as ws


@contextmanager
def refused_in_one_line(message):
    """Expect an InputError that a message matches."""
    with pytest.raises(ws.InputError, match=message) as caught:
        yield
    assert "\n" not in str(caught.value)
