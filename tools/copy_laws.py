"""Copies laws and licenses into the packages for engines: an add-on or package is installed without this repository.

`python tools/copy_laws.py` writes the copies. tests/unit compare them.
"""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SHADERS = ROOT / "shaders"
ENGINES = ROOT / "engines"


def copies() -> dict[Path, str]:
    """Return the content of each copy by its path."""
    names = ("leafcloud", "octahedral", "shares")
    laws, octahedral, shares = ((SHADERS / f"{name}.glsl").read_text(encoding="utf-8") for name in names)
    module = _module({"LAWS": laws, "OCTAHEDRAL": octahedral, "SHARES": shares})
    licenses = {name: (ROOT / name).read_text(encoding="utf-8") for name in ("LICENSE-MIT", "LICENSE-APACHE")}
    return {
        **{ENGINES / engine / name: licenses[name] for engine in ("three", "babylon", "bevy") for name in licenses},
        ENGINES / "godot" / "addons" / "leafcloud" / "LICENSE": licenses["LICENSE-MIT"],
        ENGINES / "godot" / "addons" / "leafcloud" / "leafcloud.gdshaderinc": laws,
        ENGINES / "godot" / "addons" / "leafcloud" / "shares.gdshaderinc": shares,
        ENGINES / "three" / "src" / "glsl.js": module,
        ENGINES / "babylon" / "src" / "glsl.js": module,
        **{
            ENGINES / "babylon" / "src" / name: (ENGINES / "three" / "src" / name).read_text(encoding="utf-8")
            for name in ("laws.js", "mips.js")
        },
    }


def _module(sources: dict[str, str]) -> str:
    """Return a JavaScript module that exports the sources as strings."""
    head = "// Copies of the laws in shaders/, made by tools/copy_laws.py.\n"
    return head + "".join(f"\nexport const {name} = `{_escaped(text)}`;\n" for name, text in sources.items())


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace("`", "\\`").replace("${", "\\${")


if __name__ == "__main__":
    for path, content in copies().items():
        path.write_text(content, encoding="utf-8")
