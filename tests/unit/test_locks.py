"""The locks of the Python tools: complete, hashed, in agreement with each other, and enforced by pip."""

from __future__ import annotations

import base64
import hashlib
import os
import re
import subprocess
import sys
import zipfile
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).resolve().parents[2]
REQUIREMENTS = ROOT / "tools" / "requirements"
LOCKS = sorted(REQUIREMENTS.glob("*.txt"))


def locked(lock: Path) -> dict[str, tuple[Requirement, list[str]]]:
    """Return the packages of a lock by name, each with its hashes."""
    lines = lock.read_text().replace("\\\n", " ").splitlines()
    entries = [line for line in lines if line and not line.startswith(("#", "--"))]
    packages = {}
    for entry in entries:
        requirement = Requirement(entry.partition(" --hash")[0])
        packages[canonicalize_name(requirement.name)] = requirement, re.findall(r"--hash=(\S+)", entry)
    return packages


def wanted(source: Path) -> list[Requirement]:
    """Return the requirements of an .in file."""
    lines = source.read_text().splitlines()
    return [Requirement(line) for line in lines if line and not line.startswith(("#", "--"))]


def version(requirement: Requirement) -> str:
    (specifier,) = requirement.specifier
    assert specifier.operator == "=="
    return specifier.version


def test_each_list_of_packages_has_a_lock() -> None:
    assert LOCKS
    assert [lock.stem for lock in LOCKS] == sorted(path.stem for path in REQUIREMENTS.glob("*.in"))


@pytest.mark.parametrize("lock", LOCKS, ids=lambda lock: lock.stem)
def test_lock_pins_all_that_is_wanted_with_hashes(lock: Path) -> None:
    packages = locked(lock)
    for requirement in wanted(lock.with_suffix(".in")):
        pin, _ = packages[canonicalize_name(requirement.name)]
        assert requirement.specifier.contains(version(pin), prereleases=True), f"{requirement}: run make locks"
    for pin, hashes in packages.values():
        assert Version(version(pin))
        assert hashes, f"{pin} has no hash"
        assert all(re.fullmatch("sha256:[0-9a-f]{64}", text) for text in hashes)
    assert "://" not in lock.read_text(), "a lock names no package index"


@pytest.mark.parametrize("lock", LOCKS, ids=lambda lock: lock.stem)
def test_lock_has_what_its_packages_need(lock: Path) -> None:
    """The metadata of the packages in this environment tells their needs. Other packages are skipped."""
    packages = locked(lock)
    for name, (pin, _) in packages.items():
        try:
            installed = distribution(name)
        except PackageNotFoundError:
            continue
        if installed.version != version(pin):
            continue
        for need in map(Requirement, installed.requires or []):
            if need.marker is None or need.marker.evaluate({"extra": ""}):
                assert canonicalize_name(need.name) in packages, f"{name} needs {need}: run make locks"


def test_packages_of_this_environment_are_compared() -> None:
    """The test above would pass in an empty environment."""
    names = {name for lock in LOCKS for name in locked(lock)}
    assert len([name for name in names if _is_installed(name)]) >= 30


def _is_installed(name: str) -> bool:
    try:
        distribution(name)
    except PackageNotFoundError:
        return False
    return True


def test_all_locks_have_one_version_of_each_package() -> None:
    """Make installs several locks into one environment. Each Blender has its own bpy and numpy."""
    versions: dict[str, set[str]] = {}
    for lock in LOCKS:
        for name, (pin, _) in locked(lock).items():
            versions.setdefault(name, set()).add(version(pin))
    several = {name for name, found in versions.items() if len(found) > 1}
    assert several <= {"bpy", "numpy"}
    assert version(locked(REQUIREMENTS / "fidelity.txt")["numpy"][0]) == version(
        locked(REQUIREMENTS / "blender-4.5.txt")["numpy"][0]
    )


def tiny_wheel(folder: Path) -> Path:
    """Write the wheel of an empty package."""
    files = {
        "tiny.py": b"",
        "tiny-1.0.dist-info/METADATA": b"Metadata-Version: 2.1\nName: tiny\nVersion: 1.0\n",
        "tiny-1.0.dist-info/WHEEL": b"Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    digests = {
        name: base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
        for name, data in files.items()
    }
    record = "".join(f"{name},sha256={digests[name]},{len(data)}\n" for name, data in files.items())
    wheel = folder / "tiny-1.0-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
        archive.writestr("tiny-1.0.dist-info/RECORD", f"{record}tiny-1.0.dist-info/RECORD,,\n")
    return wheel


def install(folder: Path, line: str) -> subprocess.CompletedProcess[str]:
    """Install one line of a lock by tools/environment.sh from the wheels in `folder`, without a network."""
    lock = folder / "lock.txt"
    lock.write_text(f"{line}\n")
    offline = {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(folder), "PYTHON": sys.executable}
    return subprocess.run(
        [ROOT / "tools" / "environment.sh", folder / "environment", lock],
        env={**os.environ, **offline},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def test_environment_refuses_files_that_the_lock_does_not_know(tmp_path: Path) -> None:
    digest = hashlib.sha256(tiny_wheel(tmp_path).read_bytes()).hexdigest()
    refused = install(tmp_path, f"tiny==1.0 --hash=sha256:{'0' * 64}")
    assert refused.returncode != 0
    assert "DO NOT MATCH THE HASHES" in refused.stderr
    unhashed = install(tmp_path, "tiny==1.0")
    assert unhashed.returncode != 0
    assert "Hashes are required" in unhashed.stderr
    installed = install(tmp_path, f"tiny==1.0 --hash=sha256:{digest}")
    assert installed.returncode == 0, installed.stderr
    assert list((tmp_path / "environment").rglob("tiny-1.0.dist-info"))
