"""Synthetic catalogs of element sets, with bad ones among them."""

from __future__ import annotations

import numpy as np

from warpsim.exchange.elements_files import element_records, read_element_records


def parse_element_sets(text):
    """All element sets of a text."""
    return [record.parse() for record in element_records(text)]


def read_element_sets(path):
    """All element sets of a file."""
    return [record.parse() for record in read_element_records(path)]


def checksummed(line):
    """The line with the checksum that it needs."""
    return line[:68] + str(sum(int(c) if c in "0123456789" else c == "-" for c in line[:68]) % 10)


def iss(epoch="19343.69339541"):
    """Two lines of the space station, of a year of two digits and its day."""
    first = checksummed(f"1 25544U 98067A   {epoch}  .00001764  00000-0  38792-4 0  999")
    return first, "2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482"


def low_orbit(number, rng):
    """Name and two lines of a satellite in low orbit, of 20 March 2025, 12:00 UTC."""
    angle = rng.uniform(0.0, 360.0, 3)
    inclination, eccentricity, motion = rng.uniform(30, 100), rng.integers(0, 20_000), rng.uniform(12.5, 15.5)
    return [
        f"SAT {number}",
        checksummed(f"1 {number:05d}U 25001A   25079.50000000  .00000100  00000-0  10000-4 0  999"),
        checksummed(
            f"2 {number:05d} {inclination:8.4f} {angle[0]:8.4f} {eccentricity:07d} {angle[1]:8.4f} {angle[2]:8.4f} "
            f"{motion:11.8f}    1"
        ),
    ]


def uneven(number):
    """So low and with so much drag that SGP4's motion has a kink at 12:28:38, a third of a metre in steps of 12 s."""
    return [
        f"SAT {number}",
        checksummed(f"1 {number:05d}U 25001A   25079.50000000  .00000100  00000-0  24135-1 0  9994"),
        checksummed(f"2 {number:05d}  33.1284  40.3534 0002118 356.3681 277.4808 16.25588122    14"),
    ]


def wrong_checksum(lines):
    return [*lines[:1], lines[1][:68] + str((int(lines[1][68]) + 1) % 10), lines[2]]


def one_line(lines):
    return lines[:2]


def decayed(lines):
    """So much drag that it is down within days."""
    return [
        lines[0],
        checksummed(lines[1].replace("10000-4", "99999-0")),
        checksummed(lines[2][:52] + "16.50000000    1"),
    ]


def not_a_number(lines):
    return [*lines[:2], checksummed(lines[2][:26] + "12O4567" + lines[2][33:])]


FAULTS = (wrong_checksum, one_line, decayed, not_a_number)
"""What happens to sets of real catalogs, in turn."""


def catalog(n, every=100):
    """Lines of a catalog of n satellites, numbered from 1, and the numbers of the bad ones: one of `every`."""
    rng = np.random.default_rng(1)
    lines, bad = [], {}
    for number in range(1, n + 1):
        own = low_orbit(number, rng)
        if number % every == every // 2:
            bad[number] = FAULTS[number // every % len(FAULTS)]
            own = bad[number](own)
        lines += own
    return lines, bad
