"""Control laws: frozen settings, torque on the body from estimates and reference; allocation to wheels is a step of its own."""
