"""The thread that keeps a page up to date, on a page that only notes what it is told to show."""

from __future__ import annotations

import time
from types import SimpleNamespace

from waiting import until

from warpsim.live.page import Player, Status


def playing_on(frames, frames_per_s=0.0, fails=()):
    """A player and its page; frames that fail are not shown."""
    page = SimpleNamespace(frame=frames[0], frames=list(frames), status=Status(), seen=[])

    def show(frame, images):
        page.seen.append((frame, images))
        if frame not in fails:
            page.frame = frame

    return Player(page, show, lambda: frames_per_s), page


def test_what_is_asked_for_is_shown_once_and_failures_are_not_tried_again():
    player, page = playing_on(range(10), fails=[7])
    player.start()
    player.ask(3)
    assert until(lambda: page.frame == 3)
    player.ask(7)
    assert until(lambda: (7, None) in page.seen and player.wanted == 3)
    player.ask_again()
    assert until(lambda: len(page.seen) == 3)
    time.sleep(0.05)
    assert page.seen == [(3, None), (7, None), (3, None)] and player._thread.is_alive()
    player.stop()
    assert not player._thread.is_alive()


def test_playing_drops_frames_and_ends_with_the_last():
    player, page = playing_on(range(100, 200), frames_per_s=2000.0, fails=[199])
    player.playing = True
    player.start()
    assert until(lambda: not player.playing)
    player.stop()
    shown = [frame for frame, _ in page.seen]
    assert shown == sorted(set(shown)) and shown[-1] == page.frame == 199
    assert page.status.n_dropped == 99 - len(shown)


def test_of_what_is_offered_the_last_is_shown():
    player, page = playing_on(range(10))
    for frame in (1, 2, 5):
        player.offer(frame, str(frame))  # stands for the function of the images
    player.start()
    assert until(lambda: page.seen)
    player.stop()
    assert page.seen == [(5, "5")] and page.status.n_dropped == 2 and player.wanted == 5
