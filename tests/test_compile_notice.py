"""What the command line says while kernels are compiled: on a terminal, in a log, and where there is nothing to say."""

from __future__ import annotations

import io
import os
import pty
import re
import subprocess
import sys
import time
from concurrent.futures import Future

import pytest
import warp as wp

from warpsim.commands import compile_notice, options
from warpsim.commands.compile_notice import CompileNotice
from warpsim.render import device


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def notice(monkeypatch):
    """One that waits for a tenth of a second, and takes what takes 0.02 s for compiled."""
    monkeypatch.setattr(compile_notice, "AFTER_S", 0.1)
    monkeypatch.setattr(compile_notice, "CACHED_S", 0.02)
    monkeypatch.setenv("COLUMNS", "100")
    return CompileNotice("/cache")


def begun(notice, n):
    loads = [Future() for _ in range(n)]
    for load in loads:
        notice.add(load)
    return loads


def end(loads):
    for load in loads:
        load.set_result(None)


def test_a_terminal_shows_a_bar_of_what_is_compiled_and_erases_it(notice, monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    loads = begun(notice, 5)
    end(loads[:1])  # from the cache
    time.sleep(0.05)
    end(loads[1:2])
    assert not sys.stderr.getvalue()
    time.sleep(0.2)
    for load in loads[2:]:
        end([load])
    lines = sys.stderr.getvalue().split("\r\x1b[K")
    assert [re.search(r"\[(#*) *\] (\d/\d), once; they are kept in /cache", line).groups() for line in lines[1:-1]] == [
        ("#" * (20 * n // 4), f"{n}/4") for n in (1, 2, 3, 4)
    ]
    assert lines[-1] == "" and "\n" not in sys.stderr.getvalue()


def test_more_that_comes_later_goes_on(notice, monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    for _ in range(2):
        loads = begun(notice, 2)
        time.sleep(0.2)
        end(loads)
    assert re.findall(r"\d/\d", sys.stderr.getvalue()) == ["0/2", "1/2", "2/2", "2/4", "3/4", "4/4"]


def test_a_line_fits_the_terminal(notice, monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setenv("COLUMNS", "40")
    loads = begun(notice, 1)
    time.sleep(0.2)
    end(loads)
    assert {len(line) for line in sys.stderr.getvalue().split("\r\x1b[K")} == {0, 39}


def test_a_log_has_one_line(notice, monkeypatch):
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    for _ in range(2):
        loads = begun(notice, 3)
        time.sleep(0.2)
        end(loads)
    assert sys.stderr.getvalue() == "compiling kernels, once; they are kept in /cache\n"


@pytest.mark.parametrize("terminal", [False, True])
def test_nothing_is_said_of_what_is_soon_over(notice, monkeypatch, terminal):
    monkeypatch.setattr(sys, "stderr", Terminal() if terminal else io.StringIO())
    loads = begun(notice, 3)
    time.sleep(0.05)
    end(loads)
    time.sleep(0.2)
    assert not sys.stderr.getvalue()


def test_failed_compilations_end_the_line(notice, monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    loads = begun(notice, 1)
    time.sleep(0.2)
    loads[0].set_exception(RuntimeError("cannot be compiled"))
    assert sys.stderr.getvalue().endswith("\r\x1b[K")


@pytest.mark.parametrize("quiet", [False, True])
def test_commands_watch_once_unless_they_are_quiet(monkeypatch, quiet):
    monkeypatch.setattr(options, "_NOTICES", [])
    monkeypatch.setattr(device, "_WATCHERS", [])
    options.start_warp(quiet)
    options.start_warp(quiet)
    assert len(device._WATCHERS) == (0 if quiet else 1)


def test_loading_tells_of_each_module_once_and_before_its_wait_ends(monkeypatch):
    seen = []
    monkeypatch.setattr(device, "_WATCHERS", [])
    monkeypatch.setattr(wp, "load_module", lambda module, device, block_dim: time.sleep(0.05))
    device.when_loading(lambda load: load.add_done_callback(seen.append))
    loading = device.KernelLoading(wp.get_device("cpu"))
    kernels = [type("Kernel", (), {"module": name})() for name in ("a", "b", "a")]
    loading.start(*kernels)
    loading.wait()
    assert len(seen) == 2


@pytest.mark.slow  # an empty cache
def test_a_first_command_shows_a_bar(tmp_path, checkout_environment):
    command = [sys.executable, "-m", "warpsim", "render", "stss", "--frames", "60:61", "--sensors", "sat11", "-o"]
    environment = checkout_environment | {"WARP_CACHE_PATH": str(tmp_path / "cache"), "COLUMNS": "200"}
    for run, wanted in (("a", True), ("b", False)):
        ours, theirs = pty.openpty()
        process = subprocess.Popen(
            [*command, str(tmp_path / run)], stdout=subprocess.DEVNULL, stderr=theirs, env=environment
        )
        os.close(theirs)
        said = b""
        try:
            while part := os.read(ours, 4096):
                said += part
        except OSError:  # Linux: the other end is closed
            pass
        os.close(ours)
        assert process.wait() == 0
        assert bool(re.search(rb"compiling kernels  \[#+ *\] \d+/\d+, once; they are kept in", said)) is wanted
