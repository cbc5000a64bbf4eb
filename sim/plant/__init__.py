"""The truth: many MuJoCo simulations stepped as one."""
