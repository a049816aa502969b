"""Served frames: other processes get the bits of `render`, and disturb nobody."""

import contextlib
import errno
import fcntl
import importlib.util
import json
import re
import shutil
import signal
import subprocess
import sys
import threading
import uuid
from pathlib import Path

import numpy as np
import pytest
from astropy.time import Time, TimeDelta
from command_line import refused
from conftest import slow
from scipy.spatial.transform import Rotation
from waiting import until

import warpsim as ws
from warpsim.serving.packet import HEADER
from warpsim.serving.ring import RING, RingWriter
from warpsim.serving.sockets import CommandSocket

zmq = pytest.importorskip("zmq")

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples" / "serve"
SENSORS, BANDS, N_FRAME = ["sat11", "sat27"], ["A", "C"], 12
PATIENCE_S = 30.0
ABOUT = b'{"scene": "x", "rate_hz": 1, "sensors": [], "bands": []}'


@pytest.fixture(scope="module")
def reader():
    """The example, which knows nothing of warpsim."""
    spec = importlib.util.spec_from_file_location("subscriber", EXAMPLES / "subscriber.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def renderer():
    frames = {"count": 400, "interval_s": 1 / 30, "start_s": 600.0}
    return ws.Renderer(ws.Scene.load("stss").replace(frames=frames, sky__catalog="none"), device="cpu")


@pytest.fixture(scope="module")
def rendered(renderer):
    return renderer.render(range(N_FRAME), SENSORS, BANDS)


@pytest.fixture
def ring():
    """Name of a ring that nobody has."""
    name = f"warpsim-test-{uuid.uuid4().hex}"
    yield name
    (Path("/dev/shm") / name).unlink(missing_ok=True)


def subscribed(address, *topics):
    socket = zmq.Context.instance().socket(zmq.SUB)
    socket.setsockopt(zmq.RCVHWM, 0)
    socket.connect(address)
    for topic in topics:
        socket.subscribe(topic)
    return socket


def received(socket, n_packet, is_any=False):
    """Messages until so many packets (or any messages) have come, or none comes any more."""
    messages = []
    while n_packet and socket.poll(1000 * PATIENCE_S):
        messages.append(socket.recv_multipart())
        n_packet -= is_any or messages[-1][0] != b"scene"
    socket.close()
    return messages


def replied(address, *requests):
    """Replies to requests, one after the other."""
    replies = []
    with zmq.Context.instance().socket(zmq.REQ) as socket:
        socket.connect(address)
        for request in requests:
            socket.send_multipart(request)
            assert socket.poll(1000 * PATIENCE_S)
            replies.append(json.loads(socket.recv()))
    return replies


def counts_of(packet):
    return np.frombuffer(packet, "<u2", offset=HEADER.itemsize).reshape(128, 128)


def assert_rendered(packets, rendered, reader):
    """Packets are all images of the frames in order, with counts, time, state and attitude."""
    fields = [reader.fields_of(packet) for packet in packets]
    scenario = rendered.scenario
    assert [one["sequence"] for one in fields] == list(range(len(rendered.frames) * 4))
    for one, packet in zip(fields, packets, strict=True):
        frame, sensor, band = one["frame"], one["sensor"], one["band"]
        assert one["sequence"] == frame * 4 + sensor * 2 + band
        np.testing.assert_array_equal(counts_of(packet), rendered.counts.numpy()[frame, sensor, band])
        assert (one["sensor_name"], one["band_name"]) == (SENSORS[sensor], BANDS[band])
        assert one["time_s"] == rendered.time_s[frame] and one["loop"] == 0
        position_m, velocity_m_s = scenario.instrument.state(SENSORS[sensor], one["time_s"])
        assert one["position_m"] == tuple(position_m) and one["velocity_m_s"] == tuple(velocity_m_s)
        axes = Rotation.from_quat(one["quaternion"]).as_matrix()
        np.testing.assert_allclose(axes, rendered.axes_icrs[frame, sensor], rtol=0, atol=1e-15)
        utc = Time(scenario.scene.epoch_utc, scale="utc") + TimeDelta(one["time_s"], format="sec")
        assert abs((Time(one["utc"], scale="utc") - utc).sec) < 1e-6
        assert one["due_unix_ns"] <= one["sent_unix_ns"]
        shape = one["n_sensor"], one["n_band"], one["n_row"], one["n_col"], one["dtype"].rstrip(b"\0")
        assert shape == (2, 2, 128, 128, b"<u2")


def test_subscribers_get_the_bits_of_render(renderer, rendered, reader):
    """All of them, or those of a topic; and what the packets are of."""
    options = {"rate_hz": 100.0, "address": "tcp://127.0.0.1:*", "late": "send", "wait_for": 3}
    with ws.FrameServer(renderer, range(N_FRAME), SENSORS, BANDS, **options) as server:
        everything, some = subscribed(server.address, "scene", "frame/"), subscribed(server.address, "frame/sat27/C")
        stats = server.run()
        assert (stats.n_frame, stats.n_dropped, server.n_packet) == (N_FRAME, 0, 4 * N_FRAME)
        messages, only = received(everything, 4 * N_FRAME), received(some, N_FRAME)
    topics, contents = zip(*messages, strict=True)
    assert_rendered(
        [content for topic, content in zip(topics, contents, strict=True) if topic != b"scene"], rendered, reader
    )
    about = json.loads(contents[topics.index(b"scene")])
    assert [item["name"] for item in about["sensors"]] == SENSORS and about["rate_hz"] == 100.0
    levels = rendered.instrument.levels["C"]
    assert about["bands"][1]["nei_w_cm2"] == levels.nei_w_cm2
    assert about["bands"][1]["offset_counts"] == levels.blank_counts
    assert about["packet_bytes"] == 320 + 2 * 128 * 128
    assert [topic for topic, _ in only] == [b"frame/sat27/C"] * N_FRAME


@pytest.fixture(scope="module")
def c_reader(tmp_path_factory):
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler")
    program = tmp_path_factory.mktemp("c") / "subscriber"
    flags = ["-std=c11", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
    subprocess.run([compiler, *flags, "-o", str(program), str(EXAMPLES / "subscriber.c")], check=True)
    return program


@pytest.mark.parametrize("language", ["c", "python"])
def test_readers_of_the_ring_get_the_bits_of_render(language, renderer, rendered, reader, ring, tmp_path, request):
    out, options = tmp_path / "packets", {"rate_hz": 50.0, "ring": ring, "late": "send", "ring_frames": 2 * N_FRAME}
    with ws.FrameServer(renderer, range(N_FRAME), SENSORS, BANDS, **options) as server:
        if language == "c":
            command = [request.getfixturevalue("c_reader"), server.ring, "1000", out]
        else:
            command = [sys.executable, EXAMPLES / "subscriber.py", server.ring, "--out", out, "--timeout", "60"]
        child = started(command)
        assert until(lambda: ring in Path(f"/proc/{child.pid}/maps").read_text())  # it has all from the first packet on
        server.run()
    lines, errors = child.communicate(timeout=PATIENCE_S)
    assert child.returncode == 0, errors
    if language == "c":
        assert errors == "0 overtaken, 0 damaged\n"
    assert lines.splitlines()[-1].startswith(
        f"{4 * N_FRAME - 1}: frame {N_FRAME - 1}, 2025-01-01T14:10:00.366667, sat27 in C, "
    )
    data = out.read_bytes()
    size = HEADER.itemsize + 2 * 128 * 128
    assert_rendered([data[start : start + size] for start in range(0, len(data), size)], rendered, reader)
    assert not Path(f"/dev/shm/{ring}").exists()


def started(command, **options):
    parts = [str(part) for part in command]
    return subprocess.Popen(parts, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


SERVER = """
import sys, time
import numpy as np
from warpsim.serving.ring import RingWriter
writer = RingWriter(sys.argv[1], 8, 384, b'{"scene": "x", "rate_hz": 1, "sensors": [], "bands": []}')
writer.write(np.zeros(384, np.uint8))
print("ready", flush=True)
time.sleep(600)
"""


def test_the_c_reader_ends_when_its_server_was_killed(c_reader, ring, checkout_environment):
    """Also while nobody has asked how it ended."""
    server = started([sys.executable, "-c", SERVER, ring], env=checkout_environment)
    try:
        assert server.stdout.readline() == "ready\n"
        child = started([c_reader, f"/dev/shm/{ring}"])
        assert until(lambda: ring in Path(f"/proc/{child.pid}/maps").read_text())
    finally:
        server.kill()
    lines, errors = child.communicate(timeout=PATIENCE_S)
    server.communicate()
    assert child.returncode == 1 and lines.startswith("0: frame 0, ")
    assert errors == "0 overtaken, 0 damaged\nthe server has gone\n"


def test_the_python_reader_ends_at_ctrl_c(ring, tmp_path):
    writer = RingWriter(ring, 8, 384, ABOUT)
    command = [sys.executable, EXAMPLES / "subscriber.py", writer.path, "--timeout", "600", "--out", tmp_path / "out"]
    child = started(command, preexec_fn=_with_interrupts)
    assert child.stderr.readline() == "x at 1 Hz: ; bands \n"
    child.send_signal(signal.SIGINT)
    assert child.communicate(timeout=PATIENCE_S) == ("", "") and child.returncode == 0
    writer.close()


def test_the_layout_is_that_of_the_c_header_and_of_the_page():
    """Byte and name of every field."""
    text = (EXAMPLES / "warpsim_packet.h").read_text()
    rows = re.findall(r"^  \w+ (\w+)(?:\[\d*\])?; +/\* +(\d+) ", text, re.MULTILINE)
    packet, own = rows[: len(HEADER.names)], [(name, str(HEADER.fields[name][1])) for name in HEADER.names]
    assert packet == own and rows[len(own)] == ("counts", "320")
    assert rows[len(own) + 1 : -1] == [(name, str(RING.fields[name][1])) for name in RING.names]
    page = (ROOT / "docs" / "howto" / "serve.md").read_text()
    assert re.findall(r"^\| (\d+) \| `(\w+)` \|", page, re.MULTILINE) == [(byte, name) for name, byte in own]


def test_a_reader_knows_when_it_was_overtaken(ring, reader, capsys):
    """Packets that were overwritten are counted, those handed over are whole, and in order."""
    size = 4096
    writer, packet = RingWriter(ring, 8, size, ABOUT), np.empty(size, np.uint8)

    def write(numbers):
        for number in numbers:
            packet[:] = number % 251
            writer.write(packet)

    write(range(20))
    packets = reader.from_ring(str(writer.path), 1.0)
    seen = [next(packets) for _ in range(2)]  # 16 and 17: it begins with the last half
    write(range(20, 40))
    seen += [next(packets) for _ in range(2)]  # 18 and 19 are gone
    writer.close()
    seen += list(packets)
    assert [packet[0] for packet in seen] == [16, 17, 36, 37, 38, 39]
    assert all(len(set(packet)) == 1 for packet in seen)
    assert "overtaken: 18 packets are lost" in capsys.readouterr().err


def test_readers_never_take_a_packet_that_is_half_written(ring, reader):
    """A writer as fast as it can be, without a pause, beside a reader."""
    writer, size = RingWriter(ring, 4, 2**16, ABOUT), 2**16
    ended = threading.Event()

    def write():
        packet, number = np.empty(size, np.uint8), 0
        while not ended.is_set():
            packet[:] = number % 251
            writer.write(packet)
            number += 1
        writer.close()

    thread = threading.Thread(target=write)
    thread.start()
    n_seen = 0
    try:
        for packet in reader.from_ring(str(writer.path), PATIENCE_S):
            assert packet == packet[:1] * size
            n_seen += 1
            if n_seen == 200:
                ended.set()
    finally:
        ended.set()
        thread.join()
    assert n_seen >= 200


CHILD = """
import sys, time
sys.path.insert(0, sys.argv[1])
import subscriber
source = sys.argv[2]
packets = subscriber.from_socket(source, "frame/", 60.0) if "://" in source else subscriber.from_ring(source, 60.0)
for packet in packets:
    print(subscriber.fields_of(packet)["sequence"], flush=True)
    time.sleep(float(sys.argv[3]))
"""


@pytest.mark.ci
def test_subscribers_that_are_slow_stopped_or_killed_disturb_nobody(renderer, rendered, reader, ring):
    """One of each kind is killed, one is stopped, one falls behind; the last gets every packet."""
    options = {"rate_hz": 60.0, "ring": ring, "late": "send", "address": "tcp://127.0.0.1:*", "wait_for": 8}
    children = []
    with ws.FrameServer(renderer, range(120), SENSORS, BANDS, **options) as server, contextlib.ExitStack() as stack:
        for source, pause_s in ((server.address, 0), (server.ring, 0), (server.address, 0), (server.address, 0.5)):
            command = [sys.executable, "-c", CHILD, str(EXAMPLES), source, str(pause_s)]
            child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
            stack.callback(child.wait)
            stack.callback(child.kill)
            children.append(child)
        good, messages = subscribed(server.address, "frame/", "scene"), []
        receiving = threading.Thread(target=lambda: messages.extend(received(good, 480)))

        def disturb():
            for child in children:
                child.stdout.readline()  # it is in the middle of things
            children[0].kill()
            children[1].kill()
            children[2].send_signal(signal.SIGSTOP)

        disturbing = threading.Thread(target=disturb)
        receiving.start()
        disturbing.start()
        stats = server.run()
        disturbing.join()
        receiving.join()
    assert (stats.n_frame, stats.n_dropped) == (120, 0)
    packets = [content for topic, content in messages if topic != b"scene"]
    assert [reader.fields_of(packet)["sequence"] for packet in packets] == list(range(480))
    np.testing.assert_array_equal(counts_of(packets[4 * 7 + 2]), rendered.counts.numpy()[7, 1, 0])


def test_a_library_that_does_not_end_holds_up_nobody(renderer, monkeypatch):
    """libzmq may wait forever for a subscriber that is stopped; the server ends all the same."""
    released, ended, term = threading.Event(), [], zmq.Context.term
    monkeypatch.setattr("warpsim.serving.sockets.END_S", 0.0)
    monkeypatch.setattr(zmq.Context, "term", lambda context: ended.append(released.wait(30.0)) or term(context))
    with ws.FrameServer(renderer, range(1), SENSORS, BANDS, address="tcp://127.0.0.1:*"):
        pass
    assert not ended
    released.set()


@pytest.mark.parametrize("late", ["send", "drop"])
def test_late_frames(late, renderer, reader, ring):
    """Frames due within 6 us, sooner than any can be sent: all go out late, or some only; the sequence has no gap."""
    n_frame = 60
    with ws.FrameServer(
        renderer, range(n_frame), SENSORS, ["A"], rate_hz=1e7, ring=ring, late=late, ring_frames=n_frame
    ) as server:
        stats = server.run()
        fields = all_fields(server.ring, reader, server.n_packet)
    frames = [one["frame"] for one in fields[::2]]
    assert [one["sequence"] for one in fields] == list(range(2 * stats.n_frame))
    assert frames == sorted(set(frames)) and len(frames) == stats.n_frame == n_frame - stats.n_dropped
    assert sum(one["flags"] & reader.LATE for one in fields[::2]) == stats.n_late > 0
    assert (stats.n_dropped > 0) == (late == "drop")


def all_fields(path, reader, n_packet):
    """Headers of all packets of a ring that holds them all."""
    data, size = Path(path).read_bytes(), 64 + 320 + 2 * 128 * 128
    first, _, stride = reader.RING.unpack_from(data)[3:6]
    return [reader.fields_of(data[first + k * stride + 64 : first + k * stride + size]) for k in range(n_packet)]


def test_a_loop_goes_on_until_it_is_stopped(renderer, rendered, reader, ring):
    with ws.FrameServer(
        renderer, range(5), SENSORS, ["A"], rate_hz=200.0, ring=ring, loop=True, late="send", ring_frames=500
    ) as server:

        def stop():
            assert until(lambda: server.n_packet > 20)
            server.stop()

        threading.Thread(target=stop).start()
        stats = server.run()
        fields = all_fields(server.ring, reader, min(server.n_packet, 1000))
    assert stats.n_frame > 5
    for one in fields:
        assert (one["loop"], one["frame"]) == divmod(one["sequence"] // 2, 5)


def test_sensors_are_pointed_over_a_socket(renderer, reader):
    """The reply says what was done; bad requests get one line, and the server goes on."""
    options = {"rate_hz": 60.0, "late": "send", "loop": True, "n_ahead": 2}
    options |= {"address": "tcp://127.0.0.1:*", "control": "tcp://127.0.0.1:*", "wait_for": 1}
    replies = []
    with ws.FrameServer(renderer, range(20), SENSORS, ["A"], **options) as server:
        everything = subscribed(server.address, "frame/")

        def ask():
            pointed = [b'{"sensor": "sat99", "track": "main"}'], [b'{"sensor": "sat27", "ra_dec_deg": [10, 20]}']
            replies.extend(replied(server.control, [b"{"], pointed[0], [b"[" * 100_000], [b"{}", b"more"], pointed[1]))
            n_packet = server.n_packet
            assert until(lambda: server.n_packet > n_packet + 2 * 40)  # the pass is over
            server.stop()

        asking = threading.Thread(target=ask)
        asking.start()
        server.run()
        asking.join()
        fields = [reader.fields_of(packet) for _, packet in received(everything, server.n_packet)]
    assert replies[0]["error"].startswith("command: must be JSON: Expecting property name")
    assert replies[1]["error"].startswith("command.sensors: must be sensors of the scene")
    assert all(reply["error"].startswith("command: must be JSON: ") for reply in replies[2:4])
    (row,) = replies[4]["applied"]
    assert row["sensor"] == "sat27" and row["start_s"] == row["settled_s"]
    boresights = [Rotation.from_quat(one["quaternion"]).as_matrix()[2] for one in fields if one["sensor"] == 1]
    ra, dec = np.radians([10.0, 20.0])
    towards = [np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)]
    there = [bool(np.abs(one - towards).max() < 1e-9) for one in boresights]
    assert sum(there) == 20 - row["frame"]
    number = there.index(True)
    assert number % 20 == row["frame"] and all(there[number : number + sum(there)])


def test_whatever_a_command_comes_upon_is_replied():
    """The socket goes on after errors that nobody has thought of."""

    def send(command):
        if command == 1:
            raise KeyError("moon")
        return []

    socket = CommandSocket("tcp://127.0.0.1:*", send)
    try:
        replies = replied(socket.address, [b"1"], [b"2"])
    finally:
        socket.close()
    assert replies[0]["error"].startswith("command: failed: KeyError: ") and replies[1] == {"applied": []}


def test_subscribers_are_attended_to_and_stop_is_heard_between_frames(renderer):
    """The next frame is due in 1000 s."""
    options = {"rate_hz": 0.001, "address": "tcp://127.0.0.1:*"}
    with ws.FrameServer(renderer, range(3), SENSORS, ["A"], **options) as server:
        running = threading.Thread(target=server.run)
        running.start()
        assert until(lambda: server.n_packet == 2)
        topics = [received(subscribed(server.address, "scene"), 1, is_any=True)[0][0] for _ in range(2)]
        server.stop()
        running.join(PATIENCE_S)
        assert not running.is_alive()
    assert topics == [b"scene"] * 2 and server.stats.n_frame == 1


def test_addresses_and_rings_in_use_are_one_line(renderer, ring, tmp_path):
    asked = (renderer, range(3), SENSORS, ["A"])
    with ws.FrameServer(*asked, address="tcp://127.0.0.1:*", ring=ring, control="tcp://127.0.0.1:*") as server:
        port = server.address
        with pytest.raises(ws.InputError, match=f"^address: cannot be bound: Address already in use.*, got '{port}'$"):
            ws.FrameServer(*asked, address=port)
        with pytest.raises(ws.InputError, match=r"^control: cannot be bound: "):
            ws.FrameServer(*asked, ring=f"{ring}2", control=server.control)
        with pytest.raises(ws.InputError, match=r"^ring: must be a ring that no other server writes, got '/dev/shm/"):
            ws.FrameServer(*asked, ring=ring)
    assert not list(Path("/dev/shm").glob(f"{ring}*"))
    with ws.FrameServer(*asked, address=port):  # is free again
        pass
    (tmp_path / "mine").write_text("dear")
    with pytest.raises(ws.InputError, match=r"^ring: must be a name that no other file has"):
        ws.FrameServer(*asked, ring=str(tmp_path / "mine"))
    with pytest.raises(ws.InputError, match=r"^ring: cannot be made: No such file or directory, got '/no/ring'"):
        ws.FrameServer(*asked, ring="/no/ring")
    assert (tmp_path / "mine").read_text() == "dear"
    for folder in (tmp_path, "/", ""):
        with pytest.raises(ws.InputError, match=r"^ring: must be a name that no other file has"):
            ws.FrameServer(*asked, ring=str(folder))
    with pytest.raises(ws.InputError, match=r"^ring: cannot be made: File name too long"):
        ws.FrameServer(*asked, ring="x" * 300)
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_a_ring_that_a_killed_server_has_left_gives_way(renderer, ring):
    with ws.FrameServer(renderer, range(3), SENSORS, ["A"], ring=ring) as server:
        left = Path(server.ring).read_bytes()
    Path(f"/dev/shm/{ring}").write_bytes(left)
    with ws.FrameServer(renderer, range(3), SENSORS, ["A"], ring=ring, rate_hz=100.0) as server:
        server.run()
        assert Path(server.ring).read_bytes()[64:72] == (6).to_bytes(8, "little")


def test_what_a_server_killed_while_it_made_its_ring_has_left_gives_way(tmp_path):
    """A ring appears whole: until then its file has another name, which is taken over."""
    (tmp_path / ".ring.partial").write_bytes(bytes(5000))
    writer = RingWriter(str(tmp_path / "ring"), 2, 64, b"{}")
    assert [path.name for path in tmp_path.iterdir()] == ["ring"]
    assert (tmp_path / "ring").read_bytes()[:6] == b"WSRING"
    writer.close()
    assert not list(tmp_path.iterdir())
    with (tmp_path / ".ring.partial").open("wb") as other:  # of a server that makes its ring just now
        fcntl.flock(other, fcntl.LOCK_EX)
        with pytest.raises(ws.InputError, match=r"^ring: must be a ring that no other server writes"):
            RingWriter(str(tmp_path / "ring"), 2, 64, b"{}")
    assert [path.name for path in tmp_path.iterdir()] == [".ring.partial"]


def test_a_ring_that_cannot_take_its_name_is_one_line(tmp_path, monkeypatch):
    """As where the one left behind is another user's."""

    def refuse(*_):
        raise PermissionError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(Path, "replace", refuse)
    with pytest.raises(ws.InputError, match=r"^ring: cannot be made: Operation not permitted, got '/"):
        RingWriter(str(tmp_path / "ring"), 2, 64, b"{}")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({}, "address, ring: one of them must be given"),
        ({"address": "5555"}, "address: cannot be bound: Invalid argument"),
        ({"ring": "x", "late": "wait"}, "late: must be 'drop' or 'send', got 'wait'"),
        ({"ring": "x", "rate_hz": 0}, "rate_hz: must be a number of at least 1e-06, got 0"),
        ({"ring": "x", "wait_for": 1}, "wait_for: is for subscriptions"),
        ({"ring": "x", "frames": []}, "frames: must hold at least one"),
        ({"ring": "x", "ring_frames": 1}, "ring_frames: must be a whole number >= 2, got 1"),
    ],
)
def test_bad_options_are_one_line(renderer, options, text):
    with pytest.raises(ws.InputError, match=f"^{text}"):
        ws.serve(renderer, **options)
    assert not Path("/dev/shm/x").exists()


def test_the_pace_is_that_of_the_scene_and_a_ring_holds_a_second(renderer, reader, ring):
    with ws.FrameServer(renderer, range(3), SENSORS, ["A"], ring=ring) as server:
        data = Path(server.ring).read_bytes()
    assert json.loads(data[128:4096].rstrip(b"\0"))["rate_hz"] == pytest.approx(30.0, rel=1e-12)
    assert reader.RING.unpack_from(data)[4] == pytest.approx(2 * 30, abs=2)  # frames are whole


def test_the_extra_is_named_where_it_is_missing(renderer, monkeypatch):
    monkeypatch.setitem(sys.modules, "zmq", None)
    with pytest.raises(ws.InputError, match=r"sockets need the extra serve: pip install 'warpsim\[serve\]'"):
        ws.serve(renderer, address="tcp://127.0.0.1:*")


@pytest.mark.ci
@pytest.mark.parametrize("how", [signal.SIGINT, slow(signal.SIGTERM)])
def test_the_command_serves_until_it_is_interrupted(how, ring, checkout_environment):
    command = [sys.executable, "-m", "warpsim", "serve", "stss", "--ring", ring, "--rate", "50", "--loop"]
    command += ["--frames", "60:70", "--sensors", "sat11", "--bands", "A", "--device", "cpu"]
    child = started(command, env=checkout_environment, preexec_fn=_with_interrupts)
    try:
        assert child.stdout.readline() == f"serving stss: ring /dev/shm/{ring}\n"
        path = Path(f"/dev/shm/{ring}")
        assert until(lambda: path.read_bytes()[64:72] > (20).to_bytes(8, "little"))
        child.send_signal(how)
        out, errors = child.communicate(timeout=PATIENCE_S)
    finally:
        child.kill()
    assert (child.returncode, errors) == (0, "")
    assert re.search(r"^\d+ frames, \d+ packets at [\d.]+ Hz, sent [\d.]+ ms after they were due", out, re.MULTILINE)
    assert not path.exists()


def _with_interrupts():
    signal.signal(signal.SIGINT, signal.default_int_handler)  # whatever the test was started with


def test_the_command_refuses_in_one_line(capsys):
    assert "address, ring: one of them must be given" in refused(capsys, "serve", "stss")
    assert "--rate: must be a number, got 'fast'" in refused(capsys, "serve", "stss", "--ring", "x", "--rate", "fast")
