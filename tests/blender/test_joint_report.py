"""The report of several trees has their warnings, and those of the file."""

from __future__ import annotations

from typing import Any

from addon.export.report import joint_report


def warnings_for(engine: str) -> list[str]:
    report: dict[str, Any] = {"leafcloud": "0", "blender": "4", "files": [], "warnings": ["small"]}
    found: list[str] = joint_report({"oak": dict(report), "elm": dict(report)}, engine)["warnings"]
    return found


def test_warnings_name_their_tree() -> None:
    assert warnings_for("three") == ["oak: small", "elm: small"]


def test_an_engine_that_reads_one_tree_a_file_has_a_warning() -> None:
    first, *others = warnings_for("unity")
    assert "Unity" in first
    assert others == ["oak: small", "elm: small"]
