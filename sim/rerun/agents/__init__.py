"""Recordings of several agents."""
