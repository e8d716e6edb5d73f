"""The corpus doctor: what footage or a database is worth, and what to record next."""
