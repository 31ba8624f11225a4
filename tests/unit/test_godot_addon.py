"""The add-on for Godot: its copies of the laws, of the licence and of the version are those of the project."""

from __future__ import annotations

import configparser
import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ADDON = ROOT / "engines" / "godot" / "addons" / "leafcloud"


def test_its_laws_are_those_of_all_engines() -> None:
    laws = (ROOT / "shaders" / "leafcloud.glsl").read_text()
    assert (ADDON / "leafcloud.gdshaderinc").read_text() == laws, "copy shaders/leafcloud.glsl to leafcloud.gdshaderinc"


def test_it_has_the_version_of_the_project_and_a_licence() -> None:
    plugin = configparser.ConfigParser()
    plugin.read(ADDON / "plugin.cfg")
    version = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["version"]
    assert plugin["plugin"]["version"].strip('"') == version
    assert (ADDON / "LICENSE").read_text() == (ROOT / "LICENSE-MIT").read_text()


def test_the_importer_sets_only_uniforms_of_the_shader() -> None:
    """Godot ignores other names without a message."""
    shader = (ADDON / "level.gdshaderinc").read_text()
    uniforms = set(re.findall(r"^uniform \w+ (\w+)", shader, re.MULTILINE))
    source = (ADDON / "gltf_levels.gd").read_text()
    given = set(re.findall(r'^\t+"(\w+)":', source, re.MULTILINE)) | set(re.findall(r'\{"(\w+)": ', source))
    assert given
    assert given <= uniforms
    wind = {name for name in uniforms if name.startswith("wind_")}
    assert uniforms - given - wind == set(), "uniforms that nobody sets"


def test_no_uniform_shares_its_name_with_a_variable_of_the_laws() -> None:
    """Godot 4.6 replaces such a variable by the uniform in Forward+ and Mobile, and the shader does not compile."""
    uniforms = set(re.findall(r"^uniform \w+ (\w+)", (ADDON / "level.gdshaderinc").read_text(), re.MULTILINE))
    code = re.sub(r"//.*", "", (ADDON / "leafcloud.gdshaderinc").read_text())
    variables = set(re.findall(r"\b(?:bool|int|float|vec[234]|mat[34]|LcWind) (\w+)\b(?!\()", code))
    assert {"transition", "growth", "shares", "centre"} <= variables
    assert uniforms & variables == set()


def test_every_number_of_the_wind_is_a_uniform() -> None:
    shader = (ADDON / "level.gdshaderinc").read_text()
    uniforms = set(re.findall(r"^uniform \w+ wind_(\w+)", shader, re.MULTILINE))
    # The extras of a level's node (docs/files.md, "Wind").
    names = {
        "direction",
        "strength",
        "gusts",
        "period",
        "foot",
        "up",
        "height",
        "spread",
        "sway",
        "branches",
        "flutter",
    }
    assert uniforms == names
