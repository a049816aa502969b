"""Many machines: a Dask cluster as an executor of `concurrent.futures`."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

from warpsim.errors import InputError

CONNECT_TIMEOUT_S = 20


@contextmanager
def dask_executor(address: str) -> Iterator[Executor]:
    """The workers of a Dask cluster.

    Args:
        address: Of the scheduler: tcp://HOST:PORT.

    Raises:
        InputError: Dask is not installed, or no scheduler answers.
    """
    try:
        distributed: Any = importlib.import_module("distributed")
    except ImportError:
        raise InputError("needs the package distributed: pip install 'warpsim[cluster]'", "--scheduler") from None
    try:
        client = distributed.Client(address, timeout=CONNECT_TIMEOUT_S)
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"must be the address of a Dask scheduler, got {address!r}: {reason}", "--scheduler") from None
    with client:
        yield client.get_executor()
