"""Analytic models held against the plant."""
