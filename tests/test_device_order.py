"""A GPU's work after all that was asked of it: by an event of the device where the driver has one, else by waiting.

Stand-ins for the driver and the device: what the driver makes of it only a GPU shows.
"""

from types import SimpleNamespace

import pytest
import warp as wp

from warpsim.render import pool as pool_module
from warpsim.render.pool import come_after_all


@pytest.fixture
def asked(monkeypatch):
    """What driver, device and host are asked, in order."""
    log = []
    monkeypatch.setattr(wp, "Event", lambda device: SimpleNamespace(cuda_event=f"event of {device.name}"))
    monkeypatch.setattr(wp, "synchronize_device", lambda device: log.append("host waits"))
    return log


def device(log, is_capturing=False):
    waits = SimpleNamespace(wait_event=lambda event: log.append(f"null stream waits for {event.cuda_event}"))
    return SimpleNamespace(name="gpu", context=11, is_capturing=is_capturing, null_stream=waits)


def driver(monkeypatch, log, status):
    def record(context, event):
        log.append((context, event))
        return status

    monkeypatch.setattr(pool_module, "_record_of_context", lambda: record)


def test_the_device_waits_and_the_host_does_not(monkeypatch, asked):
    driver(monkeypatch, asked, 0)
    come_after_all(device(asked))
    assert asked == [(11, "event of gpu"), "null stream waits for event of gpu"]


def test_the_host_waits_where_the_driver_refuses(monkeypatch, asked):
    driver(monkeypatch, asked, 900)
    come_after_all(device(asked))
    assert asked == [(11, "event of gpu"), "host waits"]


def test_the_host_waits_where_the_driver_has_no_such_events(monkeypatch, asked):
    monkeypatch.setattr(pool_module, "_record_of_context", lambda: None)
    come_after_all(device(asked))
    assert asked == ["host waits"]


def test_the_driver_is_not_asked_amid_a_capture(monkeypatch, asked):
    """It would spoil the capture; Warp's own waiting says what is wrong."""
    driver(monkeypatch, asked, 0)
    come_after_all(device(asked, is_capturing=True))
    assert asked == ["host waits"]


@pytest.mark.parametrize("library", ["no-such-library.so", None])
def test_drivers_without_it_are_found_out(monkeypatch, library):
    """A library that is not there, and one (the process itself) without the function."""
    monkeypatch.setattr(pool_module, "_DRIVER", library)
    assert pool_module._record_of_context.__wrapped__() is None


@pytest.mark.gpu
@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device")
def test_a_blocking_stream_comes_after_a_non_blocking_one():
    """Numbers are added on a PyTorch side stream, late; a Warp stream that does not wait for it reads them."""
    torch = pytest.importorskip("torch")
    where = wp.get_device("cuda:0")
    assert pool_module._record_of_context() is not None, "the driver is older than CUDA 12.5"
    side, own = torch.cuda.Stream("cuda:0"), wp.Stream(where)
    values, seen = torch.zeros(1000, device="cuda:0"), wp.zeros(1000, dtype=float, device=where)
    torch.cuda.synchronize()
    with torch.cuda.stream(side):
        torch.cuda._sleep(50_000_000)
        values.add_(1.0)
    come_after_all(where)
    assert not side.query(), "the host did not wait"
    wp.copy(seen, wp.from_torch(values), stream=own)
    wp.synchronize_stream(own)
    assert (seen.numpy() == 1.0).all()
