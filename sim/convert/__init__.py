"""Logs of laboratories, in whatever columns, units and signs they write, as flight logs that can be replayed."""
