"""Loops of a compiled kernel, found from its branches, and how many instructions one pass through each has."""

from __future__ import annotations

import heapq
import re
from dataclasses import dataclass

from benchmarks.cubin import Instruction

_TARGET = re.compile(r"\.L_x_\d+")


@dataclass(frozen=True)
class Loop:
    """A natural loop: all that leads back to its first instruction without leaving it."""

    first: int
    """Index of its first instruction."""
    depth: int
    """Loops around it."""
    n_all: int
    """Instructions within, inner loops once, both sides of every branch."""
    n_least: int
    """Instructions on the shortest way through it."""


def find_loops(instructions: list[Instruction], label: dict[str, int]) -> list[Loop]:
    """All loops, by their first instructions.

    Subroutines, called for rare cases of divisions and roots, are not part of the loops that call them.
    """
    graph = _Graph(instructions, label)
    bodies = graph.loops()
    return [
        Loop(
            graph.start[head],
            sum(body < other for other in bodies.values()),
            sum(graph.size[block] for block in body),
            graph.shortest(head, body),
        )
        for head, body in sorted(bodies.items())
    ]


class _Graph:
    """Basic blocks that can be reached from the kernel's first instruction."""

    def __init__(self, instructions: list[Instruction], label: dict[str, int]) -> None:
        n = len(instructions)
        after = [_successors(number, n, item, label) for number, item in enumerate(instructions)]
        starts = {0}
        for number, targets in enumerate(after):
            if targets != [number + 1]:
                starts |= {*targets, number + 1}
        self.start = sorted(starts - {n})
        ends = [*self.start[1:], n]
        block = {first: number for number, first in enumerate(self.start)}
        self.size = [end - first for first, end in zip(self.start, ends, strict=True)]
        self.after = [[block[target] for target in after[end - 1]] for end in ends]
        self.before: list[list[int]] = [[] for _ in self.start]
        self.reached = {0}
        waiting = [0]
        while waiting:
            item = waiting.pop()
            for target in self.after[item]:
                self.before[target].append(item)
                if target not in self.reached:
                    self.reached.add(target)
                    waiting.append(target)

    def loops(self) -> dict[int, set[int]]:
        """Blocks of each loop by its first block: where a branch goes back to what every way to it passes."""
        dominators = self._dominators()
        bodies: dict[int, set[int]] = {}
        for block in self.reached:
            for head in self.after[block]:
                if head in dominators[block]:
                    body = bodies.setdefault(head, {head})
                    waiting = [block]
                    while waiting:
                        item = waiting.pop()
                        if item not in body:
                            body.add(item)
                            waiting += self.before[item]
        return bodies

    def _dominators(self) -> dict[int, set[int]]:
        """Blocks that every way from the first block to a block passes, itself included."""
        dominators = {block: set(self.reached) for block in self.reached}
        dominators[0] = {0}
        changed = True
        while changed:
            changed = False
            for block in sorted(self.reached - {0}):
                new = {block}.union(set.intersection(*(dominators[item] for item in self.before[block])))
                if new != dominators[block]:
                    dominators[block], changed = new, True
        return dominators

    def shortest(self, head: int, body: set[int]) -> int:
        """Fewest instructions from a loop's first block back to it."""
        ways, done = [(self.size[head], head)], set()
        while ways:
            n, block = heapq.heappop(ways)
            if block in done:
                continue
            done.add(block)
            for target in self.after[block]:
                if target == head:
                    return n
                if target in body:
                    heapq.heappush(ways, (n + self.size[target], target))
        raise ValueError(f"block {head} does not lead back to itself")


def _successors(number: int, n: int, item: Instruction, label: dict[str, int]) -> list[int]:
    """Indices of what may be executed behind an instruction."""
    behind = [number + 1] if number + 1 < n else []
    if item.opcode in ("BRA", "BRX"):
        targets = [label[name] for name in _TARGET.findall(item.operands)]
        # "P0, `(.L_x_1)": a second predicate; BRA.DIV has a register there.
        always = item.predicate is None and (item.opcode == "BRX" or item.operands.startswith("`"))
        return targets if always else [*targets, *behind]
    if item.opcode in ("EXIT", "RET"):
        return behind if item.predicate else []
    return behind
