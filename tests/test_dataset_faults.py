"""Data sets whose writing goes wrong: nothing lost, nothing doubled, clear words, and the same bytes in the end."""

from __future__ import annotations

import multiprocessing
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import pytest
from conftest import slow

import warpsim as ws
from warpsim.cli import main
from warpsim.dataset import execution, shard
from warpsim.files import prepare_folder, read_json, write_fits_table
from warpsim.output.output_folder import PARTS

pytest.importorskip("pyarrow")

RECIPE = """
scene = "stss"
n_sequence = 8
n_frame = 3
interval_s = 0.1
bands = ["A"]
masks = true
[split]
train = 3
test = 1
[sample]
camera.fov_deg = { uniform = [0.8, 1.2] }
"""
TIMEOUT_S = 120


@pytest.fixture(scope="module")
def recipe_path(tmp_path_factory):
    path = tmp_path_factory.mktemp("recipe") / "recipe.toml"
    path.write_text(RECIPE)
    return path


@pytest.fixture(scope="module")
def recipe(recipe_path):
    return ws.Recipe.load(recipe_path)


@pytest.fixture(scope="module")
def whole(recipe, tmp_path_factory):
    """The data set as it is when nothing goes wrong."""
    folder = tmp_path_factory.mktemp("whole") / "data"
    ws.write_dataset(recipe, folder, n_worker=1, device="cpu")
    return folder


def _broken_off(*arguments, **options):
    raise KeyboardInterrupt


def break_off(step, recipe, folder):
    """Write a data set up to a step, a function by its whole name, and end there as a kill would."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(step, _broken_off)
        with pytest.raises(KeyboardInterrupt):
            ws.write_dataset(recipe, folder, n_worker=1, device="cpu")


def content(folder):
    """Every file of a folder, hidden ones too, and its bytes."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def command(recipe_path, folder, *options):
    return [sys.executable, "-m", "warpsim.cli", "dataset", str(recipe_path), "-o", str(folder), "--device", "cpu",
            "--quiet", *options]  # fmt: skip


def wait_for(found, process):
    """What `found` returns, once it is something."""
    deadline = time.monotonic() + TIMEOUT_S
    while not (result := found()):
        assert process.poll() is None and time.monotonic() < deadline, "nothing came"
        time.sleep(0.002)
    return result


def busy_workers(folder):
    """Process numbers of workers in the middle of a shard: their folders are named after them."""
    return [int(path.name.split("-")[-2]) for path in (folder / PARTS / "work").glob("*")]


@pytest.mark.parametrize("wait_s", [0.0, slow(0.4)])
@pytest.mark.ci
def test_a_killed_run_is_finished_by_the_same_command(recipe_path, whole, tmp_path, checkout_environment, wait_s):
    folder = tmp_path / "data"
    process = subprocess.Popen(command(recipe_path, folder, "--workers", "2"), env=checkout_environment)
    wait_for(lambda: busy_workers(folder), process)
    time.sleep(wait_s)
    process.kill()
    process.wait()
    assert not (folder / "manifest.json").exists()
    complete = content(whole)
    for name, data in content(folder).items():
        assert name.startswith(PARTS) or data == complete[name], f"{name} is neither missing nor whole"
    subprocess.run(command(recipe_path, folder, "--workers", "1"), env=checkout_environment, check=True)
    assert content(folder) == complete


@pytest.mark.slow
def test_workers_do_not_outlive_their_parent(recipe_path, tmp_path, checkout_environment):
    folder = tmp_path / "data"
    process = subprocess.Popen(command(recipe_path, folder, "--workers", "2"), env=checkout_environment)
    workers = wait_for(lambda: busy_workers(folder), process)
    process.kill()
    process.wait()
    deadline = time.monotonic() + TIMEOUT_S
    while any(_runs(worker) for worker in workers):
        assert time.monotonic() < deadline
        time.sleep(0.05)


def _runs(number):
    status = Path(f"/proc/{number}/stat")
    return status.exists() and status.read_text().rpartition(")")[2].split()[0] != "Z"


@pytest.mark.slow
def test_when_a_worker_is_killed_others_do_its_work(recipe_path, whole, tmp_path, checkout_environment):
    folder = tmp_path / "data"
    process = subprocess.Popen(command(recipe_path, folder, "--workers", "2"), env=checkout_environment)
    victim = random.choice(wait_for(lambda: busy_workers(folder), process))
    assert victim != process.pid
    os.kill(victim, signal.SIGKILL)
    assert process.wait(TIMEOUT_S) == 0
    assert content(folder) == content(whole)


