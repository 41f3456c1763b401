"""Messages and progress on stderr; what stderr cannot take is dropped, so that no calculation is lost for it.

A message must not end a walk because stderr is a closed pipe, a file on a full disk, or missing, as in a program
without a console.
"""

from __future__ import annotations

import contextlib
import sys


class _Messages:
    """The stream that ``sys.stderr`` is when something is written; characters that it cannot encode are escaped."""

    @property
    def encoding(self) -> str:
        return getattr(sys.stderr, "encoding", None) or "ascii"

    def write(self, text: str) -> int:
        with contextlib.suppress(OSError, ValueError, AttributeError):  # full; closed; None
            try:
                sys.stderr.write(text)
            except UnicodeEncodeError:
                sys.stderr.write(text.encode(self.encoding, "backslashreplace").decode(self.encoding))
        return len(text)

    def flush(self) -> None:
        with contextlib.suppress(OSError, ValueError, AttributeError):
            sys.stderr.flush()

    def isatty(self) -> bool:
        with contextlib.suppress(ValueError, AttributeError):
            return sys.stderr.isatty()
        return False

    def fileno(self) -> int:
        """Return the number of the file. Raises OSError if there is none."""
        with contextlib.suppress(ValueError, AttributeError):
            return sys.stderr.fileno()
        raise OSError("stderr has no file")


messages = _Messages()
"""A stream for messages of hexakin, to be used instead of ``sys.stderr``."""
