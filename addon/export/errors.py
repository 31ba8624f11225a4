"""Errors of Blender while it writes a file."""

from __future__ import annotations

import re


def reason(error: RuntimeError) -> str:
    """Return the line with the reason from an operator's error, which may be a whole traceback."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    told = [line for line in lines if not line.startswith(("File ", "Location:", "Error: Python:"))]
    return re.sub(r"^(Error: |OSError: \[Errno \d+\] )", "", told[-1]) if told else "unknown reason"
