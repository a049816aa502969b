"""Data sets written by Dask workers: the same bytes, and clear words when the scheduler is lost."""

from __future__ import annotations

import socket
import subprocess
import sys
import time

import pytest
from test_dataset_faults import TIMEOUT_S, busy_workers, command, content, recipe, recipe_path, wait_for, whole

import warpsim as ws
from warpsim.cli import main

distributed = pytest.importorskip("distributed")

__all__ = ["recipe", "recipe_path", "whole"]  # fixtures


@pytest.fixture
def address():
    """Of a scheduler that is not there yet."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return f"tcp://127.0.0.1:{free.getsockname()[1]}"


@pytest.fixture
def cluster(address, tmp_path, checkout_environment):
    """A scheduler and two workers, each a process of its own: the scheduler's."""
    run = {"env": checkout_environment, "cwd": tmp_path, "stderr": subprocess.DEVNULL, "stdout": subprocess.DEVNULL}
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard", "--host", "127.0.0.1"]
    scheduler = subprocess.Popen([*dask, "--port", address.rpartition(":")[2]], **run)
    options = ["--nthreads", "1", "--nworkers", "2", "--no-dashboard", "--death-timeout", "10"]
    workers = subprocess.Popen([sys.executable, "-m", "distributed.cli.dask_worker", address, *options], **run)
    yield scheduler
    for process in (workers, scheduler):
        process.terminate()
        process.wait(TIMEOUT_S)


@pytest.mark.slow
def test_dask_workers_write_the_same_bytes(recipe, whole, tmp_path):
    folder = tmp_path / "data"
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        report = ws.write_dataset(recipe, folder, client.get_executor(), device="cpu")
    assert report.n_shard_written == 8
    assert content(folder) == content(whole)


@pytest.mark.slow
def test_a_lost_scheduler_is_told_and_the_run_goes_on_without(
    cluster, address, recipe, recipe_path, whole, tmp_path, checkout_environment
):
    folder = tmp_path / "data"
    arguments = command(recipe_path, folder, "--scheduler", address)
    process = subprocess.Popen(arguments, env=checkout_environment, stderr=subprocess.PIPE, text=True)
    wait_for(lambda: busy_workers(folder), process)
    cluster.kill()
    _, words = process.communicate(timeout=TIMEOUT_S)
    assert process.returncode == 1
    assert "the same command goes on from here: workers were lost" in words.splitlines()[-1]
    time.sleep(0.1)
    ws.write_dataset(recipe, folder, n_worker=1, device="cpu")
    assert content(folder) == content(whole)


@pytest.mark.slow
def test_the_command_runs_on_a_cluster(cluster, address, recipe_path, whole, tmp_path, capsys):
    folder = tmp_path / "data"
    assert main(command(recipe_path, folder, "--scheduler", address)[3:]) == 0
    assert content(folder) == content(whole)


def test_no_scheduler_is_told(monkeypatch, address, recipe_path, tmp_path, capsys):
    monkeypatch.setattr("warpsim.dataset.execution.CONNECT_TIMEOUT_S", 1)
    assert main(command(recipe_path, tmp_path / "data", "--scheduler", address)[3:]) == 2
    error = capsys.readouterr().err
    assert f"--scheduler: must be the address of a Dask scheduler, got '{address}'" in error and error.count("\n") == 1
    assert not (tmp_path / "data").exists()


def test_workers_and_scheduler_exclude_each_other(recipe_path, tmp_path, capsys):
    assert main(command(recipe_path, tmp_path / "data", "--scheduler", "tcp://x:1", "--workers", "2")[3:]) == 2
    assert "--workers: must be left out with --scheduler" in capsys.readouterr().err
