"""Compiled kernels as the tools of CUDA show them: registers, stack, and instructions in order.

`cuobjdump` and `nvdisasm` come in small wheels (0.3 and 5 MB, the extra `gpu-tables`) and need no GPU and no driver.
"""

from __future__ import annotations

import importlib.metadata
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

PACKAGES = {"cuobjdump": "nvidia-cuda-cuobjdump", "nvdisasm": "nvidia-cuda-nvdisasm"}
"""The wheel of each tool."""

_FUNCTION = r"Function (\S+):\s+REG:(\d+) STACK:(\d+)"
_LIMIT = r"\n\.nv\.info\.(\S+)\n(?:(?!\n\.nv\.info).)*?EIATTR_MAXREG_COUNT\s+Format:\s+\S+\s+Value:\s+(0x[0-9a-f]+)"
_LABEL = re.compile(r"\s*(\S+):\s*")
_INSTRUCTION = re.compile(r"\s*/\*[0-9a-f]+\*/\s+(?:@(!?U?P\w+)\s+)?([A-Z][\w.]*)\s*(.*?)\s*;")


class ToolMissingError(RuntimeError):
    """A tool of CUDA is not installed."""


@dataclass(frozen=True)
class Instruction:
    """One machine instruction."""

    predicate: str | None
    """Predicate, "P0" or "!P0"."""
    opcode: str
    """Without its modifiers."""
    operands: str

    @property
    def is_in_frame(self) -> bool:
        """Whether it is an access to a fixed address of the thread's stack."""
        return self.opcode in ("LDL", "STL") and "[R1" in self.operands


@dataclass(frozen=True)
class Function:
    """A kernel in a cubin."""

    n_register: int
    most_registers: int
    """Limits of the compiler."""
    stack_bytes: int
    instructions: list[Instruction]
    """In order, padding behind the last one included."""
    label: dict[str, int]
    """Index of the instruction behind each label."""


def tool(name: str) -> Path:
    """Path of a tool, from its wheel or else from the search path.

    Raises:
        ToolMissingError: It is in neither.
    """
    try:
        files = importlib.metadata.files(PACKAGES[name]) or []
        found = [Path(str(file.locate())) for file in files if file.name in (name, f"{name}.exe")]
    except importlib.metadata.PackageNotFoundError:
        found = []
    on_path = shutil.which(name)
    if not found and on_path is None:
        raise ToolMissingError(f"needs {name}: pip install {PACKAGES[name]}, or warpsim[gpu-tables]")
    return found[0] if found else Path(str(on_path))


def read_function(cubin: Path, key: str) -> Function:
    """Read the forward kernel of a key.

    Raises:
        ToolMissingError: cuobjdump or nvdisasm is not installed.
        ValueError: The cubin has no such kernel.
    """
    name = re.compile(rf"{re.escape(key)}_[0-9a-f]+_cuda_kernel_forward")
    listing = _output("cuobjdump", "-res-usage", cubin)
    usage = {found[1]: (int(found[2]), int(found[3])) for found in re.finditer(_FUNCTION, listing)}
    function = next(filter(name.fullmatch, usage), None)
    if function is None:
        raise ValueError(f"{cubin.name}: no kernel {key}")
    limits = dict(re.findall(_LIMIT, _output("cuobjdump", "-elf", cubin), re.DOTALL))
    sections = re.split(r"\n\s*\.section\s+\.text\.(\S+?),", _output("nvdisasm", "-c", cubin))
    instructions, label = parse(dict(zip(sections[1::2], sections[2::2], strict=True))[function])
    return Function(usage[function][0], int(limits[function], 16), usage[function][1], instructions, label)


def parse(text: str) -> tuple[list[Instruction], dict[str, int]]:
    """Instructions and labels of a disassembled function."""
    instructions: list[Instruction] = []
    label: dict[str, int] = {}
    for line in text.splitlines():
        if found := _INSTRUCTION.match(line):
            instructions.append(Instruction(found[1], found[2].partition(".")[0], found[3]))
        elif found := _LABEL.fullmatch(line):
            label[found[1]] = len(instructions)
    return instructions, label


def _output(name: str, option: str, cubin: Path) -> str:
    """Output of a tool for a file."""
    done = subprocess.run([tool(name), option, cubin], capture_output=True, text=True, check=True)
    return done.stdout