@pytest.mark.slow
def test_when_workers_die_again_and_again_it_is_said(recipe, tmp_path, monkeypatch):
    monkeypatch.setattr(execution, "write_shard", _die)
    with pytest.raises(OSError, match=r"the same command goes on from here: worker processes were killed again and ag"):
        ws.write_dataset(recipe, tmp_path / "data", n_worker=2, device="cpu")


def _die(task):
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.ci
def test_an_executor_that_is_lost_is_told_and_what_is_there_stays(recipe, whole, tmp_path):
    class Lost(ThreadPoolExecutor):
        """An executor that is gone after three tasks."""

        n_task = 0

        def submit(self, function, *arguments):
            self.n_task += 1
            return super().submit(function if self.n_task <= 3 else _gone, *arguments)

    folder = tmp_path / "data"
    with Lost(1) as executor, pytest.raises(OSError, match="goes on from here: workers were lost: BrokenExecutor: sch"):
        ws.write_dataset(recipe, folder, executor, device="cpu")
    with ThreadPoolExecutor(1) as executor:
        report = ws.write_dataset(recipe, folder, executor, device="cpu")
    assert report.n_shard_written == 5
    assert content(folder) == content(whole)


def _gone(task):
    raise BrokenExecutor("scheduler is gone")


def test_errors_of_the_work_itself_are_not_called_losses(recipe, tmp_path, monkeypatch):
    def faulty(*arguments):
        raise ZeroDivisionError("a fault of the program")

    monkeypatch.setattr("warpsim.dataset.shard.draw_sequence", faulty)
    with ThreadPoolExecutor(1) as executor, pytest.raises(ZeroDivisionError, match="a fault of the program"):
        ws.write_dataset(recipe, tmp_path / "data", executor, device="cpu")
    assert content(tmp_path / "data") == {}


@pytest.mark.ci
def test_interrupts_leave_what_is_whole(recipe, whole, tmp_path, monkeypatch):
    folder, written = tmp_path / "data", []

    def interrupted(task):
        if len(written) == 2:
            raise KeyboardInterrupt
        written.append(task)
        return write_shard(task)

    write_shard = execution.write_shard
    monkeypatch.setattr(execution, "write_shard", interrupted)
    with pytest.raises(KeyboardInterrupt):
        ws.write_dataset(recipe, folder, n_worker=1, device="cpu")
    monkeypatch.undo()
    assert ws.write_dataset(recipe, folder, n_worker=1, device="cpu").n_shard_written == 6
    assert content(folder) == content(whole)


@pytest.mark.skipif(os.geteuid() != 0, reason="mounting a small disk needs root")
@pytest.mark.ci
def test_a_full_disk_is_told_and_the_run_goes_on_when_there_is_room(recipe, whole, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    size = sum(len(data) for data in content(whole).values())
    if subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size // 2}", "tmpfs", str(disk)]).returncode:
        pytest.skip("nothing may be mounted here")
    try:
        folder = disk / "data"
        with pytest.raises(OSError, match=r"writing failed, the same command goes on from here: .*No space left"):
            ws.write_dataset(recipe, folder, n_worker=1, device="cpu")
        complete = content(whole)
        there = {name: data for name, data in content(folder).items() if not name.startswith(PARTS)}
        assert 0 < len(there) < len(complete)
        assert all(data == complete[name] for name, data in there.items())
        subprocess.run(["mount", "-o", f"remount,size={size * 4}", str(disk)], check=True)
        assert 0 < ws.write_dataset(recipe, folder, n_worker=1, device="cpu").n_shard_written < 8
        assert content(folder) == complete
    finally:
        subprocess.run(["umount", str(disk)], check=True)


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="a folder that takes no files, from root neither")
def test_a_folder_that_takes_no_files_is_told_before_the_work(recipe):
    with pytest.raises(ws.InputError, match="/proc/data: cannot be written: "):
        ws.write_dataset(recipe, "/proc/data", device="cpu")


@pytest.mark.slow
def test_two_runs_do_not_write_into_one_folder(recipe_path, recipe, whole, tmp_path, checkout_environment):
    folder = tmp_path / "data"
    process = subprocess.Popen(command(recipe_path, folder, "--workers", "1"), env=checkout_environment)
    wait_for(lambda: busy_workers(folder), process)
    with pytest.raises(ws.InputError, match="another run is writing to it"):
        ws.write_dataset(recipe, folder, n_worker=1, device="cpu")
    assert process.wait(TIMEOUT_S) == 0
    assert content(folder) == content(whole)


