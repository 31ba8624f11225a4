"""Settings named in messages.

A message names a setting in backticks, `epsilon`, or with a value, `chain=both`. The core's messages do the same. The
command line and the sidebar replace the names by their own words, so one message serves both.
"""

from __future__ import annotations

import re
from collections.abc import Callable

_NAMED = re.compile(r"`(\w+)(?:=([^`]*))?`")

Words = Callable[[str, str | None], str | None]
"""Function that returns an interface's words for a setting and its value, if any; None for an unknown name."""


def with_names(message: str, words: Words) -> str:
    """Replace every setting named in the message by the words of an interface. Keep other text in backticks."""
    return _NAMED.sub(lambda found: words(found[1], found[2]) or found[0], message)
