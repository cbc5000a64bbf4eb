"""Scenario files: their models, what comes with the twin, and what is wrong with a user's."""
