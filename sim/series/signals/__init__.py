"""Signals: every quantity of a recording by name, with axes, unit, frame and meaning, for whatever keeps or plots it."""