@pytest.mark.parametrize("damage", ["changed", "missing", "manifest cut", "annotations", "left behind"])
@pytest.mark.ci
def test_damage_is_found_and_only_that_is_made_again(recipe, whole, tmp_path, damage):
    folder = tmp_path / "data"
    shutil.copytree(whole, folder)
    victim = next((folder / "train").glob("*/*.fits"))
    if damage == "changed":
        data = bytearray(victim.read_bytes())
        data[5000] ^= 1
        victim.write_bytes(data)
    elif damage == "missing":
        victim.unlink()
    elif damage == "annotations":
        (folder / "annotations" / "train.json").unlink()
    elif damage == "left behind":
        (folder / PARTS / "work" / "train-000000-1-abcdef01").mkdir(parents=True)
        (folder / PARTS / "checkpoints").mkdir()
        victim.unlink()
    else:
        (folder / "manifest.json").write_text((folder / "manifest.json").read_text()[:-100])
    expected = {"annotations": 0}.get(damage, 1)
    if damage == "manifest cut":
        with pytest.raises(ws.InputError, match=r"manifest.json: is there already, .*, or it is damaged; choose"):
            ws.write_dataset(recipe, folder, n_worker=1, device="cpu")
        return
    assert ws.write_dataset(recipe, folder, n_worker=1, device="cpu").n_shard_written == expected
    assert content(folder) == content(whole)


@pytest.mark.ci
def test_a_different_data_set_is_refused_or_replaced(recipe, whole, tmp_path):
    folder = tmp_path / "data"
    shutil.copytree(whole, folder)
    (folder / "train" / "mine.txt").write_text("kept")
    other = ws.Recipe.from_dict(recipe.to_dict() | {"seed": 1, "n_sequence": 2})
    before = content(folder)
    with pytest.raises(ws.InputError, match=r"holds a different data set \(n_sequence: 8 there, 2 here\)"):
        ws.write_dataset(other, folder, n_worker=1, device="cpu")
    assert content(folder) == before
    ws.write_dataset(other, folder, n_worker=1, device="cpu", overwrite=True)
    manifest = read_json(folder / "manifest.json")
    ours = {name for record in manifest["shards"].values() for name in record["files"]} | set(manifest["files"])
    assert set(content(folder)) == ours | {"manifest.json", "train/mine.txt"}


def test_files_of_others_are_never_touched(recipe, tmp_path):
    folder = tmp_path / "data"
    (folder / "train").mkdir(parents=True)
    (folder / "train" / "mine.txt").write_text("kept")
    for overwrite in (False, True):
        with pytest.raises(ws.InputError, match="train: is there already, and warpsim did not write it"):
            ws.write_dataset(recipe, folder, n_worker=1, device="cpu", overwrite=overwrite)
    assert content(folder) == {"train/mine.txt": b"kept"}


@pytest.fixture(scope="module")
def zarr_recipe(recipe):
    pytest.importorskip("zarr", minversion="3")
    return ws.Recipe.from_dict(recipe.to_dict() | {"format": "zarr", "sequences_per_shard": 2})


@pytest.fixture(scope="module")
def zarr_whole(zarr_recipe, tmp_path_factory):
    folder = tmp_path_factory.mktemp("zarr") / "data"
    ws.write_dataset(zarr_recipe, folder, n_worker=1, device="cpu")
    return folder


@pytest.mark.ci
def test_a_lost_shard_of_an_array_is_made_again(zarr_recipe, zarr_whole, tmp_path):
    folder = tmp_path / "data"
    shutil.copytree(zarr_whole, folder)
    (folder / "train" / "images.zarr" / "counts" / "c" / "1" / "0" / "0" / "0" / "0" / "0").unlink()
    assert ws.write_dataset(zarr_recipe, folder, n_worker=1, device="cpu").n_shard_written == 1
    assert content(folder) == content(zarr_whole)


