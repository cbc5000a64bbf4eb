"""The plants as MJCF, their published parameters, attitude mathematics and the analytic models that filters and controllers believe in."""
