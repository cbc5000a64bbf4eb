"""Signals of a run in the formats of other tools: a register of formats, one a module."""
