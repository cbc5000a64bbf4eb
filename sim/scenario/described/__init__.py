"""Scenario files described for people and editors: every key with unit, default and meaning."""
