"""Attitude mathematics: quaternions, modified Rodrigues parameters, Euler angles."""
