"""The register of plants: what an entry says, and the entries."""
