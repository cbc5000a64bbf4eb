"""Filters and control laws from a user's own files."""
