"""Count what the project is made of, and compare it with the budgets in CONTRIBUTING.md.

    python .ci/budgets.py

A budget is a row `| what | at most |` of the table under "Budgets". It may be raised, by a commit that says why.
"""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path

TOP = Path(__file__).parents[1]


def sources(*folders: str) -> dict[Path, ast.Module]:
    """Return the syntax trees of all Python files of some folders."""
    paths = [path for folder in folders for path in sorted((TOP / folder).rglob("*.py"))]
    return {path: ast.parse(path.read_text()) for path in paths}


def lines_of(files: dict[Path, ast.Module]) -> int:
    """Return the number of lines, blank ones and comments included."""
    return sum(len(path.read_text().splitlines()) for path in files)


def functions(files: dict[Path, ast.Module]) -> list[ast.FunctionDef]:
    """Return all functions and methods, inner ones too."""
    return [node for tree in files.values() for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]


def is_kernel(function: ast.FunctionDef) -> bool:
    """Return whether a function is decorated with wp.kernel."""
    return any("wp.kernel" in ast.unparse(decorator) for decorator in function.decorator_list)


def longest(found: list[ast.FunctionDef]) -> int:
    """Return the lines of the longest function."""
    return max((node.end_lineno or node.lineno) - node.lineno + 1 for node in found)


def counts() -> dict[str, int]:
    """Return what is counted, by the names of the table."""
    host, kernels, tests = sources("warpsim"), sources("kernels"), sources("tests")
    classes = [node for tree in host.values() for node in tree.body if isinstance(node, ast.ClassDef)]
    device = [node for node in functions(kernels) if is_kernel(node)]
    return {
        "host lines": lines_of(host),
        "host files": len(host),
        "kernel lines": lines_of(kernels),
        "test lines": lines_of(tests),
        "public classes": sum(not node.name.startswith("_") for node in classes),
        "lines of the longest host function": longest(functions(host)),
        "lines of the longest kernel": longest(device),
        "parameters of a kernel": max(len(node.args.args) for node in device),
        "lines of the longest host file": max(len(path.read_text().splitlines()) for path in host),
    }


def budgets() -> dict[str, int]:
    """Return the budgets of the table in CONTRIBUTING.md."""
    text = (TOP / "CONTRIBUTING.md").read_text().partition("## Budgets")[2].partition("\n## ")[0]
    return {name: int(most.replace(",", "")) for name, most in re.findall(r"^\| ([a-z ]+) \| ([\d,]+) \|$", text, re.M)}


def main() -> int:
    """Print the table; return 1 if a budget is exceeded or missing."""
    found, most = counts(), budgets()
    for name in dict.fromkeys([*found, *most]):
        print(f"{name:38} {found.get(name, '-'):>7} of {most.get(name, '-'):>7}")
    over = [name for name, number in found.items() if number > most.get(name, -1)]
    unknown = [name for name in most if name not in found]
    for name in (*over, *unknown):
        print(f"over budget, or without one: {name}", file=sys.stderr)
    return 1 if over or unknown else 0


if __name__ == "__main__":
    sys.exit(main())
