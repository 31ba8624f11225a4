"""Settings in messages. A message names a setting in backticks, `epsilon`, or with a value, `chain=both`. The core does
so too. The command line and the sidebar each put their own words there, so a message is written once for both."""

from __future__ import annotations

import re
from collections.abc import Callable

_NAMED = re.compile(r"`(\w+)(?:=([^`]*))?`")

Words = Callable[[str, str | None], str | None]
"""A face's words for a setting with a value, or without one; None for a name that is no setting."""


def with_names(message: str, words: Words) -> str:
    """Put a face's own words for every setting that the message names. Anything else in backticks stays."""
    return _NAMED.sub(lambda found: words(found[1], found[2]) or found[0], message)
