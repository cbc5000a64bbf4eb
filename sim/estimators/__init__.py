"""Filters as a scenario sets them up and as the loop steps them."""
