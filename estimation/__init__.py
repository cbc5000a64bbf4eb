"""State estimators: frozen settings with `initial` and `step`, beliefs as tuples of arrays with any leading batch axes."""
