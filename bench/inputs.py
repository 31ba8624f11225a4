"""Tells whether the leaves of plants of all kinds are found: `make bench-inputs`.

tests/support/plants_of_parts.py makes the plants, and knows which triangles are leaves. *Right*: at least 98 % of the
area of the leaves is found without a question, and others are at most 2 % of it. *Asked*: a warning or a refusal names
the doubt. Prints Markdown, and writes docs/bench/inputs.md.
"""

from __future__ import annotations

from collections import Counter

from commits import measured_commit
from plants_of_parts import KINDS, found_in
from stage import ROOT

HEAD = """# Leaves that are found

Made by `make bench-inputs` at {commit}. The script [plants_of_parts.py](../../tests/support/plants_of_parts.py) makes
the plants, and knows which triangles are leaves. *Right*: at least 98 % of their area is found without a question, and
others are at most 2 % of it. *Asked*: a warning or a refusal names the doubt; plants without leaves are refused.

"""


def main() -> None:
    found = {kind: found_in(kind) for kind in KINDS}
    counts = Counter(each.outcome for each in found.values())
    rows = ["| plant | outcome | leaves found | others over the leaves |", "| --- | --- | --- | --- |"]
    rows += [f"| {kind} | {each.outcome} | {each.leaves:.1%} | {each.others:.1%} |" for kind, each in found.items()]
    said = ", ".join(f"{name} {counts[name]}" for name in ("right", "asked", "wrong"))
    text = "\n".join([*rows, "", f"{len(found)} plants: {said}."])
    print(text)
    (ROOT / "docs" / "bench" / "inputs.md").write_text(
        f"{HEAD.format(commit=measured_commit())}{text}\n", encoding="utf-8"
    )


if __name__ == "__main__":
    main()
