"""Parts of a target that are given inline or by a file."""

from __future__ import annotations

import hashlib
from functools import cached_property
from typing import TYPE_CHECKING

from warpsim.errors import InputError
from warpsim.exchange.source import SourceFile, read_source


class FromFile:
    """Base of config models of a `file`, which is read on first use and then kept, or of fields in its stead."""

    if TYPE_CHECKING:
        file: str | None

    def _is_inline(self, *names: str) -> bool:
        """Check that a file or all of some fields are given; return whether the fields are."""
        given = [getattr(self, name) is not None for name in names]
        if any(given) == (self.file is not None):
            rule = f"exactly one of a file, or {' with '.join(names)}, must be given"
            raise InputError(rule, f"file, {names[0]}")
        if any(given) and not all(given):
            raise InputError("both must be given", ", ".join(names))
        return any(given)

    @cached_property
    def _source(self) -> SourceFile:
        return read_source(str(self.file))

    @property
    def checksum(self) -> str | None:
        """SHA-256 of the file as it was read, in hexadecimal; None for fields.

        Raises:
            InputError: The file cannot be read.
        """
        return None if self.file is None else hashlib.sha256(self._source.data).hexdigest()
