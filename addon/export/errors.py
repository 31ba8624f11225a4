"""What goes wrong when Blender writes a file."""

from __future__ import annotations

import re


class ExportError(OSError):
    """Blender could not write a file. One line: which, and why."""


def reason(error: RuntimeError) -> str:
    """The one line that says it out of an operator's error, which may be a whole traceback."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    told = [line for line in lines if not line.startswith(("File ", "Location:", "Error: Python:"))]
    return re.sub(r"^(Error: |OSError: \[Errno \d+\] )", "", told[-1]) if told else "unknown reason"
