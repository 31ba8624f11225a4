"""Writes dist/leafcloud.cdx.json: the bill of materials (SBOM, CycloneDX 1.6) of all that the project ships.

    .venv-supply/bin/python tools/sbom.py [--out dist/leafcloud.cdx.json]          (`make sbom`)

Components are the extension, the wheel with all crates, C++ sources and data in it, the packages for engines, and the
packages that their users install beside them. The latter have a range of versions, in a property, instead of a version.
The file is written only if it fits CycloneDX's schema.
"""

from __future__ import annotations

import argparse
import json
import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from cyclonedx.contrib.license.factories import LicenseFactory
from cyclonedx.model import HashAlgorithm, HashType, Property
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentScope, ComponentType
from cyclonedx.output.json import JsonV1Dot6
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator
from packageurl import PackageURL
from packaging.requirements import Requirement
from third_party import ROOT, alternatives, crates_in_the_wheel, facts_beside_crates

ENGINES = ROOT / "engines"
LICENSES = LicenseFactory()
# The property with the range of versions of a package that is not shipped.
VERSIONS = "leafcloud:versions"


def toml(path: Path) -> dict[str, Any]:
    return tomllib.loads(path.read_text(encoding="utf-8"))


def package_url(kind: str, name: str, version: str | None) -> PackageURL:
    """Return the package URL. A name such as @babylonjs/core has its namespace before the slash."""
    namespace, _, base = name.rpartition("/")
    return PackageURL(kind, namespace or None, base, version)


def component(
    kind: str | None, name: str, version: str | None = None, license: str | None = None, **more: Any
) -> Component:
    """Return a component; `kind` is that of its package URL, such as `cargo`."""
    return Component(
        name=name,
        version=version,
        bom_ref=f"{kind or 'part'}:{name}{f'@{version}' if version else ''}",
        purl=package_url(kind, name, version) if kind else None,
        licenses=[LICENSES.make_from_string(license)] if license else None,
        **more,
    )


def needed(kind: str, name: str, versions: str, optional: bool = False) -> Component:
    """Return a package that users install beside a shipped one."""
    scope = ComponentScope.OPTIONAL if optional else ComponentScope.REQUIRED
    return component(kind, name, scope=scope, properties=[Property(name=VERSIONS, value=versions or "*")])


def expression(license: str) -> str:
    """Return the license of a crate as an SPDX expression; some crates write a slash for OR."""
    parts = [" OR ".join(part) for part in alternatives(license)]
    return parts[0] if len(parts) == 1 else " AND ".join(f"({part})" if " OR " in part else part for part in parts)


def content_of_the_wheel() -> list[Component]:
    """Return the crates in the wheel, and the C++ sources and data that crates hold."""
    facts = facts_beside_crates()
    lock = toml(ROOT / "Cargo.lock")["package"]
    checksums = {(entry["name"], entry["version"]): entry.get("checksum") for entry in lock}
    crates = []
    for crate in crates_in_the_wheel(facts["platforms"]):
        name, version = crate["name"], crate["version"]
        hashes = [HashType(alg=HashAlgorithm.SHA_256, content=checksums[name, version])]
        crates.append(component("cargo", name, version, expression(crate["license"]), hashes=hashes))
    return crates + [component(None, part["name"], license=part["license"]) for part in facts["parts"]]


def needs_of_the_wheel(project: dict[str, Any]) -> list[Component]:
    """Return the Python packages that the wheel needs, and those that only its extras need."""
    required = [Requirement(text) for text in project["dependencies"]]
    extras = [Requirement(text) for texts in project["optional-dependencies"].values() for text in texts]
    packages = {need.name: needed("pypi", need.name, str(need.specifier), optional=True) for need in extras}
    packages |= {need.name: needed("pypi", need.name, str(need.specifier)) for need in required}
    return list(packages.values())


def npm_package(folder: Path) -> tuple[Component, list[Component]]:
    """Return a package for npm, and the packages that its users install."""
    package = json.loads((folder / "package.json").read_text(encoding="utf-8"))
    needs = {**package.get("dependencies", {}), **package.get("peerDependencies", {})}
    shipped = component("npm", package["name"], package["version"], package["license"])
    return shipped, [needed("npm", name, versions) for name, versions in needs.items()]


def bevy_crate() -> tuple[Component, list[Component]]:
    """Return the crate for Bevy, and the crates that its users build with it."""
    manifest = toml(ENGINES / "bevy" / "Cargo.toml")
    package = manifest["package"]
    shipped = component("cargo", package["name"], package["version"], package["license"])
    return shipped, [needed("cargo", name, need["version"]) for name, need in manifest["dependencies"].items()]


def shipped() -> Iterable[tuple[Component, list[Component]]]:
    """Yield all that is shipped, each with its content and its needs."""
    project = toml(ROOT / "pyproject.toml")["project"]
    version = toml(ROOT / "Cargo.toml")["workspace"]["package"]["version"]
    wheel = component("pypi", project["name"], version, project["license"])
    yield wheel, content_of_the_wheel() + needs_of_the_wheel(project)
    extension = component("generic", "leafcloud-extension", version, "GPL-3.0-or-later")
    yield extension, [wheel]
    yield npm_package(ENGINES / "three")
    yield npm_package(ENGINES / "babylon")
    yield component("generic", "leafcloud-godot", version, "MIT"), []
    yield bevy_crate()


def bill() -> Bom:
    """Return the bill of materials. Its root depends on all that is shipped."""
    version = toml(ROOT / "Cargo.toml")["workspace"]["package"]["version"]
    root = component(None, "Leafcloud", version, type=ComponentType.APPLICATION)
    bom = Bom()
    bom.metadata.component = root
    for product, content in shipped():
        bom.components.update([product, *content])
        bom.register_dependency(root, [product])
        bom.register_dependency(product, content)
    return bom


def main() -> None:
    parser = argparse.ArgumentParser(description="Write the bill of materials of all that is shipped.")
    parser.add_argument("--out", type=Path, default=ROOT / "dist" / "leafcloud.cdx.json", help="the file to write")
    out = parser.parse_args().out
    text = JsonV1Dot6(bill()).output_as_string(indent=2)
    error = JsonStrictValidator(SchemaVersion.V1_6).validate_str(text)
    if error:
        sys.exit(f"The bill of materials does not fit CycloneDX's schema: {error}")
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(f"{text}\n", encoding="utf-8")
    print(out)


if __name__ == "__main__":
    main()
