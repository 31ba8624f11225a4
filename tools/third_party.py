"""Writes THIRD_PARTY_LICENSES.txt: the licenses of all code and data of others in the wheel.

    python tools/third_party.py          writes the file (`make licenses`)
    python tools/third_party.py --check  exits with 1 if the file is not up to date

Needs cargo, which downloads the sources of crates that are missing. Cargo.lock names the crates, and the source of each
crate has its license. third_party.toml adds the C++ sources and the font that crates hold. Where a crate offers a
choice of licenses, the first in the list of deny.toml is used.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import textwrap
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
OUTPUT = ROOT / "THIRD_PARTY_LICENSES.txt"
FACTS = Path(__file__).with_suffix(".toml")
WHEEL = "leafcloud-python"

HEAD = """\
The Python wheel of Leafcloud holds compiled code and data of these projects. So does the Blender extension, which holds
the wheel. Each line has a project, its version, and the license under which Leafcloud uses it. The texts of the
licenses follow, each with the names of its projects. `make licenses` writes this file.
"""

# Words of each license. The two BSD licenses share theirs; no crate leaves the choice between both.
WORDS = {
    "MIT": "permission is hereby granted, free of charge",
    "Apache-2.0": "terms and conditions for use, reproduction, and distribution",
    "BSD-2-Clause": "redistribution and use in source and binary forms",
    "BSD-3-Clause": "redistribution and use in source and binary forms",
    "Unicode-3.0": "unicode license v3",
}


@dataclass(frozen=True)
class Entry:
    """A project in the wheel: its name with the version, the license's name, and the license's text."""

    name: str
    license: str
    text: str


def cargo(*arguments: str) -> str:
    """Run cargo on the project's lock file; return its output."""
    command = ["cargo", *arguments, "--locked"]
    return subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout


def names_in_the_wheel(platforms: list[str]) -> set[tuple[str, str]]:
    """Return names and versions of the crates of others that are compiled into the wheel on any platform."""
    targets = [argument for platform in platforms for argument in ("--target", platform)]
    options = ["--package", WHEEL, "--features", "extension-module", "--edges", "normal"]
    tree = cargo("tree", *options, *targets, "--prefix", "none", "--format", "{p}")
    # A crate of the project has its folder behind the version.
    lines = {line.removesuffix(" (*)").removesuffix(" (proc-macro)") for line in tree.splitlines()}
    found = re.findall(r"^(\S+) v(\S+)$", "\n".join(lines), re.MULTILINE)
    return set(found)


def crates_in_the_wheel(platforms: list[str]) -> list[dict[str, Any]]:
    """Return cargo's metadata of the crates of others in the wheel, sorted by name and version."""
    names = names_in_the_wheel(platforms)
    metadata = json.loads(cargo("metadata", "--format-version", "1", "--filter-platform", platforms[0]))
    crates = [crate for crate in metadata["packages"] if (crate["name"], crate["version"]) in names]
    missing = names - {(crate["name"], crate["version"]) for crate in crates}
    if missing:
        sys.exit(f"{sorted(missing)}: only other platforms than {platforms[0]} have these crates.")
    return sorted(crates, key=lambda crate: (crate["name"], crate["version"]))


def facts_beside_crates() -> dict[str, Any]:
    """Return the content of third_party.toml."""
    return tomllib.loads(FACTS.read_text(encoding="utf-8"))


def alternatives(expression: str) -> list[list[str]]:
    """Return the parts of an SPDX expression that all apply, each as the licenses between which one may choose."""
    parts = re.sub(r"\s*/\s*", " OR ", expression).split(" AND ")
    return [part.strip("()").split(" OR ") for part in parts]


def plain(text: str) -> str:
    """Return the text in lower case with single spaces, for comparisons."""
    return " ".join(text.lower().split())


def texts_in(folder: Path) -> list[str]:
    """Return the texts of the license files of a crate, in the order of their names."""
    names = sorted(path for path in folder.iterdir() if re.match("(un)?licen[sc]e|copying", path.name.lower()))
    return [path.read_text(encoding="utf-8") for path in names if path.is_file()]


