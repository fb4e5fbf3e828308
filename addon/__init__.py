"""Strata's core and its faces; see docs/architecture.md for the ranks."""
