"""Hostile input for minutes: `python -m tests.fuzz --minutes N [--seed S]`; exit code 1 where anything broke.

Each case runs in a child process of its own, with bounded time and memory, in a folder of its own. What counts as
broken: a traceback, an end by a signal, processor time above HANG_S, memory above GROWTH_BYTES more than the imports
take, a refusal that is not one printable line, control characters printed, warnings of NumPy, files outside the folder.
`--case K` runs one case again and shows what it prints.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path
from typing import NamedTuple

sys.path[:0] = [str(Path(__file__).parent)]

from fuzz_cases import Case, case  # noqa: E402

HANG_S = 20.0
"""Processor time of a case; wall time may be six times that, on a busy machine."""
GROWTH_BYTES = 2 * 2**30
CRASHED = 99
"""Exit code of a child with a traceback."""
_PARTIAL_LINES = ("warpsim: ", "usage: ")


class Outcome(NamedTuple):
    """How a case ended: a word for what broke, "" for nothing; what it printed; its processor time [s]."""

    broken: str
    printed: str
    cpu_s: float
    code: int


def prepare() -> None:
    """Import what cases need, once: children are copies of this process."""
    import trimesh  # noqa: F401
    import warp as wp

    import warpsim.cli
    import warpsim.dataset.layout
    import warpsim.output.check
    import warpsim.output.czml  # noqa: F401

    wp.config.log_level = wp.LOG_ERROR
    wp.init()


def run_case(one: Case, folder: Path) -> Outcome:
    """Run a case in a child process, in an empty folder."""
    inside = folder / "inside"
    inside.mkdir()
    for name, data in one.files.items():
        (inside / name).write_bytes(data)
    log = folder / "log"
    child = os.fork()
    if not child:
        _child(one, inside, log)
    begun = time.monotonic()
    while True:
        found, status, used = os.wait4(child, os.WNOHANG)
        if found:
            break
        if time.monotonic() - begun > 6 * HANG_S:
            os.kill(child, signal.SIGKILL)
        time.sleep(0.01)
    printed = log.read_bytes().decode("utf-8", "surrogateescape") if log.exists() else ""
    cpu_s = used.ru_utime + used.ru_stime
    left = sorted(path.name for path in folder.iterdir() if path.name not in ("inside", "log"))
    code = os.waitstatus_to_exitcode(status)
    return Outcome(_verdict(code, printed, cpu_s, left), printed, cpu_s, code)


def _child(one: Case, inside: Path, log: Path) -> None:
    """Run the command line on a case; never returns."""
    code = CRASHED
    with contextlib.suppress(BaseException):
        out = os.open(log, os.O_WRONLY | os.O_CREAT)
        os.dup2(out, 1)
        os.dup2(out, 2)
        sys.stdout, sys.stderr = (open(number, "w", encoding="utf-8", closefd=False) for number in (1, 2))  # noqa: SIM115
        os.chdir(inside)
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        most = pages * resource.getpagesize() + GROWTH_BYTES
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
        resource.setrlimit(resource.RLIMIT_CPU, (int(HANG_S), int(HANG_S) + 2))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        signal.signal(signal.SIGXCPU, signal.SIG_DFL)
        code = _command(one)
    with contextlib.suppress(BaseException):
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(code)


def _command(one: Case) -> int:
    from warpsim import cli

    warnings.resetwarnings()
    warnings.simplefilter("default")
    warnings.filterwarnings("ignore", category=DeprecationWarning)
    warnings.showwarning = cli._show_warning
    try:
        return cli.main(one.arguments)
    except SystemExit as ended:
        return int(ended.code or 0)
    except BaseException:
        traceback.print_exc()
        return CRASHED


def _verdict(code: int, printed: str, cpu_s: float, left: list[str]) -> str:
    """What broke, by the rules above."""
    lines = printed.splitlines()
    if code == -signal.SIGXCPU or code == -signal.SIGKILL or cpu_s > HANG_S:
        return "hang"
    if any(words in printed for words in ("MemoryError", "std::bad_alloc", "there is not enough memory")):
        return "memory"
    if code < 0:
        return "signal"
    if code == CRASHED:
        return "traceback"
    if left:
        return "outside"
    if any(not (c.isprintable() or c == "\n") for c in printed):
        return "unprintable"
    if "RuntimeWarning" in printed or any("encountered in" in line for line in lines):
        return "warning"
    refusals = [line for line in lines if line.startswith("warpsim: ") and not line.startswith("warpsim: warning: ")]
    if code == 2 and not (len(refusals) == 1 and all(line.startswith("warpsim: ") for line in lines)):
        return "lines"
    return "" if code in (0, 2) else f"code {code}"


def main() -> int:
    """Run cases until the time is over; 1 where any broke."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--cases", type=int, default=10**9, help="at most so many")
    parser.add_argument("--case", type=int, help="only this one; show what it prints")
    parser.add_argument("--kind", help="only cases of this kind: scene, recipe, mesh, ...")
    options = parser.parse_args()
    prepare()
    first, n_case = (options.first, options.cases) if options.case is None else (options.case, 1)
    end, counts, kinds, broken, slowest = time.monotonic() + 60 * options.minutes, Counter(), Counter(), [], 0.0
    for number in range(first, first + n_case):
        if time.monotonic() > end:
            break
        one = case(options.seed, number)
        if options.kind not in (None, one.kind):
            continue
        with tempfile.TemporaryDirectory() as folder:
            found = run_case(one, Path(folder))
        counts[found.broken or {0: "accepted", 2: "refused"}[found.code]] += 1
        kinds[one.kind] += 1
        slowest = max(slowest, found.cpu_s)
        if found.broken:
            broken.append(number)
            last = next((line for line in reversed(found.printed.splitlines()) if line.strip()), "")
            print(f"case {number}, {one.kind}: {found.broken}: {last[:300]!a}", flush=True)
        if options.case is not None:
            print(one.arguments, *(f"{name}: {data[:3000]!r}" for name, data in one.files.items()), sep="\n")
            print(f"exit code {found.code}, {found.cpu_s:.1f} s\n{found.printed}")
    print(f"{sum(counts.values())} cases of seed {options.seed}: {dict(kinds)}")
    print(f"{dict(counts)}, slowest {slowest:.1f} s of processor time")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