@pytest.mark.parametrize(
    "step", ["_write_stores", "_write_annotations", "_write_sequences", "python_version", "sha256_of"]
)
@pytest.mark.ci
def test_a_run_that_ends_in_its_last_steps_goes_on(zarr_recipe, zarr_whole, tmp_path, step):
    break_off(f"warpsim.dataset.write_dataset.{step}", zarr_recipe, tmp_path / "data")
    assert ws.write_dataset(zarr_recipe, tmp_path / "data", n_worker=1, device="cpu").n_shard_written == 0
    assert content(tmp_path / "data") == content(zarr_whole)


@pytest.mark.parametrize("format", ["fits", "zarr"])
@pytest.mark.ci
def test_what_a_killed_run_left_is_gone_once_another_replaces_it(recipe, tmp_path, monkeypatch, format):
    """Killed when a file has got its name, and others have not."""
    if format == "zarr":
        pytest.importorskip("zarr", minversion="3")
    given = recipe.to_dict() | {"format": format, "n_sequence": 3, "sequences_per_shard": 1}
    bright, faint = (ws.Recipe.from_dict(given | change) for change in ({}, {"least_nei": 1e9, "split": {"train": 1}}))

    mkdir = Path.mkdir

    def broken_off(path, *arguments, **options):
        if path.is_relative_to(tmp_path / "data" / "train") and path.exists():
            raise KeyboardInterrupt
        mkdir(path, *arguments, **options)

    monkeypatch.setattr(Path, "mkdir", broken_off)
    with pytest.raises(KeyboardInterrupt):
        ws.write_dataset(bright, tmp_path / "data", n_worker=1, device="cpu")
    monkeypatch.undo()
    assert any(not name.startswith(PARTS) for name in content(tmp_path / "data"))
    ws.write_dataset(faint, tmp_path / "data", n_worker=1, device="cpu", overwrite=True)
    ws.write_dataset(faint, tmp_path / "fresh", n_worker=1, device="cpu")
    assert content(tmp_path / "data") == content(tmp_path / "fresh")


