"""Results of benchmarks that are programs of their own."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any


def write_or_print(found: dict[str, Any], path: Path | None) -> None:
    """Write a result as JSON, or print it where no path is given."""
    text = json.dumps(found, indent=1) + "\n"
    if path:
        path.write_text(text)
    else:
        print(text)
