"""Strata's version, as pyproject.toml and blender_manifest.toml have it (tests/measure/test_report.py)."""

VERSION = "0.1.0"
