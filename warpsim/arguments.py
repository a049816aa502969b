"""Arguments of functions: numbers, or astropy quantities converted to a unit, and names.

Each function raises an InputError that names the argument if its value is not what is asked for.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError


def plain_array(value: Any, unit: str, where: str) -> npt.NDArray[np.float64]:
    """Numbers in a unit, any shape, NaN included; plain ones are taken to be in it."""
    if hasattr(value, "unit") and hasattr(value, "to_value"):
        try:
            value = value.to_value(unit)
        except Exception:
            raise InputError(f"must be convertible to {unit}", where, str(value.unit), "s") from None
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"must be numbers, got {type(value).__name__}", where) from None


def plain_number(value: Any, unit: str, where: str) -> float:
    """One number in a unit; NaN is one."""
    if value is None or isinstance(value, bool | str) or np.ndim(value) != 0:
        raise InputError("must be a number", where, value)
    return float(plain_array(value, unit, where))


def finite_number(what: str, value: Any) -> float:
    """A finite number without unit."""
    number = plain_number(value, "", what)
    if not np.isfinite(number):
        raise InputError("must be finite", what, value)
    return number


def times_s(value: Any) -> npt.NDArray[np.float64]:
    """Times after the epoch [s] as an array of one axis or more."""
    return np.atleast_1d(plain_array(value, "s", "time_s"))


def chosen_names(what: str, names: Sequence[str] | None, known: list[str]) -> list[str]:
    """Names as a list, in the order given; all known ones for None, a single name as a list of one."""
    if names is None:
        return known
    if not isinstance(names, str | Sequence):
        raise InputError("must be a list of names", what, names)
    listed = [names] if isinstance(names, str) else list(names)
    if not listed:
        raise InputError("must name at least one", what)
    for name in listed:
        if name not in known:
            raise InputError(f"must be among {some_names(known, 6)}", what, name)
    return listed


def some_names(names: Sequence[str], most: int = 4) -> str:
    """The first of some names, for messages."""
    return ", ".join(names[:most]) + (", ..." if len(names) > most else "")


def whole_number(what: str, value: Any, least: int) -> int:
    """A whole number that is not smaller than asked for."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise InputError(f"must be a whole number >= {least}", what, value)
    return int(value)


def above_zero(what: str, value: Any) -> float:
    """A finite number above 0."""
    kinds = int | float | np.integer | np.floating
    if isinstance(value, bool) or not isinstance(value, kinds) or not 0 < value < np.inf:
        raise InputError("must be a number above 0", what, value)
    return float(value)


def frame_numbers(frames: Sequence[int] | npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return frame numbers as an array; a range is not made a list on the way."""
    if isinstance(frames, range):
        return np.arange(frames.start, frames.stop, frames.step)
    return np.asarray(frames, dtype=np.int64)


def optional_module(name: str, package: str) -> Any:
    """Return the module of a package that the extra of its name brings; InputError where it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError:
        raise InputError(f"needs {package}: pip install 'warpsim[{name}]'", f"ws.{name}") from None


def check_memory(n_byte: float, what: str) -> None:
    """Check that this process can take so many bytes more, before work that needs them begins.

    Where the system does not say how many it can, as only Linux does here, nothing is checked.
    """
    free = free_bytes()
    if n_byte > free:
        rule = f"{what} would take {n_byte / 2**30:.2g} GB of memory, and {max(free, 0.0) / 2**30:.2g} GB are free"
        raise InputError(rule)


def free_bytes() -> float:
    """Return the memory that this process may still take, by machine, control group and limits [bytes]; or infinity."""
    rooms = [math.inf]
    with suppress(OSError, ValueError):
        sizes = dict(line.split(":") for line in Path("/proc/meminfo").read_text().splitlines())
        rooms.append(1024.0 * sum(float(sizes.get(name, "0").split()[0]) for name in ("MemAvailable", "SwapFree")))
    with suppress(OSError, ValueError):  # "max" where there is no limit
        group = Path("/sys/fs/cgroup")
        rooms.append(float((group / "memory.max").read_text()) - float((group / "memory.current").read_text()))
    with suppress(OSError, ValueError, ImportError):
        import resource

        limit, pages = resource.getrlimit(resource.RLIMIT_AS)[0], int(Path("/proc/self/statm").read_text().split()[0])
        rooms.append(math.inf if limit == resource.RLIM_INFINITY else float(limit - pages * resource.getpagesize()))
    return min(rooms)