def chosen_text(crate: dict[str, Any], choices: list[str], copyrights: dict[str, str]) -> tuple[str, str]:
    """Return the license under which a crate is used, and its text. Exit with a message if the crate has none."""
    texts = texts_in(Path(crate["manifest_path"]).parent)
    for choice in choices:
        for text in texts:
            if choice in WORDS and WORDS[choice] in plain(text):
                return choice, text
    if "Apache-2.0" in choices:
        # The same text for all, without the names of authors.
        return "Apache-2.0", (ROOT / "LICENSE-APACHE").read_text(encoding="utf-8")
    name = crate["name"]
    if "MIT" in choices and name in copyrights:
        mit = (ROOT / "LICENSE-MIT").read_text(encoding="utf-8")
        return "MIT", re.sub("^Copyright .*$", copyrights[name], mit, flags=re.MULTILINE)
    sys.exit(f"{name} {crate['version']} has no text of {' or '.join(choices)}: add its copyright to {FACTS.name}.")


def allowed(rules: dict[str, Any], crate: str) -> list[str]:
    """Return the licenses that deny.toml allows a crate, the preferred first."""
    exceptions = [rule for rule in rules["licenses"]["exceptions"] if rule["crate"] == crate]
    return [*rules["licenses"]["allow"], *(name for rule in exceptions for name in rule["allow"])]


def entries_of(crate: dict[str, Any], rules: dict[str, Any], facts: dict[str, Any]) -> list[Entry]:
    """Return an entry for each license that applies to a crate. Exit with a message if deny.toml allows none."""
    name = crate["name"]
    expression = crate["license"] or "no license"
    entries = []
    for part in alternatives(expression):
        choices = [license for license in allowed(rules, name) if license in part]
        if not choices:
            sys.exit(f"{name} {crate['version']} is under {expression}, which deny.toml does not allow.")
        license, text = chosen_text(crate, choices, facts["copyrights"])
        entries.append(Entry(f"{name} {crate['version']}", license, text))
    return entries


def excerpt(text: str, first: str, last: str) -> str:
    """Return the lines of a comment from the one that holds `first` to the next that holds `last`, as plain text."""
    lines = text.splitlines()
    start = next(i for i, line in enumerate(lines) if first in line)
    end = next(i for i in range(start, len(lines)) if last in lines[i])
    bare = [re.sub(r"^\s*(//|\*(?=\s|$)) ?", "", line) for line in lines[start : end + 1]]
    return textwrap.dedent("\n".join(bare))


def entry_of_part(part: dict[str, str], crates: list[dict[str, Any]]) -> Entry:
    """Return the entry of C++ sources or data inside a crate."""
    if "crate" not in part:
        return Entry(part["name"], part["license"], part["note"])
    folder = next(Path(crate["manifest_path"]).parent for crate in crates if crate["name"] == part["crate"])
    text = (folder / part["file"]).read_text(encoding="utf-8-sig")
    if "first" in part:
        try:
            text = excerpt(text, part["first"], part["last"])
        except StopIteration:
            sys.exit(f"{part['crate']}/{part['file']} has no license from “{part['first']}” on: change {FACTS.name}.")
    return Entry(part["name"], part["license"], text)


def bundled() -> list[Entry]:
    """Return entries for all that the wheel holds beside the project's own code."""
    facts = facts_beside_crates()
    rules = tomllib.loads((ROOT / "deny.toml").read_text(encoding="utf-8"))
    crates = crates_in_the_wheel(facts["platforms"])
    entries = [entry for crate in crates for entry in entries_of(crate, rules, facts)]
    return entries + [entry_of_part(part, crates) for part in facts["parts"]]


def document(entries: list[Entry]) -> str:
    """Return the text of the file: a list of all entries, then each license once with the names of its projects."""
    groups: dict[str, list[Entry]] = {}
    for entry in entries:
        groups.setdefault(plain(entry.text), []).append(entry)
    listed = "".join(f"- {entry.name}: {entry.license}\n" for entry in entries)
    texts = []
    for group in groups.values():
        names = ", ".join(entry.name for entry in group)
        heading = "\n".join(textwrap.wrap(f"{group[0].license}: {names}", 110, break_on_hyphens=False))
        lines = group[0].text.strip("\r\n").splitlines()
        texts.append("\n".join(["=" * 110, heading, "=" * 110, "", *(line.rstrip() for line in lines), ""]))
    return f"{HEAD}\n{listed}\n" + "\n".join(texts)


def main() -> None:
    parser = argparse.ArgumentParser(description=f"Write {OUTPUT.name}.")
    parser.add_argument("--check", action="store_true", help="write nothing; exit with 1 if the file is not up to date")
    arguments = parser.parse_args()
    text = document(bundled())
    if not arguments.check:
        OUTPUT.write_text(text, encoding="utf-8")
    elif not OUTPUT.exists() or OUTPUT.read_text(encoding="utf-8") != text:
        sys.exit(f"{OUTPUT.name} is not up to date: run make licenses.")


if __name__ == "__main__":
    main()
