"""Thousands of dispersed trials: drawn, flown in blocks, stored and summed up."""
