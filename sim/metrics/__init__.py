"""Figures of merit of runs, and the files that hold them."""
