"""Frame numbers as they are asked for: any whole numbers in any order; evenly spaced ones stay, or become, a range."""

import numpy as np
import pytest

from warpsim.errors import InputError
from warpsim.render.request import checked_frames

EVEN = [
    range(5),
    range(3, 90, 7),
    range(40, 2, -3),
    [1, 2, 3],
    [9, 6, 3],
    np.arange(50),
    np.array([8, 4], dtype=np.uint8),
]
UNEVEN = [[4, 4], [1, 2, 4], [7, 7, 8], [3], np.array([5, 1, 2]), (np.int64(2), 0, 7), [0, 2, 4, 6, 9]]


@pytest.fixture
def checked(scene):
    return lambda frames: checked_frames(frames, scene.scenario.instrument, scene.duration_s)


@pytest.mark.parametrize("frames", [*EVEN, *UNEVEN], ids=str)
def test_numbers_are_those_asked_for(checked, frames):
    found = checked(frames)
    assert list(found) == [int(number) for number in frames]
    assert all(type(number) is int for number in found)
    assert isinstance(found, range) == any(frames is even for even in EVEN)


def test_no_frames_are_fine(checked):
    for frames in ([], range(0), np.zeros(0, dtype=int)):
        assert list(checked(frames)) == []


@pytest.mark.parametrize(
    ("frames", "wrong"),
    [
        ([3, -1, -2], "-1"), (range(3, -3, -1), "-2"), ([0, 2**32], "4294967296"), ([1, 2**70], str(2**70)),
        (np.array([4, -7, 1]), "-7"), ([True, 1], "True"), ([1.5], "1.5"), (np.array([1.0]), "1"), (range(-4, 4), "-4"),
    ],
    ids=str,
)  # fmt: skip
def test_wrong_numbers_are_named(checked, frames, wrong):
    with pytest.raises(InputError, match=rf"frames: must be whole numbers from 0 to 2\*\*32 - 1, got {wrong}"):
        checked(frames)


def test_frames_beyond_the_scene_are_named(checked):
    for frames in (range(160, 170), [0, 165, 3], np.array([165, 166])):
        with pytest.raises(InputError, match=r"frame 16[25] is at 16[25]0 s, after the scene's end"):
            checked(frames)


@pytest.mark.parametrize("frames", [b"ab", "12", np.array(3), np.float64(2.0)])
def test_what_is_no_list_of_numbers_is_refused(checked, frames):
    with pytest.raises(InputError, match="frames: must be a list or range of frame numbers"):
        checked(frames)


def test_endless_ranges_are_refused_by_their_ends(checked):
    with pytest.raises(InputError, match="after the scene's end"):
        checked(range(2**32))
