"""What a run writes beside its figures: a register of outputs, one a module."""
