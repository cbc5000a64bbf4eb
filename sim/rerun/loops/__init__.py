"""Recordings of several closed loops on the same trial."""
