"""Analytic models that filters and controllers believe in: rigid bodies, wheels, networks, discretisation."""