@pytest.mark.slow
@pytest.mark.parametrize("n_interrupt", [1, 2])
def test_interrupts_end_a_pool_at_once(recipe_path, tmp_path, checkout_environment, n_interrupt):
    folder = tmp_path / "data"
    process = subprocess.Popen(
        command(recipe_path, folder, "--workers", "2"), env=checkout_environment, stderr=subprocess.PIPE, text=True,
        start_new_session=True, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    workers = wait_for(lambda: busy_workers(folder), process)
    for _ in range(n_interrupt):
        os.killpg(process.pid, signal.SIGINT)
        time.sleep(0.2)
    _, words = process.communicate(timeout=TIMEOUT_S)
    assert process.returncode != 0 and not any(_runs(worker) for worker in workers)
    if n_interrupt == 1:
        assert process.returncode == 130
        assert "interrupted; the same command goes on where it stopped" in words


@pytest.mark.ci
def test_a_late_worker_does_not_write_into_another_data_set(recipe, tmp_path, monkeypatch):
    tasks = []
    monkeypatch.setattr(
        "warpsim.dataset.write_dataset.run_tasks", lambda given, *others: tasks.extend(given) or _gone(given)
    )
    with pytest.raises(BrokenExecutor):
        ws.write_dataset(recipe, tmp_path / "data", n_worker=1, device="cpu")
    monkeypatch.undo()
    other = ws.Recipe.from_dict(recipe.to_dict() | {"seed": 1, "n_sequence": 2})
    ws.write_dataset(other, tmp_path / "data", n_worker=1, device="cpu", overwrite=True)
    before = content(tmp_path / "data")
    with pytest.raises(OSError, match=r"No such file|no longer belongs to this run"):
        execution.write_shard(tasks[0])
    assert content(tmp_path / "data") == before and not (tmp_path / "data" / PARTS).exists()


def test_partial_files_of_others_are_left_alone(recipe, tmp_path):
    (tmp_path / ".movie.partial").write_text("mine")
    ws.write_dataset(ws.Recipe.from_dict(recipe.to_dict() | {"n_sequence": 1}), tmp_path, n_worker=1, device="cpu")
    assert (tmp_path / ".movie.partial").read_text() == "mine"


def test_a_recipe_that_fails_before_anything_is_written_leaves_the_folder_free(recipe, tmp_path):
    hopeless = ws.Recipe.from_dict(recipe.to_dict() | {"n_sensor": 28, "n_frame": 1000, "sample": {}})
    with pytest.raises(ws.InputError, match=r"sequence 0: in 1 draws there were never 28 sensors with access"):
        ws.write_dataset(hopeless, tmp_path / "data", n_worker=1, device="cpu")
    assert content(tmp_path / "data") == {} and not (tmp_path / "data" / PARTS).exists()


@pytest.mark.ci
def test_a_complete_data_set_is_recognized_where_nothing_can_be_written(recipe, whole, monkeypatch):
    def refused(folder):
        raise ws.InputError(f"{folder}: cannot be written: Read-only file system")

    monkeypatch.setattr("warpsim.output.output_folder.prepare_folder", refused)
    assert ws.write_dataset(recipe, whole, n_worker=1, device="cpu").n_shard_written == 0


@pytest.mark.ci
def test_workers_that_would_write_other_files_do_not(recipe, whole, tmp_path, monkeypatch):
    """On a cluster: another version of a package, or another file under the same path."""
    import warpsim.dataset.layout as identity

    folder = tmp_path / "data"
    own = identity.package_versions
    monkeypatch.setattr(
        "warpsim.dataset.write_dataset.identity_of",
        lambda *given: identity.identity_of(*given) | {"packages": own("pyarrow") | {"numpy": "1.0"}},
    )
    with pytest.raises(ws.InputError, match=r"this worker would write other files .*packages.numpy: \"1.0\" there, "):
        ws.write_dataset(recipe, folder, n_worker=1, device="cpu")
    assert content(folder) == {}


def test_either_an_executor_or_a_number_of_workers(recipe, tmp_path):
    with ThreadPoolExecutor(1) as executor, pytest.raises(ws.InputError, match="n_worker: must be left out with an"):
        ws.write_dataset(recipe, tmp_path / "data", executor, n_worker=2)


@pytest.mark.ci
def test_few_tasks_wait_at_a_time(recipe, whole, tmp_path, monkeypatch):
    waiting = []

    class Counting(ThreadPoolExecutor):
        def submit(self, function, *arguments):
            waiting.append(self._work_queue.qsize())
            return super().submit(function, *arguments)

    monkeypatch.setattr(execution, "MOST_WAITING", 2)
    with Counting(1) as executor:
        ws.write_dataset(recipe, tmp_path / "data", executor, device="cpu")
    assert len(waiting) == 8 and max(waiting) <= 1
    assert content(tmp_path / "data") == content(whole)


@pytest.mark.parametrize("format", ["fits", "zarr"])
@pytest.mark.ci
def test_a_repair_that_is_killed_goes_on(recipe, whole, zarr_recipe, zarr_whole, tmp_path, format):
    given, complete = (recipe, whole) if format == "fits" else (zarr_recipe, zarr_whole)
    folder = tmp_path / "data"
    shutil.copytree(complete, folder)
    next((folder / "train").rglob("truth.parquet" if format == "fits" else "*.truth.parquet")).unlink()
    break_off("warpsim.dataset.shard._write_files", given, folder)
    assert not (folder / "manifest.json").exists()
    assert ws.write_dataset(given, folder, n_worker=1, device="cpu").n_shard_written == 1
    assert content(folder) == content(complete)


@pytest.mark.ci
def test_a_run_killed_in_its_last_moment_is_tidied_up(recipe, whole, tmp_path):
    folder = tmp_path / "data"
    shutil.copytree(whole, folder)
    (folder / "annotations" / "train.json").unlink()
    break_off("warpsim.output.output_folder.clear", recipe, folder)
    assert (folder / PARTS / "run.json").exists() and (folder / "manifest.json").exists()
    assert ws.write_dataset(recipe, folder, n_worker=1, device="cpu").n_shard_written == 0
    assert content(folder) == content(whole) and not (folder / PARTS).exists()


@pytest.mark.ci
def test_the_reason_is_told_however_busy_other_workers_are(recipe, tmp_path, monkeypatch):
    png = ws.Recipe.from_dict(recipe.to_dict() | {"format": "png", "n_frame": 20})
    draw = shard.draw_sequence

    def first_is_wrong(given, number):
        if number == 0:
            time.sleep(0.3)
            raise ws.InputError("sequence 0: the reason")
        return draw(given, number)

    monkeypatch.setattr("warpsim.dataset.shard.draw_sequence", first_is_wrong)
    with ThreadPoolExecutor(4) as executor, pytest.raises(ws.InputError, match="sequence 0: the reason"):
        ws.write_dataset(png, tmp_path / "data", executor, device="cpu")


@pytest.mark.parametrize("loss", ["worker", "pool"])
@pytest.mark.ci
def test_losses_of_an_executor_of_the_users_are_told(recipe, tmp_path, monkeypatch, loss):
    monkeypatch.setattr(execution, "write_shard", _die)
    executor = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"))
    if loss == "pool":
        executor.shutdown()
    reason = "BrokenProcessPool" if loss == "worker" else "RuntimeError: cannot schedule new futures"
    with executor, pytest.raises(OSError, match=f"goes on from here: workers were lost: {reason}"):
        ws.write_dataset(recipe, tmp_path / "data", executor, device="cpu")


def test_a_failure_does_not_hide_what_was_done_at_the_same_time(recipe, tmp_path, monkeypatch):
    """Two tasks end together, one well: its checkpoint record counts."""
    good, bad = Future(), Future()
    good.set_result({"shard": "good"})
    bad.set_exception(ws.InputError("bad"))
    futures, done = iter([bad, good]), []

    class Ready(ThreadPoolExecutor):
        def submit(self, function, *arguments):
            return next(futures)

    with Ready(1) as executor, pytest.raises(ws.InputError, match="bad"):
        execution._collect(executor, [None, None], done.append)
    assert done == [{"shard": "good"}]


def test_runs_that_begin_together_do_not_disturb_each_other(tmp_path):
    for number in range(40):
        folder = tmp_path / f"{number}" / "data"
        with ThreadPoolExecutor(4) as executor:
            list(executor.map(prepare_folder, [folder] * 8))
        assert list(folder.iterdir()) == []


def test_files_that_change_during_a_run_are_found(tmp_path, monkeypatch):
    catalog = tmp_path / "stars.fits"
    write_fits_table(ws.StarCatalog.synthetic(500, seed=1).to_table(), catalog)
    scene = ws.Scene.load("stss").replace(sky__catalog=str(catalog))
    given = ws.Recipe(scene=scene, n_sequence=3, n_frame=1, bands="A")
    draw = shard.draw_sequence

    def changed(recipe, number):
        if number == 1:
            write_fits_table(ws.StarCatalog.synthetic(400, seed=2).to_table(), catalog)
        return draw(recipe, number)

    monkeypatch.setattr("warpsim.dataset.shard.draw_sequence", changed)
    with pytest.raises(ws.InputError, match=r"stars.fits: was changed while the data set was written"):
        ws.write_dataset(given, tmp_path / "data", n_worker=1, device="cpu")


@pytest.mark.ci
def test_kept_annotations_are_used_and_those_that_are_damaged_made_anew(recipe, whole, tmp_path, monkeypatch):
    folder, made = tmp_path / "data", []
    texts = shard._texts
    monkeypatch.setattr(shard, "_texts", lambda *given: made.append(given) or texts(*given))
    break_off("warpsim.dataset.write_dataset._Dataset.finish", recipe, folder)
    assert len(made) == 8
    kept = folder / PARTS / "coco" / "train-000000.json"
    kept.write_text(kept.read_text().replace("0", "1", 1))
    ws.write_dataset(recipe, folder, n_worker=1, device="cpu")
    assert len(made) == 9
    assert content(folder) == content(whole)


@pytest.mark.ci
def test_a_file_of_somebody_in_a_folder_to_come_is_not_touched(recipe, tmp_path):
    folder = tmp_path / "data"
    break_off("warpsim.dataset.write_dataset._Dataset.finish", recipe, folder)
    (name,) = {Path(name).parent for name in read_json(folder / PARTS / "checkpoints" / "train-000001.json")["files"]}
    home = folder / name
    (folder / PARTS / "checkpoints" / "train-000001.json").unlink()
    (home / "truth.parquet").write_text("mine")
    with pytest.raises(ws.InputError, match=rf"{name}/.*: is there already, and warpsim did not write it"):
        ws.write_dataset(recipe, folder, n_worker=1, device="cpu")
    assert (home / "truth.parquet").read_text() == "mine"


def test_a_link_in_place_of_a_split_is_refused(recipe, whole, tmp_path):
    folder = tmp_path / "data"
    shutil.copytree(whole, folder)
    (folder / "train").rename(tmp_path / "elsewhere")
    (folder / "train").symlink_to(tmp_path / "elsewhere")
    other = ws.Recipe.from_dict(recipe.to_dict() | {"seed": 1})
    before = content(tmp_path / "elsewhere")
    with pytest.raises(ws.InputError, match="train: must not be a link"):
        ws.write_dataset(other, folder, n_worker=1, device="cpu", overwrite=True)
    assert content(tmp_path / "elsewhere") == before


def test_a_worker_that_is_late_after_rendering_leaves_nothing(recipe, tmp_path, monkeypatch):
    folder = tmp_path / "data"
    write_files = shard._write_files

    def late(work, task, scratch):
        drawn = write_files(work, task, scratch)
        run = folder / PARTS / "run.json"
        run.write_text(run.read_text().replace(task.key, "0" * 64))
        for path in (folder / PARTS / "coco").iterdir():  # of the run that has begun since
            path.unlink()
        return drawn

    monkeypatch.setattr("warpsim.dataset.shard._write_files", late)
    with pytest.raises(OSError, match="no longer belongs to this run"):
        ws.write_dataset(recipe, folder, n_worker=1, device="cpu")
    assert not (folder / "train").exists() and not (folder / "test").exists()
    assert not list((folder / PARTS).glob("coco/*"))


def test_animations_are_the_same_in_whatever_calls_frames_come(recipe, tmp_path, monkeypatch):
    given = ws.Recipe.from_dict(
        recipe.to_dict() | {"preview": "gif", "n_sequence": 1, "n_frame": 7, "split": {"all": 1}, "coco": False}
    )
    monkeypatch.setattr("warpsim.dataset.writers.PREVIEW_FRAMES", 3)
    ws.write_dataset(given, tmp_path / "one", n_worker=1, device="cpu")
    monkeypatch.setattr("warpsim.dataset.shard.BYTES_PER_CALL", 1)
    ws.write_dataset(given, tmp_path / "many", n_worker=1, device="cpu")
    assert content(tmp_path / "one") == content(tmp_path / "many")
    (film,) = (tmp_path / "one" / "all" / "000000").glob("*.gif")
    assert pytest.importorskip("PIL.Image").open(film).n_frames == 3


@pytest.mark.ci
def test_runs_of_render_and_data_sets_do_not_replace_each_other(recipe, whole, tmp_path):
    scene = ws.Scene.load("stss")
    with pytest.raises(ws.InputError, match="holds a data set, no rendered run; choose another folder"):
        ws.render_to_folder(scene, whole, range(60, 61), ["sat11"], ["A"], overwrite=True)
    ws.render_to_folder(scene, tmp_path / "run", range(60, 61), ["sat11"], ["A"])
    before = content(tmp_path / "run")
    with pytest.raises(ws.InputError, match="holds a rendered run, no data set; choose another folder"):
        ws.write_dataset(recipe, tmp_path / "run", n_worker=1, device="cpu", overwrite=True)
    assert content(tmp_path / "run") == before


def test_an_unfinished_run_of_render_is_left_as_it_is(recipe, tmp_path, monkeypatch):
    scene, folder = ws.Scene.load("stss"), tmp_path / "run"
    monkeypatch.setattr("warpsim.output.run.Run.finish", _broken_off)
    with pytest.raises(KeyboardInterrupt):
        ws.render_to_folder(scene, folder, range(60, 61), ["sat11"], ["A"])
    monkeypatch.undo()
    before = content(folder)
    assert any(name.startswith(PARTS) for name in before)
    with pytest.raises(ws.InputError, match="holds a rendered run, no data set; choose another folder"):
        ws.write_dataset(recipe, folder, n_worker=1, device="cpu", overwrite=True)
    assert content(folder) == before


@pytest.mark.ci
def test_a_failure_ends_a_pool_without_waiting_for_its_other_tasks(recipe, tmp_path, monkeypatch):
    monkeypatch.setattr(execution, "write_shard", _first_fails_others_take_long)
    begin = time.monotonic()
    with pytest.raises(ws.InputError, match="the reason"):
        ws.write_dataset(recipe, tmp_path / "data", n_worker=2, device="cpu")
    assert time.monotonic() - begin < LONG_S


LONG_S = 300.0


def _first_fails_others_take_long(task):
    if task.shard.number == 0 and task.shard.split == "train":
        raise ws.InputError("the reason")
    time.sleep(LONG_S)


# --- Dask workers: the same bytes, and clear words when the scheduler is lost ---


@pytest.fixture
def address():
    """Of a scheduler that is not there yet."""
    pytest.importorskip("distributed")
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
    distributed = pytest.importorskip("distributed")
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
